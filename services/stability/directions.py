"""Horizontal directions."""

import math

import numpy as np
from numpy.typing import ArrayLike

from services.stability.contacts import Array, StabilityError


def equally_spaced(count: int) -> Array:
    """`count` unit directions from +x counter-clockwise, (count, 2).

    Mirror images are bit-exact and multiples of 45 degrees are made of 0, 1 and sqrt(1/2): cos(pi/2) = 6e-17 would flip
    the verdict on facing walls.
    """
    out = np.empty((count, 2))
    for k in range(count):
        octant, rest = divmod(8 * k, count)
        if octant % 2:  # odd octants run backwards from the next multiple of 90 degrees
            rest = count - rest
        if rest == count:
            x = y = math.sqrt(0.5)
        else:
            x, y = math.cos(rest * math.pi / (4 * count)), math.sin(rest * math.pi / (4 * count))
        x, y = ((x, y), (y, x), (-y, x), (-x, y), (-x, -y), (-y, -x), (y, -x), (x, -y))[octant]
        out[k] = x + 0.0, y + 0.0  # no negative zero
    return out


def unit(directions: ArrayLike) -> Array:
    """Normalise directions (k, 2).

    Raises:
        StabilityError: a direction is zero or not finite.
    """
    a = np.array(directions, dtype=np.float64).reshape(-1, 2)
    for i in np.flatnonzero(~np.isfinite(a).all(axis=1)):
        raise StabilityError("not_finite", f"directions.{i}", f"got {a[i].tolist()}, must be finite")
    largest = np.abs(a).max(axis=1, initial=0.0)
    for i in np.flatnonzero(largest == 0.0):
        raise StabilityError("zero_direction", f"directions.{i}", "got the zero vector, a direction is needed")
    a /= largest[:, None]
    return np.ascontiguousarray(a / np.hypot(a[:, 0], a[:, 1])[:, None])
