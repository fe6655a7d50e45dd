"""Horizontal directions."""

import math

import numpy as np
from numpy.typing import ArrayLike

from surefoot.geometry.polygon import hull
from surefoot.kernels.jit import row_kernel

from .contacts import Array, StabilityError


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


AXES = equally_spaced(8)

NEEDLE = 1e-3  # sine of what two edges of a hull may at least turn at its sharp end


@row_kernel
def has_axes(directions: Array) -> bool:
    """Whether the directions contain +-x and +-y, which decide if a region is bounded."""
    found = 0
    for k in range(directions.shape[0]):
        x, y = directions[k, 0], directions[k, 1]
        if y == 0.0:
            found |= 1 if x > 0.0 else 2
        elif x == 0.0:
            found |= 4 if y > 0.0 else 8
    return found == 15


@row_kernel
def edge_normals(position: Array) -> Array:
    """Outward normals of the hull of the contacts if it has 3 to 8 edges, else the axes: on mild ground its edges.

    The axes for a needle, too: its normals are hardly less than half a turn apart, and the support lines between them
    cross nowhere near.
    """
    corners = hull(position[:, :2].copy())
    n = corners.shape[0]
    if n < 3 or n > 8:
        return AXES.copy()
    out = np.empty((n, 2))
    for i in range(n):
        j = (i + 1) % n
        dx, dy = corners[j, 0] - corners[i, 0], corners[j, 1] - corners[i, 1]
        length = math.hypot(dx, dy)
        out[i, 0], out[i, 1] = dy / length, -dx / length
    for i in range(n):
        j = (i + 1) % n
        turn = out[i, 0] * out[j, 1] - out[i, 1] * out[j, 0]
        if turn < NEEDLE and out[i, 0] * out[j, 0] + out[i, 1] * out[j, 1] < 0.0:
            return AXES.copy()
    return out


@row_kernel
def corner_normals(position: Array) -> Array:
    """Where refinement begins: outward at each corner of the hull of the contacts, between the normals of its edges.

    On mild ground the support points are these corners at once; directions between them then go where it is curved.
    """
    edges = edge_normals(position)
    n = edges.shape[0]
    out = np.empty((n, 2))
    for i in range(n):
        x, y = edges[i, 0] + edges[(i + 1) % n, 0], edges[i, 1] + edges[(i + 1) % n, 1]
        length = math.hypot(x, y)
        out[i, 0], out[i, 1] = x / length, y / length
    return out
