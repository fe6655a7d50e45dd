"""The `best` filter over rows of samples: rest, gaps, and the merge of inertial samples and feet by their stamps.

One kernel serves a tick of a live robot, the replay of the last half second after a late sample, and a whole log.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import inner_kernel, kernel

from ..feet.contact import BestGeometry, by_height, points_of
from ..inputs.timeline import after
from .hypotheses import collapse, likeliest, mix, mode, publish_mean, weigh
from .point import OUTLIER, lift, retract
from .start import (
    ROW_Q,
    ROW_W,
    BestLimits,
    judge_tilt,
    rests,
    start_at_rest,
    start_moving,
)
from .state import (
    AGE,
    DOUBTED,
    DOWN,
    E_GYRO,
    E_POINTS,
    E_POS,
    E_ROT,
    E_VEL,
    GYRO_BIAS,
    LAG,
    LOSSES,
    LOST_FOR,
    NO_FEET,
    PHASE,
    POINTS,
    POS,
    REST,
    SINCE,
    STARTED,
    VEL,
    WAITING,
    BestNoise,
    BestState,
    felt_variance,
    forget_velocity,
    predict,
    rotation,
)
from .update import UNKNOWN_SPEED, follow, persistence, remember_slides, take_points

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

GOOD_TILT, GOOD_SPEED, GOOD_AGE = 0.03, 0.05, 2.0  # rad, m/s, s: a moving start has settled
LOST_SHARE = 0.2  # of the squared changes of the samples around lost ones, the variance of their mean
GAP_TURN = 0.1  # rad/s, unseen turning in a gap
GAP_PUSH = 1.0  # m/s^2, unseen acceleration in a gap


@kernel
def stand_on_level(state: BestState, ground: float, radius: Array, sd: float) -> None:
    """Correct with the height of the standing points over a ground that is level everywhere, in place.

    p_z + r_z = ground + radius for each, with a standard deviation of `sd` m per sample; feet that are about to lift,
    edges and dust repeat themselves, so it is to be several times what a foot is off.
    """
    cov, points = state.cov, state.points
    n = cov.shape[0]
    for k in range(points.shape[0]):
        if points[k, DOWN] == 0.0:
            continue
        row = E_POINTS + 3 * k + 2
        r = state.x[POINTS + 3 * k : POINTS + 3 * k + 3]
        # r_hat - exp(xi_R) r = xi_k: the height also changes as r turns, xi_R x r
        by = np.empty(n)
        for j in range(n):
            by[j] = cov[j, E_POS + 2] + cov[j, row] + r[1] * cov[j, E_ROT] - r[0] * cov[j, E_ROT + 1]
        s = by[E_POS + 2] + by[row] + r[1] * by[E_ROT] - r[0] * by[E_ROT + 1] + sd * sd
        z = state.x[POS + 2] + r[2] - ground - radius[k]
        if z * z > OUTLIER * s:
            continue
        xi = np.empty(n)
        for j in range(n):
            gain = by[j] / s
            xi[j] = gain * z
            for m in range(n):
                cov[j, m] -= gain * by[m]
        retract(state, xi)


@kernel
def learn_gyro_bias(state: BestState, w: Array, count: int, noise: BestNoise, limits: BestLimits) -> None:
    """Correct with the gyro of a robot at rest, about each axis u of odom, in place: u^T w = u^T b_w + noise.

    Servos settle under the weight of the robot, which tilts it but does not turn it: the noise about the vertical is
    smaller.

    Args:
        state: the state.
        w: mean of the samples, (3,) rad/s, IMU axes.
        count: number of the samples.
        noise: the noises.
        limits: of a rest.
    """
    cov, n, rot = state.cov, state.cov.shape[0], rotation(state.x)
    for i in range(3):  # one axis after the other
        creep = limits.creep if i < 2 else limits.turn_creep
        xi, column, z, s = np.empty(n), np.empty(n), 0.0, (noise.sample_gyro**2 + limits.samples * creep**2) / count
        for j in range(n):
            column[j] = cov[j, E_GYRO] * rot[i, 0] + cov[j, E_GYRO + 1] * rot[i, 1] + cov[j, E_GYRO + 2] * rot[i, 2]
        for j in range(3):
            z += rot[i, j] * (w[j] - state.x[GYRO_BIAS + j])
            s += rot[i, j] * column[E_GYRO + j]
        for j in range(n):
            gain = column[j] / s
            xi[j] = -gain * z
            for m in range(n):
                cov[j, m] -= gain * column[m]
        retract(state, xi)


@kernel
def _learn_end_of_rest(state: BestState, rows: Array, at: int, noise: BestNoise, limits: BestLimits) -> None:
    """Learn from what is left of a rest that ended before row `at`, in place.

    While it lasts each sample waits until it is as old as the window of a rest; of those that wait when it ends the
    last fifth may be of the first motion.
    """
    waiting = min(int(state.memory[REST]) - 1, limits.samples - 1)
    count = waiting - limits.samples // 5
    if count <= 0:
        return
    mean = np.zeros(3)
    for r in range(at - waiting, at - waiting + count):
        for i in range(3):
            mean[i] += rows[r, ROW_W + i] / count
    learn_gyro_bias(state, mean, count, noise, limits)


@kernel
def forget(state: BestState, d: float) -> None:
    """Forget velocity and feet after a gap of d s, in which the robot may have gone anywhere, in place."""
    cov = state.cov
    for k in range(state.points.shape[0]):
        lift(state, k)
    for i in range(3):
        cov[E_POS + i, E_POS + i] += (UNKNOWN_SPEED * d) ** 2
    forget_velocity(state, UNKNOWN_SPEED)
    state.memory[SINCE] = NO_FEET


@kernel
def _cross_gap(state: BestState, d: float, limits: BestLimits) -> float:
    """Widen the covariance over a gap of d s between inertial samples, in place; return the step to predict, s."""
    cov = state.cov
    if d <= limits.gap_s:
        return d
    for i in range(3):
        cov[E_ROT + i, E_ROT + i] += (GAP_TURN * min(d, 1.0)) ** 2
        cov[E_VEL + i, E_VEL + i] += (GAP_PUSH * min(d, 1.0)) ** 2
    if d <= limits.forget_s:
        return d
    forget(state, d)
    return 0.0


@kernel
def settled(state: BestState) -> bool:
    """Whether the estimate can be used: started at rest, or in motion and meanwhile certain."""
    memory, cov = state.memory, state.cov
    if memory[PHASE] == WAITING or memory[PHASE] == STARTED:
        return bool(memory[PHASE] == STARTED)
    tilt, speed = max(cov[0, 0], cov[1, 1]), max(cov[E_VEL, E_VEL], cov[E_VEL + 1, E_VEL + 1])
    return bool(memory[AGE] > GOOD_AGE and tilt < GOOD_TILT**2 and speed < GOOD_SPEED**2)


@kernel
def _lost_until(stamps: Stamps, at: int) -> int:
    """Stamp up to which inertial samples before row `at` are lost; that of the row before if there are none.

    The period is the shorter of the two steps before.
    """
    if at < 3:
        return stamps[max(at - 1, 0)]
    period = min(stamps[at - 1] - stamps[at - 2], stamps[at - 2] - stamps[at - 3])
    step = stamps[at] - stamps[at - 1]
    return stamps[at] - period if 2 * step > 3 * period else stamps[at - 1]


@kernel
def _hidden(rows: Array, at: int) -> tuple[float, float]:
    """Variances, (rad/s)^2 and (m/s^2)^2, of what inertial samples lost before row `at` may hide."""
    turn, push = 0.0, 0.0
    for i in range(3):
        j = ROW_W + i
        turn += (rows[at, j] - rows[at - 1, j]) ** 2 + (rows[at - 1, j] - rows[at - 2, j]) ** 2
        j = ROW_Q + i
        push += (rows[at, j] - rows[at - 1, j]) ** 2 + (rows[at - 1, j] - rows[at - 2, j]) ** 2
    return LOST_SHARE * turn, LOST_SHARE * push


@kernel
def _correct(
    state: BestState, y: Array, turn: Array, contact: Array, closed: Stamps, geometry: BestGeometry, noise: BestNoise,
    limits: BestLimits, hypotheses: bool, slides: int, share: float,
) -> float:  # fmt: skip
    """Correct one state with one sample of its points, in place; return the logarithm of its likelihood."""
    before = state.x[POS : POS + 3].copy()
    likely = take_points(state, y, turn, contact, closed, geometry, noise, hypotheses, slides, share)
    if math.isfinite(limits.level_sd):
        stand_on_level(state, limits.start[3], geometry.radius, limits.level_sd)
    if settled(state):
        follow(state, before, noise)
    return likely


@kernel
def _take_feet(
    state: BestState, feet: Array, rots: Array, contact: Array, closed: Stamps, geometry: BestGeometry,
    noise: BestNoise, limits: BestLimits,
) -> None:  # fmt: skip
    """Correct with one sample of the feet at the time of the state, in place; arguments as rows of `advance`."""
    y, turn = points_of(geometry.foot, geometry.place, feet, rots)
    at, losses = likeliest(state), state.memory[LOSSES]
    if at < 0 and (
        state.weight.size == 0 or state.memory[REST] > 0.0 or state.memory[LOST_FOR] >= 0.0 or not settled(state)
    ):
        _correct(state, y, turn, contact, closed, geometry, noise, limits, limits.hypotheses, 0, 1.0)
    else:
        losses = losses if at < 0 else state.mode_memory[at, LOSSES]
        rot = rotation(state.x) if at < 0 else rotation(state.mode_x[at])
        contact = by_height(rot, y, geometry.radius, contact)
        mix(state, contact, geometry.foot, noise)
        likely, share = np.zeros(state.weight.size), persistence(state.memory)
        for h in range(state.weight.size):
            if state.weight[h] > 0.0:
                likely[h] = _correct(mode(state, h), y, turn, contact, closed, geometry, noise, limits, False, h, share)
        weigh(state, likely)
        remember_slides(state)
        if state.mode_memory[likeliest(state), LOSSES] > losses:
            collapse(state, geometry.foot)
    if state.memory[LOSSES] > losses:
        judge_tilt(state, limits)


@inner_kernel
def _predict_one(
    state: BestState, w: Array, q: Array, d: float, noise: BestNoise, felt: float, hidden: tuple[float, float]
) -> None:
    predict(state, w, q, d, noise, felt)
    for i in range(3):
        state.cov[E_ROT + i, E_ROT + i] += hidden[0] * d * d
        state.cov[E_VEL + i, E_VEL + i] += hidden[1] * d * d


@inner_kernel
def _predict(
    state: BestState, w: Array, q: Array, d: float, noise: BestNoise, felt: float, hidden: tuple[float, float]
) -> None:
    """Carry the state, or each of its hypotheses, over d s, in place; see `predict` and `_hidden`."""
    if likeliest(state) < 0:
        _predict_one(state, w, q, d, noise, felt, hidden)
    for h in range(state.weight.size):
        if state.weight[h] > 0.0:
            _predict_one(mode(state, h), w, q, d, noise, felt, hidden)


@kernel
def _speed(x: Array, memory: Array) -> float:
    """Return an upper bound of the speed that is published of a state, m/s, from two of its arrays."""
    v, lag = 0.0, 0.0
    for i in range(3):
        v += x[VEL + i] ** 2
        lag += memory[LAG + i] ** 2
    return math.sqrt(v) + math.sqrt(lag)


@inner_kernel
def _limit_speed(state: BestState, foot: NDArray[np.int64], most: float) -> None:
    """Forget a velocity that no robot has, in place."""
    fastest = _speed(state.x, state.memory) if likeliest(state) < 0 else 0.0
    for h in range(state.weight.size):
        if state.weight[h] > 0.0:
            fastest = max(fastest, _speed(state.mode_x[h], state.mode_memory[h]))
    if fastest > most:
        collapse(state, foot)
        forget_velocity(state, UNKNOWN_SPEED)


@kernel
def advance(
    state: BestState,
    stamps: Stamps,
    rows: Array,
    feet_stamps: Stamps,
    feet: Array,
    foot_rots: Array,
    contact: Array,
    closed: Stamps,
    begin: int,
    geometry: BestGeometry,
    noise: BestNoise,
    limits: BestLimits,
) -> None:
    """Take the inertial rows from `begin` on, and the feet between them, in place.

    A sample of the feet is taken at its own stamp, between two parts of the inertial step in which it lies.

    Args:
        state: as after row `begin` - 1.
        stamps: of the inertial rows, (n,) ns, rising.
        rows: gyro (3) rad/s and accelerometer (3) m/s^2, IMU axes, (n, 6), means up to their stamps.
        feet_stamps: of the samples of the feet, (m,) ns, rising.
        feet: positions, (m, L, 3) m, IMU axes.
        foot_rots: rot_imu_from_foot, (m, L, 3, 3).
        contact: probability of contact of each contact point, (m, K).
        closed: switches of each foot that are closed, (m, L), bit s for switch s.
        begin: first row to take.
        geometry: of the robot.
        noise: of the filter.
        limits: of start and rest.
    """
    memory = state.memory
    next_foot = after(feet_stamps, stamps[begin - 1]) if begin > 0 else 0
    w, q = np.empty(3), np.empty(3)
    for at in range(begin, stamps.size):
        for i in range(3):
            w[i], q[i] = rows[at, ROW_W + i], rows[at, ROW_Q + i]
        now = stamps[at - 1] if at > 0 else stamps[at]
        if memory[PHASE] != WAITING:
            felt = felt_variance(memory, w, noise)
            gap = 1e-9 * (stamps[at] - now)
            if gap > limits.gap_s:
                collapse(state, geometry.foot)
            if _cross_gap(state, gap, limits) < gap:
                now = stamps[at]
            lost = _lost_until(stamps, at)
            if lost > now:
                for i in range(3):
                    w[i], q[i] = 0.5 * (w[i] + rows[at - 1, ROW_W + i]), 0.5 * (q[i] + rows[at - 1, ROW_Q + i])
            while now < stamps[at] or (next_foot < feet_stamps.size and feet_stamps[next_foot] <= now):
                if next_foot < feet_stamps.size and feet_stamps[next_foot] <= now:
                    _take_feet(
                        state, feet[next_foot], foot_rots[next_foot], contact[next_foot], closed[next_foot], geometry,
                        noise, limits,
                    )  # fmt: skip
                    next_foot += 1
                    continue
                end = lost if now < lost else stamps[at]
                if next_foot < feet_stamps.size:
                    end = min(end, feet_stamps[next_foot])
                hidden = _hidden(rows, at) if now < lost else (0.0, 0.0)
                _predict(state, w, q, 1e-9 * (end - now), noise, felt, hidden)
                now = end
                if now == lost:
                    for i in range(3):
                        w[i], q[i] = rows[at, ROW_W + i], rows[at, ROW_Q + i]
            memory[AGE] += gap
        _limit_speed(state, geometry.foot, limits.max_speed)
        resting = rests(rows, stamps, at, feet, feet_stamps, limits)
        if not resting and memory[PHASE] == STARTED:
            _learn_end_of_rest(state, rows, at, noise, limits)
        memory[REST] = memory[REST] + 1.0 if resting else 0.0
        if resting:
            collapse(state, geometry.foot)
            for i in range(LAG, LAG + 3):
                memory[i] = 0.0
        if resting and not settled(state) and memory[PHASE] != DOUBTED:
            start_at_rest(
                state, rows, at, feet_stamps, stamps, feet, foot_rots, contact, geometry, noise, limits
            )  # fmt: skip
        elif memory[PHASE] == WAITING:
            while next_foot < feet_stamps.size and feet_stamps[next_foot] <= stamps[at]:
                next_foot += 1
            if next_foot > 0:
                start_moving(state, q, w, next_foot - 1, feet, foot_rots, contact, geometry, limits)
        elif memory[REST] > limits.samples:
            learn_gyro_bias(state, rows[at + 1 - limits.samples, :3], 1, noise, limits)
    publish_mean(state, geometry.foot)
