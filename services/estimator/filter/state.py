"""State of the `best` filter and its prediction by one inertial sample.

A contact-aided error-state filter with a right-invariant error (after Hartley et al. 2020), re-centred on the IMU: all
vectors in axes of `odom`, contact points relative to the IMU, so that no lever grows with the distance. With
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

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear_kernels import times, turned
from surefoot.kernels.jit import kernel

from .layout import LONG_AGO, MEMORY, NO_FEET, POINT_COLUMNS, SENSOR_COLUMNS, E, M, P, S, X
from .noise import FIXED, BestNoise


class Felt(NamedTuple):
    """Noise that shocks and jerk of the trunk, and the end of a rest, add to that of one inertial sample."""

    gyro: float  # variance added to a gyro sample about level axes, (rad/s)^2
    turn: float  # variance added to a gyro sample about the vertical, (rad/s)^2
    acc: float  # variance added to an accelerometer sample, (m/s^2)^2
    woken: float = 0.0  # added to the square of the excess of the inertial noise, just after a rest


class BestState(NamedTuple):
    """State of the `best` filter; K contact points of the feet, H hypotheses about which feet slide."""

    x: Array
    """State vector, (21 + 3 K,), mixed units, laid out as in `StateLayout`."""
    cov: Array
    """Covariance of the error of `x`, (15 + 3 K, 15 + 3 K), rows and columns as in `ErrorLayout`."""
    points: Array
    """Values of each contact point, (K, 11), mixed units, columns as in `PointLayout`."""
    turn: Array
    """rot_odom_from_foot of the foot of each contact point at the last sample of the feet, (K, 3, 3)."""
    memory: Array
    """Averages, counters and times beside the state, (124,), laid out as in `MemoryLayout`."""
    mode_x: Array
    """State vectors of the hypotheses about sliding feet, laid out as `x`, (H, 21 + 3 K)."""
    mode_cov: Array
    """Covariances of the hypotheses about sliding feet, laid out as `cov`, (H, 15 + 3 K, 15 + 3 K)."""
    mode_points: Array
    """Values of the contact points of the hypotheses as in `points`, (H, K, 11)."""
    mode_turn: Array
    """Rotations `turn` of the hypotheses: rot_odom_from_foot at the last sample of the feet, (H, K, 3, 3)."""
    mode_memory: Array
    """Averages, counters and times of each hypothesis, (H, 112), laid out as `memory`."""
    weight: Array
    """Probabilities of the hypotheses about sliding feet, (H,); all 0 while the state itself is the only one."""
    sensors: Array
    """Values about the leg sensors, one row for each foot (at most K), (K, 38), columns as in `SensorLayout`."""


FRAME = 4
"""Number of state elements of the frame of another source's poses (camera, GNSS): shift (3) and turn (1)."""


def new_state(points: int, modes: int = 0, frame: int = 0) -> BestState:
    """Return an empty filter state: level, at rest, at the origin of odom, with wide covariance.

    Args:
        points: number K of contact points.
        modes: number of hypotheses about which feet slide, each with arrays of its own; 0: none.
        frame: `FRAME` = 4 if the state also holds the frame of poses of another source, such as a camera, else 0.
    """
    x, cov = np.zeros(X.points + 3 * points + frame), np.eye(E.points + 3 * points + frame) * FIXED.free
    x[X.rot] = x[X.rot + 4] = x[X.rot + 8] = 1.0
    memory = np.zeros(MEMORY)
    memory[M.excess], memory[M.since], memory[M.lost_for], memory[M.woke] = 1.0, NO_FEET, LONG_AGO, LONG_AGO
    memory[M.shown : M.shown + 3] = 1.0
    one = (x, cov, np.zeros((points, POINT_COLUMNS)), np.zeros((points, 3, 3)), memory)
    some = [np.repeat(part[None], modes, axis=0) for part in one]
    sensors = np.zeros((points, SENSOR_COLUMNS))
    sensors[:, S.source] = sensors[:, S.compared] = sensors[:, S.wired] = np.arange(points)
    sensors[:, S.trunk : S.trunk + 3] = np.nan
    return BestState(*one, some[0], some[1], some[2], some[3], some[4], np.zeros(modes), sensors)


def fit_in(source: BestState, target: BestState) -> None:
    """Copy each array of `source` into the first entries of the array of that name in the larger `target`, in place."""
    for a, b in zip(source, target, strict=True):
        b[tuple(slice(0, size) for size in a.shape)] = a


@kernel
def isolate(cov: Array, first: int, count: int, variance: float) -> None:
    """Make `count` errors from index `first` on independent of all others, in place.

    Args:
        cov: covariance of the error, (n, n); rows and columns of these errors are changed.
        variance: new variance of each of them, in their unit squared.
    """
    for i in range(first, first + count):
        for j in range(cov.shape[0]):
            cov[i, j] = 0.0
            cov[j, i] = 0.0
        cov[i, i] = variance


@kernel
def forget_velocity(state: BestState, sd: float) -> None:
    """Set the velocity in `state` to 0 with standard deviation `sd` m/s per axis and no correlations, in place.

    The lag of the velocity (the correction that is published with it) is set to 0, too.
    """
    isolate(state.cov, E.vel, 3, sd * sd)
    for i in range(3):
        state.x[X.vel + i] = state.memory[M.lag + i] = 0.0


@kernel
def turn_matrix(b: Array) -> Array:
    """Return the matrix exp([b]), (3, 3), of the rotation about b (3,) rad by the angle |b| (Rodrigues' formula)."""
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
    """Return rot_odom_from_imu, (3, 3), stored by rows in the first nine numbers of a state x (21 + 3 K,)."""
    m = np.empty((3, 3))
    for i in range(3):
        for k in range(3):
            m[i, k] = x[X.rot + 3 * i + k]
    return m


@kernel
def set_rotation(x: Array, rot: Array) -> None:
    """Write rot_odom_from_imu `rot` (3, 3) by rows into the first nine numbers of a state x (21 + 3 K,), in place."""
    for i in range(3):
        for k in range(3):
            x[X.rot + 3 * i + k] = rot[i, k]


@kernel
def _carry_rows(cov: Array, points: Array, d: float, v: Array, arms: Array, rot: Array) -> None:
    """Replace the covariance P by F P, in place, with the transition F of the error over a step of d s.

    F maps the errors of attitude xi_R, velocity xi_v, contact points xi_r, position dp and biases db_w, db_q,

        xi_R += -d R db_w
        xi_v += -d [G] xi_R - d R db_q - d [v] R db_w
        xi_r += -d xi_v + d^2/2 ([G] xi_R + R db_q) - d [r] R db_w
        dp   +=  d xi_v - d^2/2 ([G] xi_R + R db_q) - d [v] xi_R

    with gravity G = (0, 0, 9.81) m/s^2 and [a] the matrix of the cross product with a.

    Args:
        cov: P, (n, n), rows as in `ErrorLayout`; changed. Each loop writes one row, so that it becomes vector code.
        points: numbers of the contact points, (K, 11); rows of those that do not stand stay.
        d: length of the step, s.
        v: velocity of the IMU in mid-step, odom axes, (3,) m/s.
        arms: contact points r from the IMU in mid-step, odom axes, (K, 3) m.
        rot: rot_odom_from_imu R in mid-step, (3, 3).
    """
    n = cov.shape[0]
    by_acc, by_gyro, moved = np.empty((3, n)), np.empty((3, n)), np.empty((3, n))
    for i in range(3):
        a, b, c = rot[i, 0], rot[i, 1], rot[i, 2]
        for j in range(n):
            by_acc[i, j] = a * cov[E.acc_bias, j] + b * cov[E.acc_bias + 1, j] + c * cov[E.acc_bias + 2, j]
        for j in range(n):
            by_gyro[i, j] = a * cov[E.gyro_bias, j] + b * cov[E.gyro_bias + 1, j] + c * cov[E.gyro_bias + 2, j]
    for j in range(n):
        by_acc[0, j] -= GRAVITY * cov[1, j]
    for j in range(n):
        by_acc[1, j] += GRAVITY * cov[0, j]
    half = 0.5 * d * d
    for i in range(3):
        for j in range(n):
            moved[i, j] = d * cov[E.vel + i, j] - half * by_acc[i, j]
        for j in range(n):
            cov[E.vel + i, j] -= d * by_acc[i, j]
    x, y, z = v[0], v[1], v[2]
    for j in range(n):
        cov[E.pos, j] += moved[0, j] - d * (y * cov[2, j] - z * cov[1, j])
    for j in range(n):
        cov[E.pos + 1, j] += moved[1, j] - d * (z * cov[0, j] - x * cov[2, j])
    for j in range(n):
        cov[E.pos + 2, j] += moved[2, j] - d * (x * cov[1, j] - y * cov[0, j])
    for i in range(3):
        for j in range(n):
            cov[E.rot + i, j] -= d * by_gyro[i, j]
    _cross_rows(cov, E.vel, d * x, d * y, d * z, by_gyro)
    for k in range(points.shape[0]):
        if points[k, P.down] > 0.0:
            row = E.points + 3 * k
            for i in range(3):
                for j in range(n):
                    cov[row + i, j] -= moved[i, j]
            _cross_rows(cov, row, d * arms[k, 0], d * arms[k, 1], d * arms[k, 2], by_gyro)


@kernel
def _cross_rows(cov: Array, row: int, x: float, y: float, z: float, by: Array) -> None:
    """Subtract (x, y, z) x b, b each column of by (3, n), from rows `row` to `row` + 2 of cov (n, n), in place."""
    n = cov.shape[0]
    for j in range(n):
        cov[row, j] -= y * by[2, j] - z * by[1, j]
    for j in range(n):
        cov[row + 1, j] -= z * by[0, j] - x * by[2, j]
    for j in range(n):
        cov[row + 2, j] -= x * by[1, j] - y * by[0, j]


@kernel
def _transpose(cov: Array) -> None:
    """Transpose the square matrix `cov` (n, n) in place."""
    for i in range(cov.shape[0]):
        for j in range(i):
            cov[i, j], cov[j, i] = cov[j, i], cov[i, j]


@kernel
def _inertial_noise(
    cov: Array, points: Array, d: float, v: Array, arms: Array, gyro_sq: float, turn_sq: float, acc_sq: float
) -> None:
    """Add the noise of gyro and accelerometer over a step of d s to the covariance, in place.

    Gyro noise enters the errors of attitude, velocity v and contact points r by R, [v] R and [r] R; the rotation R of
    the IMU drops out, for the noise is the same about all axes. Accelerometer noise enters velocity, points and
    position by I, -d/2 I and d/2 I. About the vertical the gyro is as good as its sensor: what the feet show of errors
    of the trunk's tilt is no reason to take the heading from them.

    Args:
        cov: covariance of the error, (n, n), rows as in `ErrorLayout`; changed.
        points: numbers of the contact points, (K, 11), columns as in `PointLayout`.
        d: length of the step, s.
        v: velocity of the IMU in the middle of the step, odom axes, (3,) m/s.
        arms: contact points from the IMU then, odom axes, (K, 3) m.
        gyro_sq: noise density of the gyro about level axes squared, (rad/s)^2/Hz.
        turn_sq: noise density of the gyro about the vertical squared, (rad/s)^2/Hz.
        acc_sq: noise density of the accelerometer squared, (m/s^2)^2/Hz.
    """
    n = cov.shape[0]
    by = np.zeros((3, n))
    for i in range(3):
        by[i, E.rot + i] = 1.0
    _set_cross(by, E.vel, v[0], v[1], v[2])
    for k in range(points.shape[0]):
        if points[k, P.down] > 0.0:
            _set_cross(by, E.points + 3 * k, arms[k, 0], arms[k, 1], arms[k, 2])
    scale, turn = gyro_sq * d, turn_sq * d
    for i in range(n):
        a, b, c = scale * by[0, i], scale * by[1, i], turn * by[2, i]
        if a != 0.0 or b != 0.0 or c != 0.0:  # not biases, position and points in the air
            for j in range(n):
                cov[i, j] += a * by[0, j] + b * by[1, j] + c * by[2, j]
    share = np.zeros(n)  # of the accelerometer, the same for the three axes
    scale = acc_sq * d
    for axis in range(3):
        share[:] = 0.0
        share[E.vel + axis], share[E.pos + axis] = 1.0, 0.5 * d
        for k in range(points.shape[0]):
            if points[k, P.down] > 0.0:
                share[E.points + 3 * k + axis] = -0.5 * d
        for i in range(n):
            if share[i] != 0.0:
                a = scale * share[i]
                for j in range(n):
                    cov[i, j] += a * share[j]


@kernel
def _set_cross(by: Array, column: int, x: float, y: float, z: float) -> None:
    """Write [a]^T, with a = (x, y, z) and [a] b = a x b, into columns `column` to `column` + 2 of by (3, n)."""
    by[1, column], by[2, column] = -z, y
    by[0, column + 1], by[2, column + 1] = z, -x
    by[0, column + 2], by[1, column + 2] = -y, x


@kernel
def _walk_points(cov: Array, points: Array, stay: float, sink: float) -> None:
    """Add variances, m^2: `stay` to each axis of each standing point, `sink` to their common height, in place."""
    for k in range(points.shape[0]):
        if points[k, P.down] > 0.0:
            for i in range(E.points + 3 * k, E.points + 3 * k + 3):
                cov[i, i] += stay
            for m in range(points.shape[0]):
                if points[m, P.down] > 0.0:
                    cov[E.points + 3 * k + 2, E.points + 3 * m + 2] += sink


@kernel
def predict(state: BestState, w: Array, q: Array, d: float, noise: BestNoise, felt: Felt) -> None:
    """Predict state and covariance over a step of d s by one inertial sample, in place.

    Args:
        state: state of the filter; changed: standing contact points move against the IMU, times and averages continue.
        w: mean gyro over the step, IMU axes, (3,) rad/s.
        q: mean accelerometer over the step, IMU axes, (3,) m/s^2.
        d: length of the step, s.
        noise: noises and rates of the filter.
        felt: what shocks and jerk, and the end of a rest, add to the noise of gyro and accelerometer in this step.
    """
    x, cov, points, memory = state.x, state.cov, state.points, state.memory
    turn, half, force, v = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        turn[i] = (w[i] - x[X.gyro_bias + i]) * d
        half[i] = 0.5 * turn[i]
        force[i] = q[i] - x[X.acc_bias + i]
    begin = rotation(x)
    middle, end = times(begin, turn_matrix(half)), times(begin, turn_matrix(turn))
    push = turned(middle, force)
    push[2] -= GRAVITY
    for i in range(3):
        v[i] = x[X.vel + i] + 0.5 * d * push[i]
        x[X.vel + i] += d * push[i]
        x[X.pos + i] += d * v[i]
    set_rotation(x, end)
    arms = np.zeros((points.shape[0], 3))
    for k in range(points.shape[0]):
        if points[k, P.down] > 0.0:
            for i in range(3):
                arms[k, i] = x[X.points + 3 * k + i] - 0.5 * d * v[i]
                x[X.points + 3 * k + i] -= d * v[i]
    _carry_rows(cov, points, d, v, arms, middle)
    _transpose(cov)
    _carry_rows(cov, points, d, v, arms, middle)  # F (F P)^T, which is symmetric
    excess, up = memory[M.excess] * memory[M.excess] + felt.woken, middle[2]
    sensor_sq, own_sq = (memory[M.shown] * noise.gyro) ** 2, (memory[M.shown + 1] * noise.acc) ** 2
    acc_sq = min(excess * own_sq, max(own_sq, noise.most_shaken**2)) + (excess - 1.0) * felt.acc * d
    _inertial_noise(cov, points, d, v, arms, excess * (sensor_sq + felt.gyro * d), sensor_sq + felt.turn * d, acc_sq)
    for i in range(3):
        cov[E.gyro_bias + i, E.gyro_bias + i] += noise.gyro_bias**2 * d
        for k in range(3):  # less of it about the vertical
            cov[E.gyro_bias + i, E.gyro_bias + k] -= (noise.gyro_bias**2 - noise.turn_bias**2) * up[i] * up[k] * d
        cov[E.acc_bias + i, E.acc_bias + i] += excess * noise.acc_bias**2 * d
    _walk_points(cov, points, noise.stay**2 * d, (FIXED.sink_walk * memory[M.sinks]) ** 2 * d)
    for k in range(points.shape[0]):
        if points[k, P.down] == 0.0:
            points[k, P.mistrust] *= 1.0 - min(FIXED.forget_mistrust * d, 1.0)
    for i in range(M.lag, M.lag + 3):
        memory[i] *= 1.0 - min(d / noise.lag_s, 1.0)
    if memory[M.since] >= 0.0:
        memory[M.since] += d
    if memory[M.lost_for] >= 0.0:
        memory[M.lost_for] += d
    for i in range(3):
        memory[M.push + i] += d * push[i]
        if 0.0 <= memory[M.lost_for] < FIXED.tilted_for:
            memory[M.ran + i] = memory[M.push + i] - x[X.vel + i]


@kernel
def felt_variance(memory: Array, w: Array, q: Array, noise: BestNoise) -> Felt:
    """Return what the change since the last inertial sample, and a recent rest, add to its noise; store the sample.

    A shaken structure turns and moves the IMU against the trunk, and a sample in a shock is not the mean over its
    period; the sensors' own noise changes by 6 sigma^2 on average (three axes, two samples). A bend turns the IMU back:
    errors of the heading cancel, those of the tilt act on the velocity at every moment.

    Args:
        memory: `BestState.memory`, (124,); the last sample in it is replaced.
        w: gyro of the sample, IMU axes, (3,) rad/s.
        q: accelerometer of the sample, IMU axes, (3,) m/s^2.
        noise: noises and rates of the filter.
    """
    turn, push = 0.0, 0.0
    for i in range(3):
        turn += (w[i] - memory[M.last_gyro + i]) ** 2
        push += (q[i] - memory[M.last_acc + i]) ** 2
        memory[M.last_gyro + i], memory[M.last_acc + i] = w[i], q[i]
    turn = max(0.0, turn - 6.0 * (memory[M.shown] * noise.sample_gyro) ** 2)
    push = max(0.0, push - 6.0 * (memory[M.shown + 1] * noise.sample_acc) ** 2)
    wakes = memory[M.woke] >= 0.0 and memory[M.rest] == 0.0
    left = max(1.0 - (memory[M.age] - memory[M.woke]) / FIXED.waking_s, 0.0) if wakes else 0.0
    return Felt(noise.gyro_jerk**2 * turn, noise.turn_jerk**2 * turn, noise.acc_jerk**2 * push, FIXED.waking * left**2)
