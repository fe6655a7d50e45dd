"""State of the robot by the function services: velocity, odometry, gait."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from .base import MAX_FEET, Message, PerFoot, QuatWxyz, Vec3, Wire
from .hw import LandmarkDetections

Covariance6 = Annotated[tuple[float, ...], Field(min_length=36, max_length=36)]
Covariance4 = Annotated[tuple[float, ...], Field(min_length=16, max_length=16)]


SURER = 0.998
"""Ratio of the new to the previous heading variance below which an odometry step counts as a correction of the past;
ordinary steps reduce the variance less."""


def _none(value: object) -> bool:
    return value is None


def _sound(value: object) -> bool:
    """Return True if a foot's sensors worked (flag True), so that the field is left out of the message."""
    return value is True


def _zero(value: object) -> bool:
    return not value


class VelocityEstimate(Message):
    """Velocity and gravity direction of base_link, by one of the estimators."""

    schema_version: ClassVar[str] = "1.1"
    mode: Literal["imu", "kinematics", "kinematics_gyro", "ekf", "best"] = Field(description="which estimator made it")
    velocity: Vec3 = Field(description="m/s, velocity of the base_link origin in base_link axes")
    velocity_imu: Vec3 = Field(description="m/s, velocity of the IMU in IMU axes (the paper's quantity)")
    velocity_heading: Vec3 = Field(description="m/s, base_link velocity in heading axes: x forward horizontal, z up")
    angular_velocity: Vec3 = Field(description="rad/s, base_link axes, gyro bias removed")
    g_up: Vec3 = Field(description="m/s^2, base_link axes: specific force at rest, points UP, length about 9.81")
    roll: float = Field(description="rad, from g_up")
    pitch: float = Field(description="rad, from g_up")
    gyro_bias: Vec3 = Field(description="rad/s, IMU frame")
    acc_bias: Vec3 = Field(default=(0.0, 0.0, 0.0), description="m/s^2, IMU frame")
    covariance: Covariance6 = Field(description="row-major 6x6 of (g, v), IMU axes, SI")
    initialised: bool = Field(description="standstill calibration done; until then the covariance is wide")
    standing: bool = Field(description="the robot is at rest by the sensors")
    inputs_ok: bool = Field(description="all inputs of the last 100 ms were accepted")
    filter_ok: bool = Field(description="covariance is finite and positive, innovation within bounds")
    sensors_ok: bool = Field(description="no sensor saturated, frozen or absent")
    slipping: Annotated[tuple[bool, ...], Field(max_length=MAX_FEET)] = Field(
        description="per foot: rejected as slipping"
    )
    nis: float | None = Field(default=None, description="normalised innovation squared of the last corrections, 3 dof")
    refused: int = Field(
        default=0, ge=0, description="inputs refused since the epoch began (late, NaN, duplicate, ...)"
    )
    reasons: tuple[str, ...] = Field(
        default=(), exclude_if=_zero, description="remarks on the estimate, in words; empty: all is well"
    )


class StanceEnd(Wire):
    """Stance of a foot that has ended, by the robot's own measurements."""

    foot: int = Field(ge=0, lt=MAX_FEET, description="number of the foot, as in the robot description")
    slip: float = Field(ge=0, description="m, way slid from where the stance began, rolling removed")
    begin: Vec3 = Field(description="m, foot centre at its begin, odom")
    samples: int = Field(ge=1, description="samples of the joints from its first contact to its last")
    healthy: bool = Field(
        default=True, exclude_if=_sound, description="False: an encoder stood still or jumped, or the switch was stuck"
    )


class Odometry(Message):
    """Pose of base_link in ``odom``, dead-reckoned: yaw and position drift, and the covariance grows with them."""

    schema_version: ClassVar[str] = "1.3"

    position: Vec3 = Field(description="m, base_link origin in odom")
    quat_wxyz: QuatWxyz
    yaw: float = Field(description="rad, heading in odom, not wrapped")
    velocity: Vec3 = Field(description="m/s, in odom axes")
    covariance: Covariance4 = Field(description="row-major 4x4 of (x, y, z, yaw), m and rad")
    pose_covariance: Covariance6 | None = Field(
        default=None,
        description="row-major 6x6 since the start, as in nav_msgs: x, y, z, m, rotation about x, y, z of odom, rad",
    )
    initialised: bool = Field(description="as in VelocityEstimate")
    stances: Annotated[tuple[StanceEnd, ...], Field(max_length=MAX_FEET)] = Field(
        default=(), exclude_if=_zero, description="stances that have ended since the message before"
    )

    def corrects(self, before: "Odometry") -> bool:
        """Return whether the step from the message `before` to this one is a correction of the past, and no motion.

        Dead reckoning never reduces the variance of the heading. It falls where a rest shows the bias of the gyro, or
        where the estimator restarts: the pose jumps, and the robot did not move.
        """
        return self.covariance[-1] < SURER * before.covariance[-1]


class SeenLandmarks(LandmarkDetections):
    """Landmarks that vision recognised in the last image; places hold at ``stamp_ns``: odometry moves them there."""

    schema_version: ClassVar[str] = "1.1"
    fresh: bool = Field(default=False, description="false: no image was read since the message before")
    image_stamp_ns: int = Field(default=0, ge=0, description="ns, middle of the exposure of the image; 0 = none")
    features: int = Field(default=0, ge=0, description="features of the image")
    compared: int = Field(default=0, ge=0, description="features with a candidate in the map")
    recognised: int = Field(
        default=0, ge=0, exclude_if=_zero, description="features of the map in the image; `landmarks` are the likest"
    )
    anywhere: bool = Field(default=False, description="the whole map was searched, not only about the believed pose")
    flags: Annotated[tuple[str, ...], Field(max_length=16)] = Field(
        default=(),
        exclude_if=_zero,
        description="what is wrong with the images: dark, bright, covered, frozen, repeated, late, silent, "
        "featureless, unrecognised, half_blind, scale, no_map, bad_image, bad_view, bad_descriptor, too_many; "
        "empty = nothing",
    )


class GaitState(Message):
    """State of the gait and of the present walk."""

    schema_version: ClassVar[str] = "1.1"
    walk_id: int = Field(ge=0, description="number of the accepted walk command, 0 = none yet")
    state: Literal["waiting", "standing", "walking", "stopping", "turning", "recovering", "refused", "hold"] = Field(
        description="waiting: the estimator is not initialised; hold: inputs are stale or absent, or the driver holds "
        "the joints"
    )
    phase: float = Field(ge=0, le=1, description="phase of the present step")
    stance: Annotated[tuple[bool, ...], Field(max_length=MAX_FEET)] = Field(
        description="per foot: planned on the ground"
    )
    footholds: Annotated[tuple[Vec3, ...], Field(max_length=MAX_FEET)] = Field(
        description="m, per foot the present or planned foot centre in the map (= odom until the odometry begins anew)"
    )
    foothold_status: Annotated[tuple[str, ...], Field(max_length=MAX_FEET)] = Field(
        default=(), description="per foot: ok, raise_trunk, infeasible, nominal"
    )
    trunk_height: float = Field(default=0.0, description="m, planned height of base_link over the mean foothold")
    remaining: float = Field(description="m or rad still to go; 0 when there is no command")
    margin: float | None = Field(
        default=None, description="m, static margin of the last step check; null = not checked"
    )
    reason: str = Field(default="", description="why a step was refused or degraded, in words")
    steps: int = Field(default=0, ge=0, description="steps taken in this epoch")
    feet_sensed: PerFoot = Field(default=(), description="per foot 1.0 if the switches show contact, else 0.0")
    order: int = Field(
        default=0, ge=0, exclude_if=_zero, description="number of the navigator's last order that was taken up"
    )
    order_refused: str = Field(default="", exclude_if=_zero, description="why that order was refused, in words")
    ends_in_s: float | None = Field(
        default=None,
        exclude_if=_none,
        description="s until the last planned step of the command lands; a command that comes 0.25 s before it follows "
        "without a halt; null = no command is under way, or the gait does not know",
    )
