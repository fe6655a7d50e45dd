"""Levels of the ground of the `best` filter: a foot that comes down on a level known before shows the height again.

The height of the IMU follows from one footstep to the next, so that a few millimetres of each step add up. A floor, a
stair or a box is level, and most feet come down where others have stood: the filter remembers at which heights h_j feet
stood, and with which variance s_j of the height at that time. A foot that comes down at the height z of variance P has
drifted since by z - h_j, of variance D = P - s_j, up to the variance n of the height of a step:

    g = D/(D + n),   height -= g (z - h_j),   variance: s_j + D n/(D + n)

which is a Kalman correction of all that correlates with the height, by R = P n/D, plus g s_j, as the variance of the
level's own height remains. Feet that stand on one level are equally high, which shows the tilt.

Rough ground and slopes have no levels. Feet that stand at the same time show this independently of the drift of the
height. Their differences of height on one level are regressed on their distances: the coefficients are the slope of the
ground, the rms of the residuals is the unevenness u (for two feet, and at a stand, u is the rms of the differences, as
a slope would explain them all). n = (n_0 + u^2)^2/n_0 with n_0 = `FIXED.step_sd`^2. Nothing is corrected on a slope, or
under a foot that is off the level by more than u.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.kernels.jit import kernel

from ..feet.contact import BestGeometry
from .ground import learn_sinking
from .hypotheses import likeliest, mode
from .layout import LEVEL, LEVELS, E, M, P, X
from .noise import FIXED
from .point import retract
from .slope import learn_level_way
from .state import BestState, rotation

Feet = NDArray[np.int64]


@kernel
def _middle(state: BestState, foot: Feet, f: int) -> tuple[Array, int]:
    """Return the mean position (3,) m of the standing points of foot f, from the IMU, odom axes, and their number.

    `foot`: index of the foot of each contact point, (K,).
    """
    middle, count = np.zeros(3), 0
    for k in range(foot.size):
        if foot[k] == f and state.points[k, P.down] > 0.0:
            count += 1
            for i in range(3):
                middle[i] += state.x[X.points + 3 * k + i]
    return middle / max(count, 1), count


@kernel
def _height(state: BestState, geometry: BestGeometry, f: int, by: Array) -> tuple[float, float]:
    """Return the height in odom, m, of the ground under foot f, and its variance, m^2, 0 if the foot does not stand.

    Args:
        state: state of the filter.
        geometry: contact points on the feet.
        f: index of the foot.
        by: (n,), overwritten by the covariances of that height with the errors of the state, order of `ErrorLayout`.
    """
    cov, foot = state.cov, geometry.foot
    r, count = _middle(state, foot, f)
    radius = 0.0
    for j in range(cov.shape[0]):
        by[j] = cov[j, E.pos + 2] + r[1] * cov[j, E.rot] - r[0] * cov[j, E.rot + 1]
    for k in range(foot.size):
        if foot[k] == f and state.points[k, P.down] > 0.0:
            radius = geometry.radius[k]
            for j in range(cov.shape[0]):
                by[j] += cov[j, E.points + 3 * k + 2] / count
    return state.x[X.pos + 2] + r[2] - radius, _along(state, foot, f, by) if count > 0 else 0.0


@kernel
def _along(state: BestState, foot: Feet, f: int, by: Array) -> float:
    """Return the covariance of some quantity with the height of the ground under foot f.

    Args:
        state: state of the filter.
        foot: index of the foot of each contact point, (K,).
        f: index of the foot.
        by: covariances of the quantity with the errors of the state, (n,), order of `ErrorLayout`.
    """
    r, count = _middle(state, foot, f)
    out = by[E.pos + 2] + r[1] * by[E.rot] - r[0] * by[E.rot + 1]
    for k in range(foot.size):
        if foot[k] == f and state.points[k, P.down] > 0.0:
            out += by[E.points + 3 * k + 2] / count
    return float(out)


@kernel
def _landed(points: Array, foot: Feet, f: int) -> bool:
    """Return True if foot f stands firmly and has no ground level yet; `points` (K, 11): `BestState.points`."""
    count = 0
    for k in range(foot.size):
        if foot[k] == f and points[k, P.down] > 0.0:
            count += 1
            if points[k, P.stood] < FIXED.settles or points[k, P.new] > 0.0 or points[k, P.level] > 0.0:
                return False
    return count > 0


@kernel
def _slope(memory: Array) -> tuple[float, float]:
    """Return the slope of the ground along x and y of odom, rad, by feet that stood at the same time; 0 before any did.

    `memory`: `BestState.memory`, (124,), which holds the sums of a plane fit through pairs of feet.
    """
    s, guess = M.slope, (FIXED.step_sd / FIXED.slope_sd) ** 2
    a, b, c = memory[s] + guess, memory[s + 1], memory[s + 2] + guess
    det = a * c - b * b
    return (c * memory[s + 3] - b * memory[s + 4]) / det, (a * memory[s + 4] - b * memory[s + 3]) / det


@kernel
def _steepness(memory: Array) -> float:
    """Return the angle of the slope of the ground, rad; `memory`: `BestState.memory`, (124,)."""
    x, y = _slope(memory)
    return math.sqrt(x * x + y * y)


@kernel
def _step_noise(memory: Array) -> float:
    """Return the variance, m^2, of the height at which one step lands on a level of the ground.

    It is (n_0 + u^2)^2/n_0, n_0 the variance on flat ground and u^2 the unevenness in `BestState.memory` (124,).
    """
    return float((FIXED.step_sd**2 + memory[M.uneven]) ** 2 / FIXED.step_sd**2)


@kernel
def _learn_ground(state: BestState, likely: BestState, geometry: BestGeometry, f: int) -> bool:
    """Learn unevenness and slope of the ground from foot f and the other feet that stand on known levels, in place.

    Args:
        state: state of the filter; its memory is changed.
        likely: its likeliest hypothesis, or the state itself if there is none.
        geometry: contact points on the feet.
        f: index of the foot that has come down.

    Returns:
        True if the foot stands on a level, as far as the others show it: it is no further off than the ground is
        uneven, and the ground has no slope.
    """
    memory, foot, last = state.memory, geometry.foot, -1
    own, _ = _middle(likely, foot, f)
    square, count = 0.0, 0
    walks = foot[foot.size - 1] > 1 and memory[M.sunk + 1] > 0.0  # on more than two feet
    ahead, aside = _slope(memory) if walks else (0.0, 0.0)
    for k in range(foot.size):
        if foot[k] == last or foot[k] == f or likely.points[k, P.down] == 0.0 or likely.points[k, P.level] == 0.0:
            continue
        last = foot[k]
        other, _ = _middle(likely, foot, last)
        x, y, rise = own[0] - other[0], own[1] - other[1], own[2] - other[2]
        level, off = memory[M.levels + LEVEL * (int(likely.points[k, P.level]) - 1)], FIXED.same_level
        for j in range(LEVELS):
            at = M.levels + LEVEL * j
            if memory[at + 1] > 0.0:
                off = min(off, abs(rise - ahead * x - aside * y - (memory[at] - level)))
        if off < FIXED.same_level:
            square += off * off
            count += 1
        if abs(rise) < FIXED.same_level:
            s = M.slope
            memory[s] += x * x
            memory[s + 1] += x * y
            memory[s + 2] += y * y
            memory[s + 3] += x * rise
            memory[s + 4] += y * rise
    flat = square <= count * FIXED.level_gate * max(memory[M.uneven], FIXED.least_uneven**2)
    if count > 0:
        memory[M.uneven] += FIXED.learn_ground * (square / count - memory[M.uneven])
        for i in range(M.slope, M.slope + 5):
            memory[i] *= 1.0 - FIXED.learn_ground
    return flat and _steepness(memory) < FIXED.most_slope


@kernel
def _stand_on(
    state: BestState, geometry: BestGeometry, f: int, level: float, known: float, noise: float, lag_s: float
) -> None:
    """Correct with foot f that stands on a known level of the ground, in place.

    Its height z of variance P has drifted since by z - h, of variance D = P - s, up to the variance n of a step:

        g = D/(D + n),   height -= g (z - h),   variance of the height: s + D n/(D + n)

    Args:
        state: state of the filter, or one hypothesis; changed.
        geometry: contact points on the feet.
        f: index of the foot.
        level: height h of the level in odom, m.
        known: its variance s, m^2.
        noise: variance n of the height of a step, m^2.
        lag_s: finite where feet sink: time constant, s, with which the velocity learns what is taken off the height;
            no rotation and no bias that tilts are corrected then, for the foot that is taken first would turn the trunk
            at each step.
    """
    cov, height, n = state.cov, state.x[X.pos + 2], state.cov.shape[0]
    by, xi = np.empty(n), np.empty(n)
    z, variance = _height(state, geometry, f, by)
    drift = variance - known
    if drift <= 0.0:
        return
    share, sinks, gain = drift / (drift + noise), 1.0 if math.isfinite(lag_s) else 0.0, np.empty(n)
    for j in range(n):
        tilts = E.rot <= j < E.rot + 3 or E.acc_bias <= j < E.acc_bias + 3
        gain[j] = share * by[j] / variance * (1.0 - sinks if tilts else 1.0)
        xi[j] = gain[j] * (z - level)
    for j in range(n):
        held = sinks * (by[j] - gain[j] * variance / share)  # 0 where the gain is that of Kalman
        for m in range(n):
            cov[j, m] -= gain[j] * by[m] + held * gain[m]
    cov[E.pos + 2, E.pos + 2] += share * known
    retract(state, xi)
    rot = rotation(state.x)
    for i in range(3):
        state.memory[M.lag + i] += rot[2, i] * (state.x[X.pos + 2] - height) / lag_s


@kernel
def _stand_even(state: BestState, geometry: BestGeometry, f: int, other: int, noise: float) -> None:
    """Correct with two feet that stand on one level: they are equally high, which shows the tilt, in place.

    Args:
        state: state of the filter, or one hypothesis; changed.
        geometry: contact points on the feet.
        f: index of one foot.
        other: index of the other foot.
        noise: variance of the difference of their heights, m^2.
    """
    cov = state.cov
    n = cov.shape[0]
    by, by_other, xi = np.empty(n), np.empty(n), np.empty(n)
    z, known = _height(state, geometry, f, by)
    z_other, known_other = _height(state, geometry, other, by_other)
    if known == 0.0 or known_other == 0.0:
        return
    for j in range(n):
        by[j] -= by_other[j]
    variance = _along(state, geometry.foot, f, by) - _along(state, geometry.foot, other, by) + noise
    for j in range(n):
        gain = by[j] / variance
        xi[j] = gain * (z - z_other)
        for m in range(n):
            cov[j, m] -= gain * by[m]
    retract(state, xi)


@kernel
def _nearest(memory: Array, z: float) -> int:
    """Return the index of the level in `BestState.memory` (124,) nearest to height z, m, in odom; -1: none known."""
    best = -1
    for j in range(LEVELS):
        at = M.levels + LEVEL * j
        if memory[at + 1] > 0.0 and (best < 0 or abs(memory[at] - z) < abs(memory[M.levels + LEVEL * best] - z)):
            best = j
    return best


@kernel
def _new_level(memory: Array, z: float, variance: float) -> int:
    """Store a level of height z m and its variance, m^2, over the one not stood on for longest; return its index.

    `memory`: `BestState.memory`, (124,); changed.
    """
    oldest = 0
    for j in range(LEVELS):
        if memory[M.levels + LEVEL * j + 3] < memory[M.levels + LEVEL * oldest + 3]:
            oldest = j
    at = M.levels + LEVEL * oldest
    memory[at], memory[at + 1], memory[at + 2] = z, variance, 1.0
    return oldest


@kernel
def _even_out(state: BestState, likely: BestState, geometry: BestGeometry, f: int, level: float) -> None:
    """Correct with foot f and each other foot that stands on its level of the ground, in place.

    Args:
        state: state of the filter; it, or each of its hypotheses, is changed.
        likely: its likeliest hypothesis, or the state itself if there is none.
        geometry: contact points on the feet.
        f: index of the foot.
        level: 1 + index of the level, as in `PointLayout.level`.
    """
    last = -1
    noise = _step_noise(state.memory) * (FIXED.level_sd / FIXED.step_sd) ** 2  # the feet err alike at every step
    for k in range(geometry.foot.size):
        other = geometry.foot[k]
        if other in (last, f) or likely.points[k, P.down] == 0.0 or likely.points[k, P.level] != level:
            continue
        last = other
        if likeliest(state) < 0:
            _stand_even(state, geometry, f, other, noise)
        for h in range(state.weight.size):
            if state.weight[h] > 0.0:
                _stand_even(mode(state, h), geometry, f, other, noise)


@kernel
def stand_on_levels(state: BestState, geometry: BestGeometry, dt: float, lag_s: float) -> None:
    """Correct the height by a known level of the ground under each foot that has just come down, in place.

    A level is a height on which feet have stood before; a foot on none of them makes a new one.

    Args:
        state: state of the filter after a sample of the feet; it, its hypotheses and the known levels are changed.
        geometry: contact points on the feet.
        dt: time since the last sample of the feet, s.
        lag_s: time constant with which the velocity learns from corrections of the position, s.
    """
    memory, foot, at = state.memory, geometry.foot, likeliest(state)
    likely, by = state if at < 0 else mode(state, at), np.empty(state.cov.shape[0])
    _grow_old(state, dt)
    if memory[M.landed_foot] > 0.0:
        z, variance = _height(likely, geometry, int(memory[M.landed_foot]) - 1, by)
        memory[M.landed] = z if variance > 0.0 else memory[M.landed]
        memory[M.landed_foot] *= 1.0 if variance > 0.0 else 0.0
    if likely.memory[M.nis] > FIXED.outlier:  # the feet contradict each other or the inertial unit
        return
    last = -1
    for k in range(foot.size):
        f = foot[k]
        if f == last or not _landed(likely.points, foot, f):
            continue
        last = f
        flat = _learn_ground(state, likely, geometry, f)
        z, variance = _height(likely, geometry, f, by)
        learn_sinking(state, likely.x[X.vel : X.vel + 3], z, _steepness(memory) if flat else math.inf)
        sinks, levelled = memory[M.sinks] != 0.0, False
        found, noise = _nearest(memory, z), _step_noise(memory)
        level = M.levels + LEVEL * found
        if found < 0 or abs(z - memory[level]) > FIXED.same_level:
            found = _new_level(memory, z, variance)
            level = M.levels + LEVEL * found
        elif flat:
            height, known = memory[level], memory[level + 1]
            drift = max(variance - known, 0.0)
            levelled = sinks or (z - height) ** 2 < FIXED.level_gate * (drift + noise)
            if levelled:
                if at < 0:
                    _stand_on(state, geometry, f, height, known, noise, lag_s if sinks else math.inf)
                for h in range(state.weight.size):
                    if state.weight[h] > 0.0:
                        _stand_on(mode(state, h), geometry, f, height, known, noise, lag_s if sinks else math.inf)
                _even_out(state, likely, geometry, f, found + 1.0)
                memory[level + 2] += 1.0
                if not sinks:
                    memory[level] += noise / (drift + noise) * (z - height) / memory[level + 2]
        memory[level + 3] = memory[M.landed_at] = memory[M.age]
        memory[M.landed], _ = _height(likely, geometry, f, by)
        memory[M.landed_foot] = f + 1.0
        learn_level_way(memory, likely.x, levelled)
        for m in range(foot.size):
            if foot[m] == f:
                state.points[m, P.level] = found + 1.0
                for h in range(state.weight.size):
                    state.mode_points[h, m, P.level] = found + 1.0


@kernel
def _grow_old(state: BestState, dt: float) -> None:
    """Add dt s to the time for which each contact point stands, in `state` and its hypotheses, in place."""
    for k in range(state.points.shape[0]):
        state.points[k, P.stood] += dt
        for h in range(state.weight.size):
            state.mode_points[h, k, P.stood] += dt
