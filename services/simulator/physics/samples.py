"""Inputs and outputs of a world: commands, samples of the hardware, the exact truth, checkpoints."""

import hashlib
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array


class ServoCommand(NamedTuple):
    """Joint angles, rad, that the servos are to hold, and their largest torque, Nm."""

    position: Array
    """Commanded joint angles, (nj,) rad."""
    torque_limit: Array | None = None
    """Torque limit of each servo under this command, (nj,) Nm; None = the servos' own limits."""


class ImuSample(NamedTuple):
    """Sample of the inertial unit: mean over the tick, IMU frame; the stamp is the end of the tick."""

    stamp_ns: int
    seq: int
    acc: Array
    """Specific force in the axes of the inertial unit, (3,) m/s^2."""
    gyro: Array
    """Angular rate in the axes of the inertial unit, (3,) rad/s."""
    saturated: bool


class JointSample(NamedTuple):
    """Sample of the encoders and motor currents, joints in the order of the robot description."""

    stamp_ns: int
    seq: int
    position: Array
    """Measured joint angles, (nj,) rad."""
    current: Array
    """Measured currents of the servos, (nj,) A."""
    torque: Array
    """Torques of the servos computed from the measured currents, (nj,) Nm."""


class ContactSample(NamedTuple):
    """Sample of the foot sensors, feet in the order of the robot description."""

    stamp_ns: int
    seq: int
    touch: tuple[tuple[bool, ...], ...]
    """States of the one to four switches of each foot, True = closed."""
    normal_force: Array | None
    """Measured normal forces of the feet, (L,) N; None = the feet have switches only."""


class Samples(NamedTuple):
    """Samples that the hardware releases in one tick; None = nothing due, or lost."""

    imu: ImuSample | None
    joints: JointSample | None
    contacts: ContactSample | None


class Detection(NamedTuple):
    """One recognised landmark, seen from base_link in heading axes.

    Range in m, bearing in rad, left positive, descriptor (k,), no unit.
    """

    range: float
    bearing: float
    descriptor: Array
    landmark: int
    """Index of the landmark, known to the simulation only; -1 = the goal marker."""


class CameraFrame(NamedTuple):
    """Landmarks, and the marker of the goal if seen, that the camera recognised in one image."""

    seq: int
    landmarks: list[Detection]
    goal: Detection | None


class Reach(NamedTuple):
    """Sample of the ultrasonic sensor and the bumpers: distance of the nearest echo, and feet that touched a wall."""

    seq: int
    distance: float | None
    """Distance of the nearest ultrasonic echo, m; None = no echo."""
    bump: tuple[bool, ...]
    """True for each foot whose bumper was touched since the last sample, (L,)."""


_ARRAYS = frozenset({"acc", "gyro", "position", "current", "torque", "torque_limit", "normal_force"})


def pack(sample: NamedTuple) -> dict[str, Any]:
    """Return a sample (a named tuple) as plain JSON values by field, from which it can be made again."""
    return {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in sample._asdict().items()}


def unpack(kind: type[Any], values: dict[str, Any]) -> Any:
    """Return the sample of a class `kind` from plain JSON values by field."""
    known: dict[str, Any] = {k: np.array(v) if k in _ARRAYS and v is not None else v for k, v in values.items()}
    if "touch" in values:
        known["touch"] = tuple(tuple(foot) for foot in values["touch"])
    return kind(**known)


class ExactState(NamedTuple):
    """Exact state at the end of a tick; forces are those of the last physics step. Arrays are copies."""

    stamp_ns: int
    position: Array
    """Origin of base_link, world frame, (3,) m."""
    quat_wxyz: Array
    """Rotation from base_link to the world as a unit quaternion w, x, y, z, (4,)."""
    velocity: Array
    """Velocity of the origin of base_link, world axes, (3,) m/s."""
    angular_velocity: Array
    """Angular velocity of the trunk, base_link axes, (3,) rad/s."""
    com: Array
    """Centre of mass of the whole robot, world frame, (3,) m."""
    joints: Array
    """True joint angles, (nj,) rad."""
    foot_position: Array
    """Centres of the feet, world frame, (L, 3) m."""
    foot_force: Array
    """Contact force of the ground on each foot, world axes, (L, 3) N."""
    foot_force_n: Array
    """True normal forces of the feet, (L,) N."""
    foot_displacement: Array
    """Horizontal displacement of each foot centre since its touch-down, (L,) m."""
    contact_sliding: Array
    """Distance that the contact point of each foot has slid in the present stance, (L,) m."""
    stance_sliding: Array
    """Distance that the contact point of each foot slid in its last finished stance, (L,) m."""
    stance_displacement: Array
    """Horizontal displacement of each foot centre over its last finished stance, (L,) m."""
    stances: NDArray[np.int64]
    """Number of finished stances of each foot since the reset, (L,)."""
    tilt: float
    """Angle between the trunk's z axis and the vertical, rad."""
    fallen: bool
    """True if the tilt exceeded 45 deg or the trunk touched the ground at any time since the reset, else False."""
    foot_twist: Array
    """Rotation of each sole about the vertical since its touch-down, (L,) rad; empty for point feet."""
    stance_twist: Array
    """Rotation of each sole about the vertical in its last finished stance, (L,) rad; empty for point feet."""
    touching: bool | None
    """True if a foot or the trunk presses the side of an obstacle, False if none does; None = the world has no
    obstacles."""


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """Everything that decides the future of a simulated world: state of the physics, sensors and faults."""

    physics: Array
    """Integration state of MuJoCo's physics, 1-D, as `mj_getState` returns it."""
    meta: str
    """Random streams, biases, dividers, faults, pushes and changes to the model, as JSON."""

    @property
    def sha256(self) -> str:
        """SHA-256 of physics and `meta`, hexadecimal."""
        return hashlib.sha256(self.to_bytes()).hexdigest()

    def to_bytes(self) -> bytes:
        """Return the checkpoint as bytes: one line of JSON, then the physics as little-endian float64."""
        return self.meta.encode() + b"\n" + self.physics.astype("<f8").tobytes()

    @classmethod
    def from_bytes(cls, payload: bytes) -> "Checkpoint":
        """Return the checkpoint of bytes: one line of JSON, then little-endian float64."""
        meta, physics = payload.split(b"\n", 1)
        return cls(np.frombuffer(physics, dtype="<f8").astype(np.float64), meta.decode())
