"""The simulator's own topics and queries: truth, reset, step, push, faults. Simulation only."""

from typing import Annotated, Any, ClassVar, Literal, get_args

from pydantic import Field, SerializerFunctionWrapHandler, ValidationInfo, field_validator, model_serializer

from .base import MAX_FEET, Message, PerFoot, PerJoint, QuatWxyz, Reply, Request, Vec2, Vec3, belonging

FaultKind = Literal[
    "imu_drop", "imu_freeze", "imu_bias", "imu_saturate", "joints_drop", "joints_freeze", "encoder_stuck",
    "contacts_drop", "foot_stuck_on", "foot_stuck_off", "servo_dead", "servo_weak", "packet_delay", "packet_loss",
    "packet_reorder", "landmarks_false", "landmarks_drop", "camera_dark", "camera_freeze", "camera_bright",
    "camera_repeat", "camera_flip", "camera_cover", "camera_late", "camera_zoom", "range_drop", "range_stuck",
    "sensor_off", "sensor_stuck", "sensor_garbage", "sensor_wrong", "sensor_slow", "sensor_delayed",
    "sensor_intermittent",
]  # fmt: skip
SIZED_FAULTS = (
    "imu_bias", "imu_saturate", "servo_weak", "packet_delay", "packet_loss", "packet_reorder", "landmarks_false",
    "landmarks_drop", "camera_late", "camera_zoom", "sensor_wrong", "sensor_slow", "sensor_delayed",
    "sensor_intermittent",
)  # fmt: skip
MAX_OBSTACLES = 64
Length = Annotated[float, Field(gt=0, le=10)]
FAULT_FIELDS = {kind: ("value",) if kind in SIZED_FAULTS else () for kind in get_args(FaultKind)}


def _empty(values: tuple[float, ...]) -> bool:
    return not values


def _none(value: bool | None) -> bool:
    return value is None


class Truth(Message):
    """Exact state of the simulation. Never read by a function service (a test proves it)."""

    schema_version: ClassVar[str] = "1.2"
    position: Vec3 = Field(description="m, base_link origin in world")
    quat_wxyz: QuatWxyz
    velocity: Vec3 = Field(description="m/s, base_link origin, world axes")
    angular_velocity: Vec3 = Field(description="rad/s, base_link axes")
    com: Vec3 = Field(description="m, centre of mass of the robot in world")
    joints: PerJoint = Field(description="rad, true joint angles")
    foot_position: Annotated[tuple[Vec3, ...], Field(max_length=MAX_FEET)] = Field(
        description="m, foot centres in world"
    )
    foot_force_n: PerFoot = Field(description="N, total normal contact force per foot")
    foot_displacement: PerFoot = Field(
        description="m, horizontal way of each foot centre since its touch-down (Walas & Belter's d); 0 in swing"
    )
    contact_sliding: PerFoot = Field(
        description="m, way slid by the contact point in the present stance, gate 0.5 N; 0 in swing"
    )
    stance_sliding: PerFoot = Field(description="m, sliding of the last finished stance of each foot")
    stances: tuple[int, ...] = Field(default=(), description="finished stances per foot since the epoch began")
    foot_twist: PerFoot = Field(
        default=(), exclude_if=_empty, description="rad, turn of each sole since its touch-down; none for point feet"
    )
    stance_twist: PerFoot = Field(
        default=(), exclude_if=_empty, description="rad, turn of each sole in its last finished stance; none likewise"
    )
    tilt: float = Field(ge=0, description="rad, angle between the trunk's z axis and the vertical")
    fallen: bool = Field(description="tilt over 45 deg or trunk contact, now or earlier in this epoch")
    touching: bool | None = Field(
        default=None,
        exclude_if=_none,
        description="a foot or the trunk presses an obstacle's side; null = the world has none",
    )


class Obstacle(Request):
    """Upright box on the floor that no map shows: a robot senses it by its ranger and bumpers only."""

    centre: Vec2 = Field(description="x, y at first, frame map, m")
    half: Annotated[tuple[Length, Length], Field(description="half extents along x and y, m")] = (0.15, 0.15)
    height: float = Field(default=0.6, gt=0, le=3, description="m")
    to: Vec2 | None = Field(default=None, description="x, y of where it goes, once, m; null = it stands")
    speed: float = Field(default=0.3, gt=0, le=3, description="m/s")
    gives_way: float = Field(
        default=0.5, ge=0, le=10, description="m, it halts while the robot is nearer than this and ahead of it"
    )
    from_s: float = Field(
        default=0.0,
        ge=0,
        description="s, simulated time at which it comes, and sets out; one with `to` waits while the robot is nearer "
        "than `gives_way`",
    )
    until_s: float | None = Field(default=None, gt=0, description="s, simulated time at which it is gone; null = never")


class World(Request):
    """World that the simulator builds: ground, friction, sensors, landmarks."""

    terrain: str = Field(default="flat", max_length=64, description="kind of terrain, or path of a terrain file")
    amplitude: float | None = Field(
        default=None, ge=0, le=1, description="m, height of the terrain; null = the kind's own"
    )
    terrain_seed: int | None = Field(default=None, ge=0, description="seed of the terrain; null = the scenario's seed")
    map_profile: Literal["exact", "noise", "shifted", "none"] = Field(
        default="noise", description="how good the robot's map is; none: it gets no map"
    )
    friction: float | None = Field(
        default=None, gt=0, le=10, description="friction coefficient of the ground; null = that of the simulator, 0.7"
    )
    imu_profile: str | None = Field(default=None, max_length=64, description="sensor profile; null = the robot's own")
    torque_per_ampere: float | None = Field(
        default=None, gt=0, le=100, description="Nm/A, true constant of the servo motors; null = as described"
    )
    goal: Vec2 | None = Field(default=None, description="m, marker of the goal on the floor; null = none")
    landmarks: float = Field(default=60.0, ge=0, le=400, description="1/m2, landmarks on the floor for a camera")
    perturbation: float = Field(default=0.0, ge=0, le=10, description="level of model perturbation, 0 = nominal")
    start: Vec3 | None = Field(default=None, description="x, y in m and yaw in rad at the start; null = 0, 0, 0")
    drift: float = Field(default=0.0, ge=-0.8, le=0.8, description="rad per m, turn of a walk by unequal legs")
    camera: str | None = Field(default=None, max_length=64, description="camera profile; null = the robot's own")
    depth_camera: str | None = Field(default=None, max_length=64, description="depth camera's profile; null = none")
    copied_landmarks: float = Field(default=0.0, ge=0, le=1, description="share of landmarks whose look is another's")
    copies: int = Field(default=10, ge=2, le=1000, description="landmarks that share one such look")
    texture: str | None = Field(
        default=None,
        max_length=256,
        description="what the camera's images show of the floor: random, carpet, tiles, parquet, laminate (boards that "
        "repeat) or the path of a picture; null = the camera gives landmarks, no images",
    )
    texture_width: float = Field(default=2.0, ge=0.05, le=100, description="m, width of such a picture on the floor")
    texture_seed: int | None = Field(default=None, ge=0, description="seed of the texture; null = the scenario's seed")
    light: float = Field(default=1.0, ge=0, le=10, description="brightness of the floor in images, 1 = as usual")
    image_format: Literal["gray8", "jpeg"] = Field(default="gray8", description="format of the images")
    obstacles: Annotated[tuple[Obstacle, ...], Field(max_length=MAX_OBSTACLES)] = Field(
        default=(), description="boxes on the floor that no map shows, standing or crossing"
    )


class ResetRequest(Request):
    """Rebuilds the simulated world and raises the epoch; the run begins when every expected service is ready."""

    schema_version: ClassVar[str] = "1.7"
    seed: int = Field(default=0, ge=0, lt=2**31, description="seed of everything random in the run")
    world: World = Field(default_factory=World, description="which world")
    expect: tuple[str, ...] = Field(default=(), description="services that must be ready before tick 0")
    mode: Literal["lockstep", "paced"] = Field(
        default="lockstep", description="lockstep waits for the roster, paced does not"
    )
    rtf: float = Field(default=0.0, ge=0, le=1000, description="real-time factor of paced mode, 0 = as fast as it goes")
    actuation_delay_ticks: int = Field(default=1, ge=0, le=5, description="0 = strict: a command acts in its own tick")
    policy: Literal["hold", "degrade", "fail"] = Field(default="hold", description="what to do when a member dies")
    max_ticks: int | None = Field(default=None, gt=0, description="end of the run; null = until paused")
    paused: bool = Field(default=False, description="wait for sim/step instead of running")
    keep: bool = Field(
        default=False, description="true: what this request does not give, of the world too, stays as it was"
    )

    @model_serializer(mode="wrap")
    def _given(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Return the fields of the request to send: with ``keep`` only the given ones, else all."""
        fields = handler(self)
        if not self.keep:
            return fields
        world = {name: fields["world"][name] for name in self.world.model_fields_set}
        return {name: fields[name] for name in self.model_fields_set if name != "world"} | {"world": world}

    def over(self, before: "ResetRequest") -> "ResetRequest":
        """Return the request with ``keep`` resolved: fields that it does not give are those of `before`."""
        if not self.keep:
            return self
        wanted = {name: getattr(self.world, name) for name in self.world.model_fields_set}
        world = before.world.model_copy(update=wanted)
        given = {name: getattr(self, name) for name in self.model_fields_set - {"keep", "world"}}
        if self.mode == "lockstep" and "mode" in given:
            given.setdefault("rtf", 0.0)
        return before.model_copy(update={**given, "world": world})

    @field_validator("rtf")
    @classmethod
    def _goes_with_mode(cls, value: float, info: ValidationInfo) -> float:
        belonging(value or None, info, "mode", {"lockstep": (), "paced": ("rtf",)})
        return value


class ResetReply(Reply):
    """Reply to `sim/reset`: number of the run (epoch) that begins."""

    epoch: int = Field(ge=0, description="every message of the new run carries it")
    run_id: str = Field(description="seed, world and epoch in one word")


class StepRequest(Request):
    """Resumes a paused simulation, for a number of ticks or without end."""

    ticks: int | None = Field(default=None, gt=0, description="ticks to run before pausing again; null = until paused")


class SpeedRequest(Request):
    """Changes the real-time factor of a paced run."""

    rtf: float = Field(ge=0, le=1000, description="real-time factor, 0 = as fast as it goes")


class PauseRequest(Request):
    """Request that stops simulated time."""

    at_tick: int | None = Field(default=None, ge=0, description="tick to stop after (reproducible); null = now")
    end: bool = Field(default=False, description="true: that tick is the last of the run")


class PushRequest(Request):
    """Plans a push: an external force on a link or the trunk for a time."""

    force: Vec3 = Field(description="N, world axes")
    duration: float = Field(gt=0, le=10, description="s")
    body: str = Field(default="trunk", max_length=64, description="link the force acts on, at its centre of mass")
    at_tick: int | None = Field(default=None, ge=0, description="tick it begins in; null = the next one")


class PlaceRequest(Request):
    """Displaces the standing robot, as a hand that lifts it and puts it down elsewhere."""

    forward: float = Field(default=0.0, ge=-100, le=100, description="m along the heading")
    left: float = Field(default=0.0, ge=-100, le=100, description="m to the left")
    turn: float = Field(default=0.0, ge=-6.3, le=6.3, description="rad, left positive")
    at_tick: int | None = Field(default=None, ge=0, description="tick it happens in; null = the next one")


class SetRequest(Request):
    """Changes friction, masses or servo gains of the world while it runs."""

    quantity: Literal["friction", "mass", "servo"] = Field(description="what to change")
    value: float = Field(gt=0, le=100, description="friction coefficient, or factor on mass or servo gain")
    at_tick: int | None = Field(default=None, ge=0, description="tick it takes effect in; null = the next one")


class FaultRequest(Request):
    """Plans a fault of a sensor, servo, packet line or camera, which ends after its duration."""

    schema_version: ClassVar[str] = "1.3"
    kind: FaultKind = Field(description="which fault")
    target: str = Field(default="", max_length=64, description="joint, leg or sensor name where the fault has one")
    value: float = Field(
        default=0.0,
        description="size: bias (SI), weakness factor, delay (ticks), loss probability, share of the landmarks, "
        "part by which the focal length is stated too long; sensor_wrong: a factor; sensor_slow: n, each n-th comes",
    )
    duration: float = Field(default=1.0, gt=0, le=3600, description="s")
    at_tick: int | None = Field(default=None, ge=0, description="tick it begins in; null = the next one")

    @field_validator("value")
    @classmethod
    def _goes_with_kind(cls, value: float, info: ValidationInfo) -> float:
        belonging(value or None, info, "kind", FAULT_FIELDS)
        return value


class SimReply(Reply):
    """Reply to sim/step, speed, pause, push, place, set and fault."""

    accepted: bool = Field(description="false: nothing changed")
    tick: int = Field(ge=-1, description="tick it takes effect in, or the present one")
    reason: str = Field(default="", description="in words")


class CheckpointRequest(Request):
    """Stores the whole state of the simulator under a name."""

    name: str = Field(default="default", min_length=1, max_length=64, description="name of the checkpoint")


class RestoreRequest(Request):
    """Restores the state of the simulator that was stored under a name; raises the epoch."""

    name: str = Field(default="default", min_length=1, max_length=64, description="name of the checkpoint")


class CheckpointReply(Reply):
    """Reply about a stored or restored checkpoint: hash, tick and epoch."""

    name: str = Field(description="name of the checkpoint")
    tick: int = Field(ge=-1, description="tick it was made at")
    epoch: int = Field(ge=0, description="epoch that runs now")
    sha256: str = Field(description="of the stored state")


Primitive = Literal["flat", "slope", "edge", "hill", "ridge", "hole", "groove"]


class PrimitiveTrial(Request):
    """One stroke with all stance feet on the same ground primitive (Walas & Belter, section 3.1)."""

    primitive: Primitive = Field(description="what lies under every foot")
    height: float = Field(default=0.02, ge=0, le=0.04, description="height or depth of it, m")
    yaw: float = Field(default=0.0, ge=-10, le=10, description="heading of the primitive, rad; 0 = along the walk")
    friction: float = Field(default=0.5, gt=0, le=10, description="coefficient of the ground")
    noise: float = Field(default=0.0, ge=0, le=0.01, description="standard deviation of the heights, m")
    offset: float = Field(default=0.0, ge=0, le=0.02, description="feet off the middle of the primitive by this, m")
    offset_yaw: float = Field(default=0.0, ge=-10, le=10, description="in this direction, rad")
    stance: Literal["six", "tripod"] = Field(default="tripod", description="feet on the ground during the stroke")
    stroke: float = Field(default=0.025, ge=0.001, le=0.05, description="way of the trunk forward, m")
    seed: int = Field(default=0, ge=0, lt=2**31, description="of the noise")


class ExperimentRequest(Request):
    """Asks for trials in a world of their own; the running system is not disturbed."""

    trials: Annotated[tuple[PrimitiveTrial, ...], Field(min_length=1, max_length=64)] = Field(
        description="answered in this order"
    )


class FootOutcome(Reply):
    """Outcome of a trial for one stance foot: whether it stayed, and how far it slid."""

    leg: str = Field(description="name of the leg")
    sliding: float = Field(ge=0, description="way of the contact point in the ground plane during the stroke, m")
    displacement: float = Field(ge=0, description="horizontal way of the foot centre during the stroke, m")
    before: float = Field(ge=0, description="how far the foot came to lie from where it was put, m")
    load: float = Field(ge=0, description="mean normal force during the stroke, N")
    contact: Vec3 = Field(description="foot centre at the begin of the stroke, frame of the trial, m")


class TrialOutcome(Reply):
    """Outcome of one trial on a ground primitive."""

    status: Literal["ok", "slipped", "fallen", "impossible"] = Field(
        description="ok; slipped: a foot slid by more than a stroke before the stroke began; fallen: before or in it; "
        "impossible: robot or ground cannot be put so"
    )
    feet: tuple[FootOutcome, ...] = Field(default=(), description="stance feet; empty when impossible")
    reason: str = Field(default="", description="why not ok")


class ExperimentReply(Reply):
    """Reply to `sim/experiment`: outcomes in the order of the trials of the request."""

    robot: str = Field(description="name of the robot")
    robot_hash: str = Field(description="its hash")
    outcomes: tuple[TrialOutcome, ...] = Field(description="one for each trial")


class FeaturesRequest(Request):
    """Asks for the terrains, faults, map profiles and queries of this simulator."""


class FeaturesReply(Reply):
    """Robot, terrains, faults and queries of this simulator."""

    robot: str = Field(description="name of the robot")
    terrains: tuple[str, ...] = Field(description="kinds of terrain")
    faults: tuple[str, ...] = Field(description="kinds of fault")
    map_profiles: tuple[str, ...] = Field(description="map profiles")
    queries: tuple[str, ...] = Field(description="keys served")
    version: str = Field(description="MuJoCo's version")
