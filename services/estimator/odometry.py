"""Dead-reckoned pose of base_link in `odom`: tilt by the velocity filter, heading and position by gyro and stance feet.

Yaw and position are unobservable here: they drift, and their covariance grows with the way.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.estimator import odometry_kernel as k
from services.estimator.feet import FootSample, foot_turn
from surefoot.rotations import quat_from_matrix

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class OdometryParams:
    """Noises of the odometry filter, SI."""

    sigma_p: float = 0.0004  # m, foot by kinematics: encoder steps and bending
    sigma_c: float = 0.0005  # m/sqrt(s), walk of a stance foot
    sigma_turn: float = 0.0054 * 0.1  # rad/sqrt(s), heading by the gyro: sigma_w sqrt(IMU period)
    sigma_bias: float = 2e-5  # rad/s/sqrt(s), walk of the gyro bias
    sigma_v: float = 0.1  # m/s, velocity that carries the pose between the feet
    gate: float = 16.0  # chi^2, 3 dof, 99.9 %: beyond it a foot slides
    reanchor: float = 100.0  # far beyond it the foot is anchored anew

    def noise(self) -> Array:
        """Vector in the order of the kernel's indices."""
        return np.array(
            [self.sigma_p, self.sigma_c, self.sigma_turn, self.sigma_bias, self.sigma_v, self.gate, self.reanchor]
        )


@dataclass(frozen=True, eq=False)
class Pose:
    """Pose of base_link in odom."""

    position: Array  # (3,) m
    quat_wxyz: Array  # (4,) rot_odom_from_base
    yaw: float  # rad, not wrapped
    velocity: Array  # (3,) m/s, odom axes
    covariance: Array  # (4, 4) of x, y, z, yaw


class Odometry:
    """Filter over position, yaw, gyro bias and feet."""

    def __init__(
        self, feet: int, rot_base_from_imu: Array, imu_position: Array, radius: Array, params: OdometryParams
    ) -> None:
        self._rot_base_from_imu = np.ascontiguousarray(rot_base_from_imu)
        self._imu_position = imu_position
        self._radius = radius
        self._noise = params.noise()
        self._gate = params.gate
        self.start(np.zeros(3), 0.0, 1.0, np.zeros(4), feet)

    def start(self, position: Array, yaw: float, bias_sd: float, pose_sd: Array, feet: int | None = None) -> None:
        """Begin at a stated pose.

        Args:
            position: base_link in odom, (3,) m.
            yaw: heading, rad.
            bias_sd: of the gyro about the vertical, rad/s.
            pose_sd: of x, y, z, yaw, (4,).
            feet: number of feet; None keeps it.
        """
        if feet is not None:
            self._feet = feet
        n = k.FEET + 3 * self._feet
        self.x, self.cov = np.zeros(n), np.eye(n) * k.FREE
        self.x[k.P], self.x[k.YAW] = position, yaw
        for i in range(4):
            self.cov[i, i] = pose_sd[i] ** 2
        self.cov[k.BIAS, k.BIAS] = bias_sd**2
        self._stance = np.zeros(self._feet, dtype=np.bool_)
        self._last: FootSample | None = None
        self._psi = 0.0
        self.slipping = np.zeros(self._feet, dtype=np.bool_)

    def on_feet(self, sample: FootSample, psi: float, g: Array, w: Array, v_heading: Array) -> None:
        """Take the feet at one time.

        Args:
            sample: the feet.
            psi: integral of the heading rate by the gyro at the stamp, rad.
            g: specific force at rest at the stamp, (3,) IMU axes.
            w: mean gyro since the last sample, (3,) rad/s, IMU axes.
            v_heading: velocity of base_link in heading axes, (3,) m/s.
        """
        rot = k.level(self._rot_base_from_imu, g)  # rot_heading_from_base
        seen = k.heading_view(rot, self._rot_base_from_imu, self._imu_position, sample.position)
        last, self._last = self._last, sample
        if last is None or sample.stamp_ns <= last.stamp_ns:
            self._psi = psi
            self._stance[:] = False
            self._anchor_all(sample.contact, seen)
            return
        d = 1e-9 * (sample.stamp_ns - last.stamp_ns)
        turn = feet_turn(last.rot, sample.rot, w * d)
        roll = k.heading_roll(rot @ self._rot_base_from_imu, turn, self._radius)
        nis = k.step(
            self.x, self.cov, d, psi - self._psi, v_heading * d, roll, seen, self._stance, sample.contact, self._noise
        )
        self.slipping = nis > self._gate
        self._psi = psi
        self._stance = sample.contact.copy()

    def _anchor_all(self, contact: Flags, seen: Array) -> None:
        for foot in np.flatnonzero(contact):
            k.anchor(self.x, self.cov, int(foot), seen[foot], self._noise)
        self._stance = contact.copy()

    def pose(self, since_s: float, psi: float, g: Array, v_heading: Array) -> Pose:
        """Pose now, carried on from the last foot sample by `since_s`."""
        turn = (psi - self._psi) - self.x[k.BIAS] * since_s if self._last is not None else 0.0
        yaw = float(self.x[k.YAW] + turn)
        c, s = np.cos(yaw), np.sin(yaw)
        rot_odom_from_heading = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        velocity = rot_odom_from_heading @ v_heading
        rot = rot_odom_from_heading @ k.level(self._rot_base_from_imu, g)
        return Pose(
            position=self.x[k.P] + (velocity * since_s if self._last is not None else 0.0),
            quat_wxyz=quat_from_matrix(rot),
            yaw=yaw,
            velocity=velocity,
            covariance=self.cov[: k.YAW + 1, : k.YAW + 1].copy(),
        )

    @property
    def ready(self) -> bool:
        """Whether feet have been seen."""
        return self._last is not None


@k.kernel
def feet_turn(rot_0: Array, rot_1: Array, turn_imu: Array) -> Array:
    """Rotation of each foot over the ground between two samples, IMU axes, (L, 3) rad."""
    out = np.empty((rot_0.shape[0], 3))
    for f in range(rot_0.shape[0]):
        out[f] = foot_turn(rot_0[f], rot_1[f]) + turn_imu
    return out


def warm() -> None:
    """Compile every kernel of this module."""
    rot = np.eye(3)[None].copy()
    feet_turn(rot, rot, np.zeros(3))
