"""What the `best` filter reports of its state: velocity, tilt, pose, biases and covariances."""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear_kernels import times, times_transposed
from surefoot.geometry.rotations import quat_from_matrix
from surefoot.kernels.jit import kernel

from ..feet.contact import BestGeometry
from ..health import Condition
from ..inputs.judge import faults_at
from ..output import healthy
from .cell import CONTACT_NS, FEET_NS, NOW_NS, Cell
from .run import settled
from .state import (
    ACC_BIAS,
    DOWN,
    E_POS,
    EXCESS,
    GYRO_BIAS,
    LAG,
    NIS,
    POS,
    REST,
    SEEN,
    VEL,
    BestState,
    rotation,
)

Array = NDArray[np.float64]

SLIDES = 0.5  # probability from which a foot is said to slide
LENGTH_SD = 0.01  # m/s^2, of the length of g, which the state takes as known


@kernel
def _covariances(rot: Array, cov: Array) -> tuple[Array, Array]:
    """Covariance of (g, v) in IMU axes (6, 6), and of x, y, z, yaw in odom (4, 4)."""
    by = np.zeros((6, 6))
    for i in range(3):
        by[i, 0], by[i, 1] = -GRAVITY * rot[1, i], GRAVITY * rot[0, i]
        for k in range(3):
            by[3 + i, 3 + k] = rot[k, i]
    block, pose, index = np.empty((6, 6)), np.empty((4, 4)), np.array([E_POS, E_POS + 1, E_POS + 2, 2])
    for i in range(6):
        for k in range(6):
            block[i, k] = cov[i, k]
    out = times_transposed(times(by, block), by)
    for i in range(3):
        for k in range(3):
            out[i, k] += LENGTH_SD**2 * rot[2, i] * rot[2, k]
    for i in range(4):
        for k in range(4):
            pose[i, k] = cov[index[i], index[k]]
    for i in range(6):
        for k in range(i):
            out[i, k] = out[k, i] = 0.5 * (out[i, k] + out[k, i])
    return out, pose


@kernel
def summary(state: BestState, geometry: BestGeometry, w: Array, feet: int) -> tuple[Array, Array, Array, Array]:
    """Return what is known.

    Vectors by rows (8, 3): g, v, position and velocity of base_link in odom, biases, (yaw, settled, samples at rest),
    (nis, excess, 0); its quaternion (4,) and the probability of sliding of each foot (L,) in one array; covariances as
    `_covariances`.

    Args:
        state: the state.
        geometry: of the robot.
        w: gyro, (3,) rad/s.
        feet: their number L.
    """
    x, points = state.x, state.points
    rot, rows, more = rotation(x), np.zeros((8, 3)), np.zeros(4 + feet)
    base, arm, turn, v_imu = np.zeros((3, 3)), np.zeros(3), np.zeros(3), np.zeros(3)
    for i in range(3):
        for k in range(3):
            v_imu[i] += rot[k, i] * x[VEL + k]
            turn[i] += rot[i, k] * (w[k] - x[GYRO_BIAS + k])
            for m in range(3):
                base[i, k] += rot[i, m] * geometry.rot_base_from_imu[k, m]
    for i in range(3):
        for k in range(3):
            arm[i] += base[i, k] * geometry.imu_position[k]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rows[0, i], rows[1, i] = GRAVITY * rot[2, i], v_imu[i] + state.memory[LAG + i]
        rows[2, i] = x[POS + i] - arm[i]
        rows[3, i] = x[VEL + i] - (turn[j] * arm[k] - turn[k] * arm[j])
        for m in range(3):
            rows[3, i] += rot[i, m] * state.memory[LAG + m]
        rows[4, i], rows[5, i] = x[GYRO_BIAS + i], x[ACC_BIAS + i]
    rows[6, 0] = math.atan2(base[1, 0], base[0, 0])
    rows[6, 1], rows[6, 2] = 1.0 if settled(state) else 0.0, state.memory[REST]
    rows[7, 0], rows[7, 1] = state.memory[NIS], state.memory[EXCESS]
    quat = quat_from_matrix(base)
    for i in range(4):
        more[i] = quat[i]
    count = np.zeros(feet)
    for k in range(points.shape[0]):
        if points[k, DOWN] > 0.0:
            more[4 + geometry.foot[k]] += points[k, SEEN]
            count[geometry.foot[k]] += 1.0
    for f in range(feet):
        more[4 + f] = more[4 + f] / count[f] if count[f] > 0.0 else math.nan
    covariance, pose = _covariances(rot, state.cov)
    return rows, more, covariance, pose


@kernel
def condition(cell: Cell, vectors: Array, more: Array, covariance: Array) -> Condition:
    """Return what flags and words are made of.

    Args:
        cell: the filter with its judge.
        vectors: of `summary`,
        more: the same,
        covariance: and its first covariance.
    """
    slipping, stamps = False, cell.clock.stamps
    for i in range(4, more.size):
        slipping = slipping or more[i] > SLIDES
    now = stamps[NOW_NS]
    since_contact_s = 1e-9 * (now - stamps[CONTACT_NS])
    return Condition(
        vectors[6, 1] > 0.0, vectors[6, 2] > 0.0, healthy(vectors[0], vectors[1], covariance), vectors[7, 0], slipping,
        vectors[7, 1], faults_at(cell.judge, cell.judge_limits, cell.noisy, now), 1e-9 * (now - stamps[FEET_NS]),
        since_contact_s, since_contact_s,
    )  # fmt: skip
