"""Hardware contract: what a driver (or the simulator) provides on ``hw/*`` and consumes on ``cmd/*``."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from .base import MAX_FEET, Message, PerJoint, QuatWxyz, Reply, Request, Vec2, Vec3, Wire

Matrix3 = Annotated[tuple[float, ...], Field(min_length=9, max_length=9)]


def _absent(value: bool | tuple[int, ...]) -> bool:
    """Return True for a value that a message leaves out: false, or an empty list."""
    return not value


class Tick(Message):
    """Manifest of a control tick: its samples and the services that must answer. Published after the samples."""

    schema_version: ClassVar[str] = "1.2"

    roster: tuple[str, ...] = Field(description="services that must finish this tick; changed by the driver only")
    roster_version: int = Field(ge=0, description="counts the changes of the roster")
    since: tuple[int, ...] = Field(
        default=(),
        exclude_if=_absent,
        description="first tick of each service on the roster, in its order, which lockstep does not leave out; "
        "absent = tick 0 of all",
    )
    due: tuple[str, ...] = Field(
        description="hw keys that carry a sample in this tick; in the prime (tick -1) every key the driver has"
    )
    mode: Literal["lockstep", "paced"] = Field(
        description="lockstep: the driver waits for the roster; paced: it does not"
    )
    seed: int = Field(default=0, ge=0, description="scenario seed, for the random streams of services")
    report: bool = Field(default=True, description="true: every member answers this tick with its done")
    end: bool = Field(default=False, description="true on the last tick of the run")
    held: bool = Field(
        default=False,
        exclude_if=_absent,
        description="true: the driver holds the joints, as no command was accepted for 100 ms; absent = false",
    )


class Imu(Message):
    """Inertial sample, mean over its window; ``stamp_ns`` is the end of the window."""

    acc: Vec3 = Field(description="specific force, m/s^2, IMU frame; at rest +9.81 along up")
    gyro: Vec3 = Field(description="angular rate, rad/s, IMU frame")
    saturated: bool = Field(default=False, description="true when an axis is at the end of its range")


class JointState(Message):
    """Encoders and servo loads, in the joint order of the robot description."""

    position: PerJoint = Field(description="joint angles, rad")
    velocity: PerJoint | None = Field(default=None, description="joint rates, rad/s")
    current: PerJoint | None = Field(default=None, description="motor currents, A")
    torque: PerJoint | None = Field(default=None, description="joint torques, Nm")


class FootContacts(Message):
    """Foot switches and foot forces, in the leg order of the robot description."""

    touch: Annotated[tuple[tuple[bool, ...], ...], Field(max_length=MAX_FEET)] = Field(
        description="per foot one to four switches in the order of its points in the robot description, true = pressed"
    )
    normal_force_n: Annotated[tuple[float | None, ...], Field(max_length=MAX_FEET)] = Field(
        description="per foot the force along the sole normal, N; null = no such sensor"
    )


class ExternalMotion(Message):
    """Pose, heading or velocity of the robot by another source, e.g. a camera or motion capture.

    ``stamp_ns`` is the time at which the value holds, not that of its arrival; the estimator takes up values that are
    half a second old at most.
    """

    position: Vec3 | None = Field(
        default=None, description="m, IMU in the frame of the source, z up; needs yaw; null = unknown"
    )
    position_covariance: Matrix3 | None = Field(default=None, description="row-major 3x3, m^2, axes of that frame")
    yaw: float | None = Field(default=None, description="rad, heading of base_link in the frame of the source")
    yaw_variance: float | None = Field(default=None, gt=0, description="rad^2")
    velocity: Vec3 | None = Field(default=None, description="m/s, of the IMU, IMU frame")
    velocity_covariance: Matrix3 | None = Field(default=None, description="row-major 3x3, (m/s)^2, IMU frame")


class MakerMotion(Message):
    """Motion estimate by the software of the robot's maker, recorded for comparison; no service reads it."""

    position: Vec3 | None = Field(default=None, description="m, in the maker's frame; null = unknown")
    quat_wxyz: QuatWxyz | None = Field(default=None, description="in the maker's frame; null = unknown")
    velocity: Vec3 | None = Field(default=None, description="m/s, axes as the maker has them; null = unknown")
    yaw_speed: float | None = Field(default=None, description="rad/s; null = unknown")
    gait: int | None = Field(default=None, description="number of the maker's gait; null = unknown")


class Sighting(Wire):
    """Place of an object on the floor, as distance and bearing from base_link."""

    range: float = Field(ge=0, description="m, along the floor")
    bearing: float = Field(description="rad, against the heading of base_link, left positive")


class Landmark(Sighting):
    """Landmark that a camera recognised, with its descriptor."""

    descriptor: Annotated[tuple[float, ...], Field(max_length=256)] = Field(
        description="what it looks like; the same landmark looks alike each time, up to noise"
    )


class LandmarkDetections(Message):
    """Landmarks that a camera recognised in one image; ``stamp_ns`` is the end of the exposure."""

    landmarks: Annotated[tuple[Landmark, ...], Field(max_length=256)] = Field(description="in no meaningful order")
    goal: Sighting | None = Field(default=None, description="the marker of the goal; null = not seen")


class CameraImage(Message):
    """Image of a camera; ``stamp_ns`` is the middle of the exposure of the middle row."""

    width: int = Field(ge=8, le=8192, description="px")
    height: int = Field(ge=8, le=8192, description="px")
    format: Literal["gray8", "jpeg"] = Field(description="gray8: a byte a pixel, row by row from the top; jpeg: a file")
    pixels: str = Field(description="base64 of that")
    focal: float = Field(gt=0, description="px, of both axes; a pixel at (u, v) looks along (u - cx, v - cy, focal)")
    center: Vec2 = Field(description="px, cx and cy: where the optical axis meets the image; (0, 0) is its corner")
    exposure: float = Field(ge=0, description="s, of each row")
    readout: float = Field(default=0.0, ge=0, description="s, between the exposures of the first and the last row")
    position: Vec3 = Field(description="m, camera in base_link, by kinematics")
    quat_wxyz: QuatWxyz = Field(description="turns camera axes (x right, y down, z ahead) to base_link, by kinematics")


class DepthImage(Message):
    """Image of a depth camera; ``stamp_ns`` is the middle of its exposure.

    Depths are float32 little-endian, row by row from the top, m along the optical axis; NaN = no echo, or the robot's
    own body. Frame and sign follow ROS (REP 118).
    """

    width: int = Field(ge=1, le=640, description="px")
    height: int = Field(ge=1, le=480, description="px")
    depths: str = Field(description="base64 of the depths")
    focal: float = Field(gt=0, description="px, of both axes; a pixel at (u, v) looks along (u - cx, v - cy, focal)")
    center: Vec2 = Field(description="px, cx and cy: where the optical axis meets the image; (0, 0) is its corner")
    sigma: float = Field(ge=0, description="m, standard deviation of a depth close by")
    sigma_square: float = Field(ge=0, description="m per m2, beside that, with the square of the depth")
    frame: str = Field(default="base_link", max_length=64, description="frame of position and rotation")
    position: Vec3 = Field(description="m, camera in that frame")
    quat_wxyz: QuatWxyz = Field(description="turns camera axes (x right, y down, z ahead) to that frame")


class Range(Message):
    """Ultrasound and bumpers: distance and touch of obstacles."""

    distance: float | None = Field(ge=0, description="m, nearest echo; null = none within reach")
    shortest: float = Field(ge=0, description="m, nearer things read as this")
    longest: float = Field(gt=0, description="m, end of the reach")
    field_of_view: float = Field(gt=0, description="rad, full cone about the heading")
    bump: Annotated[tuple[bool, ...], Field(max_length=MAX_FEET)] = Field(
        description="per foot: pressed against something upright since the last sample"
    )


class JointCommand(Message):
    """Position set-points for the servos; stale after 100 ms of simulated time: the driver holds and reports."""

    model_config = Request.model_config
    position: PerJoint | None = Field(
        description="set-points, rad, joint order of the robot description; null = hold what was"
    )
    torque_limit: PerJoint | None = Field(
        default=None, description="the most each servo may give for these set-points, Nm, 0 = limp; null = its own"
    )


class EmergencyStop(Message):
    """Emergency stop: the driver holds the present joint positions until a reset; ``sim/status`` names the reason."""

    reason: str = Field(default="", description="who asks and why")


class DescriptionRequest(Request):
    """Asks the driver which robot description it was built from."""


class DescriptionReply(Reply):
    """Robot description that the driver was built from; a service that has another hash is not ready."""

    robot: str = Field(description="name of the robot")
    hash: str = Field(description="sha256 of the canonical robot description")
    joints: tuple[str, ...] = Field(description="joint names in message order")
    feet: tuple[str, ...] = Field(description="leg names in message order")
