"""Corrections of the `best` filter by one contact point.

A contact point that stays is measured by the encoders at y (IMU axes): R y - r is zero up to noise, so the innovation
z = R_hat y - r_hat has the matrix H = -I at the point's own rows. A point that slides is a second hypothesis: its place
has moved by N(0, Q), Q = (slide dt)^2. With the innovation covariances S_0 = P_rr + N and S_1 = S_0 + Q, and the prior
probability of sliding pi,

    w = pi L_1 / (pi L_1 + (1 - pi) L_0),   L_i = N(z; 0, S_i)

and the state becomes the mean of both corrections by w, its covariance that of the mixture. No sample is refused: a
point that slides still bounds the velocity by the speed at which things slide. Where hypotheses are carried through
time (`hypotheses`), each of them is corrected by itself, `observe` without hypotheses, and L_0 is its likelihood.
"""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.linear_kernels import inverse3, quadratic, times, turned
from surefoot.kernels.jit import kernel

from .layout import E, M, P, X
from .noise import FIXED, BestNoise
from .state import BestState, isolate, rotation, set_rotation, turn_matrix


@kernel
def lift(state: BestState, k: int) -> None:
    """Mark contact point k of `state` as off the ground and its place as unknown, in place; its mistrust stays."""
    isolate(state.cov, E.points + 3 * k, 3, FIXED.free)
    for column in range(P.closed):
        state.points[k, column] = 0.0


@kernel
def put_down(state: BestState, k: int, y: Array, noise: BestNoise) -> None:
    """Put contact point k down where it is seen, in place; its error correlates with no other.

    Args:
        state: state of the filter, or one hypothesis; changed.
        k: index of the point.
        y: place of the point from the IMU, IMU axes, (3,) m.
        noise: noises and rates of the filter.
    """
    lift(state, k)
    seen = turned(rotation(state.x), y)
    for i in range(3):
        state.x[X.points + 3 * k + i] = seen[i]
        state.cov[E.points + 3 * k + i, E.points + 3 * k + i] = (state.memory[M.shown + 2] * noise.point) ** 2
    state.points[k, P.down], state.points[k, P.new] = 1.0, 1.0


@kernel
def retract(state: BestState, xi: Array) -> None:
    """Subtract the error xi from the state, in place.

    Attitude, velocity and points are turned by exp(-[xi_R]), xi_R the first three numbers; all else is subtracted.

    Args:
        state: state of the filter, or one hypothesis; changed.
        xi: error, (15 + 3 K,) in the order of `ErrorLayout`: rotation rad, velocity m/s, gyro bias rad/s, accelerometer
            bias m/s^2, position m, contact points m; errors of the frame of another source, m and rad, may follow.
    """
    x, points, back = state.x, state.points, np.empty(3)
    for i in range(3):
        back[i] = -xi[E.rot + i]
    turn = turn_matrix(back)
    rot = times(turn, rotation(x))
    set_rotation(x, rot)
    for i in range(3):
        back[i] = x[X.vel + i] - xi[E.vel + i]
        x[X.gyro_bias + i] -= xi[E.gyro_bias + i]
        x[X.acc_bias + i] -= xi[E.acc_bias + i]
        x[X.pos + i] -= xi[E.pos + i]
    v = turned(turn, back)
    for i in range(3):
        x[X.vel + i] = v[i]
    for k in range(points.shape[0]):
        if points[k, P.down] > 0.0:
            for i in range(3):
                back[i] = x[X.points + 3 * k + i] - xi[E.points + 3 * k + i]
            seen = turned(turn, back)
            for i in range(3):
                x[X.points + 3 * k + i] = seen[i]
    end = 3 * points.shape[0]
    for i in range(x.size - X.points - end):
        x[X.points + end + i] -= xi[E.points + end + i]


@kernel
def determinant(m: Array) -> float:
    """Return the determinant of a matrix m (3, 3), in the cube of the unit of its elements."""
    return float(
        m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
        - m[0, 1] * (m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0])
        + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    )


@kernel
def observe(
    state: BestState, k: int, y: Array, contact: float, dt: float, noise: BestNoise, hypotheses: bool
) -> tuple[float, float]:
    """Correct state and covariance by contact point k, which stands and is seen at y, in place.

    Args:
        state: state of the filter, or one hypothesis; changed.
        k: index of the point.
        y: place of the point from the IMU by the encoders, IMU axes, (3,) m.
        contact: probability that it touches the ground.
        dt: time since the last sample, s.
        noise: noises and rates of the filter.
        hypotheses: True: the point may slide, and staying and sliding are mixed; False: the point stays, or its slide
            is in the covariance already.

    Returns:
        Normalised innovation squared of a point that may slide, 3 degrees of freedom, and the logarithm of the
        likelihood of the sample up to a constant; an outlier has that of the largest accepted innovation.
    """
    x, cov, row = state.x, state.cov, E.points + 3 * k
    z, shift, point = turned(rotation(x), y), np.empty(3), state.memory[M.shown + 2] * noise.point
    for i in range(3):
        z[i] -= x[X.points + 3 * k + i]
        shift[i] = (noise.slide * dt) ** 2 * (1.0 if i < 2 else FIXED.vertical_slide)
    stays, slides = np.empty((3, 3)), np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            stays[i, j] = slides[i, j] = cov[row + i, row + j]
        stays[i, i] += point**2
        slides[i, i] += point**2 + shift[i]
    inverse_1 = inverse3(slides)[0]
    misfit = quadratic(z, inverse_1)
    state.points[k, P.mistrust] += FIXED.learn_mistrust * (
        (1.0 if misfit > FIXED.outlier else 0.0) - state.points[k, P.mistrust]
    )
    if misfit > FIXED.outlier:
        new = state.points[k, P.new] > 0.0
        state.points[k, P.misfit] = FIXED.most_misfits if new else state.points[k, P.misfit] + 1.0
        if state.points[k, P.misfit] >= FIXED.most_misfits:
            return misfit, -0.5 * (FIXED.outlier + math.log(determinant(stays)))
        wider = (z[0] ** 2 + z[1] ** 2 + z[2] ** 2) / 3.0  # an outlier holds little information
        for i in range(3):
            stays[i, i] += wider
            slides[i, i] += wider
        inverse_1 = inverse3(slides)[0]
    else:
        state.points[k, P.misfit] = state.points[k, P.new] = 0.0
    inverse_0 = inverse3(stays)[0]
    nis = quadratic(z, inverse_0)
    likely = -0.5 * (min(nis, FIXED.outlier) + math.log(determinant(stays)))
    if not hypotheses:
        _stay(state, row, z, inverse_0)
    else:
        ratio = 0.5 * (nis - quadratic(z, inverse_1) + math.log(determinant(stays) / determinant(slides)))
        weight = _weigh_slide(state.points[k], contact, ratio, noise)
        _mix(state, row, z, inverse_0, inverse_1, shift, weight)
    return misfit, likely


@kernel
def _weigh_slide(point: Array, contact: float, ratio: float, noise: BestNoise) -> float:
    """Return the probability that a point slides, by one sample; store it and the reported one in `point`.

    Args:
        point: numbers of the point, (11,), columns as in `PointLayout`; changed.
        contact: probability that it touches the ground.
        ratio: logarithm of the likelihood of sliding over that of staying.
        noise: noises and rates of the filter.
    """
    before, seen = point[P.slide], point[P.seen]
    prior = before * noise.go_on + (1.0 - before) * noise.begin_slide
    prior = 1.0 - contact * (1.0 - prior)
    odds = prior / max(1.0 - prior, 1e-9) * math.exp(min(ratio, 300.0))
    weight = odds / (1.0 + odds)
    seen = 1.0 - contact * (1.0 - seen * FIXED.reported_on - (1.0 - seen) * FIXED.reported_begin)
    odds = seen / max(1.0 - seen, 1e-9) * math.exp(min(ratio, 300.0))
    point[P.seen] = odds / (1.0 + odds)
    if point[P.misfit] == 0.0:
        point[P.slide] = weight
    return weight


@kernel
def _stay(state: BestState, row: int, z: Array, inverse: Array) -> None:
    """Correct with the innovation of a point that stays, in place.

    Args:
        state: state of the filter, or one hypothesis; changed.
        row: first row of the point in the error.
        z: innovation of its place, seen minus estimated, odom axes, (3,) m.
        inverse: inverse covariance of z, (3, 3) 1/m^2.
    """
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
    """Apply the mean of the corrections of two hypotheses, the point stays (0) or slides (1), in place.

    Args:
        state: state of the filter; changed.
        row: first row of the point in the error.
        z: innovation of its place, seen minus estimated, odom axes, (3,) m.
        inverse_0: inverse covariance of z if the point stays, (3, 3) 1/m^2.
        inverse_1: inverse covariance of z if it slides, (3, 3) 1/m^2.
        shift: variance that sliding adds to each axis, (3,) m^2.
        weight: probability of sliding.
    """
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
