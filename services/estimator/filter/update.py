"""Corrections of the `best` filter by a sample of all feet: rolling, twisting and sliding feet, excess, lag."""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.linear_kernels import inverse3, times
from surefoot.kernels.jit import kernel

from ..feet.contact import SURE, BestGeometry, by_height
from ..feet.kinematics import foot_turn
from .point import MOST_MISFITS, lift, observe, put_down, quadratic
from .sole import rock_soles, twist_soles
from .state import (
    ALONG,
    DOWN,
    E_POINTS,
    EXCESS,
    INNOVATION,
    LAG,
    LOSSES,
    MISFIT,
    NIS,
    POINTS,
    POS,
    SEEN,
    SINCE,
    SLIDE,
    SLIDE_PRODUCT,
    SLIDE_SQUARE,
    UNFIT,
    BestNoise,
    BestState,
    forget_velocity,
    rotation,
    turned,
)

Array = NDArray[np.float64]
Feet = NDArray[np.int64]

MOST_CARRIED = 3.0  # excess of the inertial noise beyond which the velocity of a slide is hardly learned
SWING = 0.2  # m/s, of a foot that may be in the air
LONGEST = 0.12  # s without a sample of the feet, after which any of them may have stepped
UNKNOWN_SPEED = 1.0  # m/s
MOST_LAG = 5.0  # noises of a point: a longer correction is no lag, but a mishap
KEEP = 0.99  # per sample, of what is remembered about slides
TRUSTED = 1e-4  # (m/s)^2, weight of the assumption that slides persist
LEAST_PERSISTENCE = 0.3  # below it no slide is expected to go on
MOST_GROWTH = 0.1  # of the logarithm of the excess by one pair of innovations


@kernel
def learn_excess(state: BestState, y: Array, noise: BestNoise) -> None:
    """Fit the excess of the inertial noise to what all standing points see in common, in place.

    The innovations of a filter whose noises are right do not correlate in time. If the mean innovation z of all points
    goes the same way again and again, the error is in the prediction: with S its covariance, the excess follows

        log excess += learn (z_k^T S^-1 z_(k-1)/3 - drop),   1 <= excess <= most_excess
    """
    x, cov, points, memory = state.x, state.cov, state.points, state.memory
    z, s, count, rot = np.zeros(3), np.zeros((3, 3)), 0, rotation(x)
    for k in range(points.shape[0]):
        if points[k, DOWN] > 0.0:
            seen = turned(rot, y[k])
            count += 1
            for i in range(3):
                z[i] += seen[i] - x[POINTS + 3 * k + i]
                s[i, i] += noise.point**2
            for m in range(points.shape[0]):
                if points[m, DOWN] > 0.0:
                    for i in range(3):
                        for j in range(3):
                            s[i, j] += cov[E_POINTS + 3 * k + i, E_POINTS + 3 * m + j]
    if count == 0:
        return
    inverse, evidence = inverse3(s)[0], 0.0
    for i in range(3):
        for j in range(3):
            evidence += count * z[i] * inverse[i, j] * memory[INNOVATION + j] / 3.0
    memory[NIS] = quadratic(z, inverse)
    for i in range(3):
        memory[INNOVATION + i] = z[i] / count
    most = MOST_GROWTH / noise.learn
    evidence = min(max(evidence, -most), most)
    memory[EXCESS] = min(max(memory[EXCESS] * math.exp(noise.learn * (evidence - noise.drop)), 1.0), noise.most_excess)


@kernel
def _loosen(state: BestState, contact: Array, foot: Feet, slides: int, slip: float, swing: float) -> None:
    """Let points move that slide, or hardly touch the ground, in place.

    Args:
        state: the state.
        contact: probability that each point touches the ground, (K,).
        foot: the foot of each.
        slides: bit f: foot f slides.
        slip: variance of the way of a sliding foot along each level axis, m^2; its points go together.
        swing: variance of the way of a point in the air along each axis, m^2.
    """
    cov, points = state.cov, state.points
    for k in range(points.shape[0]):
        if points[k, DOWN] == 0.0:
            continue
        row = E_POINTS + 3 * k
        for i in range(row, row + 3):
            cov[i, i] += max(SURE - contact[k], 0.0) * swing
        for m in range(points.shape[0]):
            if (slides >> foot[k]) & 1 and foot[m] == foot[k] and points[m, DOWN] > 0.0:
                for i in range(2):
                    cov[row + i, E_POINTS + 3 * m + i] += slip


@kernel
def follow(state: BestState, before: Array, noise: BestNoise) -> None:
    """Let the velocity follow the position: after a sample of the feet that moved it from `before` (3,) m, in place.

    Errors of the accelerometer that come with every step push velocity and position the same way again and again, and
    the feet take them out again. Corrections of the position that do not cancel are a velocity that was missed:

        lag' = -lag/T + R^T sum_k delta_k/T,   v_out = v + R lag

    with the correction delta_k of sample k, at most `MOST_LAG` points' noises long, and T = `lag_s`. The integral of
    v_out is the position.
    """
    rot, delta, length = rotation(state.x), np.empty(3), 0.0
    for i in range(3):
        delta[i] = state.x[POS + i] - before[i]
        length += delta[i] * delta[i]
    share = min(1.0, MOST_LAG * noise.point / math.sqrt(max(length, 1e-30))) / noise.lag_s
    for i in range(3):
        for j in range(3):
            state.memory[LAG + i] += share * rot[j, i] * delta[j]


@kernel
def persistence(memory: Array) -> float:
    """Return the share of the learned velocity s of a slide that is expected of the next sample, 0 to 1.

    A foot that is pushed slides on, one that rocks comes back. Over all samples of the feet, weighted by
    `KEEP` to the power of their age in samples, with m (2,) m/s the velocity that a sample showed and s that learned
    before it,

        rho = (sum m.s + p)/(sum s.s + p),   share = (rho - rho_0)/(1 - rho_0)

    with p = `TRUSTED` and rho_0 = `LEAST_PERSISTENCE`; `memory` is that of `BestState`.
    """
    rho = (memory[SLIDE_PRODUCT] + TRUSTED) / (memory[SLIDE_SQUARE] + TRUSTED)
    return float(min(max((rho - LEAST_PERSISTENCE) / (1.0 - LEAST_PERSISTENCE), 0.0), 1.0))


@kernel
def remember_slides(state: BestState) -> None:
    """Add m.s and s.s of a sample, see `persistence`, of all hypotheses by their weights to the sums, in place."""
    for i in (SLIDE_PRODUCT, SLIDE_SQUARE):
        state.memory[i] *= KEEP
        for h in range(state.weight.size):
            if state.weight[h] > 0.0:
                state.memory[i] += state.weight[h] * state.mode_memory[h, i]


@kernel
def _slide(state: BestState, foot: Feet, slides: int, dt: float, share: float) -> Array:
    """Move the points of sliding feet on as they have slid, in place; return where they were, (K, 2) m, odom axes."""
    before = np.empty((foot.size, 2))
    for k in range(foot.size):
        for i in range(2):
            before[k, i] = state.x[POINTS + 3 * k + i]
            if (slides >> foot[k]) & 1 and state.points[k, DOWN] > 0.0:
                state.x[POINTS + 3 * k + i] += share * state.points[k, ALONG + i] * dt
    return before


@kernel
def _learn_slide(state: BestState, foot: Feet, slides: int, before: Array, dt: float, gain: float) -> None:
    """Learn the velocity s (2,) m/s of each sliding foot from how a sample moved its points on average, in place.

        s += g (delta/dt - s),   g = gain/(1 + (excess/`MOST_CARRIED`)^4)

    The factor of `excess` reduces the gain where the inertial noise exceeds that of the sensor: its error looks like a
    slide. While two or more feet stand and all of them slide, s is zero: that is an error of the inertial unit. The
    products of delta/dt and s, and of s and s, are left in the memory for `remember_slides`.
    """
    points, down, sliding, last = state.points, 0, 0, -1
    for k in range(foot.size):
        if points[k, DOWN] > 0.0 and foot[k] != last:
            last = foot[k]
            down += 1
            sliding += (slides >> last) & 1
    gain /= 1.0 + (state.memory[EXCESS] / MOST_CARRIED) ** 4
    for k in range(foot.size):
        if points[k, DOWN] == 0.0:
            continue
        moved, count = np.zeros(2), 0
        for m in range(foot.size):
            if foot[m] == foot[k] and points[m, DOWN] > 0.0:
                count += 1
                for i in range(2):
                    moved[i] += state.x[POINTS + 3 * m + i] - before[m, i]
        for i in range(2):
            if (slides >> foot[k]) & 1 and (down < 2 or sliding < down):
                state.memory[SLIDE_PRODUCT] += moved[i] / (count * dt) * points[k, ALONG + i] / count
                state.memory[SLIDE_SQUARE] += points[k, ALONG + i] ** 2 / count
                points[k, ALONG + i] += gain * (moved[i] / (count * dt) - points[k, ALONG + i])
            else:
                points[k, ALONG + i] = 0.0


@kernel
def take_points(
    state: BestState,
    y: Array,
    rot: Array,
    contact: Array,
    closed: Feet,
    geometry: BestGeometry,
    noise: BestNoise,
    hypotheses: bool,
    slides: int,
    share: float,
) -> float:
    """Take one sample of all contact points, in place: roll, twist, slide, correct, put down and lift.

    Args:
        state: the state at the stamp of the sample.
        y: contact points, (K, 3) m, IMU axes.
        rot: rot_imu_from_foot of each, (K, 3, 3).
        contact: probability that each touches the ground, (K,); below one half it is lifted. NaN: unknown, see
            `by_height`.
        closed: switches of each foot that are closed, (L,), bit s for switch s.
        geometry: of the robot.
        noise: the noises.
        hypotheses: see `observe`.
        slides: bit f: foot f slides, in a state that is one of several hypotheses.
        share: of the learned velocity of a slide by which it goes on, see `persistence`.

    Returns:
        Logarithm of the likelihood of the sample up to a constant.
    """
    x, points, memory, foot, radius = state.x, state.points, state.memory, geometry.foot, geometry.radius
    count, here = points.shape[0], rotation(state.x)
    likely = 0.0
    dt = memory[SINCE]
    contact = by_height(here, y, radius, contact)
    for k in range(count):
        now = times(here, rot[k])
        if points[k, DOWN] > 0.0 and (contact[k] < 0.5 or dt > LONGEST or dt < 0.0):
            lift(state, k)
        if points[k, DOWN] > 0.0 and radius[k] > 0.0:
            turn = foot_turn(state.turn[k], now)
            x[POINTS + 3 * k] += turn[1] * radius[k]
            x[POINTS + 3 * k + 1] -= turn[0] * radius[k]
        for i in range(3):
            for j in range(3):
                state.turn[k, i, j] = now[i, j]
    twist_soles(state, foot, noise.twist**2 * dt)
    rocking = rock_soles(state, closed, geometry, (noise.rock * dt) ** 2)
    if not hypotheses:
        _loosen(state, contact, foot, slides, (noise.slip * dt) ** 2, (SWING * dt) ** 2)
        _loosen(state, contact, foot, rocking & ~slides, (noise.creep * dt) ** 2, 0.0)
    before = _slide(state, foot, slides, dt, share)
    if not hypotheses:
        memory[SLIDE_PRODUCT] = memory[SLIDE_SQUARE] = 0.0
    learn_excess(state, y, noise)
    standing, unfit = 0, 0
    for k in range(count):
        if points[k, DOWN] > 0.0:
            likely += observe(state, k, y[k], contact[k], dt, noise, hypotheses)[1]
            standing += 1
            unfit += points[k, MISFIT] > 0.0
    if not hypotheses and dt > 0.0:
        _learn_slide(state, foot, slides, before, dt, noise.carry)
    memory[UNFIT] = memory[UNFIT] + 1.0 if 0 < standing == unfit else 0.0
    lost = memory[UNFIT] >= MOST_MISFITS
    if lost:  # not the feet are somewhere else, the velocity is wrong
        forget_velocity(state, UNKNOWN_SPEED)
        memory[LOSSES] += 1.0
        memory[UNFIT] = 0.0
    for k in range(count):
        if points[k, DOWN] > 0.0 and (points[k, MISFIT] >= MOST_MISFITS or (lost and points[k, MISFIT] > 0.0)):
            put_down(state, k, y[k], noise)
            points[k, SLIDE] = points[k, SEEN] = 1.0
    for k in range(count):
        if contact[k] >= 0.5 and points[k, DOWN] == 0.0:
            put_down(state, k, y[k], noise)
    memory[SINCE] = 0.0
    return likely
