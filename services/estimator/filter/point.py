"""Corrections of the `best` filter by one contact point.

A contact point that stays is seen by the encoders at y (IMU axes): R y - r = xi-free up to its noise, so the innovation
z = R_hat y - r_hat has the matrix H = -I at the point's own rows. A point that slides is a second hypothesis: its place
has moved by N(0, Q), Q = (slide dt)^2. With the innovation covariances S_0 = P_rr + N and S_1 = S_0 + Q, and the prior
probability of sliding pi,

    w = pi L_1 / (pi L_1 + (1 - pi) L_0),   L_i = N(z; 0, S_i)

and the state becomes the mean of both corrections by w, its covariance that of the mixture. No sample is refused: a
point that slides still bounds the velocity by the speed at which things slide. Where hypotheses are carried through
time (`best_modes`), each of them is corrected by itself, `observe` without hypotheses, and L_0 is its likelihood.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.linear_kernels import inverse3, times
from surefoot.kernels.jit import kernel

from .state import (
    ACC_BIAS,
    ALONG,
    DOWN,
    E_ACC,
    E_GYRO,
    E_POINTS,
    E_POS,
    E_ROT,
    E_VEL,
    FREE,
    GYRO_BIAS,
    MISFIT,
    NEW,
    POINTS,
    POS,
    ROT,
    SEEN,
    SLIDE,
    VEL,
    BestNoise,
    BestState,
    rotation,
    turn_matrix,
    turned,
)

Array = NDArray[np.float64]

VERTICAL_SLIDE = 0.25  # share of the variance of sliding that is vertical
SLIDES, SLIDES_ON = 0.01, 0.9  # probabilities per sample that a foot begins to slide, and goes on: what is reported
OUTLIER = 16.0  # chi^2, 3 dof, 99.9 %: an innovation beyond it, even for a sliding point, is no honest sample
MOST_MISFITS = 3  # such samples in a row: the point is somewhere else now


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
    state.points[k, NEW] = state.points[k, ALONG] = state.points[k, ALONG + 1] = 0.0


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
def quadratic(z: Array, inverse: Array) -> float:
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
def observe(
    state: BestState, k: int, y: Array, contact: float, dt: float, noise: BestNoise, hypotheses: bool
) -> tuple[float, float]:
    """Correct with a standing point k seen at y, in place; see the head of this file.

    Args:
        state: the state.
        k: the point.
        y: where it is seen, (3,) m, IMU axes.
        contact: probability that it touches the ground.
        dt: time since the last sample, s.
        noise: the noises.
        hypotheses: False: the point stays, or its slide is in the covariance already.

    Returns:
        Normalised innovation squared of the point if it stays, 3 degrees of freedom, and the logarithm of the
        likelihood of the sample up to a constant, for an outlier that of the largest honest innovation.
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
    misfit = quadratic(z, inverse_1)
    if misfit > OUTLIER:
        state.points[k, MISFIT] = MOST_MISFITS if state.points[k, NEW] > 0.0 else state.points[k, MISFIT] + 1.0
        if state.points[k, MISFIT] >= MOST_MISFITS:
            return misfit, -0.5 * (OUTLIER + math.log(_determinant(stays)))
        wider = (z[0] ** 2 + z[1] ** 2 + z[2] ** 2) / 3.0  # a sample like that says little
        for i in range(3):
            stays[i, i] += wider
            slides[i, i] += wider
        inverse_1 = inverse3(slides)[0]
    else:
        state.points[k, MISFIT] = state.points[k, NEW] = 0.0
    inverse_0 = inverse3(stays)[0]
    nis, weight = quadratic(z, inverse_0), 0.0
    likely = -0.5 * (min(nis, OUTLIER) + math.log(_determinant(stays)))
    if not hypotheses:
        _stay(state, row, z, inverse_0)
    else:
        before = state.points[k, SLIDE]
        prior = before * noise.go_on + (1.0 - before) * noise.begin_slide
        prior = 1.0 - contact * (1.0 - prior)
        ratio = 0.5 * (nis - quadratic(z, inverse_1) + math.log(_determinant(stays) / _determinant(slides)))
        odds = prior / max(1.0 - prior, 1e-9) * math.exp(min(ratio, 300.0))
        weight = odds / (1.0 + odds)
        seen = state.points[k, SEEN]
        seen = 1.0 - contact * (1.0 - seen * SLIDES_ON - (1.0 - seen) * SLIDES)
        odds = seen / max(1.0 - seen, 1e-9) * math.exp(min(ratio, 300.0))
        state.points[k, SEEN] = odds / (1.0 + odds)
        if state.points[k, MISFIT] == 0.0:
            state.points[k, SLIDE] = weight
        _mix(state, row, z, inverse_0, inverse_1, shift, weight)
    return nis, likely


@kernel
def _stay(state: BestState, row: int, z: Array, inverse: Array) -> None:
    """Correct with an innovation z (3,) m of the rows from `row` on and its inverse covariance (3, 3), in place."""
    cov = state.cov
    n = cov.shape[0]
    seen, gain, xi, push = np.empty((3, n)), np.empty((n, 3)), np.empty(n), turned(inverse, z)
    for i in range(n):
        for j in range(3):
            seen[j, i] = cov[i, row + j]
        xi[i] = -(seen[0, i] * push[0] + seen[1, i] * push[1] + seen[2, i] * push[2])
        for j in range(3):
            gain[i, j] = seen[0, i] * inverse[0, j] + seen[1, i] * inverse[1, j] + seen[2, i] * inverse[2, j]
    for i in range(n):
        a, b, c = gain[i, 0], gain[i, 1], gain[i, 2]
        for j in range(i + 1):  # along a row: what a processor does several at a time
            cov[i, j] -= a * seen[0, j] + b * seen[1, j] + c * seen[2, j]
    for i in range(n):
        for j in range(i):
            cov[j, i] = cov[i, j]
    retract(state, xi)


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
