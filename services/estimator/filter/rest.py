"""Corrections of the `best` filter by a rest, in which the gyro measures its bias."""

import numpy as np

from surefoot.arrays import Array
from surefoot.kernels.jit import kernel

from .layout import E, M, X
from .monitor import LEAST_TURN
from .noise import BestLimits, BestNoise
from .point import retract
from .samples import ROW_W, SampleStore
from .state import BestState, rotation


@kernel
def turns(state: BestState, samples: SampleStore, at: int, limits: BestLimits) -> bool:
    """Return True if the robot turns evenly in the window of a rest that ends at inertial row `at`.

    The gyro is compared with its bias of the last rest: a fall faster than it can measure may spoil the present one.

    Args:
        state: state of the filter, with that bias.
        samples: stored samples.
        at: last row of the window.
        limits: limits of a rest, with its number of samples.
    """
    square = 0.0
    for i in range(3):
        rate = -state.memory[M.own_bias + i]
        for r in range(at + 1 - limits.samples, at + 1):
            rate += samples.imu[r, ROW_W + i] / limits.samples
        square += rate * rate
    return square > LEAST_TURN**2


@kernel
def learn_gyro_bias(state: BestState, w: Array, count: int, noise: BestNoise, limits: BestLimits) -> None:
    """Correct with the gyro of a robot at rest, about each axis u of odom, in place: u^T w = u^T b_w + noise.

    Servos settle under the weight of the robot, which tilts it but does not turn it: the noise about the vertical is
    smaller.

    Args:
        state: state of the filter; changed.
        w: mean of the gyro samples, IMU axes, (3,) rad/s.
        count: number of the samples.
        noise: noises and rates of the filter.
        limits: limits of a rest.
    """
    cov, n, rot = state.cov, state.cov.shape[0], rotation(state.x)
    sample_sq = (state.memory[M.shown] * noise.sample_gyro) ** 2
    for i in range(3):  # one axis after the other
        creep = limits.creep if i < 2 else limits.turn_creep
        xi, column, z, s = np.empty(n), np.empty(n), 0.0, (sample_sq + limits.samples * creep**2) / count
        for j in range(n):
            column[j] = (
                cov[j, E.gyro_bias] * rot[i, 0]
                + cov[j, E.gyro_bias + 1] * rot[i, 1]
                + cov[j, E.gyro_bias + 2] * rot[i, 2]
            )
        for j in range(3):
            z += rot[i, j] * (w[j] - state.x[X.gyro_bias + j])
            s += rot[i, j] * column[E.gyro_bias + j]
        for j in range(n):
            gain = column[j] / s
            xi[j] = -gain * z
            for m in range(n):
                cov[j, m] -= gain * column[m]
        retract(state, xi)
    for i in range(3):
        state.memory[M.own_bias + i] = state.x[X.gyro_bias + i]


@kernel
def learn_end_of_rest(state: BestState, rows: Array, at: int, noise: BestNoise, limits: BestLimits) -> None:
    """Learn the gyro bias from the last samples of a rest that ended before inertial row `at`, in place.

    In a rest each sample is used once it is as old as the window of a rest. When the rest ends, the samples of one
    window are still unused; those of its last fifth may belong to the first motion and are left out.

    Args:
        state: state of the filter; changed.
        rows: gyro rad/s (3) and accelerometer m/s^2 (3) of each sample, IMU axes, (n, 6).
        at: row after the rest.
        noise: noises and rates of the filter.
        limits: limits of a rest.
    """
    waiting = min(int(state.memory[M.rest]) - 1, limits.samples - 1)
    count = waiting - limits.samples // 5
    if count <= 0:
        return
    mean = np.zeros(3)
    for r in range(at - waiting, at - waiting + count):
        for i in range(3):
            mean[i] += rows[r, ROW_W + i] / count
    learn_gyro_bias(state, mean, count, noise, limits)
