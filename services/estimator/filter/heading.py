"""Heading of the `best` filter: by the gyro where the distance between standing feet changes, else by gyro and feet.

Only the difference of gyro and feet is observed: a gyro with the bias b about the vertical looks like feet that turn at
-b. Feet that creep, roll, or stand on legs of other lengths than stated turn step after step, and the distance between
them changes by as much, which a gyro bias does not cause.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.geometry.linear_kernels import times_transposed
from surefoot.kernels.jit import kernel

from .layout import E, M, P, X
from .noise import FIXED
from .state import BestState, rotation

Feet = NDArray[np.int64]


@kernel
def learn_parting(state: BestState, y: Array, contact: Array, foot: Feet) -> None:
    """Learn the rate at which the distance between standing feet changes, in place; a turn of the robot leaves it.

    While the same points of two or more feet stand, their mean square distance m from their middle stays. Feet that
    have stood together for t s, `least_stood` or longer, with m = m_0 at the beginning, show

        rate = log(m/m_0)/(2 t),   parting += min(t/T, 1) (rate^2 - parting),   T = `parting_s`

    Args:
        state: state of the filter; the mean square rate `parting` in its memory and in its hypotheses' is changed.
        y: contact points from the IMU, IMU axes, (K, 3) m.
        contact: probability that each stands, (K,); from one half on a point counts as standing.
        foot: index of the foot of each point, (K,).
    """
    memory, stands, count, feet, last = state.memory, 0, 0, 0, -1
    middle, apart = np.zeros(3), 0.0
    for k in range(foot.size):
        if contact[k] >= 0.5:
            stands |= 1 << k
            count += 1
            feet += foot[k] != last
            last = foot[k]
            for i in range(3):
                middle[i] += y[k, i]
    for k in range(foot.size):
        if contact[k] >= 0.5:
            for i in range(3):
                apart += (y[k, i] - middle[i] / count) ** 2 / count
    if feet < 2 or apart <= 0.0:
        stands = 0
    stood_for = memory[M.age] - memory[M.stood_since]
    if stands == int(memory[M.stood]) and stood_for >= 0.0:
        if stands > 0 and stood_for >= FIXED.least_stood:
            memory[M.rate] = math.log(apart / memory[M.apart]) / (2.0 * stood_for)
        return
    if int(memory[M.stood]) > 0 and stood_for >= FIXED.least_stood:
        memory[M.parting] += min(stood_for / FIXED.parting_s, 1.0) * (memory[M.rate] ** 2 - memory[M.parting])
        for h in range(state.weight.size):
            state.mode_memory[h, M.parting] = memory[M.parting]
    memory[M.stood], memory[M.stood_since], memory[M.apart], memory[M.rate] = stands, memory[M.age], apart, 0.0


@kernel
def gyro_share(memory: Array) -> float:
    """Return the weight of the gyro in the heading, 0 to 1; the feet have the remaining weight.

    It is rho^4/(rho^4 + rho_0^4), rho^2 the mean square rate at which standing feet part, rho_0 = 0.02/s; 0 if small.

    Args:
        memory: `BestState.memory`, (124,), which holds rho^2.
    """
    share = memory[M.parting] ** 2 / (memory[M.parting] ** 2 + FIXED.parting**4)
    return float(share) if share >= FIXED.no_share else 0.0


@kernel
def trusted_share(state: BestState) -> float:
    """Return the weight s of the gyro in the heading, 0 to 1; 0 before the first rest if the gyro bias is not near 0.

    Until the first rest the gyro bias is taken to be 0, unless its estimate b in `state` has (1 - s) |b| above
    `FIXED.own_unknown`: b comes from the feet, and counts as much as these.
    """
    memory, own, size_sq, share = state.memory, M.own_bias, 0.0, gyro_share(state.memory)
    if memory[own] == 0.0 and memory[own + 1] == 0.0 and memory[own + 2] == 0.0:
        for i in range(3):
            size_sq += state.x[X.gyro_bias + i] ** 2
    return share if (1.0 - share) ** 2 * size_sq <= FIXED.own_unknown**2 else 0.0


@kernel
def keep_heading(state: BestState, d: float) -> None:
    """Turn the heading so that it follows the gyro with its bias at the last rest over a step of d s, in place.

    The angle is s u^T (b - b_0) d with the share s of the gyro, the vertical u, the present estimate b of the gyro bias
    and the bias b_0 at the last rest. b itself stays: the velocity needs it, whether the gyro or the feet err. The
    variance of the heading in `state` grows as well.
    """
    x, share, angle = state.x, trusted_share(state), 0.0
    if share > 0.0:
        for i in range(3):
            angle += share * x[X.rot + 6 + i] * (x[X.gyro_bias + i] - state.memory[M.own_bias + i]) * d
        turn_heading(state, angle)
        sd = math.sqrt(state.cov[E.rot + 2, E.rot + 2]) + share * FIXED.own_sd * d
        state.cov[E.rot + 2, E.rot + 2] = sd * sd


@kernel
def take_back(state: BestState, before: Array) -> None:
    """Undo a part of the turn of the heading by a sample of the feet, in place: the share of the gyro (0 to 1).

    Args:
        state: state of the filter after a sample of the feet; changed.
        before: rot_odom_from_imu before the sample, (3, 3).
    """
    share = trusted_share(state)
    if share > 0.0:
        turn = times_transposed(rotation(state.x), before)
        turn_heading(state, -0.5 * share * (turn[1, 0] - turn[0, 1]))


@kernel
def turn_heading(state: BestState, angle: float) -> None:
    """Turn attitude, velocity and points of `state` about the vertical by `angle` rad, in place; the position stays."""
    x, c, s = state.x, math.cos(angle), math.sin(angle)
    for i in range(3):
        _turn(x, X.rot + i, X.rot + 3 + i, c, s)
    _turn(x, X.vel, X.vel + 1, c, s)
    for k in range(state.points.shape[0]):
        if state.points[k, P.down] > 0.0:
            _turn(x, X.points + 3 * k, X.points + 3 * k + 1, c, s)


@kernel
def _turn(x: Array, i: int, j: int, c: float, s: float) -> None:
    """Turn the pair x[i], x[j] of a state x (21 + 3 K,) by the angle of cosine c and sine s in its plane, in place."""
    x[i], x[j] = c * x[i] - s * x[j], s * x[i] + c * x[j]
