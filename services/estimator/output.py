"""What the estimator tells: one filter's g and v expressed in the frames that users want, with flags."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import kernel
from surefoot.services.estimator.odometry_kernel import level

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Estimate(NamedTuple):
    """Velocity and gravity direction by one estimator."""

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
    nis: float | None  # of the last correction, 3 degrees of freedom
    refused: int  # inputs refused so far
    contact_lost_s: float  # since a foot was last in contact
    prediction_only_s: float  # since the legs last gave a velocity


@kernel
def express(g: Array, v: Array, w: Array, rot_base_from_imu: Array, imu_position: Array) -> Array:
    """IMU quantities in other frames, as rows: velocity, heading velocity, angular velocity, g_up, (roll, pitch, 0).

    The velocity of the base_link origin is rot (v) + w x (0 - imu_position).

    Args:
        g: (3,) m/s^2, IMU axes.
        v: (3,) m/s, IMU axes.
        w: (3,) rad/s, IMU axes, bias removed.
        rot_base_from_imu: (3, 3).
        imu_position: (3,) m in base_link.
    """
    out = np.zeros((5, 3))
    for i in range(3):
        for k in range(3):
            out[0, i] += rot_base_from_imu[i, k] * v[k]
            out[2, i] += rot_base_from_imu[i, k] * w[k]
            out[3, i] += rot_base_from_imu[i, k] * g[k]
    x, y, z = imu_position[0], imu_position[1], imu_position[2]
    out[0, 0] -= out[2, 1] * z - out[2, 2] * y
    out[0, 1] -= out[2, 2] * x - out[2, 0] * z
    out[0, 2] -= out[2, 0] * y - out[2, 1] * x
    rot = level(rot_base_from_imu, g)
    for i in range(3):
        for k in range(3):
            out[1, i] += rot[i, k] * out[0, k]
    out[4, 0] = math.atan2(out[3, 1], out[3, 2])
    out[4, 1] = math.atan2(-out[3, 0], math.hypot(out[3, 1], out[3, 2]))
    return out


@kernel
def healthy(g: Array, v: Array, p: Array) -> bool:
    """Finite, positive variances, a length of g near 9.81 and a speed that a legged robot can have."""
    length, speed = 0.0, 0.0
    for i in range(3):
        length += g[i] * g[i]
        speed += v[i] * v[i]
    if not (math.isfinite(length) and math.isfinite(speed)):
        return False
    for i in range(p.shape[0]):
        if not (math.isfinite(p[i, i]) and p[i, i] > 0.0):
            return False
    return abs(math.sqrt(length) - 9.81) < 1.0 and speed < 9.0


@kernel
def summary(
    g: Array, v: Array, p: Array, w: Array, rot_base_from_imu: Array, imu_position: Array, hidden: float
) -> tuple[Array, Array, bool]:
    """`express`; P (6, 6) with the variance `hidden` (m^2/s^4) added to that of g; whether it is `healthy`."""
    covariance = p + 0.0
    for i in range(3):
        covariance[i, i] += hidden
    return express(g, v, w, rot_base_from_imu, imu_position), covariance, healthy(g, v, covariance)
