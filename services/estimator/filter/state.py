"""State of the `best` filter and its prediction by one inertial sample.

A contact-aided error-state filter with a right-invariant error (after Hartley et al. 2020), re-centred on the IMU: all
vectors in axes of `odom`, contact points relative to the IMU, so that no lever grows with the way. With
G = (0, 0, 9.81)

    R' = R [w - b_w],   v' = R (q - b_q) - G,   p' = v,   r_i' = -v,   biases constant

The error of a state is xi_R = log(R_hat R^T), xi_v = v_hat - exp(xi_R) v, xi_r = r_hat - exp(xi_R) r, and the plain
difference of p and the biases. To second order in the step d, with v, r in the middle of it:

    xi_R += -d R db_w
    xi_v += -d [G] xi_R - d R db_q - d [v] R db_w
    xi_r += -d xi_v + d^2/2 ([G] xi_R + R db_q) - d [r] R db_w
    dp   +=  d xi_v - d^2/2 ([G] xi_R + R db_q) - d [v] xi_R

`[a]` is the matrix of the cross product. The covariance of the velocity in IMU axes is R^T P_vv R.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear_kernels import times
from surefoot.kernels.jit import kernel

Array = NDArray[np.float64]

# parts of the state x; a contact point k has three numbers from POINTS + 3 k
ROT, VEL, GYRO_BIAS, ACC_BIAS, POS, POINTS = 0, 9, 12, 15, 18, 21
# rows of the error and of its covariance; a contact point has three from E_POINTS + 3 k
E_ROT, E_VEL, E_GYRO, E_ACC, E_POS, E_POINTS = 0, 3, 6, 9, 12, 15
# columns of `BestState.points`
DOWN, SLIDE, MISFIT, SEEN, NEW, ALONG, CLOSED = 0, 1, 2, 3, 4, 5, 7
# parts of `BestState.memory`
EXCESS, INNOVATION, LAST_GYRO, SINCE, NIS, PHASE, REST, AGE, LAG = 0, 1, 4, 7, 8, 9, 10, 11, 12
LOSSES, LOST_FOR, PUSH, UNFIT, SLIDE_PRODUCT, SLIDE_SQUARE = 15, 16, 17, 20, 21, 22
MEMORY = 23
WAITING, MOVING, STARTED, DOUBTED = 0.0, 1.0, 2.0, 3.0  # values of `PHASE`
FREE = 1.0  # m^2, variance of a point that touches nothing
NO_FEET = -1.0  # `SINCE` before the first sample of the feet
LONG_AGO = -1.0  # `LOST_FOR` when there is nothing to compare
LOST_MEMORY = 1.0  # s, over which losses of the velocity are taken together


class BestState(NamedTuple):
    """All that the filter remembers; K contact points."""

    x: Array
    """(21 + 3 K,): rot_odom_from_imu by rows, velocity of the IMU in odom axes m/s, biases of gyro rad/s and
    accelerometer m/s^2 in IMU axes, position of the IMU in odom m, contact points from the IMU in odom axes m."""
    cov: Array
    """(15 + 3 K, 15 + 3 K) covariance of the error."""
    points: Array
    """(K, 8): 1 while the point stands, weight of sliding in its correction, misfits in a row, probability that it
    slides, 1 until a second sample has confirmed its place, velocity (2) m/s of its foot if that slides, odom axes,
    switches of its foot that were closed at the last sample, bit s for switch s."""
    turn: Array
    """(K, 3, 3) rot_odom_from_foot at the last sample of the feet."""
    memory: Array
    """(23,): excess of the inertial noise, last common innovation (3) m, last gyro (3) rad/s, time since the last
    sample of the feet s (negative: there was none), its normalised innovation squared (3 dof), phase of the start,
    inertial samples at rest in a row, time since the start s, lag of the velocity (3) m/s, IMU axes, see `follow`,
    how often the velocity was lost, time since it was lost s (negative: long ago), change of the velocity by the
    inertial unit since then (3) m/s, odom axes, see `judge_tilt`, samples of the feet in a row of which no
    point fitted, sums of m s and of s s, see `persistence`."""
    mode_x: Array
    """(H, 21 + 3 K) the same of each hypothesis about which feet slide, see `best_modes`; so are the next four."""
    mode_cov: Array
    mode_points: Array
    mode_turn: Array
    mode_memory: Array
    weight: Array
    """(H,) probabilities of the hypotheses, all 0 while there is only the state itself."""


class BestNoise(NamedTuple):
    """Noises and rates of the filter, SI; those of the sensors per square root of s."""

    gyro: float  # rad/s/sqrt(Hz)
    acc: float  # m/s^2/sqrt(Hz)
    gyro_bias: float  # rad/s/sqrt(s), walk
    turn_bias: float  # rad/s/sqrt(s), the same about the vertical
    acc_bias: float  # m/s^2/sqrt(s), walk
    gyro_jerk: float  # share of the change between two samples that is error
    sample_gyro: float  # rad/s, noise of one sample
    point: float  # m, a contact point by kinematics
    stay: float  # m/sqrt(s), walk of a point that stays
    slide: float  # m/s, a point that slides
    carry: float  # share of the latest sample in the velocity of a sliding foot
    slip: float  # m/s, by which that velocity errs, where hypotheses are carried through time
    slip_begin: float  # probability per sample that it begins to slide
    slip_landing: float  # probability that it slides when it comes down
    begin_slide: float  # probability per sample that a point begins to slide
    go_on: float  # probability per sample that a sliding point goes on
    learn: float  # rate at which the excess of the inertial noise follows the innovations
    drop: float  # correlation of successive innovations that is no sign of anything
    twist: float  # rad/sqrt(s), turning of a standing sole about the vertical
    rock: float  # rad/s, of a sole that stands on an edge or a corner
    creep: float  # m/s, of that edge or corner
    most_excess: float  # largest factor of the inertial noise
    lag_s: float  # s, over which corrections of the position are averaged


def new_state(points: int, modes: int = 0) -> BestState:
    """An empty state of `points` contact points, level, at rest, with wide covariance and room for hypotheses."""
    x, cov = np.zeros(POINTS + 3 * points), np.eye(E_POINTS + 3 * points) * FREE
    x[ROT] = x[ROT + 4] = x[ROT + 8] = 1.0
    memory = np.zeros(MEMORY)
    memory[EXCESS], memory[SINCE], memory[LOST_FOR] = 1.0, NO_FEET, LONG_AGO
    one = (x, cov, np.zeros((points, CLOSED + 1)), np.zeros((points, 3, 3)), memory)
    some = [np.repeat(part[None], modes, axis=0) for part in one]
    return BestState(*one, some[0], some[1], some[2], some[3], some[4], np.zeros(modes))


def copy_state(source: BestState, target: BestState) -> None:
    """Copy every array of a state into those of another."""
    for a, b in zip(source, target, strict=True):
        b[...] = a


@kernel
def forget_velocity(state: BestState, sd: float) -> None:
    """Make the velocity unknown: 0 +- sd m/s on each axis, in place."""
    for i in range(E_VEL, E_VEL + 3):
        for j in range(state.cov.shape[0]):
            state.cov[i, j] = 0.0
            state.cov[j, i] = 0.0
        state.cov[i, i] = sd * sd
        state.x[VEL + i - E_VEL] = state.memory[LAG + i - E_VEL] = 0.0


@kernel
def turn_matrix(b: Array) -> Array:
    """exp([b]), (3, 3): active rotation about b (3,) by |b| rad (Rodrigues' formula)."""
    square = b[0] * b[0] + b[1] * b[1] + b[2] * b[2]
    if square > 1e-16:
        angle = math.sqrt(square)
        s, c = math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
    else:
        s, c = 1.0, 0.5
    m = np.empty((3, 3))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        m[i, i] = 1.0 - c * (b[j] * b[j] + b[k] * b[k])
        m[i, j] = c * b[i] * b[j] - s * b[k]
        m[j, i] = c * b[i] * b[j] + s * b[k]
    return m


@kernel
def rotation(x: Array) -> Array:
    """rot_odom_from_imu of a state, (3, 3)."""
    m = np.empty((3, 3))
    for i in range(3):
        for k in range(3):
            m[i, k] = x[ROT + 3 * i + k]
    return m


@kernel
def turned(m: Array, v: Array) -> Array:
    """m v, (3,)."""
    out = np.empty(3)
    for i in range(3):
        out[i] = m[i, 0] * v[0] + m[i, 1] * v[1] + m[i, 2] * v[2]
    return out


@kernel
def _carry_rows(cov: Array, points: Array, d: float, v: Array, arms: Array, rot: Array) -> None:
    """cov <- F cov in place, F as in the head of this file; v (3,), arms (K, 3) and rot (3, 3) in mid-step.

    Each loop writes one row and takes its factors from variables: so it becomes a loop over vectors.
    """
    n = cov.shape[0]
    by_acc, by_gyro, moved = np.empty((3, n)), np.empty((3, n)), np.empty((3, n))
    for i in range(3):
        a, b, c = rot[i, 0], rot[i, 1], rot[i, 2]
        for j in range(n):
            by_acc[i, j] = a * cov[E_ACC, j] + b * cov[E_ACC + 1, j] + c * cov[E_ACC + 2, j]
        for j in range(n):
            by_gyro[i, j] = a * cov[E_GYRO, j] + b * cov[E_GYRO + 1, j] + c * cov[E_GYRO + 2, j]
    for j in range(n):
        by_acc[0, j] -= GRAVITY * cov[1, j]
    for j in range(n):
        by_acc[1, j] += GRAVITY * cov[0, j]
    half = 0.5 * d * d
    for i in range(3):
        for j in range(n):
            moved[i, j] = d * cov[E_VEL + i, j] - half * by_acc[i, j]
        for j in range(n):
            cov[E_VEL + i, j] -= d * by_acc[i, j]
    x, y, z = v[0], v[1], v[2]
    for j in range(n):
        cov[E_POS, j] += moved[0, j] - d * (y * cov[2, j] - z * cov[1, j])
    for j in range(n):
        cov[E_POS + 1, j] += moved[1, j] - d * (z * cov[0, j] - x * cov[2, j])
    for j in range(n):
        cov[E_POS + 2, j] += moved[2, j] - d * (x * cov[1, j] - y * cov[0, j])
    for i in range(3):
        for j in range(n):
            cov[E_ROT + i, j] -= d * by_gyro[i, j]
    _cross_rows(cov, E_VEL, d * x, d * y, d * z, by_gyro)
    for k in range(points.shape[0]):
        if points[k, DOWN] > 0.0:
            row = E_POINTS + 3 * k
            for i in range(3):
                for j in range(n):
                    cov[row + i, j] -= moved[i, j]
            _cross_rows(cov, row, d * arms[k, 0], d * arms[k, 1], d * arms[k, 2], by_gyro)


@kernel
def _cross_rows(cov: Array, row: int, x: float, y: float, z: float, by: Array) -> None:
    """Subtract (x, y, z) x by from three rows, by (3, n)."""
    n = cov.shape[0]
    for j in range(n):
        cov[row, j] -= y * by[2, j] - z * by[1, j]
    for j in range(n):
        cov[row + 1, j] -= z * by[0, j] - x * by[2, j]
    for j in range(n):
        cov[row + 2, j] -= x * by[1, j] - y * by[0, j]


@kernel
def _transpose(cov: Array) -> None:
    for i in range(cov.shape[0]):
        for j in range(i):
            cov[i, j], cov[j, i] = cov[j, i], cov[i, j]


@kernel
def _inertial_noise(cov: Array, points: Array, d: float, v: Array, arms: Array, gyro_sq: float, acc_sq: float) -> None:
    """Add the noise of gyro and accelerometer, variances per s, over a step of d s.

    The columns by which they enter are R, [v] R, [r] R and I, -d/2 I, d/2 I; R drops out, for the noise has no axis.
    """
    n = cov.shape[0]
    by = np.zeros((3, n))
    for i in range(3):
        by[i, E_ROT + i] = 1.0
    _set_cross(by, E_VEL, v[0], v[1], v[2])
    for k in range(points.shape[0]):
        if points[k, DOWN] > 0.0:
            _set_cross(by, E_POINTS + 3 * k, arms[k, 0], arms[k, 1], arms[k, 2])
    scale = gyro_sq * d
    for i in range(n):
        a, b, c = scale * by[0, i], scale * by[1, i], scale * by[2, i]
        if a != 0.0 or b != 0.0 or c != 0.0:  # not biases, position and points in the air
            for j in range(n):
                cov[i, j] += a * by[0, j] + b * by[1, j] + c * by[2, j]
    share = np.zeros(n)  # of the accelerometer, the same for the three axes
    scale = acc_sq * d
    for axis in range(3):
        share[:] = 0.0
        share[E_VEL + axis], share[E_POS + axis] = 1.0, 0.5 * d
        for k in range(points.shape[0]):
            if points[k, DOWN] > 0.0:
                share[E_POINTS + 3 * k + axis] = -0.5 * d
        for i in range(n):
            if share[i] != 0.0:
                a = scale * share[i]
                for j in range(n):
                    cov[i, j] += a * share[j]


@kernel
def _set_cross(by: Array, column: int, x: float, y: float, z: float) -> None:
    """Write [a]^T of a = (x, y, z) into three columns of by (3, n)."""
    by[1, column], by[2, column] = -z, y
    by[0, column + 1], by[2, column + 1] = z, -x
    by[0, column + 2], by[1, column + 2] = -y, x


@kernel
def predict(state: BestState, w: Array, q: Array, d: float, noise: BestNoise, felt: float) -> None:
    """Carry the state over d s, in place.

    Args:
        state: the state.
        w: gyro, (3,) rad/s, IMU axes, mean over the step.
        q: accelerometer, (3,) m/s^2, likewise.
        d: the step, s.
        noise: the noises.
        felt: (rad/s)^2, variance of one gyro sample by the jerk of the moment; see `felt_variance`.
    """
    x, cov, points, memory = state.x, state.cov, state.points, state.memory
    turn, half, force, v = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        turn[i] = (w[i] - x[GYRO_BIAS + i]) * d
        half[i] = 0.5 * turn[i]
        force[i] = q[i] - x[ACC_BIAS + i]
    begin = rotation(x)
    middle, end = times(begin, turn_matrix(half)), times(begin, turn_matrix(turn))
    push = turned(middle, force)
    push[2] -= GRAVITY
    for i in range(3):
        v[i] = x[VEL + i] + 0.5 * d * push[i]
        x[VEL + i] += d * push[i]
        x[POS + i] += d * v[i]
        for k in range(3):
            x[ROT + 3 * i + k] = end[i, k]
    arms = np.zeros((points.shape[0], 3))
    for k in range(points.shape[0]):
        if points[k, DOWN] > 0.0:
            for i in range(3):
                arms[k, i] = x[POINTS + 3 * k + i] - 0.5 * d * v[i]
                x[POINTS + 3 * k + i] -= d * v[i]
    _carry_rows(cov, points, d, v, arms, middle)
    _transpose(cov)
    _carry_rows(cov, points, d, v, arms, middle)  # F (F P)^T, which is symmetric
    excess, up = memory[EXCESS] * memory[EXCESS], middle[2]
    _inertial_noise(cov, points, d, v, arms, excess * (noise.gyro * noise.gyro + felt * d), excess * noise.acc**2)
    for i in range(3):
        cov[E_GYRO + i, E_GYRO + i] += excess * noise.gyro_bias**2 * d
        for k in range(3):  # less of it about the vertical
            cov[E_GYRO + i, E_GYRO + k] -= excess * (noise.gyro_bias**2 - noise.turn_bias**2) * up[i] * up[k] * d
        cov[E_ACC + i, E_ACC + i] += excess * noise.acc_bias**2 * d
    for k in range(points.shape[0]):
        if points[k, DOWN] > 0.0:
            for i in range(E_POINTS + 3 * k, E_POINTS + 3 * k + 3):
                cov[i, i] += noise.stay**2 * d
    for i in range(LAG, LAG + 3):
        memory[i] *= 1.0 - min(d / noise.lag_s, 1.0)
    if memory[SINCE] >= 0.0:
        memory[SINCE] += d
    if memory[LOST_FOR] >= 0.0:
        memory[LOST_FOR] += d
        for i in range(3):
            memory[PUSH + i] += d * push[i]
        if memory[LOST_FOR] > LOST_MEMORY:
            memory[LOST_FOR] = LONG_AGO


@kernel
def felt_variance(memory: Array, w: Array, noise: BestNoise) -> float:
    """Variance of a gyro sample beyond its sensor's noise, (rad/s)^2, by its change since the last one.

    A structure that shakes turns the IMU against the trunk; the sensor's own noise changes by 6 sigma^2 on average.
    """
    square = 0.0
    for i in range(3):
        square += (w[i] - memory[LAST_GYRO + i]) ** 2
        memory[LAST_GYRO + i] = w[i]
    return noise.gyro_jerk**2 * max(0.0, square - 6.0 * noise.sample_gyro**2)
