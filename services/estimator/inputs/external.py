"""A pose, heading or velocity from elsewhere (camera, motion capture, GNSS), checked and as one row of numbers."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from surefoot.arguments import NO_NUMBERS
from surefoot.arrays import Array

from .results import InputResult

SHAPES = (("position", 3), ("yaw", 1), ("velocity", 3))
"""Parts of a sample of another source in the order of a row, each with its number of components."""
LARGEST = {"position": 1e7, "yaw": 1e3, "velocity": 1e3}
"""Largest absolute value of a component: m (coordinates of the whole earth fit), rad (turns may be counted), m/s."""


@dataclass(frozen=True)
class ExternalSample:
    """Pose, heading or velocity from another source, such as a camera, at one moment; None = not in this sample.

    Args:
        position: position of the IMU in the frame of the source, z up, (3,) m, with its covariance, (3, 3) or (9,) m^2.
        yaw: heading of base_link in that frame, rad, with its variance, rad^2; a position needs one.
        velocity: velocity of the IMU in IMU axes, (3,) m/s, with its covariance, (3, 3) or (9,) (m/s)^2.
    """

    position: ArrayLike | None = None  # (3,) m, IMU in the frame of the source, z up
    position_covariance: ArrayLike | None = None  # (3, 3) or (9,) m^2, axes of that frame
    yaw: float | None = None  # rad, heading of base_link in that frame
    yaw_variance: float | None = None  # rad^2
    velocity: ArrayLike | None = None  # (3,) m/s, of the IMU, IMU axes
    velocity_covariance: ArrayLike | None = None  # (3, 3) or (9,) (m/s)^2, IMU axes

    def row(self) -> tuple[Array, InputResult]:
        """Return the numbers (26,) of the sample in the order of `ExternalLayout`, and the result of their check.

        The order is position, heading, velocity, and the covariance of each by rows; NaN = absent. A position needs a
        heading, for nothing else shows how its frame is turned against odom.
        """
        numbers: list[Array] = []
        spreads: list[Array] = []
        good = InputResult.OK
        for name, size in SHAPES:
            value, spread = (getattr(self, key) for key in (name, f"{name}_{'covariance' if size > 1 else 'variance'}"))
            numbers.append(_numbers(value, size))
            spreads.append(_numbers(spread, size * size))
            if value is None:
                continue
            if len(numbers[-1]) != size or len(spreads[-1]) != size * size:
                return np.full(26, np.nan), InputResult.SHAPE
            if not (np.isfinite(numbers[-1]).all() and np.isfinite(spreads[-1]).all()):
                good = InputResult.NONFINITE
            elif np.abs(numbers[-1]).max() > LARGEST[name]:
                good = InputResult.UNIT
            elif not _positive(spreads[-1].reshape(size, size)):
                good = InputResult.COVARIANCE
        if self.position is not None and self.yaw is None:
            good = InputResult.FRAME
        if self.position is None and self.yaw is None and self.velocity is None:
            good = InputResult.SHAPE
        return np.concatenate(numbers + spreads), good


def _numbers(value: ArrayLike | None, size: int) -> Array:
    """Return a part of a sample as a flat array, `size` NaN if it is absent, empty if it holds no numbers."""
    if value is None:
        return np.full(size, np.nan)
    try:
        found = np.ma.filled(np.ma.asarray(value, dtype=np.float64), np.nan)
    except (TypeError, ValueError, OverflowError):
        return np.empty(0)
    return np.empty(0) if np.asarray(value).dtype.kind in NO_NUMBERS else found.ravel()


def _positive(m: Array) -> bool:
    """Return True if m (1, 1) is above 0, or m (3, 3) is symmetric with positive leading minors: a covariance."""
    if len(m) == 1:
        return bool(m[0, 0] > 0.0)
    (a, b, c), (d, e, f), (g, h, i) = m.tolist()
    even = all(math.isclose(x, y, rel_tol=1e-6, abs_tol=1e-12) for x, y in ((b, d), (c, g), (f, h)))
    det = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return even and a > 0.0 and a * e - b * d > 0.0 and det > 0.0
