"""Dead-reckoned pose of base_link in `odom`: tilt by the velocity filter, heading and position by gyro and stance feet.

Yaw and position are unobservable here: they drift, and their covariance grows with the way.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.rotations import quat_from_matrix
from surefoot.kernels.jit import kernel
from surefoot.services.estimator import odometry_kernel as k
from surefoot.services.estimator.feet import FootSample, foot_turn

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


MAX_INTERVAL_S = 0.12  # s without feet after which nobody knows which of them lifted


@dataclass(frozen=True)
class OdometryParams:
    """Noises of the odometry filter, SI."""

    sigma_p: float = 0.0006  # m, foot by kinematics: encoder steps, bending, uneven ground under a round foot
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


class OdometryPose(NamedTuple):
    """Pose of base_link in odom."""

    position: Array  # (3,) m
    quat_wxyz: Array  # (4,) rot_odom_from_base
    yaw: float  # rad, not wrapped
    velocity: Array  # (3,) m/s, odom axes
    covariance: Array  # (4, 4) of x, y, z, yaw


class OdometryFilter:
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
        self._begin = position.copy()
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
        last, self._last = self._last, sample
        if last is None or sample.stamp_ns <= last.stamp_ns:
            self._psi = psi
            rot = k.level(self._rot_base_from_imu, g)  # rot_heading_from_base
            seen = k.heading_view(rot, self._rot_base_from_imu, self._imu_position, sample.position)
            self._anchor_all(sample.contact, seen)
            return
        d = 1e-9 * (sample.stamp_ns - last.stamp_ns)
        if d > MAX_INTERVAL_S:
            self._stance[:] = False
        nis = take_feet(
            self.x, self.cov, d, psi - self._psi, w, v_heading, g, self._rot_base_from_imu, self._imu_position,
            self._radius, sample.position, last.rot, sample.rot, self._stance, sample.contact, self._noise,
        )  # fmt: skip
        self.slipping = nis > self._gate
        self._psi = psi
        self._stance = sample.contact.copy()

    def _anchor_all(self, contact: Flags, seen: Array) -> None:
        for foot in np.flatnonzero(contact):
            k.anchor(self.x, self.cov, int(foot), seen[foot], self._noise)
        self._stance = contact.copy()

    def pose(self, since_s: float, psi: float, g: Array, v_heading: Array, tilt_variance: float = 0.0) -> OdometryPose:
        """Pose now, carried on from the last foot sample by `since_s`.

        A constant error of the tilt (rad^2 per axis) bends the whole way up or down: it adds to the covariance.
        """
        since_s, turn = (since_s, psi - self._psi) if self._last is not None else (0.0, 0.0)
        rows, covariance = carry_on(
            self.x, self.cov, since_s, turn, v_heading, self._rot_base_from_imu, g, self._begin, tilt_variance
        )
        return OdometryPose(rows[:3], rows[3:7], float(rows[7]), rows[8:], covariance)

    @property
    def ready(self) -> bool:
        """Whether feet have been seen."""
        return self._last is not None


@kernel
def take_feet(
    x: Array,
    cov: Array,
    d: float,
    turn: float,
    w: Array,
    v_heading: Array,
    g: Array,
    rot_base_from_imu: Array,
    imu_position: Array,
    radius: Array,
    position: Array,
    rot_0: Array,
    rot_1: Array,
    was: Flags,
    now: Flags,
    noise: Array,
) -> Array:
    """`odometry_kernel.step` from the feet as the IMU sees them.

    Args:
        x: state, (n,), in place.
        cov: covariance, (n, n), in place.
        d: time since the last sample, s.
        turn: heading change by the gyro since then, rad.
        w: mean gyro since then, (3,) rad/s, IMU axes.
        v_heading: velocity of base_link, heading axes, (3,) m/s.
        g: specific force at rest, IMU axes, (3,).
        rot_base_from_imu: (3, 3).
        imu_position: in base_link, (3,) m.
        radius: of round feet, (L,) m.
        position: feet from the IMU, IMU axes, (L, 3) m.
        rot_0: rot_imu_from_foot at the last sample, (L, 3, 3).
        rot_1: the same now.
        was: feet anchored at the last sample, (L,).
        now: feet in contact now, (L,).
        noise: see `odometry_kernel.predict`.
    """
    rot = k.level(rot_base_from_imu, g)
    seen = k.heading_view(rot, rot_base_from_imu, imu_position, position)
    turned_by, rot_heading_from_imu, moved = np.empty(position.shape), np.zeros((3, 3)), np.empty(3)
    for f in range(radius.size):  # rotation of each foot over the ground, IMU axes
        turn_by_feet = foot_turn(rot_0[f], rot_1[f])
        for i in range(3):
            turned_by[f, i] = turn_by_feet[i] + w[i] * d
    for i in range(3):
        moved[i] = v_heading[i] * d
        for m in range(3):
            for j in range(3):
                rot_heading_from_imu[i, j] += rot[i, m] * rot_base_from_imu[m, j]
    roll = k.heading_roll(rot_heading_from_imu, turned_by, radius)
    return k.step(x, cov, d, turn, moved, roll, seen, was, now, noise)


@kernel
def carry_on(
    x: Array,
    cov: Array,
    since_s: float,
    turn: float,
    v_heading: Array,
    rot_base_from_imu: Array,
    g: Array,
    begin: Array,
    tilt_variance: float,
) -> tuple[Array, Array]:
    """The pose at `since_s` after the last foot sample; see `Odometry.pose`.

    Returns:
        position (3), quaternion (4), yaw and velocity in odom (3), (11,); covariance of x, y, z, yaw, (4, 4).
    """
    out = np.empty(11)
    yaw = x[k.YAW] + turn - x[k.BIAS] * since_s
    c, s = math.cos(yaw), math.sin(yaw)
    out[8] = c * v_heading[0] - s * v_heading[1]
    out[9] = s * v_heading[0] + c * v_heading[1]
    out[10] = v_heading[2]
    for i in range(3):
        out[i] = x[i] + out[8 + i] * since_s
    rot = k.level(rot_base_from_imu, g)
    for i in range(3):
        ahead, left = rot[0, i], rot[1, i]
        rot[0, i] = c * ahead - s * left
        rot[1, i] = s * ahead + c * left
    quat = quat_from_matrix(rot)
    for i in range(4):
        out[3 + i] = quat[i]
    out[7] = yaw
    covariance = np.empty((4, 4))
    for i in range(4):
        for j in range(4):
            covariance[i, j] = cov[i, j]
    dx, dy, dz = x[0] - begin[0], x[1] - begin[1], x[2] - begin[2]
    covariance[0, 0] += tilt_variance * dz * dz
    covariance[1, 1] += tilt_variance * dz * dz
    covariance[2, 2] += tilt_variance * (dx * dx + dy * dy)
    return out, covariance
