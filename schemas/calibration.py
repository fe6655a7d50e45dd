"""The calibration of the joint torques as a question to the stability service (Walas & Belter, 4.7)."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator

from .base import MAX_FEET, PerJoint, Reply, Request, Vec2, Vec3, belonging

MAX_POSES = 256
FIELDS: Mapping[str, tuple[str, ...]] = {
    "fit": ("poses", "per_joint"),
    "start": (),
    "status": (),
    "finish": ("per_joint", "apply"),
    "cancel": (),
}
"""Fields of `CalibrateRequest` that go with each of its actions, beside ``at_tick``; another field is refused."""


class CalibrationPose(Request):
    """Joint angles and torques of the robot at rest, with all marked feet on the ground, for a torque calibration."""

    joints: PerJoint = Field(description="joint angles, rad, order of the robot description")
    torque: PerJoint = Field(description="torques as the driver reports them, Nm")
    g_up: Vec3 = Field(default=(0.0, 0.0, 9.81), description="upward specific force, m/s^2, base_link")
    touch: Annotated[tuple[bool, ...], Field(max_length=MAX_FEET)] | None = Field(
        default=None, description="per foot: on the ground; null = all"
    )


class CalibrateRequest(Request):
    """Asks for the factors that correct published torques (Walas & Belter 4.7): by a job, or at once from poses."""

    action: Literal["fit", "start", "status", "finish", "cancel"] = Field(
        description="fit: from the poses given; start: collect poses from now on, whenever the robot rests in a new "
        "one; status: what was found so far; finish: fit them; cancel: forget them"
    )
    poses: Annotated[tuple[CalibrationPose, ...], Field(max_length=MAX_POSES)] = Field(
        default=(), description="for fit"
    )
    per_joint: bool = Field(default=False, description="a factor for every joint; else one for all")
    apply: bool = Field(default=True, description="finish: use the factors for state/stability from then on")
    at_tick: int | None = Field(
        default=None, ge=0, description="start, finish: tick it takes effect in (reproducible); null = the next one"
    )

    @field_validator("poses", "per_joint", "apply")
    @classmethod
    def _goes_with_action(cls, value: Any, info: ValidationInfo) -> Any:
        usual = cls.model_fields[info.field_name or ""].default
        belonging(None if value == usual else value, info, "action", FIELDS)
        return value


class CalibrateReply(Reply):
    """Reply to a request of a torque calibration: progress of the job, or the factors found."""

    accepted: bool = Field(description="false: nothing changes")
    reason: str = Field(default="", description="why it was refused, or what came of it, in words")
    state: Literal["idle", "collecting", "done"] = Field(description="of the job")
    poses: int = Field(ge=0, description="poses collected or fitted")
    gain: float | None = Field(default=None, description="factor common to all torques; null = not fitted yet")
    gain_sd: float | None = Field(default=None, description="its standard deviation")
    joint_gain: PerJoint | None = Field(default=None, description="factor of each joint")
    torque_per_ampere: float | None = Field(
        default=None, description="Nm/A, constant of the robot description times the common factor"
    )
    offset: Vec2 | None = Field(default=None, description="m forward and left, CoM beside that of the description")
    residual_n: float | None = Field(default=None, description="N, RMS of the force equations that remain")
