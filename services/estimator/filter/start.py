"""Start of the `best` filter: at rest, or from one sample of a robot in motion."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear_kernels import inverse3, times
from surefoot.kernels.jit import kernel

from ..feet.contact import BestGeometry, points_of
from ..inputs.timeline import after
from .point import lift
from .state import (
    ACC_BIAS,
    AGE,
    DOUBTED,
    E_ACC,
    E_GYRO,
    E_POINTS,
    E_POS,
    E_VEL,
    EXCESS,
    GYRO_BIAS,
    LAST_GYRO,
    LONG_AGO,
    LOST_FOR,
    MOVING,
    NO_FEET,
    PHASE,
    POS,
    PUSH,
    REST,
    ROT,
    SINCE,
    STARTED,
    VEL,
    BestNoise,
    BestState,
    rotation,
    turn_matrix,
    turned,
)
from .update import UNKNOWN_SPEED

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

MOVING_TILT = 0.52  # rad, 30 deg: how wrong the first guess of a robot in motion may be
CONTRADICTION = 4.0  # sigma by which the accelerometer may differ from the stated slope
PLANE_POINT = 5e-4  # m, by which a foot of an assembled robot is beside its model
TILTED = 0.7  # m/s^2, mean horizontal acceleration by the inertial unit while the velocity is lost again and again,
TILTED_FOR = 0.1  # s at least, that shows a wrong tilt: 4 deg
TILTED_SD = 0.3  # rad, tilt by the mean accelerometer of a robot in motion
UPRIGHT = 0.76  # cosine of 40 deg: a robot that is tilted further has fallen, and lost its feet by that
FALLING = 0.1  # share by which the mean specific force of one that stands may differ from gravity; in a fall it is less
ROW_W, ROW_Q = 0, 3  # columns of an inertial row
BLOCK = 16  # rows of which a rest is judged at a time


class BestLimits(NamedTuple):
    """Start and rest, SI."""

    samples: int  # inertial samples of a rest
    gyro_variance: float  # (rad/s)^2, largest of an axis at rest
    acc_variance: float  # (m/s^2)^2
    travel: float  # m, largest move of a foot in them
    gyro_bias_sd: float  # rad/s, of an unknown bias
    creep: float  # rad/s, by which a robot at rest may still turn
    turn_creep: float  # rad/s, the same about the vertical
    acc_bias_sd: float  # m/s^2
    slope_sd: float  # rad, of the ground at the start, infinite = unknown
    start: Array  # (4,) x, y, yaw of base_link and height of the ground under it, m and rad
    start_sd: float  # m and rad
    gap_s: float  # s between inertial samples: uncertainty is added
    forget_s: float  # s: velocity and feet are unknown
    max_speed: float  # m/s; a faster estimate is an error
    level_sd: float  # m, of a point over level ground; infinite = the ground may have any shape
    hypotheses: bool  # points may slide


@kernel
def _level(up: Array, rot_base_from_imu: Array, yaw: float) -> Array:
    """rot_odom_from_imu (3, 3) with this up (3,), IMU axes, and base_link's x axis at `yaw`; y if x is vertical."""
    z = np.empty(3)
    for i in range(3):
        z[i] = 0.0
        for k in range(3):
            z[i] += rot_base_from_imu[i, k] * up[k]
    axis = 0 if abs(z[0]) < 0.9 else 1
    ahead, size = np.empty(3), 0.0
    for i in range(3):
        ahead[i] = (1.0 if i == axis else 0.0) - z[axis] * z[i]
        size += ahead[i] * ahead[i]
    size = math.sqrt(size)
    level = np.empty((3, 3))  # rot_heading_from_base
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        level[axis, i] = ahead[i] / size
        side = (z[j] * ahead[k] - z[k] * ahead[j]) / size
        level[1 - axis, i] = side if axis == 0 else -side
        level[2, i] = z[i]
    c, s = math.cos(yaw), math.sin(yaw)
    for i in range(3):
        x, y = level[0, i], level[1, i]
        level[0, i], level[1, i] = c * x - s * y, s * x + c * y
    return times(level, rot_base_from_imu)


@kernel
def rests(rows: Array, stamps: Stamps, at: int, feet: Array, feet_stamps: Stamps, limits: BestLimits) -> bool:
    """Whether inertial rows and feet (M, L, 3) of the window that ends with row `at` say that the robot rests."""
    n = limits.samples
    if at + 1 < n:
        return False
    mean, square, count = np.zeros(6), np.zeros(6), 0
    while count < n:  # block by block from the newest: a robot that walks shows it in the first
        some = min(BLOCK, n - count)
        end = at + 1 - count
        for c in range(6):
            own, spread = 0.0, 0.0
            for r in range(end - some, end):
                own += rows[r, c]
            own /= some
            for r in range(end - some, end):
                spread += (rows[r, c] - own) ** 2
            apart = own - mean[c]  # means and sums of squares of two parts together: Chan et al. 1979
            square[c] += spread + apart * apart * count * some / (count + some)
            mean[c] += apart * some / (count + some)
            if square[c] > n * (limits.gyro_variance if c < ROW_Q else limits.acc_variance):
                return False
        count += some
    first, last = after(feet_stamps, stamps[at + 1 - n] - 1), after(feet_stamps, stamps[at])
    for f in range(feet.shape[1]):
        for i in range(3):
            mean = 0.0
            for m in range(first, last):
                mean += feet[m, f, i]
            mean /= max(last - first, 1)
            for m in range(first, last):
                if abs(feet[m, f, i] - mean) > limits.travel:
                    return False
    return bool(last > first)


@kernel
def _begin(state: BestState, rot: Array, geometry: BestGeometry, limits: BestLimits, foot: int, feet: Array,
           foot_rots: Array, contact: Array) -> None:  # fmt: skip
    """Set attitude and position, everything else to zero, with the covariance of a stated pose, in place."""
    x, cov = state.x, state.cov
    for k in range(state.points.shape[0]):
        lift(state, k)
    for i in range(E_POINTS):
        for j in range(cov.shape[0]):
            cov[i, j] = 0.0
            cov[j, i] = 0.0
    lever, height, standing = np.zeros(3), 0.0, 0
    for i in range(3):
        for k in range(3):
            x[ROT + 3 * i + k] = rot[i, k]
            for m in range(3):
                lever[i] += rot[i, k] * geometry.rot_base_from_imu[m, k] * geometry.imu_position[m]
        x[VEL + i] = x[GYRO_BIAS + i] = x[ACC_BIAS + i] = 0.0
    if foot >= 0:
        y, _ = points_of(geometry.foot, geometry.place, feet[foot], foot_rots[foot])
        for k in range(geometry.foot.size):
            if contact[foot, k] >= 0.5:
                height += geometry.radius[k] - turned(rot, y[k])[2]
                standing += 1
    x[POS], x[POS + 1] = limits.start[0] + lever[0], limits.start[1] + lever[1]
    x[POS + 2] = limits.start[3] + (height / standing if standing else lever[2])
    for i in range(3):
        cov[E_POS + i, E_POS + i] = limits.start_sd**2
    cov[2, 2] = limits.start_sd**2
    state.memory[EXCESS], state.memory[SINCE], state.memory[AGE] = 1.0, NO_FEET, 0.0


@kernel
def _plane(points: Array, used: Array, up: Array) -> tuple[Array, float]:
    """Upward normal (3,) of the plane through used points (K, 3), and their least spread in it, m (0: no plane)."""
    centre, n = np.zeros(3), 0
    for k in range(used.size):
        if used[k] >= 0.5:
            n += 1
            for i in range(3):
                centre[i] += points[k, i]
    if n < 3:
        return up, 0.0
    square, trace = np.zeros((3, 3)), 0.0
    for k in range(used.size):
        if used[k] >= 0.5:
            for i in range(3):
                for j in range(3):
                    square[i, j] += (points[k, i] - centre[i] / n) * (points[k, j] - centre[j] / n) / n
    for i in range(3):
        trace += square[i, i]
    if trace < 1e-12:
        return up, 0.0
    for i in range(3):
        square[i, i] += 1e-9 * trace
    inverse, normal = inverse3(square)[0], up.copy()
    for _ in range(8):  # inverse iteration: the axis of the least spread
        normal = turned(inverse, normal)
        size = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
        for i in range(3):
            normal[i] /= size
    least, along = 0.0, 0.0
    for i in range(3):
        along += normal[i] * up[i]
        for j in range(3):
            least += normal[i] * square[i, j] * normal[j]
    if along < 0.0:
        for i in range(3):
            normal[i] = -normal[i]
    # the two others: their sum and the sum of principal minors give the smaller
    minors = 0.0
    for i in range(3):
        j = (i + 1) % 3
        minors += square[i, i] * square[j, j] - square[i, j] * square[j, i]
    total = trace - least
    product = max(minors - least * total, 0.0)
    smaller = 0.5 * (total - math.sqrt(max(total * total - 4.0 * product, 0.0)))
    return normal, math.sqrt(max(smaller, 0.0))


@kernel
def start_at_rest(state: BestState, rows: Array, at: int, feet_stamps: Stamps, stamps: Stamps, feet: Array,
                  foot_rots: Array, contact: Array, geometry: BestGeometry, noise: BestNoise,
                  limits: BestLimits) -> None:  # fmt: skip
    """Start with the means of a rest (equation (1) of Wawrzynski et al., and the biases), in place.

    The accelerometer cannot tell its bias b from a tilt: q = R^T G + b. A stated slope of the ground, 0 +- s rad, makes
    the plane of the contact points a second witness of the vertical; both are weighted by their variances, unless they
    contradict each other.
    """
    n = limits.samples
    w, q = np.zeros(3), np.zeros(3)
    for r in range(at + 1 - n, at + 1):
        for i in range(3):
            w[i] += rows[r, ROW_W + i] / n
            q[i] += rows[r, ROW_Q + i] / n
    size = math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2)
    foot = after(feet_stamps, stamps[at]) - 1
    up, tilt_sd = q / size, limits.acc_bias_sd / GRAVITY
    if foot >= 0 and math.isfinite(limits.slope_sd) and tilt_sd > 0.0:
        y, _ = points_of(geometry.foot, geometry.place, feet[foot], foot_rots[foot])
        normal, spread = _plane(y, contact[foot], up)
        if spread > 0.02:
            sd = math.sqrt(limits.slope_sd**2 + (PLANE_POINT / spread) ** 2)
            apart = (normal[0] - up[0]) ** 2 + (normal[1] - up[1]) ** 2 + (normal[2] - up[2]) ** 2
            if apart < CONTRADICTION**2 * (sd**2 + tilt_sd**2):
                k = tilt_sd**2 / (tilt_sd**2 + sd**2)
                for i in range(3):
                    up[i] += k * (normal[i] - up[i])
                tilt_sd = sd * math.sqrt(k)
                size_up = math.sqrt(up[0] ** 2 + up[1] ** 2 + up[2] ** 2)
                for i in range(3):
                    up[i] /= size_up
    rot = _level(up, geometry.rot_base_from_imu, limits.start[2])
    _begin(state, rot, geometry, limits, foot, feet, foot_rots, contact)
    cov, bias_sd = state.cov, math.sqrt(noise.sample_gyro**2 / n + limits.creep**2)
    for i in range(3):
        state.x[GYRO_BIAS + i], state.x[ACC_BIAS + i] = w[i], q[i] - GRAVITY * up[i]
        cov[E_VEL + i, E_VEL + i] = 1e-4
        cov[E_GYRO + i, E_GYRO + i] = bias_sd**2
        cov[E_ACC + i, E_ACC + i] = limits.acc_bias_sd**2
    # b = q - R^T G exactly: a tilt xi shows as the bias R db = -[G] xi
    for i in range(2):
        cov[i, i] = tilt_sd**2
    for i in range(3):
        east, north = -GRAVITY * rot[1, i] * tilt_sd**2, GRAVITY * rot[0, i] * tilt_sd**2
        cov[E_ACC + i, 0] = cov[0, E_ACC + i] = east
        cov[E_ACC + i, 1] = cov[1, E_ACC + i] = north
        for j in range(3):
            across = rot[0, i] * rot[0, j] + rot[1, i] * rot[1, j]
            cov[E_ACC + i, E_ACC + j] = (
                rot[2, i] * rot[2, j] * limits.acc_bias_sd**2 + across * (GRAVITY * tilt_sd) ** 2
            )
        cov[E_ACC + i, E_ACC + i] += noise.acc**2 / (0.01 * n)
    state.memory[PHASE] = STARTED
    state.memory[REST] = 1.0  # its samples are taken: the next rest begins here


@kernel
def start_moving(state: BestState, q: Array, w: Array, foot: int, feet: Array, foot_rots: Array, contact: Array,
                  geometry: BestGeometry, limits: BestLimits) -> None:  # fmt: skip
    """Start with nothing but one sample: up by the accelerometer, 30 deg wrong, at an unknown speed, in place."""
    size = math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2)
    up = q / size if size > 0.1 * GRAVITY else np.array([0.0, 0.0, 1.0])
    rot = _level(up, geometry.rot_base_from_imu, limits.start[2])
    _begin(state, rot, geometry, limits, foot, feet, foot_rots, contact)
    for i in range(3):
        if i < 2:
            state.cov[i, i] = MOVING_TILT**2
        state.cov[E_VEL + i, E_VEL + i] = UNKNOWN_SPEED**2
        state.cov[E_GYRO + i, E_GYRO + i] = limits.gyro_bias_sd**2
        state.cov[E_ACC + i, E_ACC + i] = limits.acc_bias_sd**2
        state.memory[LAST_GYRO + i] = w[i]
    state.memory[PHASE], state.memory[REST] = MOVING, 0.0


@kernel
def judge_tilt(state: BestState, limits: BestLimits) -> None:
    """Doubt the tilt when the velocity is lost again and again, in place; to be called at each loss.

    With a tilt that is wrong by a, the velocity by the inertial unit runs away from the feet with 9.81 sin a m/s^2
    until it is lost, and again. The mean specific force in odom since the first loss points up, up to what a walk
    accelerates: the attitude is turned so that it does, tilt and accelerometer bias are unknown again. Heading,
    position and gyro bias stay. A robot that falls loses its velocity, too: its specific force is not that of one that
    stands, and its tilt by the gyro is right.
    """
    memory, cov, n = state.memory, state.cov, state.cov.shape[0]
    if memory[LOST_FOR] < 0.0:
        memory[LOST_FOR] = 0.0
        for i in range(3):
            memory[PUSH + i] = 0.0
        return
    ahead, side, up = memory[PUSH], memory[PUSH + 1], memory[PUSH + 2] + GRAVITY * memory[LOST_FOR]
    level = math.sqrt(ahead * ahead + side * side)
    if memory[LOST_FOR] < TILTED_FOR or level < TILTED * memory[LOST_FOR]:
        return
    force = math.sqrt(level * level + up * up) / memory[LOST_FOR]
    if abs(force - GRAVITY) > FALLING * GRAVITY or rotation(state.x)[2, 2] < UPRIGHT:
        return
    angle = math.atan2(level, up)
    turn = turn_matrix(np.array([side / level * angle, -ahead / level * angle, 0.0]))
    rot = times(turn, rotation(state.x))
    for k in range(state.points.shape[0]):
        lift(state, k)
    for i in range(3):
        for k in range(3):
            state.x[ROT + 3 * i + k] = rot[i, k]
        state.x[ACC_BIAS + i] = 0.0
        for j in range(n):
            cov[E_ACC + i, j] = cov[j, E_ACC + i] = 0.0
            if i < 2:
                cov[i, j] = cov[j, i] = 0.0
        cov[E_ACC + i, E_ACC + i] = limits.acc_bias_sd**2
        if i < 2:
            cov[i, i] = TILTED_SD**2
    memory[PHASE], memory[AGE], memory[EXCESS], memory[LOST_FOR] = DOUBTED, 0.0, 1.0, LONG_AGO
