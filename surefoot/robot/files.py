"""Schema of the file `robot.toml`: its tables with their fields, units and allowed values."""

import math
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, ConfigDict, Field, model_validator

from surefoot.tables import (
    UNIT_SLACK,
    FileModel,
    Name,
    NotNegative,
    Number,
    Positive,
    Text,
    Vector,
    Whole,
    as_table,
    refused,
    unknown_key,
)


def _unit(values: list[float]) -> list[float]:
    length = math.sqrt(math.fsum(x * x for x in values))
    if abs(length - 1.0) > UNIT_SLACK:
        raise refused("value", f"got {values} of length {length:.6g}, expected length 1")
    return values


def _sizes(values: list[float]) -> list[float]:
    if min(values) <= 0:
        raise refused("value", f"got {values}, every size must be above 0")
    return values


def _some(values: list[list[float]]) -> list[list[float]]:
    if not values:
        raise refused("value", "is empty: a foot needs at least one sphere")
    return values


Axis = Annotated[Vector, AfterValidator(_unit)]
Quaternion = Annotated[list[Number], Field(min_length=4, max_length=4), AfterValidator(_unit)]
Sizes = Annotated[Vector, AfterValidator(_sizes)]
SmallAngle = Annotated[Number, Field(ge=0, le=5)]


class Sourced(FileModel):
    """Base of tables of a robot description that name the source of their numbers."""

    source: Text = Field(description="key of [sources]")


class SphereTable(FileModel):
    """A sphere on the underside of the trunk, for contact with the ground when the robot lies."""

    position: Vector = Field(description="m, base_link")
    radius: Positive = Field(description="m")


class TrunkTable(Sourced):
    """Mass, inertia, size and contact spheres of the trunk, whose frame is base_link."""

    mass: Positive = Field(description="kg")
    com: Vector = Field(description="m, centre of mass")
    box: Sizes = Field(description="m, full size, centred in base_link")
    inertia_box: Sizes | None = Field(None, description="m, box of the same inertia about the centre of mass [box]")
    inertia_quat_wxyz: Quaternion = Field([1.0, 0.0, 0.0, 0.0], description="axes of that box, rot_base_from_principal")
    belly: list[SphereTable] = Field(min_length=1, description="where the trunk touches the ground in a fall")


class ServoTable(Sourced):
    """Parameters of a type of position servo: torque = kp (command - q) - kv dq/dt, clipped."""

    kp: Positive = Field(description="Nm/rad")
    kv: NotNegative = Field(description="Nm s/rad")
    max_torque: Positive = Field(description="Nm")
    armature: NotNegative = Field(description="kg m2, inertia of the rotor seen at the joint")
    frictionloss: NotNegative = Field(description="Nm")
    resolution_deg: SmallAngle = Field(0.0, description="deg, step of the set-point")
    backlash_deg: SmallAngle = Field(0.0, description="deg, free play of the shaft, end to end")
    latency_ms: Number = Field(0.0, ge=0, le=100, description="ms between a set-point's arrival and its effect")


class LinkTable(FileModel):
    """A rigid body of a chain; if it has an axis, a joint connects it to its parent, else it is fixed."""

    name: Name
    position: Vector = Field(description="m, frame in the parent's frame")
    quat_wxyz: Quaternion = Field([1.0, 0.0, 0.0, 0.0], description="rot_parent_from_link at joint angle zero")
    parent: Text | None = Field(None, description="link of the same chain [the one before]")
    axis: Axis | None = Field(None, description="joint axis in the link's frame")
    mirrored: Literal["no", "axis", "limits"] | None = Field(None, description="effect of `mirror` on the joint")
    lower_deg: Number | None = Field(None, ge=-360, description="deg")
    upper_deg: Number | None = Field(None, le=360, description="deg")
    neutral_deg: Number | None = Field(None, description="deg, angle in the neutral stance")
    servo: Text | None = Field(None, description="key of [servos]")
    mass: Positive = Field(description="kg")
    com: Vector = Field(description="m, centre of mass in the link's frame")
    inertia_box: Sizes = Field(description="m, box of the same inertia about the centre of mass")
    inertia_quat_wxyz: Quaternion = Field([1.0, 0.0, 0.0, 0.0], description="axes of that box, rot_link_from_principal")

    @model_validator(mode="before")
    @classmethod
    def _joint(cls, table: Any) -> Any:
        needed = ("lower_deg", "upper_deg", "neutral_deg", "servo")
        return _go_with(cls, table, "axis" in as_table(table), needed, (*needed, "mirrored"))

    @model_validator(mode="after")
    def _limits(self) -> Self:
        if self.lower_deg is None or self.upper_deg is None or self.neutral_deg is None:
            return self
        if not self.lower_deg < self.upper_deg:
            text = f"got {self.upper_deg}, must be above lower_deg = {self.lower_deg}"
            raise refused("value", text, "upper_deg")
        if not self.lower_deg <= self.neutral_deg <= self.upper_deg:
            text = f"got {self.neutral_deg}, must be in [{self.lower_deg}, {self.upper_deg}]"
            raise refused("value", text, "neutral_deg")
        return self


class FootTable(Sourced):
    """Contact end of a leg: a centre and spheres of one radius."""

    link: Text = Field(description="link of the chain that carries the foot")
    position: Vector = Field(description="m, centre in that link")
    points: Annotated[list[Vector], AfterValidator(_some)] | None = Field(
        None, description="m, centres of the spheres in that link [the foot's centre]"
    )
    radius: Positive = Field(description="m, of the spheres")


class ChainTable(Sourced):
    """Links of a limb, from the trunk outwards; a limb whose chain has a foot is a leg."""

    links: list[LinkTable] = Field(min_length=1)
    foot: FootTable | None = None


class LimbTable(Sourced):
    """A limb of a robot: the name of its chain, and the pose at which it is mounted on the trunk."""

    name: Name
    chain: Text = Field(description="key of [chains]")
    mirror: bool = Field(False, description="the chain is reflected at the plane y = 0")
    position: Vector = Field(description="m, base_link")
    yaw_deg: Number = Field(0.0, description="deg, heading about z")
    shared: dict[str, Text] = Field({}, description="by link, the joint whose motor moves it too")


class ImuTable(Sourced):
    """Name of the noise profile of the inertial unit, and its pose in the trunk."""

    profile: Text = Field(description="file in robots/sensors")
    position: Vector = Field(description="m, base_link")
    quat_wxyz: Quaternion = Field(description="rot_base_from_imu")


class ContactTable(Sourced):
    """Foot sensors of the robot: switches with hysteresis, or force sensors with a range."""

    kind: Literal["switch", "force"]
    switches: Annotated[Whole, Field(ge=1, le=4)] = Field(description="per foot")
    on_n: Positive = Field(description="N, touch begins at this normal force")
    off_n: NotNegative = Field(description="N, touch ends below it")
    min_n: NotNegative | None = Field(None, description="N, smallest force that a force sensor reports")
    max_n: Number | None = Field(None, description="N, saturation of a force sensor")

    @model_validator(mode="before")
    @classmethod
    def _kind(cls, table: Any) -> Any:
        kind, only = as_table(table).get("kind"), ("min_n", "max_n")
        return _go_with(cls, table, kind == "force", only, only if kind == "switch" else ())

    @model_validator(mode="after")
    def _range(self) -> Self:
        if self.off_n > self.on_n:
            raise refused("value", f"got {self.off_n}, must be in [0, {self.on_n}]", "off_n")
        if self.min_n is not None and self.max_n is not None and self.max_n <= self.min_n:
            raise refused("value", f"got {self.max_n}, must be above min_n = {self.min_n}", "max_n")
        return self


class EncoderTable(Sourced):
    """Resolution and zero error of the joint encoders."""

    resolution_deg: NotNegative = Field(description="deg, 0 = exact")
    zero_sigma_deg: NotNegative = Field(description="deg, standard deviation of the zero error")


class CurrentTable(Sourced):
    """Torque per ampere and noise of the servos' current sensors."""

    torque_per_ampere: Positive = Field(description="Nm/A")
    noise_ampere: NotNegative = Field(description="A, standard deviation")


class GaitTable(Sourced):
    """Gait parameters of the robot: numbers by name; any names are allowed."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Number] = Field(init=False)  # pyright: ignore[reportIncompatibleVariableOverride]


class RobotFile(FileModel):
    """Content of a robot description, the file `robots/<name>/robot.toml`."""

    format: Literal["surefoot.robot.description/1"] = Field(alias="schema")
    name: Name
    kind: Literal["hexapod", "quadruped", "biped"]
    description: Text
    sources: dict[str, Text] = Field(description="where the numbers come from, by key")
    trunk: TrunkTable
    servos: dict[str, ServoTable]
    chains: dict[str, ChainTable]
    limbs: list[LimbTable] = Field(min_length=1)
    imu: ImuTable
    contacts: ContactTable
    encoders: EncoderTable
    current: CurrentTable
    gait: GaitTable
    camera: Name | None = Field(None, description="file in robots/cameras")
    ranger: Name | None = Field(None, description="file in robots/rangers")
    other_names: dict[str, Text] = Field({}, description="names that other software gives joints, by name here")


def _go_with(model: type[FileModel], table: Any, goes: bool, needed: tuple[str, ...], only: tuple[str, ...]) -> Any:
    """Refuse a table that lacks a key of `needed` if `goes` is True, or has a key of `only` if `goes` is False."""
    for key in needed if goes else ():
        if key not in table:
            raise refused("missing", "is missing", key)
    known = [name for name in model.model_fields if name not in only]
    if not goes and any(key in as_table(table) for key in only):
        key = next(key for key in as_table(table) if key not in known)
        raise refused("unknown_key", unknown_key(key, known), key)
    return table
