"""Corrections of the `best` filter by a pose, heading or velocity from elsewhere: camera, motion capture, GNSS.

The frame of the source is turned about the vertical by psi and shifted by t (3,) against odom; both are four more
states behind the contact points, unknown until the first pose and constant after it. With p the IMU in odom, v its
velocity and R its orientation, a sample that is tau old has

    position   Rz(psi) (p - v tau) + t,     heading   psi + yaw(R) - tau yaw',     velocity   R^T v at that time

A sample whose normalised innovation exceeds `FIXED.outlier` is left out; after `FIXED.most_jumps` poses in a row the
frame of the source has jumped, and psi and t are unknown again.
"""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear_kernels import inverse3, quadratic, times_transposed, turned
from surefoot.geometry.rotations import wrap_angle
from surefoot.kernels.jit import kernel

from .hypotheses import likeliest, mode, weigh
from .layout import E, M, X
from .noise import FIXED, BestSetting
from .point import determinant, retract
from .samples import EX, ROW_Q, ROW_W, SampleStore, after
from .slope import give_to_filter
from .state import BestState, isolate, rotation

POSITION, YAW, VELOCITY = range(3)
"""Kinds of measurement in a sample of another source; `POSITION`: of the IMU; `YAW`: heading of base_link; `VELOCITY`:
of the IMU."""


@kernel
def frame_of(state: BestState) -> int:
    """Return the error index at which the frame of another source begins: shift, m (3 rows), then turn, rad (1 row)."""
    return E.points + 3 * state.points.shape[0]


@kernel
def _heading(state: BestState, rot_base_from_imu: Array) -> tuple[float, Array]:
    """Return the heading of base_link in odom, rad, and its derivative by the rotation error of the state, (3,).

    `rot_base_from_imu`: mounting of the IMU, (3, 3).
    """
    ahead = times_transposed(rotation(state.x), rot_base_from_imu)[:, 0]
    level = ahead[0] ** 2 + ahead[1] ** 2
    by = np.array([-ahead[2] * ahead[0] / level, -ahead[2] * ahead[1] / level, 1.0])
    return math.atan2(ahead[1], ahead[0]), by


@kernel
def expected(
    state: BestState, part: int, row: Array, w: Array, q: Array, age: float, rot_base_from_imu: Array
) -> tuple[Array, Array, Array]:
    """Return innovation z = estimate - sample (3,), its derivative by the error (3, n), and the noise (3, 3).

    z is in m, rad or m/s, the noise in its square. Of a heading only z[0] counts; the other two are zero with
    derivative zero.

    Args:
        state: state of the filter, whose error has n numbers, at the end of the inertial step.
        part: what is compared: `POSITION` = 0, `YAW` = 1 or `VELOCITY` = 2.
        row: the sample, (26,) as in `ExternalLayout`: m, rad, m/s and their squares.
        w: gyro since the sample, IMU axes, (3,) rad/s.
        q: accelerometer since the sample, IMU axes, (3,) m/s^2.
        age: time since the sample, s, less than an inertial period.
        rot_base_from_imu: mounting of the IMU in base_link, (3, 3).
    """
    x, rot, n = state.x, rotation(state.x), state.cov.shape[0]
    z, by, noise, frame = np.zeros(3), np.zeros((3, n)), np.eye(3), frame_of(state)
    at = X.points + 3 * state.points.shape[0]
    rate = np.empty(3)
    for i in range(3):
        rate[i] = w[i] - x[X.gyro_bias + i]
    if part == YAW:
        yaw, turn = _heading(state, rot_base_from_imu)
        z[0] = wrap_angle(x[at + 3] + yaw - age * turned(rot, rate)[2] - row[EX.yaw])
        for i in range(3):
            by[0, E.rot + i] = turn[i]
        by[0, frame + 3], noise[0, 0] = 1.0, row[EX.yaw_variance]
        return z, by, noise
    first = EX.position if part == POSITION else EX.velocity
    covariance = EX.position_covariance if part == POSITION else EX.velocity_covariance
    for i in range(3):
        for k in range(3):
            noise[i, k] = row[covariance + 3 * i + k]
    if part == POSITION:
        c, s, p = math.cos(x[at + 3]), math.sin(x[at + 3]), np.empty(3)
        for i in range(3):
            p[i] = x[X.pos + i] - age * x[X.vel + i]
        seen = np.array([c * p[0] - s * p[1], s * p[0] + c * p[1], p[2]])
        spin = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        by[0, frame + 3], by[1, frame + 3] = -seen[1], seen[0]
        for i in range(3):
            z[i] = seen[i] + x[at + i] - row[first + i]
            by[i, frame + i] = 1.0
            for k in range(3):
                by[i, E.pos + k], by[i, E.vel + k] = spin[i, k], -age * spin[i, k]
        return z, by, noise
    v = np.zeros(3)
    for i in range(3):
        for k in range(3):
            v[i] += rot[k, i] * x[X.vel + k]
            by[i, E.vel + k] = rot[k, i]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        push = q[i] - x[X.acc_bias + i] - GRAVITY * rot[2, i]
        z[i] = v[i] + age * (rate[j] * v[k] - rate[k] * v[j] - push) - row[first + i]
    return z, by, noise


@kernel
def _spread(cov: Array, by: Array, noise: Array) -> tuple[Array, Array]:
    """Return P H^T, (n, 3), and H P H^T + N, (3, 3), the covariance of an innovation.

    Args:
        cov: covariance P of the error of the state, (n, n).
        by: derivative H of the innovation by the error, (3, n).
        noise: covariance N of the sample, (3, 3).
    """
    n = cov.shape[0]
    across, total = np.zeros((n, 3)), noise.copy()
    for j in range(n):
        for i in range(3):
            for k in range(n):
                if by[i, k] != 0.0:
                    across[j, i] += cov[j, k] * by[i, k]
    for i in range(3):
        for k in range(3):
            for j in range(n):
                total[i, k] += by[i, j] * across[j, k]
    return across, total


@kernel
def _correct(state: BestState, z: Array, by: Array, noise: Array) -> float:
    """Correct one state with an innovation, in place; return the logarithm of its likelihood up to a constant.

    Args:
        state: state of the filter, or one hypothesis, whose error has n numbers; changed.
        z: innovation, estimate minus sample, (3,), m, rad or m/s.
        by: derivative of the innovation by the error, (3, n).
        noise: covariance of the sample, (3, 3), unit of z squared.
    """
    cov, n = state.cov, state.cov.shape[0]
    across, total = _spread(cov, by, noise)
    inverse = inverse3(total)[0]
    xi, gain = np.zeros(n), np.zeros((n, 3))
    for j in range(n):
        for i in range(3):
            for k in range(3):
                gain[j, i] += across[j, k] * inverse[k, i]
            xi[j] += gain[j, i] * z[i]
    for j in range(n):
        for k in range(j + 1):
            change = gain[j, 0] * across[k, 0] + gain[j, 1] * across[k, 1] + gain[j, 2] * across[k, 2]
            cov[j, k] -= change
            if k < j:
                cov[k, j] = cov[j, k]
    retract(state, xi)
    return -0.5 * (quadratic(z, inverse) + math.log(determinant(total)))


@kernel
def _anchor(state: BestState, row: Array, rot_base_from_imu: Array, placed: bool) -> None:
    """Make the frame of the source uncertain, and place it so that the sample fits, in place.

    Args:
        state: state of the filter, or one hypothesis; shift and turn of the frame, and their covariance, are changed.
        row: the sample, (26,) as in `ExternalLayout`.
        rot_base_from_imu: mounting of the IMU in base_link, (3, 3).
        placed: True if the sample has a position; else only the turn of the frame is set.
    """
    frame, at, x = frame_of(state), X.points + 3 * state.points.shape[0], state.x
    isolate(state.cov, frame, 3, FIXED.frame_sd**2)
    isolate(state.cov, frame + 3, 1, FIXED.frame_turn_sd**2)
    x[at + 3] = wrap_angle(row[EX.yaw] - _heading(state, rot_base_from_imu)[0])
    if placed:
        c, s = math.cos(x[at + 3]), math.sin(x[at + 3])
        x[at] = row[EX.position] - (c * x[X.pos] - s * x[X.pos + 1])
        x[at + 1] = row[EX.position + 1] - (s * x[X.pos] + c * x[X.pos + 1])
        x[at + 2] = row[EX.position + 2] - x[X.pos + 2]


@kernel
def _fits(state: BestState, z: Array, by: Array, noise: Array) -> bool:
    """Return True if the normalised square of an innovation (3 degrees of freedom) is below `FIXED.outlier` = 16.

    Args:
        state: state of the filter, or one hypothesis, whose error has n numbers.
        z: innovation, estimate minus sample, (3,), m, rad or m/s.
        by: derivative of the innovation by the error, (3, n).
        noise: covariance of the sample, (3, 3), unit of z squared.
    """
    total = _spread(state.cov, by, noise)[1]
    return bool(determinant(total) > 0.0 and quadratic(z, inverse3(total)[0]) < FIXED.outlier)


@kernel
def _take_part(
    state: BestState, part: int, row: Array, w: Array, q: Array, age: float, rot_base_from_imu: Array
) -> bool:
    """Correct the state, or each hypothesis, with a part of a sample, in place; return False if it was left out.

    Args:
        state: state of the filter; changed.
        part: `POSITION` = 0, `YAW` = 1 or `VELOCITY` = 2.
        row: the sample, (26,) as in `ExternalLayout`.
        w: gyro since the sample, IMU axes, (3,) rad/s.
        q: accelerometer since the sample, IMU axes, (3,) m/s^2.
        age: time since the sample, s.
        rot_base_from_imu: mounting of the IMU in base_link, (3, 3).
    """
    best = likeliest(state)
    first = state if best < 0 else mode(state, best)
    z, by, noise = expected(first, part, row, w, q, age, rot_base_from_imu)
    if not _fits(first, z, by, noise):
        return False
    if best < 0:
        _correct(state, z, by, noise)
        return True
    likely = np.zeros(state.weight.size)
    for h in range(state.weight.size):
        if state.weight[h] > 0.0:
            z, by, noise = expected(mode(state, h), part, row, w, q, age, rot_base_from_imu)
            likely[h] = _correct(mode(state, h), z, by, noise)
    weigh(state, likely)
    return True


@kernel
def _take_one(state: BestState, row: Array, w: Array, q: Array, age: float, rot_base_from_imu: Array) -> None:
    """Correct with all parts of one sample of another source, in place, and count what was left out.

    Args:
        state: state of the filter; changed.
        row: the sample, (26,) as in `ExternalLayout`; NaN: not in the sample.
        w: gyro since the sample, IMU axes, (3,) rad/s.
        q: accelerometer since the sample, IMU axes, (3,) m/s^2.
        age: time since the sample, s.
        rot_base_from_imu: mounting of the IMU in base_link, (3, 3).
    """
    memory, placed, headed = state.memory, not math.isnan(row[EX.position]), not math.isnan(row[EX.yaw])
    if headed and (memory[M.framed] == 0.0 or memory[M.jumps] >= FIXED.most_jumps):
        _anchor(state, row, rot_base_from_imu, placed)
        for h in range(state.weight.size):
            if state.weight[h] > 0.0:
                _anchor(mode(state, h), row, rot_base_from_imu, placed)
        memory[M.frames] += 1.0
        memory[M.framed], memory[M.jumps] = 1.0, 0.0
    good, posed = True, True
    if headed:
        posed = _take_part(state, YAW, row, w, q, age, rot_base_from_imu)
    if placed and posed:
        give_to_filter(state)
        posed = _take_part(state, POSITION, row, w, q, age, rot_base_from_imu)
    if not math.isnan(row[EX.velocity]):
        good = _take_part(state, VELOCITY, row, w, q, age, rot_base_from_imu)
    if headed:
        memory[M.jumps] = 0.0 if posed else memory[M.jumps] + 1.0
    memory[M.left_out] = 0.0 if good and posed else memory[M.left_out] + 1.0
    memory[M.externals] += 1.0
    memory[M.externals_out] += 0.0 if good and posed else 1.0


@kernel
def take_external(state: BestState, samples: SampleStore, at: int, setting: BestSetting) -> None:
    """Correct with the samples of another source between inertial rows `at` - 1 and `at`, in place.

    Args:
        state: state of the filter at row `at`; changed.
        samples: stored samples, filled rows only.
        at: inertial row.
        setting: geometry, noises and limits of the filter.
    """
    stamps, now = samples.external_stamps, samples.imu_stamps[at]
    last = after(stamps, now)
    for e in range(after(stamps, samples.imu_stamps[max(at - 1, 0)]), last):
        age = 1e-9 * (now - stamps[e])
        w, q = samples.imu[at, ROW_W : ROW_W + 3].copy(), samples.imu[at, ROW_Q : ROW_Q + 3].copy()
        _take_one(state, samples.external[e], w, q, age, setting.geometry.rot_base_from_imu)
