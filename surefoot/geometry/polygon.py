"""Convex polygons in the plane: hull, area, signed distance, clipping, rays.

A polygon is its vertices (n, 2) in m, counter-clockwise, not closed; one vertex is a point, two are a segment.
"""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.kernels.jit import row_kernel

FLAT = 1e-12  # relative; a turn below it is taken as straight
MISSED = math.nan


@row_kernel
def _turn(a: Array, b: Array, c: Array) -> float:
    """Return twice the signed area of a triangle of points (2,), unit squared; above 0: c lies left of a to b."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


@row_kernel
def hull(points: Array) -> Array:
    """Return the convex hull of points (n, 2), any unit: vertices (m, 2), counter-clockwise (Andrew's monotone chain).

    It begins at the leftmost vertex (the lowest of them); points on an edge and duplicates are left out.
    """
    n = points.shape[0]
    if n == 0:
        return np.empty((0, 2))
    order = np.empty(n, dtype=np.int64)
    for i in range(n):  # insertion sort by x, then y: n is small, and often nearly sorted
        x, y, j = points[i, 0], points[i, 1], i
        while j > 0:
            k = order[j - 1]
            if points[k, 0] < x or (points[k, 0] == x and points[k, 1] <= y):
                break
            order[j] = k
            j -= 1
        order[j] = i
    first, last = order[0], order[n - 1]
    height = 0.0
    for i in range(n):
        height = max(height, abs(points[i, 1] - points[first, 1]))
    size = max(points[last, 0] - points[first, 0], height)
    floor = FLAT * size * size
    if size == 0.0:
        return points[first : first + 1].copy()
    chain = np.empty((2 * n, 2))
    m = 0
    for side in range(2):
        base = m
        for step in range(n):
            i = order[step] if side == 0 else order[n - 1 - step]
            while m - base >= 2 and _turn(chain[m - 2], chain[m - 1], points[i]) <= 0.0:
                m -= 1
            if m - base == 1:
                dx, dy = points[i, 0] - chain[m - 1, 0], points[i, 1] - chain[m - 1, 1]
                if dx * dx + dy * dy <= floor * FLAT:
                    continue
            chain[m, 0], chain[m, 1] = points[i, 0], points[i, 1]
            m += 1
        # only now: the points of an upright edge are sorted by the rounding of x, up and down; with a tolerance above
        # one that lies back along the edge would take the end of the edge away
        kept = min(base + 1, m)
        for k in range(base + 1, m):
            if k == m - 1 or _turn(chain[kept - 1], chain[k], chain[k + 1]) > floor:
                chain[kept, 0], chain[kept, 1] = chain[k, 0], chain[k, 1]
                kept += 1
        m = kept - 1  # the end of one chain begins the other
    return chain[: max(m, 1)].copy()


@row_kernel
def area(polygon: Array) -> float:
    """Return the signed area of a polygon, vertices (n, 2), in its unit squared; positive counter-clockwise."""
    total, n = 0.0, polygon.shape[0]
    for i in range(n):
        j = (i + 1) % n
        x0, y0 = polygon[i, 0] - polygon[0, 0], polygon[i, 1] - polygon[0, 1]
        x1, y1 = polygon[j, 0] - polygon[0, 0], polygon[j, 1] - polygon[0, 1]
        total += x0 * y1 - x1 * y0
    return 0.5 * total


@row_kernel
def distance_to_segment(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Return the distance of (px, py) from the segment between (ax, ay) and (bx, by), all in one unit of length."""
    dx, dy = bx - ax, by - ay
    length2 = dx * dx + dy * dy
    t = 0.0
    if length2 > 0.0:
        t = min(1.0, max(0.0, ((px - ax) * dx + (py - ay) * dy) / length2))
    return math.hypot(px - ax - t * dx, py - ay - t * dy)


@row_kernel
def signed_distance(polygon: Array, x: float, y: float) -> float:
    """Return the distance of (x, y) to the border of a convex polygon, in their unit, positive inside.

    It is negative outside, and -inf for an empty polygon. A point or segment has no inside: the result is minus the
    distance. `polygon`: vertices (n, 2), counter-clockwise.
    """
    n = polygon.shape[0]
    if n == 0:
        return -math.inf
    inside, nearest, depth = n > 2, math.inf, math.inf
    for i in range(n):
        j = (i + 1) % n
        ax, ay, bx, by = polygon[i, 0], polygon[i, 1], polygon[j, 0], polygon[j, 1]
        nearest = min(nearest, distance_to_segment(x, y, ax, ay, bx, by))
        length = math.hypot(bx - ax, by - ay)
        if n > 2 and length > 0.0:
            d = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / length
            depth = min(depth, d)
            inside = inside and d >= 0.0
    return depth if inside else -nearest


@row_kernel
def clip(polygon: Array, ax: float, ay: float, limit: float) -> Array:
    """Return the part of a convex polygon where points p satisfy ax p_x + ay p_y <= limit, vertices (m, 2).

    Sutherland and Hodgman's algorithm.

    Args:
        polygon: vertices (n, 2), counter-clockwise, any unit.
        ax: x of the normal of the border, towards what is cut off.
        ay: y of the normal.
        limit: value at the border, unit of p if (ax, ay) is a unit vector.
    """
    n = polygon.shape[0]
    out = np.empty((n + 1, 2))
    m = 0
    for i in range(n):
        j = (i + 1) % n
        u = ax * polygon[i, 0] + ay * polygon[i, 1] - limit
        v = ax * polygon[j, 0] + ay * polygon[j, 1] - limit
        if u <= 0.0:
            out[m] = polygon[i]
            m += 1
        if (u < 0.0 < v) or (v < 0.0 < u):
            t = u / (u - v)
            out[m, 0] = polygon[i, 0] + t * (polygon[j, 0] - polygon[i, 0])
            out[m, 1] = polygon[i, 1] + t * (polygon[j, 1] - polygon[i, 1])
            m += 1
    return out[:m].copy()


@row_kernel
def half_planes(normals: Array, limits: Array, bound: float) -> Array:
    """Return the polygon of points p with a_k.p <= b_k for all k, vertices (e, 2), cut off at abs(x), abs(y) <= bound.

    Args:
        normals: directions a_k, (n, 2), unit.
        limits: b_k, (n,), in the unit of p.
        bound: half edge of the square to begin with, in the unit of p.
    """
    polygon = np.array([[-bound, -bound], [bound, -bound], [bound, bound], [-bound, bound]])
    for k in range(limits.size):
        polygon = clip(polygon, normals[k, 0], normals[k, 1], limits[k])
        if polygon.shape[0] == 0:
            break
    return polygon


@row_kernel
def ray(polygon: Array, x: float, y: float, ax: float, ay: float) -> tuple[float, float]:
    """Return t at which the line (x, y) + t (ax, ay) enters, and leaves, a convex polygon (n, 2); NaN: it misses.

    A segment or point is hit if the line passes it at no more than 1e-12 of its largest distance from (x, y). All
    lengths have one unit; (ax, ay) is a unit vector, and t is in that unit.
    """
    n = polygon.shape[0]
    if n == 0:
        return MISSED, MISSED
    t_in, t_out, size = math.inf, -math.inf, 0.0
    for i in range(n):
        size = max(size, max(abs(polygon[i, 0] - x), abs(polygon[i, 1] - y)))
    slack = FLAT * size
    for i in range(n):
        j = (i + 1) % n
        rx, ry = polygon[i, 0] - x, polygon[i, 1] - y
        sx, sy = polygon[j, 0] - x, polygon[j, 1] - y
        u, v = ax * ry - ay * rx, ax * sy - ay * sx  # offsets to the left of the line
        if abs(u) <= slack:
            t = ax * rx + ay * ry
            t_in, t_out = min(t_in, t), max(t_out, t)
        elif (u < 0.0 < v or v < 0.0 < u) and abs(v) > slack:
            f = u / (u - v)
            t = ax * (rx + f * (sx - rx)) + ay * (ry + f * (sy - ry))
            t_in, t_out = min(t_in, t), max(t_out, t)
    if t_in > t_out:
        return MISSED, MISSED
    return t_in, t_out


@row_kernel
def gap(inner: Array, outer: Array) -> float:
    """Return the largest distance, m, of a vertex of `outer` from polygon `inner`; NaN if `outer` is empty.

    Both hold vertices (n, 2) m, counter-clockwise. It is 0 if all vertices of `outer` lie in `inner`.
    """
    far = 0.0 if outer.shape[0] > 0 else math.nan
    for i in range(outer.shape[0]):
        far = max(far, -signed_distance(inner, outer[i, 0], outer[i, 1]))
    return far
