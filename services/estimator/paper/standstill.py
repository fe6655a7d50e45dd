"""Standstill of the robot, and the sensor biases that a standstill shows (equation (1) of Wawrzynski et al.).

At rest the gyro reads its bias and the accelerometer reads g plus its bias.
"""

import math
from dataclasses import dataclass

import numpy as np

from surefoot.arrays import Array, Flags
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear import dot, eigen3, norm, product
from surefoot.kernels.jit import kernel

from ..params import EstimatorParams

DISAGREE = 4.0  # sigma
PATIENCE = 4
"""Number of windows at rest in a row that must contradict a bias to replace it: the first rest was a slow turn."""
MIN_SPREAD = 0.02  # m; feet closer to one line have no plane


@kernel
def _push(
    ring: Array, count: int, w: Array, q: Array, gyro_variance: float, acc_variance: float
) -> tuple[Array, Array, bool]:
    """Write one IMU sample over the oldest row of a ring, in place.

    Args:
        ring: gyro rad/s (3) and accelerometer m/s^2 (3) of the last n samples, IMU axes, (n, 6); changed.
        count: samples that were written before.
        w: gyro, IMU axes, (3,) rad/s.
        q: accelerometer, IMU axes, (3,) m/s^2.
        gyro_variance: largest variance of a gyro axis at rest, (rad/s)^2.
        acc_variance: largest variance of an accelerometer axis at rest, (m/s^2)^2.

    Returns:
        The row that was replaced (6,), the mean of the rows (6,), True if all variances are within the limits.
    """
    n, row = ring.shape[0], count % ring.shape[0]
    oldest = ring[row].copy()
    for i in range(3):
        ring[row, i] = w[i]
        ring[row, 3 + i] = q[i]
    mean, var = np.zeros(6), np.zeros(6)
    for r in range(n):
        for i in range(6):
            mean[i] += ring[r, i]
    mean /= n
    for r in range(n):
        for i in range(6):
            var[i] += (ring[r, i] - mean[i]) ** 2
    quiet = True
    for i in range(6):
        quiet = quiet and var[i] / n <= (gyro_variance if i < 3 else acc_variance)
    return oldest, mean, quiet


@kernel
def _travel(position: Array, since: Array) -> float:
    """Return the largest change of a coordinate of feet from `since` to `position`, m; those that are NaN do not count.

    Args:
        position: feet now, (L, 3) m.
        since: feet earlier, (L, 3) m.
    """
    most = 0.0
    for i in range(position.shape[0]):
        for k in range(3):
            moved = abs(position[i, k] - since[i, k])
            if moved > most:
                most = moved
    return most


@dataclass
class Standstill:
    """Detector of rest by the variances of the last `length` IMU samples and by the travel of the feet.

    Attributes:
        length: number of consecutive samples, 50 in `EstimatorParams`.
        gyro_sd: largest standard deviation of a gyro axis at rest, rad/s.
        acc_sd: largest standard deviation of an accelerometer axis at rest, m/s^2.
        travel: largest displacement of a foot in the IMU frame within `length` IMU samples at rest, m.

    A slow turn of the trunk looks like rest at first. Biases are therefore learned from `settled` alone: the sample
    that is `length` samples old, once the rest has lasted since `length` samples before that.
    """

    length: int
    gyro_sd: float
    acc_sd: float
    travel: float

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all samples; the robot counts as moving until a rest is seen again."""
        self._ring = np.zeros((self.length, 6))
        self._count = 0
        self._still_since = 0
        self._feet: Array | None = None
        self.standing = False
        self.settled: Array | None = None  # (6,) gyro rad/s and accelerometer m/s^2
        self.mean = np.zeros(6)  # (6,) mean gyro rad/s and accelerometer m/s^2 of the last `length` samples
        self._rest = 0

    def break_off(self) -> None:
        """Start the count of samples at rest anew, after a gap in the data."""
        self._count = 0
        self._rest = 0
        self._still_since = 0
        self.settled = None
        self.standing = False

    def on_imu(self, w: Array, q: Array) -> bool:
        """Take gyro w (3,) rad/s and accelerometer q (3,) m/s^2, IMU axes; return True if the robot stands."""
        oldest, mean, quiet = _push(self._ring, self._count, w, q, self.gyro_sd**2, self.acc_sd**2)
        self._count += 1
        if self._count < self.length:
            return False
        self.mean = mean
        self.standing = quiet and (self._feet is None or self._count - self._still_since >= self.length)
        self._rest = self._rest + 1 if self.standing else 0
        self.settled = oldest if self._rest > self.length else None
        return self.standing

    def on_feet(self, position: Array) -> None:
        """Take foot positions (L, 3) m in IMU axes, NaN = unknown: at rest they must stay where they are."""
        if self._feet is None:
            self._feet = position.copy()
            return
        if _travel(position, self._feet) > self.travel:
            self._feet = position.copy()
            self._still_since = self._count


@kernel
def _refined(
    value: Array, samples: int, mean: Array, w: Array, length: int, sigma: float, floor: float, most: int
) -> tuple[Array, int]:
    """Return the gyro bias (3,) rad/s and the number of its samples after one more sample w at rest.

    Nothing changes if the mean of a window is further than 4 sigma from the bias: the robot turns slowly.

    Args:
        value: bias so far, the mean of `samples` samples, IMU axes, (3,) rad/s.
        samples: number of samples in it.
        mean: mean gyro of the last `length` samples, (3,) rad/s.
        w: gyro of the sample, (3,) rad/s.
        length: number of samples of a window.
        sigma: standard deviation of one sample, rad/s.
        floor: smallest standard deviation of a bias, rad/s.
        most: largest number of samples; from there on older ones are forgotten.
    """
    if samples > 0:
        sd = math.hypot(sigma * math.sqrt(1.0 / length + 1.0 / samples), floor)
        for i in range(3):
            if abs(mean[i] - value[i]) > 4.0 * sd:
                return value, samples
    count, after = min(samples + 1, most), np.empty(3)
    for i in range(3):
        after[i] = value[i] + (w[i] - value[i]) / count
    return after, count


@dataclass
class GyroBias:
    """Bias of the gyro, its mean over all samples at rest: b <- b + (w - b)/n for the n-th sample w.

    Attributes:
        sigma: standard deviation of one sample, rad/s.
        floor: smallest standard deviation that a bias is given, rad/s (drift while the gyro runs).
        most: number of samples after which the mean forgets older ones.
    """

    sigma: float
    floor: float
    most: int = 6000

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the bias of the gyro."""
        self.value = np.zeros(3)  # (3,) rad/s, IMU axes
        self.samples = 0
        self._against = 0

    def interrupt(self) -> None:
        """Reset the count of contradictions because the robot moves: those of two rests do not add up."""
        self._against = 0

    def start(self, mean: Array, samples: int) -> None:
        """Take the mean gyro, IMU axes, (3,) rad/s, of a whole window of `samples` samples as the bias."""
        self.value = mean.copy()
        self.samples = samples

    def refine(self, mean: Array, w: Array, length: int) -> None:
        """Update the gyro bias by one more sample at rest.

        A window that contradicts the bias shows a slow turn of the robot, which is left out; a rest that does so for
        `PATIENCE` windows shows that the old bias was learned in such a turn, and gives a new bias.

        Args:
            mean: mean of the gyro over the last `length` samples, (3,) rad/s.
            w: the sample, (3,) rad/s.
            length: number of samples of a window.
        """
        value, samples = _refined(self.value, self.samples, mean, w, length, self.sigma, self.floor, self.most)
        refused = samples == self.samples and bool(np.all(value == self.value))
        self._against = self._against + 1 if refused else 0
        self.value, self.samples = value, samples
        if self._against >= PATIENCE * length:
            self.start(mean, length)
            self._against = 0


def gravity_at_rest(mean_q: Array, up: Array | None, params: EstimatorParams) -> tuple[Array, float]:
    """Return g at rest: the mean accelerometer, or its blend with the normal of the ground under the feet.

    The accelerometer alone does not separate its bias from a tilt. If the slope of the start place is stated as 0 +- s
    rad, the plane of the feet is a second measurement. With b the sd of the bias of an axis, s' = 9.81 s and the weight
    k = b^2/(b^2 + s'^2):  g = (1 - k) mean q + k 9.81 up, variance of its direction k s'^2. Measurements further apart
    than `DISAGREE` = 4 sigma contradict the statement: then the accelerometer alone counts.

    Args:
        mean_q: mean accelerometer, IMU axes, (3,) m/s^2.
        up: upward unit normal of the plane of the feet, IMU axes, (3,), or None.
        params: `acc_bias_sd` = b, `start_slope_sd` = s, infinite if unknown.

    Returns:
        g (3,) m/s^2, and the variance of an axis of it that no motion will ever reveal, m^2/s^4.
    """
    bias, stated = params.acc_bias_sd**2, (GRAVITY * params.start_slope_sd) ** 2
    if up is None or not np.isfinite(stated) or bias == 0.0:
        return mean_q.copy(), bias
    apart = GRAVITY * (mean_q / norm(mean_q) - up)
    if dot(apart, apart) > DISAGREE**2 * (bias + stated):
        return mean_q.copy(), bias
    k = bias / (bias + stated)
    return (1.0 - k) * mean_q + k * GRAVITY * up, k * stated


def plane_normal(points: Array, used: Flags, g: Array) -> Array | None:
    """Return the unit normal (3,) of the plane through the used points, on the side of g; None: they span no plane.

    Args:
        points: positions of the L feet, (L, 3) m, IMU axes.
        used: points to take, (L,) bool.
        g: specific force at rest, (3,) m/s^2, IMU axes.
    """
    chosen = points[used]
    if len(chosen) < 3:
        return None
    centred = chosen - chosen.mean(axis=0)
    square, axes = eigen3(product(centred.T, centred))
    if square[1] < MIN_SPREAD**2:
        return None
    return axes[2] if dot(axes[2], g) > 0.0 else -axes[2]
