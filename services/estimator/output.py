"""Output of an estimator: gravity g and velocity v of the IMU expressed in the frames of users, with flags."""

import math
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Flags
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear_kernels import times_vector
from surefoot.kernels.jit import kernel

FASTEST, FASTEST_PAPER = 9.0, 3.0
"""Speeds, m/s, from which on an estimate is out of bounds: one of `best`; one of the estimators of Wawrzynski et al."""


class VelocityAndTilt(NamedTuple):
    """Velocity and gravity direction by one estimator at one stamp, with biases, flags and reasons; L feet.

    velocity: of the base_link origin, base_link axes, m/s; velocity_imu: of the IMU, IMU axes, m/s; velocity_heading:
    of the base_link origin in heading axes (z vertical), m/s; angular_velocity: base_link axes, bias removed, rad/s;
    g_up: upward gravity, base_link axes, m/s^2; roll, pitch: rad; biases: IMU axes; covariance: of (g, v), IMU axes,
    (6, 6); inputs_ok: inputs are accepted and new; filter_ok: the estimate is consistent; sensors_ok: no sensor is
    faulty; sliding: probability that a foot slides, (L,), NaN = it does not stand; refused: inputs refused so far.
    """

    mode: str  # name in the table of estimators
    stamp_ns: int
    velocity: Array  # (3,) m/s, base_link origin, base_link axes
    velocity_imu: Array  # (3,) m/s, IMU, IMU axes
    velocity_heading: Array  # (3,) m/s, base_link origin, heading axes
    angular_velocity: Array  # (3,) rad/s, base_link axes, bias removed
    g_up: Array  # (3,) m/s^2, base_link axes, points up
    roll: float  # rad
    pitch: float  # rad
    gyro_bias: Array  # (3,) rad/s, IMU axes
    acc_bias: Array  # (3,) m/s^2, IMU axes
    covariance: Array  # (6, 6) of (g, v), IMU axes
    initialised: bool
    standing: bool
    inputs_ok: bool
    filter_ok: bool
    sensors_ok: bool
    slipping: Flags  # (L,)
    sliding: Array  # (L,) probability that the foot slides; NaN: it does not stand
    nis: float | None  # of the last corrections (0.25 s), 3 degrees of freedom
    refused: int  # inputs refused so far
    reasons: tuple[str, ...]  # reasons of the flags, in words


class OdometryPose(NamedTuple):
    """Pose of base_link in odom: position, m, `quat_wxyz` (rot_odom_from_base), yaw, rad, velocity, m/s, odom axes.

    The covariance (6, 6) is that of x, y, z and of the rotation about x, y, z, in odom axes.
    """

    position: Array  # (3,) m
    quat_wxyz: Array  # (4,) rot_odom_from_base
    yaw: float  # rad, not wrapped
    velocity: Array  # (3,) m/s, odom axes
    covariance: Array  # (6, 6) of x, y, z and the rotation about x, y, z, odom axes


@kernel
def level(rot_base_from_imu: Array, g: Array) -> Array:
    """Return rot_heading_from_base (3, 3) = Ry(pitch) Rx(roll); heading axes are base_link's with z vertical.

    Args:
        rot_base_from_imu: mounting of the IMU in base_link, (3, 3).
        g: specific force at rest, (3,) m/s^2, IMU axes, points up.
    """
    up = times_vector(rot_base_from_imu, g)
    roll, pitch = math.atan2(up[1], up[2]), math.atan2(-up[0], math.hypot(up[1], up[2]))
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    return np.array([[cp, sp * sr, sp * cr], [0.0, cr, -sr], [-sp, cp * sr, cp * cr]])


@kernel
def express(g: Array, v: Array, w: Array, rot_base_from_imu: Array, imu_position: Array) -> Array:
    """Return IMU quantities in other frames, as five rows (5, 3).

    Rows: velocity of the base_link origin, base_link axes, m/s; that velocity in heading axes, m/s; turn rate,
    base_link axes, rad/s; g, base_link axes, m/s^2; (roll, pitch, 0), rad. The velocity of the origin is
    R v + w x (0 - imu_position), with R v and w in base_link axes.

    Args:
        g: specific force at rest, points up, (3,) m/s^2, IMU axes.
        v: velocity of the IMU, (3,) m/s, IMU axes.
        w: turn rate, (3,) rad/s, IMU axes, bias removed.
        rot_base_from_imu: R, mounting of the IMU in base_link, (3, 3).
        imu_position: place of the IMU in base_link, (3,) m.
    """
    out = np.zeros((5, 3))
    out[0], out[2] = times_vector(rot_base_from_imu, v), times_vector(rot_base_from_imu, w)
    out[3] = times_vector(rot_base_from_imu, g)
    x, y, z = imu_position[0], imu_position[1], imu_position[2]
    out[0, 0] -= out[2, 1] * z - out[2, 2] * y
    out[0, 1] -= out[2, 2] * x - out[2, 0] * z
    out[0, 2] -= out[2, 0] * y - out[2, 1] * x
    out[1] = times_vector(level(rot_base_from_imu, g), out[0])
    out[4, 0] = math.atan2(out[3, 1], out[3, 2])
    out[4, 1] = math.atan2(-out[3, 0], math.hypot(out[3, 1], out[3, 2]))
    return out


@kernel
def healthy(g: Array, v: Array, p: Array, fastest: float) -> bool:
    """Return True for finite values, positive variances, a length of g within 1 m/s^2 of 9.81 and a possible speed.

    Args:
        g: specific force at rest, IMU axes, (3,) m/s^2.
        v: velocity of the IMU, IMU axes, (3,) m/s.
        p: covariance of (g, v), (6, 6) or larger.
        fastest: speed that is not possible, m/s.
    """
    length, speed = 0.0, 0.0
    for i in range(3):
        length += g[i] * g[i]
        speed += v[i] * v[i]
    if not (math.isfinite(length) and math.isfinite(speed)):
        return False
    for i in range(p.shape[0]):
        if not (math.isfinite(p[i, i]) and p[i, i] > 0.0):
            return False
    return abs(math.sqrt(length) - GRAVITY) < 1.0 and speed < fastest * fastest


@kernel
def summary(
    g: Array, v: Array, p: Array, w: Array, gyro_bias: Array, rot_base_from_imu: Array, imu_position: Array
) -> tuple[Array, bool]:
    """Return an estimate in the frames of users, five rows (5, 3), and True if its numbers are possible.

    Rows: velocity of the base_link origin, base_link axes, m/s; that velocity in heading axes, m/s; turn rate,
    base_link axes, rad/s; g, base_link axes, m/s^2; (roll, pitch, 0), rad.

    Args:
        g: specific force at rest, points up, (3,) m/s^2, IMU axes.
        v: velocity of the IMU, (3,) m/s, IMU axes.
        p: covariance of (g, v), (6, 6).
        w: gyro, (3,) rad/s, IMU axes.
        gyro_bias: subtracted from the gyro, (3,) rad/s, IMU axes.
        rot_base_from_imu: mounting of the IMU in base_link, (3, 3).
        imu_position: place of the IMU in base_link, (3,) m.
    """
    rate = np.empty(3)
    for i in range(3):
        rate[i] = w[i] - gyro_bias[i]
    return express(g, v, rate, rot_base_from_imu, imu_position), healthy(g, v, p, FASTEST_PAPER)
