"""Start of the `best` filter: at rest, or from one sample of a robot in motion."""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear_kernels import inverse3, quadratic, times, turned
from surefoot.kernels.jit import kernel

from ..feet.contact import points_of
from ..params import UNKNOWN_SPEED
from .ground import forget_levels
from .layout import LONG_AGO, MOVING, NO_FEET, STARTED, E, M, X
from .noise import FIXED, BestLimits, BestSetting
from .point import lift
from .samples import ROW_Q, ROW_W, SampleStore, after
from .state import BestState, isolate, set_rotation

BLOCK = 16
"""Number of rows of a possible rest that are checked at a time."""


@kernel
def _level(up: Array, rot_base_from_imu: Array, yaw: float) -> Array:
    """Return rot_odom_from_imu (3, 3) from the vertical and a heading.

    Args:
        up: upward unit vector, IMU axes, (3,).
        rot_base_from_imu: mounting of the IMU in base_link, (3, 3).
        yaw: heading of base_link's x in odom, rad; if x is nearly vertical, y of base_link is 90 deg to the left of it.
    """
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
def rests(samples: SampleStore, at: int, limits: BestLimits) -> bool:
    """Return True if the last `limits.samples` inertial samples up to row `at`, and the feet meanwhile, show a rest.

    At rest each axis of gyro and accelerometer has a small variance, and no foot moves further than `limits.travel`.
    """
    n, rows, stamps, feet = limits.samples, samples.imu, samples.imu_stamps, samples.feet
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
    first = after(samples.feet_stamps, stamps[at + 1 - n] - 1)
    last = after(samples.feet_stamps, stamps[at])
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
def _begin(state: BestState, rot: Array, samples: SampleStore, foot: int, setting: BestSetting) -> None:
    """Set attitude and position, everything else to zero, with the covariance of a stated pose, in place.

    Args:
        state: state of the filter; changed.
        rot: rot_odom_from_imu, (3, 3).
        samples: stored samples.
        foot: the row of the feet that shows the height over the ground; -1: none.
        setting: geometry, noises and limits of the filter; holds the start pose.
    """
    x, geometry, limits = state.x, setting.geometry, setting.limits
    for k in range(state.points.shape[0]):
        lift(state, k)
    isolate(state.cov, E.rot, E.points, 0.0)
    set_rotation(x, rot)
    lever, height, standing = np.zeros(3), 0.0, 0
    for i in range(3):
        for k in range(3):
            for m in range(3):
                lever[i] += rot[i, k] * geometry.rot_base_from_imu[m, k] * geometry.imu_position[m]
        x[X.vel + i] = x[X.gyro_bias + i] = x[X.acc_bias + i] = state.memory[M.own_bias + i] = 0.0
    if foot >= 0:
        y, _ = points_of(geometry.foot, geometry.place, samples.feet[foot], samples.foot_rots[foot])
        for k in range(geometry.foot.size):
            if samples.contact[foot, k] >= 0.5:
                height += geometry.radius[k] - turned(rot, y[k])[2]
                standing += 1
    x[X.pos], x[X.pos + 1] = limits.start.x + lever[0], limits.start.y + lever[1]
    x[X.pos + 2] = limits.start.ground + (height / standing if standing else lever[2])
    for i in (E.pos, E.pos + 1, E.pos + 2, E.rot + 2):
        state.cov[i, i] = limits.start_sd**2
    state.memory[M.excess], state.memory[M.since], state.memory[M.age] = 1.0, NO_FEET, 0.0
    state.memory[M.framed], state.memory[M.woke] = 0.0, LONG_AGO
    forget_levels(state.memory)
    for i in range(M.pose_extra, M.pose_extra + 7):
        state.memory[i] = 0.0


@kernel
def _plane(points: Array, used: Array, up: Array) -> tuple[Array, float]:
    """Return the upward unit normal (3,) of the plane through some points, and their smaller rms spread in it, m.

    Args:
        points: all points, (K, 3) m.
        used: weight of each, (K,); points from one half on are taken.
        up: upward unit vector in the axes of the points, (3,).

    Returns:
        The normal, and the spread; `up` and 0 if fewer than three points are used.
    """
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
    least, along = quadratic(normal, square), 0.0
    for i in range(3):
        along += normal[i] * up[i]
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
def _up_at_rest(q: Array, samples: SampleStore, foot: int, setting: BestSetting) -> tuple[Array, float]:
    """Return up (3,), IMU axes, and its standard deviation, rad, by accelerometer and plane of the feet.

    The accelerometer alone does not separate its bias b from a tilt: q = R^T G + b, with R the attitude and G gravity
    upwards. A stated slope of the ground, 0 +- s rad, makes the plane of the contact points a second measurement of the
    vertical; both are weighted by their variances, unless they contradict each other.

    Args:
        q: mean accelerometer of the rest, IMU axes, (3,) m/s^2.
        samples: stored samples.
        foot: the last row of the feet; -1: none.
        setting: geometry, noises and limits of the filter.
    """
    geometry, limits = setting.geometry, setting.limits
    size = math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2)
    up, tilt_sd = q / size, limits.acc_bias_sd / GRAVITY
    if foot >= 0 and math.isfinite(limits.slope_sd) and tilt_sd > 0.0:
        y, _ = points_of(geometry.foot, geometry.place, samples.feet[foot], samples.foot_rots[foot])
        normal, spread = _plane(y, samples.contact[foot], up)
        if spread > 0.02:
            sd = math.sqrt(limits.slope_sd**2 + (FIXED.plane_point / spread) ** 2)
            apart = (normal[0] - up[0]) ** 2 + (normal[1] - up[1]) ** 2 + (normal[2] - up[2]) ** 2
            if apart < FIXED.contradiction**2 * (sd**2 + tilt_sd**2):
                k = tilt_sd**2 / (tilt_sd**2 + sd**2)
                for i in range(3):
                    up[i] += k * (normal[i] - up[i])
                tilt_sd = sd * math.sqrt(k)
                size_up = math.sqrt(up[0] ** 2 + up[1] ** 2 + up[2] ** 2)
                for i in range(3):
                    up[i] /= size_up
    return up, tilt_sd


@kernel
def shown_noise(rows: Array, mean: Array, stated: float) -> float:
    """Return the factor by which the stated noise of a sensor is multiplied, from the noise that a rest shows.

    If the middle axis is above 1.3 times the stated noise, the factor is their ratio; else it is 1.6 (`most_noise`)
    times the ratio of the noisiest axis to the stated noise, at most 1. If that axis is below 3 % (`least_noise`) of
    the stated noise, it shows the steps of the sensor, not its noise: the factor is 1.

    Args:
        rows: samples of one sensor at rest, (n, 3), rad/s or m/s^2.
        mean: mean of `rows`, (3,), in their unit.
        stated: standard deviation of one sample as stated, unit of `rows`.
    """
    least, most, total = math.inf, 0.0, 0.0
    for i in range(3):
        square = 0.0
        for r in range(rows.shape[0]):
            square += (rows[r, i] - mean[i]) ** 2 / rows.shape[0]
        least, most, total = min(least, square), max(most, square), total + square
    middle = max(total - least - most, least)
    if math.sqrt(most) < FIXED.least_noise * stated or stated == 0.0:
        return 1.0
    if math.sqrt(middle) > FIXED.more_noise * stated:
        return math.sqrt(middle) / stated
    return min(FIXED.most_noise * math.sqrt(most) / stated, 1.0)


@kernel
def start_at_rest(state: BestState, samples: SampleStore, at: int, setting: BestSetting) -> None:
    """Start with the means of the rest that ends at inertial row `at` (equation (1) of Wawrzynski et al.), in place.

    Args:
        state: state of the filter; it becomes one at rest, with biases and tilt by the means.
        samples: stored samples.
        at: last inertial row of the rest.
        setting: geometry, noises and limits of the filter.
    """
    limits, noise = setting.limits, setting.noise
    n = limits.samples
    w, q = np.zeros(3), np.zeros(3)
    for r in range(at + 1 - n, at + 1):
        for i in range(3):
            w[i] += samples.imu[r, ROW_W + i] / n
            q[i] += samples.imu[r, ROW_Q + i] / n
    foot = after(samples.feet_stamps, samples.imu_stamps[at]) - 1
    up, tilt_sd = _up_at_rest(q, samples, foot, setting)
    rot = _level(up, setting.geometry.rot_base_from_imu, limits.start.yaw)
    _begin(state, rot, samples, foot, setting)
    rows, memory = samples.imu[at + 1 - n : at + 1], state.memory
    memory[M.shown] = shown_noise(rows[:, ROW_W : ROW_W + 3], w, noise.sample_gyro)
    memory[M.shown + 1] = shown_noise(rows[:, ROW_Q : ROW_Q + 3], q, noise.sample_acc)
    cov, bias_sd = state.cov, math.sqrt((memory[M.shown] * noise.sample_gyro) ** 2 / n + limits.creep**2)
    for i in range(3):
        state.x[X.gyro_bias + i], state.x[X.acc_bias + i] = w[i], q[i] - GRAVITY * up[i]
        memory[M.own_bias + i] = w[i]
        cov[E.vel + i, E.vel + i] = 1e-4
        cov[E.gyro_bias + i, E.gyro_bias + i] = bias_sd**2
        cov[E.acc_bias + i, E.acc_bias + i] = limits.acc_bias_sd**2
    # b = q - R^T G exactly: a tilt xi shows as the bias R db = -[G] xi
    for i in range(2):
        cov[i, i] = tilt_sd**2
    for i in range(3):
        east, north = -GRAVITY * rot[1, i] * tilt_sd**2, GRAVITY * rot[0, i] * tilt_sd**2
        cov[E.acc_bias + i, 0] = cov[0, E.acc_bias + i] = east
        cov[E.acc_bias + i, 1] = cov[1, E.acc_bias + i] = north
        for j in range(3):
            across = rot[0, i] * rot[0, j] + rot[1, i] * rot[1, j]
            cov[E.acc_bias + i, E.acc_bias + j] = (
                rot[2, i] * rot[2, j] * limits.acc_bias_sd**2 + across * (GRAVITY * tilt_sd) ** 2
            )
        cov[E.acc_bias + i, E.acc_bias + i] += (memory[M.shown + 1] * noise.acc) ** 2 / limits.rest_s
    memory[M.phase] = STARTED
    memory[M.rest] = 1.0  # its samples are taken: the next rest begins here


@kernel
def start_moving(state: BestState, samples: SampleStore, at: int, foot: int, setting: BestSetting) -> None:
    """Start from one sample: vertical by the accelerometer (30 deg standard deviation), unknown speed, in place.

    Args:
        state: state of the filter; changed.
        samples: stored samples.
        at: the inertial row.
        foot: the row of the feet.
        setting: geometry, noises and limits of the filter.
    """
    limits, q = setting.limits, samples.imu[at, ROW_Q : ROW_Q + 3]
    size = math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2)
    up = q / size if size > 0.1 * GRAVITY else np.array([0.0, 0.0, 1.0])
    rot = _level(up, setting.geometry.rot_base_from_imu, limits.start.yaw)
    _begin(state, rot, samples, foot, setting)
    for i in range(3):
        if i < 2:
            state.cov[E.rot + i, E.rot + i] = FIXED.moving_tilt**2
        state.cov[E.vel + i, E.vel + i] = UNKNOWN_SPEED**2
        state.cov[E.gyro_bias + i, E.gyro_bias + i] = limits.gyro_bias_sd**2
        state.cov[E.acc_bias + i, E.acc_bias + i] = limits.acc_bias_sd**2
        state.memory[M.last_gyro + i], state.memory[M.last_acc + i] = samples.imu[at, ROW_W + i], q[i]
    state.memory[M.phase], state.memory[M.rest], state.memory[M.excess] = MOVING, 0.0, FIXED.moving_excess
