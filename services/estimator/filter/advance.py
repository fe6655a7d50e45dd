"""The `best` filter over rows of samples: rest, gaps, and the merge of inertial samples and feet by their stamps.

One kernel serves a tick of a live robot, the replay of the last half second after a late sample, and a whole log.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.kernels.jit import inner_kernel, kernel

from ..feet.contact import BestGeometry, SeenPoints, by_height, points_of
from ..params import GAP_PUSH, GAP_TURN, UNKNOWN_SPEED
from .external import take_external
from .ground import forget_levels
from .heading import keep_heading, learn_parting, take_back
from .hypotheses import collapse, likeliest, mix, mode, publish_mean, weigh
from .layout import CERTAIN, DOUBTED, MOVING, NO_FEET, STARTED, WAITING, E, M, P, S, X
from .level import stand_on_levels
from .monitor import believed, carried, judge_noise, watch_sensors
from .noise import FIXED, BestLimits, BestNoise, BestSetting
from .point import lift, retract
from .pose import grow_pose
from .rest import learn_end_of_rest, learn_gyro_bias, turns
from .samples import ROW_Q, ROW_W, SampleStore, after
from .speed import limit_speed
from .start import rests, start_at_rest, start_moving
from .state import BestState, Felt, felt_variance, forget_velocity, predict, rotation
from .tilt import check_rest, check_start, check_tilt
from .update import follow, persistence, remember_slides, take_points

Stamps = NDArray[np.int64]


@kernel
def stand_on_level(state: BestState, ground: float, radius: Array, sd: float) -> None:
    """Correct with the height of the standing points over a ground that is level everywhere, in place.

    p_z + r_z = ground + radius for each, p the IMU in odom and r the point from the IMU, with a standard deviation of
    `sd` per sample; errors by lifting feet, edges and dust last for several samples, so `sd` is several times the error
    of one foot.

    Args:
        state: state of the filter; changed.
        ground: height of the ground in odom, m.
        radius: radius of the foot sphere of each point, (K,) m; 0 for soles.
        sd: standard deviation of the height of a point per sample, m.
    """
    cov, points = state.cov, state.points
    n = cov.shape[0]
    for k in range(points.shape[0]):
        if points[k, P.down] == 0.0:
            continue
        row = E.points + 3 * k + 2
        r = state.x[X.points + 3 * k : X.points + 3 * k + 3]
        # r_hat - exp(xi_R) r = xi_k: the height also changes as r turns, xi_R x r
        by = np.empty(n)
        for j in range(n):
            by[j] = cov[j, E.pos + 2] + cov[j, row] + r[1] * cov[j, E.rot] - r[0] * cov[j, E.rot + 1]
        s = by[E.pos + 2] + by[row] + r[1] * by[E.rot] - r[0] * by[E.rot + 1] + sd * sd
        z = state.x[X.pos + 2] + r[2] - ground - radius[k]
        if z * z > FIXED.outlier * s:
            continue
        xi = np.empty(n)
        for j in range(n):
            gain = by[j] / s
            xi[j] = gain * z
            for m in range(n):
                cov[j, m] -= gain * by[m]
        retract(state, xi)


@kernel
def forget(state: BestState, d: float) -> None:
    """Forget velocity, contact points and ground levels of `state` after a gap of d s, in place; widen the position."""
    cov = state.cov
    for k in range(state.points.shape[0]):
        lift(state, k)
    for i in range(3):
        cov[E.pos + i, E.pos + i] += (UNKNOWN_SPEED * d) ** 2
    forget_velocity(state, UNKNOWN_SPEED)
    state.memory[M.since] = NO_FEET
    forget_levels(state.memory)


@kernel
def _cross_gap(state: BestState, d: float, before: Array, after_it: Array, limits: BestLimits) -> float:
    """Widen the covariance over a gap of inertial samples, in place; return the time left to predict, `d` or 0, s.

    A robot that turned at the ends of the gap, as one that is knocked over faster than its gyro can measure, may have
    turned on or not.

    Args:
        state: state of the filter; changed if the gap is longer than usual.
        d: length of the gap, s; steps up to `limits.gap_s` are no gap, beyond `limits.forget_s` velocity and feet go.
        before: gyro at the begin of the gap, IMU axes, (3,) rad/s.
        after_it: gyro at its end, IMU axes, (3,) rad/s.
        limits: limits of the filter.
    """
    cov = state.cov
    if d <= limits.gap_s:
        return d
    turn = GAP_TURN**2
    for i in range(3):
        turn += 0.25 * (before[i] ** 2 + after_it[i] ** 2)
    for i in range(3):
        cov[E.rot + i, E.rot + i] += turn * min(d, 1.0) ** 2
        cov[E.vel + i, E.vel + i] += (GAP_PUSH * min(d, 1.0)) ** 2
    if d <= limits.forget_s:
        return d
    forget(state, d)
    return 0.0


@kernel
def settled(state: BestState) -> bool:
    """Return True if the estimate in `state` can be used: started at rest, or in motion and certain by now."""
    memory, cov = state.memory, state.cov
    if memory[M.phase] == WAITING or memory[M.phase] == STARTED or memory[M.phase] == CERTAIN:
        return bool(memory[M.phase] != WAITING)
    tilt, speed = max(cov[0, 0], cov[1, 1]), max(cov[E.vel, E.vel], cov[E.vel + 1, E.vel + 1])
    return bool(memory[M.age] > FIXED.good_age and tilt < FIXED.good_tilt**2 and speed < FIXED.good_speed**2)


@kernel
def _lost_until(stamps: Stamps, at: int) -> int:
    """Return the stamp, ns, up to which samples before inertial row `at` are lost; that of row `at` - 1 if none are.

    `stamps`: of the inertial samples, (n,) ns, rising. The period is the shorter of the two steps before.
    """
    if at < 3:
        return stamps[max(at - 1, 0)]
    period = min(stamps[at - 1] - stamps[at - 2], stamps[at - 2] - stamps[at - 3])
    step = stamps[at] - stamps[at - 1]
    return stamps[at] - period if 2 * step > 3 * period else stamps[at - 1]


@kernel
def _hidden(rows: Array, at: int) -> tuple[float, float]:
    """Return variances, (rad/s)^2 and (m/s^2)^2, of gyro and accelerometer samples lost before row `at`.

    `rows`: gyro rad/s (3) and accelerometer m/s^2 (3) of each sample, IMU axes, (n, 6).
    """
    turn, push = 0.0, 0.0
    for i in range(3):
        j = ROW_W + i
        turn += (rows[at, j] - rows[at - 1, j]) ** 2 + (rows[at - 1, j] - rows[at - 2, j]) ** 2
        j = ROW_Q + i
        push += (rows[at, j] - rows[at - 1, j]) ** 2 + (rows[at - 1, j] - rows[at - 2, j]) ** 2
    return FIXED.lost_share * turn, FIXED.lost_share * push


@kernel
def _correct(
    state: BestState, seen: SeenPoints, setting: BestSetting, hypotheses: bool, slides: int, share: float
) -> float:
    """Correct one state with one sample of its points, in place; return the logarithm of its likelihood.

    Args:
        state: state of the filter, or one hypothesis of it, at the stamp of the sample; changed.
        seen: places and contacts of the contact points.
        hypotheses: True: each point may slide, staying and sliding are mixed; False: `slides` names the feet that
            slide.
        slides: bit f is set if foot f slides.
        share: share of the learned velocity of a slide by which it goes on, 0 to 1.
    """
    before, rot, limits = state.x[X.pos : X.pos + 3].copy(), rotation(state.x), setting.limits
    likely = take_points(state, seen, setting.geometry, setting.noise, hypotheses, slides, share)
    if math.isfinite(limits.level_sd):
        stand_on_level(state, limits.start.ground, setting.geometry.radius, limits.level_sd)
    take_back(state, rot)
    if settled(state):
        follow(state, before, setting.noise)
    return likely


@kernel
def _repeats(state: BestState, y: Array, contact: Array, closed: NDArray[np.int64], geometry: BestGeometry) -> bool:
    """Return True if a sample of the feet repeats the errors of the last one: soon after it, with equal contacts.

    Encoders, flexible legs and soles err alike for some 10 ms; to take every sample of a fast log would be to count one
    error many times.

    Args:
        state: state of the filter.
        y: contact points from the IMU, IMU axes, (K, 3) m.
        contact: probability that each touches the ground, (K,), NaN = unknown.
        closed: closed switches of each foot, (L,), bit s for switch s.
        geometry: contact points on the feet.
    """
    at = likeliest(state)
    memory, points = (state.memory, state.points) if at < 0 else (state.mode_memory[at], state.mode_points[at])
    if memory[M.since] < 0.0 or memory[M.since] >= FIXED.least_step:
        return False
    now = by_height(rotation(state.x if at < 0 else state.mode_x[at]), y, geometry.radius, contact)
    for k in range(now.size):
        if (now[k] >= 0.5) != (points[k, P.down] > 0.0) or closed[geometry.foot[k]] != points[k, P.closed]:
            return False
    return True


@kernel
def _take_feet(state: BestState, samples: SampleStore, row: int, setting: BestSetting) -> None:
    """Correct the state with row `row` of the samples of the feet, at the time of the state, in place."""
    geometry, noise = setting.geometry, setting.noise
    watch_sensors(state, samples, row, geometry.foot, settled(state))
    judge_noise(state, noise.stated_point)
    position, rot, closed = samples.feet[row].copy(), samples.foot_rots[row].copy(), samples.closed[row].copy()
    for f in range(position.shape[0]):
        source = int(state.sensors[f, S.source])
        position[f], rot[f] = samples.feet[row, source], samples.foot_rots[row, source]
        closed[f] = samples.closed[row, int(state.sensors[f, S.wired])]
    y, turn = points_of(geometry.foot, geometry.place, position, rot)
    contact = believed(state, samples, row, geometry.foot)
    at, losses = likeliest(state), state.memory[M.losses]
    dt = max(state.memory[M.since] if at < 0 else state.mode_memory[at, M.since], 0.0)
    if _repeats(state, y, contact, closed, geometry):
        return
    contact = by_height(rotation(state.x) if at < 0 else rotation(state.mode_x[at]), y, geometry.radius, contact)
    learn_parting(state, y, contact, geometry.foot)
    if at < 0 and (
        state.weight.size == 0 or state.memory[M.rest] > 0.0 or state.memory[M.lost_for] >= 0.0 or not settled(state)
    ):
        _correct(state, SeenPoints(y, turn, contact, closed), setting, setting.limits.hypotheses, 0, 1.0)
    else:
        losses = losses if at < 0 else state.mode_memory[at, M.losses]
        seen = SeenPoints(y, turn, contact, closed)
        mix(state, contact, geometry.foot, noise)
        likely, share = np.zeros(state.weight.size), persistence(state.memory)
        for h in range(state.weight.size):
            if state.weight[h] > 0.0:
                likely[h] = _correct(mode(state, h), seen, setting, False, h, share)
        weigh(state, likely)
        remember_slides(state)
        if state.mode_memory[likeliest(state), M.losses] > losses:
            collapse(state, geometry.foot)
    if setting.limits.levels and settled(state):
        stand_on_levels(state, geometry, dt, noise.lag_s)
    if state.memory[M.losses] > losses or state.memory[M.lost_for] > FIXED.lost_memory:
        check_tilt(state, setting, state.memory[M.losses] > losses)
    elif state.memory[M.woke] >= 0.0 and state.memory[M.age] - state.memory[M.woke] < FIXED.woken_s:
        check_start(state, contact, dt, setting)


@inner_kernel
def _predict_one(
    state: BestState, w: Array, q: Array, d: float, noise: BestNoise, felt: Felt, hidden: tuple[float, float]
) -> None:
    """Predict one state over `d` s by one inertial sample, in place; `hidden`: variances of lost samples."""
    predict(state, w, q, d, noise, felt)
    keep_heading(state, d)
    for i in range(3):
        state.cov[E.rot + i, E.rot + i] += hidden[0] * d * d
        state.cov[E.vel + i, E.vel + i] += hidden[1] * d * d


@inner_kernel
def _predict(
    state: BestState, w: Array, q: Array, d: float, noise: BestNoise, felt: Felt, hidden: tuple[float, float]
) -> None:
    """Predict the state, or each of its hypotheses, over `d` s by one inertial sample, in place.

    w, q: mean gyro, rad/s, and accelerometer, m/s^2, over the step, IMU axes, (3,); felt: variances that shocks add to
    them; hidden: variances of what lost samples may hide, (rad/s)^2 and (m/s^2)^2, 0 where none is lost.
    """
    if likeliest(state) < 0:
        _predict_one(state, w, q, d, noise, felt, hidden)
    for h in range(state.weight.size):
        if state.weight[h] > 0.0:
            _predict_one(mode(state, h), w, q, d, noise, felt, hidden)


@kernel
def _step(state: BestState, samples: SampleStore, at: int, next_foot: int, setting: BestSetting) -> int:
    """Predict the state to inertial row `at`, and correct it with the samples of the feet up to its stamp, in place.

    A sample of the feet is taken at its own stamp, between two parts of the inertial step in which it lies.

    Args:
        state: state of the filter at row `at` - 1; changed.
        samples: stored samples, filled rows only.
        at: inertial row.
        next_foot: first row of the feet that has not been taken.

    Returns:
        The first row of the feet that is left.
    """
    stamps, rows, feet_stamps, noise = samples.imu_stamps, samples.imu, samples.feet_stamps, setting.noise
    w, q = rows[at, ROW_W : ROW_W + 3].copy(), rows[at, ROW_Q : ROW_Q + 3].copy()
    now = stamps[at - 1] if at > 0 else stamps[at]
    felt = felt_variance(state.memory, w, q, noise)
    gap = 1e-9 * (stamps[at] - now)
    if gap > setting.limits.gap_s:
        collapse(state, setting.geometry.foot)
    if _cross_gap(state, gap, rows[max(at - 1, 0), ROW_W:ROW_Q], w, setting.limits) < gap:
        now = stamps[at]
    lost = _lost_until(stamps, at)
    if lost > now:
        for i in range(3):
            w[i], q[i] = 0.5 * (w[i] + rows[at - 1, ROW_W + i]), 0.5 * (q[i] + rows[at - 1, ROW_Q + i])
    while now < stamps[at] or (next_foot < feet_stamps.size and feet_stamps[next_foot] <= now):
        if next_foot < feet_stamps.size and feet_stamps[next_foot] <= now:
            _take_feet(state, samples, next_foot, setting)
            next_foot += 1
            continue
        end = lost if now < lost else stamps[at]
        if next_foot < feet_stamps.size:
            end = min(end, feet_stamps[next_foot])
        hidden = _hidden(rows, at) if now < lost else (0.0, 0.0)
        _predict(state, w, q, 1e-9 * (end - now), noise, felt, hidden)
        now = end
        if now == lost:
            w[:], q[:] = rows[at, ROW_W : ROW_W + 3], rows[at, ROW_Q : ROW_Q + 3]
    state.memory[M.age] += gap
    grow_pose(state, gap, noise)
    if settled(state) and state.memory[M.phase] != STARTED:  # it stays so; whoever was doubted keeps its pose
        old = state.memory[M.phase] == DOUBTED or state.memory[M.age] > FIXED.fresh_age
        state.memory[M.phase] = STARTED if old else CERTAIN
    return next_foot


@kernel
def _rest_or_start(state: BestState, samples: SampleStore, at: int, next_foot: int, setting: BestSetting) -> int:
    """Learn from a rest at inertial row `at`, or start there, in place; return the first row of the feet that is left.

    As long as the filter has not started, the feet (rows from `next_foot` on) up to the row are left out.
    """
    memory, limits, feet_stamps = state.memory, setting.limits, samples.feet_stamps
    resting = rests(samples, at, limits) and not (carried(memory) and turns(state, samples, at, limits))
    if not resting and memory[M.phase] == STARTED:
        learn_end_of_rest(state, samples.imu, at, setting.noise, limits)
    if memory[M.phase] == STARTED and memory[M.rest] > 0.0 and memory[M.excess] <= 1.0:
        memory[M.woke] = memory[M.age]
        memory[M.push : M.push + 3] = memory[M.wrong : M.wrong + 4] = 0.0
    memory[M.rest] = memory[M.rest] + 1.0 if resting else 0.0
    if resting:
        collapse(state, setting.geometry.foot)
        memory[M.lag : M.lag + 3] = 0.0
        if memory[M.phase] != WAITING and memory[M.rest] % limits.samples == 1.0:
            check_rest(state, samples.imu[at + 1 - limits.samples : at + 1], setting)
    moving = memory[M.phase] == MOVING or memory[M.phase] == CERTAIN
    fresh = moving and memory[M.age] < FIXED.fresh_age
    if resting and (fresh or not settled(state)) and memory[M.phase] != DOUBTED:
        start_at_rest(state, samples, at, setting)
    elif memory[M.phase] == WAITING:
        while next_foot < feet_stamps.size and feet_stamps[next_foot] <= samples.imu_stamps[at]:
            next_foot += 1
        if next_foot > 0:
            start_moving(state, samples, at, next_foot - 1, setting)
    elif memory[M.rest] > limits.samples:
        oldest = samples.imu[at + 1 - limits.samples, ROW_W:ROW_Q]
        learn_gyro_bias(state, oldest, 1, setting.noise, limits)
    return next_foot


@kernel
def advance(state: BestState, samples: SampleStore, begin: int, setting: BestSetting) -> None:
    """Advance the filter over the inertial rows from `begin` on and the other samples between them, in place.

    Args:
        state: state of the filter, as after row `begin` - 1; changed.
        samples: stored samples by rising stamps, filled rows only.
        begin: first inertial row to take.
        setting: geometry, noises and limits of the filter.
    """
    stamps, foot = samples.imu_stamps, setting.geometry.foot
    next_foot = after(samples.feet_stamps, stamps[begin - 1]) if begin > 0 else 0
    for at in range(begin, stamps.size):
        if state.memory[M.phase] != WAITING:
            next_foot = _step(state, samples, at, next_foot, setting)
            if samples.external_stamps.size > 0 and settled(state):
                take_external(state, samples, at, setting)
        limit_speed(state, foot, setting.limits.max_speed)
        next_foot = _rest_or_start(state, samples, at, next_foot, setting)
    publish_mean(state, foot)
