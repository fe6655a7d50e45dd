"""Corrections of the `best` filter by a sample of all feet: rolling, twisting and sliding feet, excess, lag."""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.geometry.linear_kernels import inverse3, times, turned
from surefoot.kernels.jit import kernel

from ..feet.contact import SURE, BestGeometry, SeenPoints, by_height
from ..feet.mount import foot_turn
from ..params import UNKNOWN_SPEED
from .layout import E, M, P, X
from .noise import FIXED, BestNoise
from .point import lift, observe, put_down
from .sole import rock_soles, turn_soles
from .state import BestState, forget_velocity, rotation

Feet = NDArray[np.int64]


@kernel
def learn_excess(state: BestState, y: Array, noise: BestNoise) -> None:
    """Fit the excess of the inertial noise, a factor >= 1, to what all standing points see in common, in place.

    The innovations of a filter whose noises are right do not correlate in time. If the mean innovation z of all points
    has one direction again and again, the error is in the prediction: with S its covariance, the excess follows

        e = z_k^T S^-1 z_(k-1)/3,   log excess += learn (rise max(e, 0) + min(e, 0) - drop)

    within 1 and `most_excess`; k counts the samples, the other names are fields of `noise`.

    Args:
        state: state of the filter; excess and last innovation in its memory are changed.
        y: contact points as the feet are seen now, from the IMU, IMU axes, (K, 3) m.
        noise: noises and rates of the filter.
    """
    x, cov, points, memory = state.x, state.cov, state.points, state.memory
    z, s, count, rot = np.zeros(3), np.zeros((3, 3)), 0, rotation(x)
    for k in range(points.shape[0]):
        if points[k, P.down] > 0.0:
            seen = turned(rot, y[k])
            count += 1
            for i in range(3):
                z[i] += seen[i] - x[X.points + 3 * k + i]
                s[i, i] += (memory[M.shown + 2] * noise.point) ** 2
            for m in range(points.shape[0]):
                if points[m, P.down] > 0.0:
                    for i in range(3):
                        for j in range(3):
                            s[i, j] += cov[E.points + 3 * k + i, E.points + 3 * m + j]
    if count == 0:
        return
    inverse, evidence = inverse3(s)[0], 0.0
    for i in range(3):
        for j in range(3):
            evidence += count * z[i] * inverse[i, j] * memory[M.innovation + j] / 3.0
    for i in range(3):
        memory[M.innovation + i] = z[i] / count
    most = FIXED.most_growth / noise.learn
    evidence = min(max(evidence, -most), most)
    growth = noise.learn * (max(evidence, noise.rise * evidence) - noise.drop)
    memory[M.excess] = min(max(memory[M.excess] * math.exp(growth), 1.0), noise.most_excess)


@kernel
def _loosen(state: BestState, contact: Array, foot: Feet, slides: int, slip: float, swing: float) -> None:
    """Widen the covariance of points that slide, or hardly touch the ground, in place.

    Args:
        state: state of the filter; its covariance is changed.
        contact: probability that each point touches the ground, (K,).
        foot: index of the foot of each point, (K,).
        slides: bit f is set if foot f slides.
        slip: variance of the displacement of a sliding foot along each level axis, m^2; its points move together.
        swing: variance of the displacement of a point in the air along each axis, m^2.
    """
    cov, points = state.cov, state.points
    for k in range(points.shape[0]):
        if points[k, P.down] == 0.0:
            continue
        row = E.points + 3 * k
        for i in range(row, row + 3):
            cov[i, i] += max(SURE - contact[k], 0.0) * swing
        for m in range(points.shape[0]):
            if (slides >> foot[k]) & 1 and foot[m] == foot[k] and points[m, P.down] > 0.0:
                for i in range(2):
                    cov[row + i, E.points + 3 * m + i] += slip


@kernel
def follow(state: BestState, before: Array, noise: BestNoise) -> None:
    """Learn the lag of the velocity from the correction of the position by a sample of the feet, in place.

    Errors of the accelerometer that come with every step push velocity and position in one direction again and again,
    and the feet correct them. Corrections of the position that do not cancel are a velocity that was missed:

        lag' = -lag/T + R^T sum_k delta_k/T,   v_out = v + R lag

    with the correction delta_k of the position by sample k, at most `most_lag` standard deviations of a point long, T =
    `lag_s`, and R the attitude. The integral of the published velocity v_out is the position. The decay -lag/T is
    applied in the prediction.

    Args:
        state: state of the filter after a sample of the feet; the lag in its memory is changed.
        before: position of the IMU in odom before the sample, (3,) m.
        noise: noises and rates of the filter.
    """
    rot, delta, length = rotation(state.x), np.empty(3), 0.0
    for i in range(3):
        delta[i] = state.x[X.pos + i] - before[i]
        length += delta[i] * delta[i]
    most = FIXED.most_lag * state.memory[M.shown + 2] * noise.point
    share = min(1.0, most / math.sqrt(max(length, 1e-30))) / noise.lag_s
    for i in range(3):
        for j in range(3):
            state.memory[M.lag + i] += share * rot[j, i] * delta[j]


@kernel
def persistence(memory: Array) -> float:
    """Return the share of the learned velocity s of a slide that is expected of the next sample, 0 to 1.

    A foot that is pushed slides on, one that rocks comes back. Over all samples of the feet, weighted by `slide_memory`
    to the power of their age in samples, with m (2,) m/s the velocity that a sample showed and s that learned before
    it,

        rho = (sum m.s + p)/(sum s.s + p),   share = (rho - rho_0)/(1 - rho_0)

    with p = `slide_trust` and rho_0 = `least_persistence`, clipped to 0 and 1.

    Args:
        memory: `BestState.memory`, (124,), which holds both sums.
    """
    rho = (memory[M.slide_product] + FIXED.slide_trust) / (memory[M.slide_square] + FIXED.slide_trust)
    return float(min(max((rho - FIXED.least_persistence) / (1.0 - FIXED.least_persistence), 0.0), 1.0))


@kernel
def remember_slides(state: BestState) -> None:
    """Add m.s and s.s of a sample of the feet to their decaying sums in the memory of the state, in place.

    m is the level velocity of a slide that the sample shows, s the one that was learned before it, m/s; both products
    are means over the hypotheses about sliding feet by their probabilities.
    """
    for i in (M.slide_product, M.slide_square):
        state.memory[i] *= FIXED.slide_memory
        for h in range(state.weight.size):
            if state.weight[h] > 0.0:
                state.memory[i] += state.weight[h] * state.mode_memory[h, i]


@kernel
def _slide(state: BestState, foot: Feet, slides: int, dt: float, share: float) -> Array:
    """Move the standing points of sliding feet by their learned velocity, in place; return the earlier points.

    Args:
        state: state of the filter; level places of the points are changed.
        foot: index of the foot of each point, (K,).
        slides: bit f is set if foot f slides.
        dt: time since the last sample of the feet, s.
        share: share of the learned velocity of a slide by which it goes on, 0 to 1.

    Returns:
        x and y of each point from the IMU, odom axes, (K, 2) m.
    """
    before = np.empty((foot.size, 2))
    for k in range(foot.size):
        for i in range(2):
            before[k, i] = state.x[X.points + 3 * k + i]
            if (slides >> foot[k]) & 1 and state.points[k, P.down] > 0.0:
                state.x[X.points + 3 * k + i] += share * state.points[k, P.along + i] * dt
    return before


@kernel
def _learn_slide(state: BestState, foot: Feet, slides: int, before: Array, dt: float, gain: float) -> None:
    """Learn the velocity s (2,) m/s of each sliding foot from how a sample moved its points on average, in place.

        s += g (delta/dt - s),   g = gain/(1 + (excess/`most_carried`)^4)

    with delta the mean displacement of its points. The gain is smaller where the inertial noise exceeds that of the
    sensor (excess > 1), because its error looks like a slide. While two or more feet stand and all of them slide, s is
    zero: that is an error of the inertial unit. Products of delta/dt and s, and of s and s, are added in the memory of
    the state.

    Args:
        state: state of the filter, corrected by the sample; slide velocities and memory are changed.
        foot: index of the foot of each point, (K,).
        slides: bit f is set if foot f slides.
        before: x and y of each point before the sample, odom axes, (K, 2) m.
        dt: time since the last sample of the feet, s.
        gain: share of the sample in s without excess, 0 to 1.
    """
    points, down, sliding, last = state.points, 0, 0, -1
    for k in range(foot.size):
        if points[k, P.down] > 0.0 and foot[k] != last:
            last = foot[k]
            down += 1
            sliding += (slides >> last) & 1
    gain /= 1.0 + (state.memory[M.excess] / FIXED.most_carried) ** 4
    for k in range(foot.size):
        if points[k, P.down] == 0.0:
            continue
        moved, count = np.zeros(2), 0
        for m in range(foot.size):
            if foot[m] == foot[k] and points[m, P.down] > 0.0:
                count += 1
                for i in range(2):
                    moved[i] += state.x[X.points + 3 * m + i] - before[m, i]
        for i in range(2):
            if (slides >> foot[k]) & 1 and (down < 2 or sliding < down):
                state.memory[M.slide_product] += moved[i] / (count * dt) * points[k, P.along + i] / count
                state.memory[M.slide_square] += points[k, P.along + i] ** 2 / count
                points[k, P.along + i] += gain * (moved[i] / (count * dt) - points[k, P.along + i])
            else:
                points[k, P.along + i] = 0.0


@kernel
def _roll(state: BestState, seen: SeenPoints, contact: Array, radius: Array, dt: float) -> None:
    """Lift points that may have stepped, and roll round feet since the last sample of the feet, in place.

    Args:
        state: state of the filter; points and stored rotations of the feet are changed.
        seen: contact points at the sample.
        contact: probability that each touches the ground, (K,); below one half a point is lifted.
        radius: radius of the foot sphere of each point, (K,) m; 0: it does not roll.
        dt: time since the last sample of the feet, s; all points are lifted if it is negative or too long.
    """
    here = rotation(state.x)
    for k in range(contact.size):
        now = times(here, seen.rot[k])
        if state.points[k, P.down] > 0.0 and (contact[k] < 0.5 or dt > FIXED.longest_gap or dt < 0.0):
            lift(state, k)
        if state.points[k, P.down] > 0.0 and radius[k] > 0.0:
            turn = foot_turn(state.turn[k], now)
            state.x[X.points + 3 * k] += turn[1] * radius[k]
            state.x[X.points + 3 * k + 1] -= turn[0] * radius[k]
        state.turn[k] = now


@kernel
def _observe_points(
    state: BestState, y: Array, contact: Array, dt: float, noise: BestNoise, hypotheses: bool
) -> tuple[float, bool]:
    """Correct with all standing points in place; return the logarithm of the likelihood, and if none of them fitted.

    The mean normalised innovation squared follows those of the points in `surprise_s`, each `most_surprise` at most.

    Args:
        state: state of the filter; changed.
        y: places of the points from the IMU, IMU axes, (K, 3) m.
        contact: probability that each touches the ground, (K,).
        dt: time since the last sample, s.
        noise: noises and rates of the filter.
        hypotheses: True: a point may slide, and both corrections are mixed; False: slides are in the covariance
            already.
    """
    likely, standing, unfit, surprise = 0.0, 0, 0, 0.0
    for k in range(contact.size):
        if state.points[k, P.down] > 0.0:
            misfit, one = observe(state, k, y[k], contact[k], dt, noise, hypotheses)
            likely += one
            surprise += min(misfit, FIXED.most_surprise)
            standing += 1
            unfit += state.points[k, P.misfit] > 0.0
    if standing > 0 and dt > 0.0:
        state.memory[M.nis] += min(dt / FIXED.surprise_s, 1.0) * (surprise / standing - state.memory[M.nis])
    return likely, 0 < standing == unfit


@kernel
def _put_down_points(state: BestState, y: Array, contact: Array, unfit: bool, noise: BestNoise) -> None:
    """Put points down that touch the ground anew or do not fit any more, in place.

    Where no point fits for several samples, the velocity is wrong rather than the feet, and is forgotten.

    Args:
        state: state of the filter; changed.
        y: places of the points from the IMU, IMU axes, (K, 3) m.
        contact: probability that each touches the ground, (K,).
        unfit: True if no standing point fitted this sample.
        noise: noises and rates of the filter.
    """
    points, memory = state.points, state.memory
    memory[M.unfit] = memory[M.unfit] + 1.0 if unfit else 0.0
    lost = memory[M.unfit] >= FIXED.most_misfits
    if lost:
        forget_velocity(state, UNKNOWN_SPEED)
        memory[M.losses] += 1.0
        memory[M.unfit] = 0.0
    for k in range(contact.size):
        misfit = points[k, P.misfit]
        if points[k, P.down] > 0.0 and (misfit >= FIXED.most_misfits or (lost and misfit > 0.0)):
            put_down(state, k, y[k], noise)
            points[k, P.slide] = points[k, P.seen] = 1.0
    for k in range(contact.size):
        if contact[k] >= 0.5 and points[k, P.down] == 0.0:
            put_down(state, k, y[k], noise)


@kernel
def take_points(
    state: BestState, seen: SeenPoints, geometry: BestGeometry, noise: BestNoise, hypotheses: bool, slides: int,
    share: float,
) -> float:  # fmt: skip
    """Take one sample of all contact points, in place: roll, twist, slide, correct, put down and lift.

    Args:
        state: state of the filter at the stamp of the sample; changed.
        seen: the points; one with a contact below one half is lifted, of an unknown contact (NaN) its height decides.
        geometry: contact points on the feet, and mounting of the IMU.
        noise: noises and rates of the filter.
        hypotheses: True: each point may slide, staying and sliding are mixed; False: `slides` names the feet that
            slide.
        slides: bit f is set if foot f slides, in a state that is one of several hypotheses.
        share: share of the learned velocity of a slide by which it goes on, 0 to 1.

    Returns:
        Logarithm of the likelihood of the sample up to a constant.
    """
    foot, memory, dt = geometry.foot, state.memory, state.memory[M.since]
    contact = by_height(rotation(state.x), seen.y, geometry.radius, seen.contact)
    _roll(state, seen, contact, geometry.radius, dt)
    turn_soles(state, geometry, noise, dt)
    rocking = rock_soles(state, seen.closed, geometry, (noise.rock * dt) ** 2)
    if not hypotheses:
        _loosen(state, contact, foot, slides, (noise.slip * dt) ** 2, (FIXED.swing * dt) ** 2)
        _loosen(state, contact, foot, rocking & ~slides, (noise.creep * dt) ** 2, 0.0)
    before = _slide(state, foot, slides, dt, share)
    if not hypotheses:
        memory[M.slide_product] = memory[M.slide_square] = 0.0
    learn_excess(state, seen.y, noise)
    likely, unfit = _observe_points(state, seen.y, contact, dt, noise, hypotheses)
    if not hypotheses and dt > 0.0:
        _learn_slide(state, foot, slides, before, dt, noise.carry)
    _put_down_points(state, seen.y, contact, unfit, noise)
    memory[M.since] = 0.0
    return likely
