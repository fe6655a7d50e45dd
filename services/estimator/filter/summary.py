"""Report of the `best` filter from its state: velocity, tilt, pose, biases and covariances."""

import math
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear_kernels import congruence
from surefoot.geometry.rotations import quat_from_matrix
from surefoot.kernels.jit import kernel

from ..feet.contact import BestGeometry
from ..health import Condition, LegSensors
from ..inputs.check import LATE_FEET_NS, faults_at
from ..output import FASTEST, healthy
from .advance import settled
from .intake import CONTACT_NS, FEET_NS, NOW_NS, FilterParts
from .layout import M, P, S, X
from .noise import FIXED
from .pose import pose_covariance
from .slope import add_to_gravity
from .state import BestState, rotation


class RowLayout(NamedTuple):
    """Rows of the vectors (8, 3) of an estimate: gravity, velocities, position, biases and others."""

    g: int = 0
    """Row of the specific force at rest, IMU axes, m/s^2; it points up."""
    v: int = 1
    """Row of the velocity of the IMU, IMU axes, m/s."""
    position: int = 2
    """Row of the position of base_link in odom, m."""
    v_odom: int = 3
    """Row of the velocity of base_link, odom axes, m/s."""
    gyro_bias: int = 4
    """Row of the bias of the gyro, IMU axes, rad/s."""
    acc_bias: int = 5
    """Row of the bias of the accelerometer, IMU axes, m/s^2."""
    start: int = 6
    """Row of heading of base_link in odom, rad; 1 if the start has settled, else 0; number of samples at rest in a
    row."""
    fit: int = 7
    """Row of normalised innovation squared (3 degrees of freedom); factor of inertial noise over the sensor's; 0."""


R = RowLayout()
YAW, SETTLED, RESTING = (R.start, 0), (R.start, 1), (R.start, 2)
NIS, EXCESS = (R.fit, 0), (R.fit, 1)
"""`NIS`, `EXCESS`: row and column of normalised innovation squared and inertial noise factor in the vectors (8, 3)."""
QUAT = 4
"""Length of the quaternion, which precedes the probabilities of sliding of L feet in one array (4 + L,)."""


@kernel
def _imu_errors(rot: Array, size: int) -> Array:
    """Return the matrix (size, size) that turns the first errors of the state into errors of (g, v) in IMU axes.

    With R_hat = exp([xi_R]) R the error of g = R^T G is R^T [G] xi_R, that of v is R^T xi_v, G gravity upwards in odom,
    xi_R and xi_v the errors of attitude and velocity; the errors that follow, those of the biases, stay.

    Args:
        rot: rot_odom_from_imu R, (3, 3).
        size: 6, or 12 with the biases of gyro and accelerometer.
    """
    by = np.zeros((size, size))
    for i in range(3):
        by[i, 0], by[i, 1] = GRAVITY * rot[1, i], -GRAVITY * rot[0, i]
        for k in range(3):
            by[3 + i, 3 + k] = rot[k, i]
    for i in range(6, size):
        by[i, i] = 1.0
    return by


@kernel
def joint_covariance(rot: Array, cov: Array) -> Array:
    """Return the covariance (12, 12) of g, v, gyro and accelerometer bias in IMU axes, SI.

    Args:
        rot: rot_odom_from_imu, (3, 3).
        cov: covariance of the filter's error, (12, 12) or larger, order of `ErrorLayout`.
    """
    out = congruence(_imu_errors(rot, 12), np.ascontiguousarray(cov[:12, :12]))
    for i in range(3):
        for k in range(3):
            out[i, k] += FIXED.length_sd**2 * rot[2, i] * rot[2, k]
    return out


@kernel
def _covariance(rot: Array, state: BestState) -> Array:
    """Return the covariance (6, 6) of g, m/s^2, and v, m/s, in IMU axes.

    Args:
        rot: rot_odom_from_imu, (3, 3).
        state: state of the filter.
    """
    block = np.empty((6, 6))
    for i in range(6):
        for k in range(6):
            block[i, k] = state.cov[i, k]
    out = congruence(_imu_errors(rot, 6), block)
    for i in range(3):
        for k in range(3):
            out[i, k] += FIXED.length_sd**2 * rot[2, i] * rot[2, k]
    add_to_gravity(state.memory, rot[2], out)
    for i in range(6):
        for k in range(i):
            out[i, k] = out[k, i] = 0.5 * (out[i, k] + out[k, i])
    return out


@kernel
def summary(state: BestState, geometry: BestGeometry, w: Array, feet: int) -> tuple[Array, Array, Array, Array]:
    """Return the estimate of a state as arrays: vectors, quaternion with probabilities of sliding, two covariances.

    Args:
        state: state of the filter.
        geometry: contact points on the feet, and mounting of the IMU.
        w: gyro, IMU axes, (3,) rad/s.
        feet: number of feet L.

    Returns:
        Vectors by rows, (8, 3), as in `RowLayout`.

        Quaternion w, x, y, z of base_link in odom (4,) and probability that each foot slides (L,), NaN for a foot that
        does not stand, as one array.

        Covariance of (g, v) in IMU axes, (6, 6), m/s^2 and m/s squared.

        Covariance of the pose of base_link: x, y, z, m, and rotation about x, y, z of odom, rad, (6, 6).
    """
    x, points = state.x, state.points
    rot, rows, more = rotation(x), np.zeros((8, 3)), np.zeros(QUAT + feet)
    base, arm, turn, v_imu = np.zeros((3, 3)), np.zeros(3), np.zeros(3), np.zeros(3)
    for i in range(3):
        for k in range(3):
            v_imu[i] += rot[k, i] * x[X.vel + k]
            turn[i] += rot[i, k] * (w[k] - x[X.gyro_bias + k])
            for m in range(3):
                base[i, k] += rot[i, m] * geometry.rot_base_from_imu[k, m]
    for i in range(3):
        for k in range(3):
            arm[i] += base[i, k] * geometry.imu_position[k]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rows[R.g, i], rows[R.v, i] = GRAVITY * rot[2, i], v_imu[i] + state.memory[M.lag + i]
        rows[R.position, i] = x[X.pos + i] - arm[i]
        rows[R.v_odom, i] = x[X.vel + i] - (turn[j] * arm[k] - turn[k] * arm[j])
        for m in range(3):
            rows[R.v_odom, i] += rot[i, m] * state.memory[M.lag + m]
        rows[R.gyro_bias, i], rows[R.acc_bias, i] = x[X.gyro_bias + i], x[X.acc_bias + i]
    rows[YAW] = math.atan2(base[1, 0], base[0, 0])
    rows[SETTLED], rows[RESTING] = 1.0 if settled(state) else 0.0, state.memory[M.rest]
    rows[NIS], rows[EXCESS] = state.memory[M.nis], state.memory[M.excess]
    quat = quat_from_matrix(base)
    for i in range(QUAT):
        more[i] = quat[i]
    count = np.zeros(feet)
    for k in range(points.shape[0]):
        if points[k, P.down] > 0.0:
            more[QUAT + geometry.foot[k]] += points[k, P.seen]
            count[geometry.foot[k]] += 1.0
    for f in range(feet):
        more[QUAT + f] = more[QUAT + f] / count[f] if count[f] > 0.0 else math.nan
    return rows, more, _covariance(rot, state), pose_covariance(state, arm)


@kernel
def leg_sensors(parts: FilterParts) -> LegSensors:
    """Return which sensors of the legs are wrong, bit f for foot f, and by how much the stamps of the feet are late."""
    foot, points, sensors = parts.setting.geometry.foot, parts.state.points, parts.state.sensors
    left_out = switches = jumping = still = swapped = 0
    for k in range(foot.size):
        left_out |= (1 << foot[k]) if points[k, P.mistrust] > FIXED.most_mistrust else 0
    for f in range(parts.check.feet.shape[0]):
        wrong = sensors[f, S.switch] > FIXED.most_mistrust or int(sensors[f, S.wired]) != f
        switches |= (1 << f) if wrong else 0
        jumping |= (1 << f) if sensors[f, S.jump] > FIXED.most_mistrust else 0
        still |= (1 << f) if sensors[f, S.still] > FIXED.most_mistrust else 0
        swapped |= (1 << f) if int(sensors[f, S.source]) != f else 0
    return LegSensors(left_out, switches, jumping, still, swapped, parts.check.marks[LATE_FEET_NS])


@kernel
def condition(parts: FilterParts, vectors: Array, more: Array, covariance: Array) -> Condition:
    """Return the numbers from which the flags of an estimate, and the reasons for them in words, follow.

    Args:
        parts: parts of the filter, brought up to the newest inertial sample.
        vectors: estimate by rows, (8, 3), SI, as in `RowLayout`.
        more: quaternion of base_link in odom (4,) and probability that each foot slides (L,), as one array (4 + L,).
        covariance: covariance of (g, v) in IMU axes, (6, 6), m/s^2 and m/s squared.
    """
    slipping, stamps = False, parts.clock.stamps
    for i in range(QUAT, more.size):
        slipping = slipping or more[i] > FIXED.slides
    now, legs = stamps[NOW_NS], leg_sensors(parts)
    since_contact_s = 1e-9 * (now - stamps[CONTACT_NS])
    return Condition(
        vectors[SETTLED] > 0.0, vectors[RESTING] > 0.0,
        healthy(vectors[R.g], vectors[R.v], covariance, FASTEST), vectors[NIS],
        slipping, vectors[EXCESS], faults_at(parts.check, parts.check_limits, parts.noisy, now),
        1e-9 * (now - stamps[FEET_NS]), since_contact_s, since_contact_s, legs,
        legs.left_out | legs.still == (1 << parts.check.feet.shape[0]) - 1,
        parts.state.memory[M.lost_for] >= 0.0 and legs.left_out != 0, int(parts.state.memory[M.left_out]),
        parts.state.memory[M.sinks],
    )  # fmt: skip
