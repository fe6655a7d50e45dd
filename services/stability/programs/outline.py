"""Outline of a region: directions to begin with, polygons and answers in metres."""

import math
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.polygon import gap, hull
from surefoot.kernels.jit import row_kernel

from .contacts import AXES
from .fan import ENCLOSE, FEW, FEW_AT_ONCE, Fan, FanGoal, enclose, new_fan
from .lanes import LANES
from .reduced import Reduced

NEEDLE = 1e-3  # sine of the least turn between two edges at the sharp end of a hull


class Outline(NamedTuple):
    """Region of a set of ordinary contacts, in metres, frame of the request."""

    fine: bool
    """True: the directions have answers and the region has an area; False: the other fields are not valid."""
    fan: Fan
    """Answers of all directions of the fan, in the scaled frame of `Reduced`."""
    answers: int
    """Number of directions of the fan that have answers."""
    gap: float
    """Largest distance of outer from inner polygon, m, or an upper bound on that distance."""
    inner: Array
    """Corners of the polygon inside the region, (p, 2) m."""
    outer: Array
    """Corners of the polygon around the region, (q, 2) m."""
    direction: Array
    """Unit directions that were solved for, (k, 2); sorted by angle with the goal ENCLOSE."""
    point: Array
    """Positions x, y of the CoM in the region that lie farthest in each direction, (k, 2) m."""
    twist: Array
    """Certificate of each direction, (k, 4): virtual twist (v, w_z), v in m about the origin, w_z without unit."""
    force: Array
    """Contact forces that hold the CoM at each point, (k, n, 3) in units of the weight."""
    slack: Array
    """Duality gap of each direction: support value less a'p of the point p found, (k,) m."""


@row_kernel
def outline(r: Reduced, position: Array, first: Array, goal: FanGoal, limit: int, skip: int) -> Outline:
    """Solve for directions of a contact set and return its region of balance in metres.

    Args:
        r: cone programs of the set.
        position: points of contact, (n, 3) m; with the goal ENCLOSE the corners of their hull give further first
            directions.
        first: unit directions to solve for, (k, 2).
        goal: aim of further directions: ANSWER (none) or ENCLOSE (outer polygon near the inner one).
        limit: most directions with ENCLOSE.
        skip: without ENCLOSE, number of directions at the start whose answers are left out of the result.
    """
    if goal.kind == ENCLOSE:
        first = np.concatenate((corner_normals(hull(position[:, :2].copy())), first))
    count = first.shape[0]
    limit = max(limit, count)
    batch = FEW_AT_ONCE if limit <= FEW else LANES
    fan = new_fan(limit if goal.kind == ENCLOSE else count, r.a.shape[0])
    fan.direction[:count] = first
    count, fine, height, inner, outer = enclose(r, fan, 0, count, goal, limit, batch)
    a, length, n, k = r.a, r.length, r.a.shape[0], count - skip if fine else 0
    point, twist, force = np.empty((k, 2)), np.empty((k, 4)), np.zeros((k, n, 3))
    direction, slack = np.empty((k, 2)), np.empty(k)
    ox, oy, oz = r.origin[0], r.origin[1], r.origin[2]
    for i in range(k):
        s = fan.order[i] if goal.kind == ENCLOSE else skip + i
        ax, ay, w = fan.direction[s, 0], fan.direction[s, 1], fan.unknown[s, 3]
        direction[i, 0], direction[i, 1] = ax, ay
        point[i, 0], point[i, 1] = ox + length * fan.point[s, 0], oy + length * fan.point[s, 1]
        twist[i, 0] = length * fan.unknown[s, 0] - (ax * oz - w * oy)
        twist[i, 1] = length * fan.unknown[s, 1] - (w * ox + ay * oz)
        twist[i, 2] = length * fan.value[s] + ax * ox + ay * oy
        twist[i, 3] = w
        slack[i] = length * (fan.value[s] - ax * fan.point[s, 0] - ay * fan.point[s, 1])
        for j in range(n):
            for q in range(3):
                for d in range(3):
                    force[i, j, d] += a[j, q, d] * fan.force[s, j, q]
    for polygon in (inner, outer):
        for i in range(polygon.shape[0]):
            polygon[i, 0] = ox + length * polygon[i, 0]
            polygon[i, 1] = oy + length * polygon[i, 1]
    near = goal.kind == ENCLOSE and height <= goal.tolerance
    widest = height * length if near else gap(inner, outer)
    return Outline(fine, fan, count, widest, inner, outer, direction, point, twist, force, slack)


@row_kernel
def edge_normals(corners: Array) -> Array:
    """Return outward unit normals (e, 2) of a hull with e = 3 to 8 corners, (e, 2) m; else 8 directions, 45 deg apart.

    On mild ground these are the normals of the region's edges. A very thin hull gets the 8 directions, too: its normals
    are hardly less than half a turn apart, and the support lines between them cross far away.
    """
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
def corner_normals(corners: Array) -> Array:
    """Return unit directions at which refinement begins, (e, 2): outward at the e corners of a hull, `corners` in m.

    On mild ground the support points of these directions are the corners themselves, so that further directions serve
    the curved parts of the border. Hulls of less than 3 or more than 8 corners, and very thin ones, get 8 directions.
    """
    edges = edge_normals(corners)
    n = edges.shape[0]
    out = np.empty((n, 2))
    for i in range(n):
        x, y = edges[i, 0] + edges[(i + 1) % n, 0], edges[i, 1] + edges[(i + 1) % n, 1]
        length = math.hypot(x, y)
        out[i, 0], out[i, 1] = x / length, y / length
    return out
