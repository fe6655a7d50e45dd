"""Corrections of the `best` filter: contact points, rest, level ground.

A contact point that stays is seen by the encoders at y (IMU axes): R y - r = xi-free up to its noise, so the innovation
z = R_hat y - r_hat has the matrix H = -I at the point's own rows. A point that slides is a second hypothesis: its place
has moved by N(0, Q), Q = (slide dt)^2. With the innovation covariances S_0 = P_rr + N and S_1 = S_0 + Q, and the prior
probability of sliding pi,

    w = pi L_1 / (pi L_1 + (1 - pi) L_0),   L_i = N(z; 0, S_i)

and the state becomes the mean of both corrections by w, its covariance that of the mixture. No sample is refused: a
point that slides still bounds the velocity by the speed at which things slide.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.linear_kernels import inverse3, times
from surefoot.kernels.jit import kernel
from surefoot.services.estimator.best_kernel import (
    ACC_BIAS,
    DOWN,
    E_ACC,
    E_GYRO,
    E_POINTS,
    E_POS,
    E_ROT,
    E_VEL,
    EXCESS,
    FREE,
    GYRO_BIAS,
    INNOVATION,
    LAG,
    LOSSES,
    MISFIT,
    NEW,
    NIS,
    POINTS,
    POS,
    ROT,
    SEEN,
    SINCE,
    SLIDE,
    UNFIT,
    VEL,
    BestNoise,
    BestState,
    forget_velocity,
    rotation,
    turn_matrix,
    turned,
)
from surefoot.services.estimator.contact import by_height
from surefoot.services.estimator.feet import foot_turn

Array = NDArray[np.float64]
Feet = NDArray[np.int64]

VERTICAL_SLIDE = 0.25  # share of the variance of sliding that is vertical
SLIDES, SLIDES_ON = 0.01, 0.9  # probabilities per sample that a foot begins to slide, and goes on: what is reported
OUTLIER = 16.0  # chi^2, 3 dof, 99.9 %: an innovation beyond it, even for a sliding point, is no honest sample
LONGEST = 0.12  # s without a sample of the feet, after which any of them may have stepped
UNKNOWN_SPEED = 1.0  # m/s
MOST_MISFITS = 3  # such samples in a row: the point is somewhere else now
MOST_LAG = 5.0  # noises of a point: a longer correction is no lag, but a mishap
MOST_EVIDENCE = 5.0  # one pair of innovations counts no more


@kernel
def lift(state: BestState, k: int) -> None:
    """Forget a contact point, in place."""
    row = E_POINTS + 3 * k
    for i in range(row, row + 3):
        for j in range(state.cov.shape[0]):
            state.cov[i, j] = 0.0
            state.cov[j, i] = 0.0
        state.cov[i, i] = FREE
    state.points[k, DOWN] = 0.0
    state.points[k, SLIDE] = 0.0
    state.points[k, MISFIT] = 0.0
    state.points[k, SEEN] = 0.0
    state.points[k, NEW] = 0.0


@kernel
def put_down(state: BestState, k: int, y: Array, noise: BestNoise) -> None:
    """A point came to rest at y (3,) m, IMU axes, in place: only the kinematics know where, so nothing correlates."""
    lift(state, k)
    seen = turned(rotation(state.x), y)
    for i in range(3):
        state.x[POINTS + 3 * k + i] = seen[i]
        state.cov[E_POINTS + 3 * k + i, E_POINTS + 3 * k + i] = noise.point**2
    state.points[k, DOWN], state.points[k, NEW] = 1.0, 1.0


@kernel
def retract(state: BestState, xi: Array) -> None:
    """Take the error xi (15 + 3 K,) out of the state, in place."""
    x, points, back = state.x, state.points, np.empty(3)
    for i in range(3):
        back[i] = -xi[E_ROT + i]
    turn = turn_matrix(back)
    rot = times(turn, rotation(x))
    for i in range(3):
        for k in range(3):
            x[ROT + 3 * i + k] = rot[i, k]
        back[i] = x[VEL + i] - xi[E_VEL + i]
        x[GYRO_BIAS + i] -= xi[E_GYRO + i]
        x[ACC_BIAS + i] -= xi[E_ACC + i]
        x[POS + i] -= xi[E_POS + i]
    v = turned(turn, back)
    for i in range(3):
        x[VEL + i] = v[i]
    for k in range(points.shape[0]):
        if points[k, DOWN] > 0.0:
            for i in range(3):
                back[i] = x[POINTS + 3 * k + i] - xi[E_POINTS + 3 * k + i]
            seen = turned(turn, back)
            for i in range(3):
                x[POINTS + 3 * k + i] = seen[i]


@kernel
def _quadratic(z: Array, inverse: Array) -> float:
    total = 0.0
    for i in range(3):
        for k in range(3):
            total += z[i] * inverse[i, k] * z[k]
    return total


@kernel
def _determinant(m: Array) -> float:
    return float(
        m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
        - m[0, 1] * (m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0])
        + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    )


@kernel
def observe(state: BestState, k: int, y: Array, contact: float, dt: float, noise: BestNoise, hypotheses: bool) -> float:
    """Correct with a standing point k seen at y, in place; see the head of this file.

    Args:
        state: the state.
        k: the point.
        y: where it is seen, (3,) m, IMU axes.
        contact: probability that it touches the ground.
        dt: time since the last sample, s.
        noise: the noises.
        hypotheses: False: every point stays, as in other filters (for ablation).

    Returns:
        Normalised innovation squared of the point if it stays, 3 degrees of freedom.
    """
    x, cov = state.x, state.cov
    row = E_POINTS + 3 * k
    z, shift = turned(rotation(x), y), np.empty(3)
    for i in range(3):
        z[i] -= x[POINTS + 3 * k + i]
        shift[i] = (noise.slide * dt) ** 2 * (1.0 if i < 2 else VERTICAL_SLIDE)
    stays, slides = np.empty((3, 3)), np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            stays[i, j] = slides[i, j] = cov[row + i, row + j]
        stays[i, i] += noise.point**2
        slides[i, i] += noise.point**2 + shift[i]
    inverse_1 = inverse3(slides)[0]
    misfit = _quadratic(z, inverse_1)
    if misfit > OUTLIER:
        state.points[k, MISFIT] = MOST_MISFITS if state.points[k, NEW] > 0.0 else state.points[k, MISFIT] + 1.0
        if state.points[k, MISFIT] >= MOST_MISFITS:
            return misfit
        wider = (z[0] ** 2 + z[1] ** 2 + z[2] ** 2) / 3.0  # a sample like that says little
        for i in range(3):
            stays[i, i] += wider
            slides[i, i] += wider
        inverse_1 = inverse3(slides)[0]
    else:
        state.points[k, MISFIT] = state.points[k, NEW] = 0.0
    inverse_0 = inverse3(stays)[0]
    nis, weight = _quadratic(z, inverse_0), 0.0
    if hypotheses:
        before = state.points[k, SLIDE]
        prior = before * noise.go_on + (1.0 - before) * noise.begin_slide
        prior = 1.0 - contact * (1.0 - prior)
        ratio = 0.5 * (nis - _quadratic(z, inverse_1) + math.log(_determinant(stays) / _determinant(slides)))
        odds = prior / max(1.0 - prior, 1e-9) * math.exp(min(ratio, 300.0))
        weight = odds / (1.0 + odds)
        seen = state.points[k, SEEN]
        seen = 1.0 - contact * (1.0 - seen * SLIDES_ON - (1.0 - seen) * SLIDES)
        odds = seen / max(1.0 - seen, 1e-9) * math.exp(min(ratio, 300.0))
        state.points[k, SEEN] = odds / (1.0 + odds)
        if state.points[k, MISFIT] == 0.0:
            state.points[k, SLIDE] = weight
    _mix(state, row, z, inverse_0, inverse_1, shift, weight)
    return nis


@kernel
def _mix(state: BestState, row: int, z: Array, inverse_0: Array, inverse_1: Array, shift: Array, weight: float) -> None:
    """Mean of the corrections of both hypotheses, `weight` = probability of the second, in place."""
    cov = state.cov
    n = cov.shape[0]
    seen_0, seen_1 = np.empty((n, 3)), np.empty((n, 3))  # cov H^T up to the sign
    for i in range(n):
        for j in range(3):
            seen_0[i, j] = seen_1[i, j] = cov[i, row + j]
    for i in range(3):
        seen_1[row + i, i] += shift[i]
    push_0, push_1 = turned(inverse_0, z), turned(inverse_1, z)
    xi, apart = np.empty(n), np.empty(n)
    gain_0, gain_1 = np.empty((n, 3)), np.empty((n, 3))
    stay = 1.0 - weight
    for i in range(n):
        a = -(seen_0[i, 0] * push_0[0] + seen_0[i, 1] * push_0[1] + seen_0[i, 2] * push_0[2])
        b = -(seen_1[i, 0] * push_1[0] + seen_1[i, 1] * push_1[1] + seen_1[i, 2] * push_1[2])
        xi[i], apart[i] = stay * a + weight * b, a - b
        for j in range(3):
            gain_0[i, j] = stay * (
                seen_0[i, 0] * inverse_0[0, j] + seen_0[i, 1] * inverse_0[1, j] + seen_0[i, 2] * inverse_0[2, j]
            )
            gain_1[i, j] = weight * (
                seen_1[i, 0] * inverse_1[0, j] + seen_1[i, 1] * inverse_1[1, j] + seen_1[i, 2] * inverse_1[2, j]
            )
    spread = weight * stay
    for i in range(n):
        for j in range(i + 1):
            cov[i, j] += (
                spread * apart[i] * apart[j]
                - (gain_0[i, 0] * seen_0[j, 0] + gain_0[i, 1] * seen_0[j, 1] + gain_0[i, 2] * seen_0[j, 2])
                - (gain_1[i, 0] * seen_1[j, 0] + gain_1[i, 1] * seen_1[j, 1] + gain_1[i, 2] * seen_1[j, 2])
            )
    for i in range(3):
        cov[row + i, row + i] += weight * shift[i]
    for i in range(n):
        for j in range(i):
            cov[j, i] = cov[i, j]
    retract(state, xi)


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
    memory[NIS] = _quadratic(z, inverse)
    for i in range(3):
        memory[INNOVATION + i] = z[i] / count
    evidence = min(max(evidence, -MOST_EVIDENCE), MOST_EVIDENCE)
    memory[EXCESS] = min(max(memory[EXCESS] * math.exp(noise.learn * (evidence - noise.drop)), 1.0), noise.most_excess)


@kernel
def twist_soles(state: BestState, foot: Feet, variance: float) -> None:
    """Add the turning of standing soles about the vertical, `variance` rad^2, to the covariance of their points.

    Friction holds a sole against tilting by the weight on it, against twisting by its small lever only.
    """
    x, cov, points = state.x, state.cov, state.points
    count, across = points.shape[0], np.zeros((points.shape[0], 2))
    for k in range(count):
        together = 0
        for m in range(count):
            if foot[m] == foot[k] and points[m, DOWN] > 0.0:
                together += 1
                across[k, 0] += x[POINTS + 3 * m + 1]
                across[k, 1] -= x[POINTS + 3 * m]
        if points[k, DOWN] > 0.0 and together > 1:  # z x (r_k - centre)
            across[k, 0] = across[k, 0] / together - x[POINTS + 3 * k + 1]
            across[k, 1] = across[k, 1] / together + x[POINTS + 3 * k]
        else:
            across[k, 0] = across[k, 1] = 0.0
    for k in range(count):
        for m in range(count):
            if foot[m] == foot[k]:
                for i in range(2):
                    for j in range(2):
                        cov[E_POINTS + 3 * k + i, E_POINTS + 3 * m + j] += variance * across[k, i] * across[m, j]


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
def take_points(
    state: BestState,
    y: Array,
    rot: Array,
    contact: Array,
    radius: Array,
    foot: Feet,
    noise: BestNoise,
    hypotheses: bool,
) -> Array:
    """Take one sample of all contact points, in place: roll, twist, correct, put down and lift.

    Args:
        state: the state at the stamp of the sample.
        y: contact points, (K, 3) m, IMU axes.
        rot: rot_imu_from_foot of each, (K, 3, 3).
        contact: probability that each touches the ground, (K,); below one half it is lifted. NaN: unknown, see
            `by_height`.
        radius: of round feet, (K,) m, 0 = does not roll.
        foot: the foot of each, (K,).
        noise: the noises.
        hypotheses: see `observe`.

    Returns:
        Normalised innovation squared of each point, (K,), NaN where there was none.
    """
    x, points, memory = state.x, state.points, state.memory
    count, here = points.shape[0], rotation(state.x)
    nis = np.full(count, np.nan)
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
    learn_excess(state, y, noise)
    standing, unfit = 0, 0
    for k in range(count):
        if points[k, DOWN] > 0.0:
            nis[k] = observe(state, k, y[k], contact[k], dt, noise, hypotheses)
            standing += 1
            unfit += points[k, MISFIT] > 0.0
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
    return nis
