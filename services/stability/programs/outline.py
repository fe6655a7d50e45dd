"""Outline of a region: directions refined for a goal, inner and outer polygon, answers in metres.

Points of the region beyond the chords between support points are found without the solver. The mean of the forces at
two support points holds the CoM in the middle of their chord. Where the border bulges between them, the forces of some
contacts differ in direction, and the mean lies inside these friction cones. From there one step of an affine-scaling
method leads outwards: with P_i = x_i x_i' - (x_i'J x_i) J / 2, J = diag(1, -1, -1), the inverse Hessian of the cone's
barrier -log x'Jx, the step d = P (g - A lam) gains most along the outward normal, g_i = h_i(normal), among all of its
length that keep the balance, A'd = 0; it ends where it meets a cone. Its end is a place of the CoM that forces hold,
as certain as a support point, for a fraction of its price.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.polygon import area, gap, half_planes, hull
from surefoot.kernels.jit import row_kernel

from .contacts import AXES
from .fan import (
    ANSWER,
    ENCLOSE,
    Fan,
    FanGoal,
    Outlook,
    evaluate,
    heights,
    insert,
    near_arcs,
    new_fan,
    wide,
    wide_triangles,
)
from .lanes import LANES, PIVOT
from .reduced import Reduced

Array = NDArray[np.float64]

NEEDLE = 1e-3  # sine of the least turn between two edges at the sharp end of a hull
LEAST = 1e-4  # of the area; smaller triangles over a chord are left out
BALANCED = 1e-10  # of the weight, largest error that a step may add to the balance


@row_kernel
def explore(
    r: Reduced, fan: Fan, solved: int, count: int, goal: FanGoal, limit: int, batch: int
) -> tuple[int, bool, Outlook]:
    """Solve for the directions given, then for those that a goal asks for. The only kernel that contains the solver.

    Args:
        r: programs of the contact set.
        fan: the first `solved` directions have answers and an order, those up to `count` are to be answered.
        solved: how many are.
        count: how many there are.
        goal: what to refine for.
        limit: at most so many directions in the end, <= capacity of the fan.
        batch: at most so many at once, <= 8: fewer use what the last ones showed, more are quicker.

    Returns:
        Number of directions that have an answer, whether all given ones are solved, and what is known about the goal.
    """
    pick = np.empty((LANES, 2))
    outlook = Outlook(math.inf, -math.inf, 0)
    if count > solved:
        if not evaluate(r, fan, solved, count):
            return solved, False, outlook
        insert(fan, solved, count)
    while goal.kind != ANSWER:
        room = min(batch, limit - count)
        if goal.kind == ENCLOSE:
            wanted, outlook = wide_triangles(fan, count, goal, pick, room)
        else:
            wanted, outlook = near_arcs(fan, count, goal, pick, room)
        if wanted == 0:
            break
        for k in range(wanted):
            fan.direction[count + k, 0], fan.direction[count + k, 1] = pick[k, 0], pick[k, 1]
        if not evaluate(r, fan, count, count + wanted):
            break  # numerically at the end: what was there stays valid
        insert(fan, count, count + wanted)
        count += wanted
    return count, True, outlook


@row_kernel
def enclose(
    r: Reduced, fan: Fan, solved: int, count: int, goal: FanGoal, limit: int, batch: int
) -> tuple[int, bool, float, Array, Array]:
    """Explore, then draw the polygons.

    With the goal ENCLOSE points between the directions are added to the inner polygon where the directions did not
    suffice.

    Args:
        r: programs of the contact set.
        fan: as in `explore`.
        solved: as in `explore`.
        count: as in `explore`.
        goal: ENCLOSE or ANSWER.
        limit: as in `explore`.
        batch: as in `explore`.

    Returns:
        Number of answers, True if the region has an area, largest height of a triangle between the polygons, inner and
        outer polygon; scaled frame.
    """
    count, fine, outlook = explore(r, fan, solved, count, goal, limit, batch)
    if not fine:
        return count, False, outlook.best, fan.point[:0], fan.point[:0]
    over = heights(fan, count)
    fine, inner, size = wide(fan, count)
    if not fine:
        return count, False, outlook.best, inner, inner
    if goal.kind == ENCLOSE:
        more = beyond_chords(r, fan, over, goal.tolerance, area(inner))
        if more.shape[0] > 0:
            inner = hull(np.concatenate((inner, more)))
    far = 0.0
    for k in range(count):
        far = max(far, abs(fan.value[k]))
    outer = hull(half_planes(fan.direction[:count], fan.value[:count], 8.0 * (size + far)))
    return count, True, outlook.best, inner, outer


class Outline(NamedTuple):
    """Region of a set of ordinary contacts, in metres, frame of the request."""

    fine: bool
    """The directions have answers and the region has an area; False: the rest holds nothing."""
    fan: Fan
    """Answers, scaled frame."""
    answers: int
    """Number of answers in the fan."""
    gap: float
    """m, largest distance of outer from inner, or a bound on it."""
    inner: Array
    """(p, 2) m."""
    outer: Array
    """(q, 2) m."""
    direction: Array
    """(k, 2) unit; sorted by angle with the goal ENCLOSE."""
    point: Array
    """(k, 2) m."""
    twist: Array
    """(k, 4) (v m, w_z)."""
    force: Array
    """(k, n, 3) in units of the weight."""
    slack: Array
    """(k,) m, duality gap."""


@row_kernel
def outline(r: Reduced, first: Array, goal: FanGoal, limit: int, batch: int, skip: int) -> Outline:
    """Solve for the directions `first` (k, 2) and those of a goal, and return everything in metres.

    Without the goal ENCLOSE the answers to the first `skip` directions are left out of the result.
    """
    count = first.shape[0]
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
def beyond_chords(r: Reduced, fan: Fan, over: Array, tolerance: float, size: float) -> Array:
    """Three more points (p, 2) of the region over each chord whose triangle is wide.

    Args:
        r: programs of the contact set.
        fan: answers, in order.
        over: of `heights`, (count, 2).
        tolerance: triangles no higher than that are left out.
        size: area of the inner polygon.
    """
    h, n, count, found = r.h, r.h.shape[0], over.shape[0], 0
    point, equations = np.empty((3 * count, 2)), np.empty((4, 5))
    middle, side, step = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    for i in range(count):
        k, m = fan.order[i], fan.order[(i + 1) % count]
        if over[i, 0] <= tolerance or over[i, 1] <= LEAST * size:
            continue
        x, y, dx, dy = fan.point[k, 0], fan.point[k, 1], fan.point[m, 0], fan.point[m, 1]
        if not _outward(r, fan.force[k], fan.force[m], dy - y, x - dx, middle, step, equations):
            continue
        mx, my = _place(h, middle)
        point[found, 0], point[found, 1] = mx, my
        found += 1
        if _outward(r, fan.force[k], middle, my - y, x - mx, side, step, equations):
            point[found, 0], point[found, 1] = _place(h, side)
            found += 1
        if _outward(r, middle, fan.force[m], dy - my, mx - dx, side, step, equations):
            point[found, 0], point[found, 1] = _place(h, side)
            found += 1
    return point[:found]


@row_kernel
def _place(h: Array, x: Array) -> tuple[float, float]:
    """The CoM that forces hold, scaled."""
    px, py = 0.0, 0.0
    for i in range(x.shape[0]):
        for q in range(3):
            px += h[i, q, 0] * x[i, q]
            py += h[i, q, 1] * x[i, q]
    return px, py


@row_kernel
def _outward(
    r: Reduced, first: Array, second: Array, nx: float, ny: float, x: Array, step: Array, equations: Array
) -> bool:
    """From the mean of two feasible forces as far as the cones allow: x (n, 3); False where no step can be trusted.

    Room for the step (n, 3) and for the equations A'PA lam = A'Pg (4, 5) is the caller's.
    """
    a, h, n = r.a, r.h, x.shape[0]
    equations[:] = 0.0
    for i in range(n):
        for q in range(3):
            x[i, q] = 0.5 * (first[i, q] + second[i, q])
        for j in range(5):
            if j < 4:
                p0, p1, p2 = _weighed(x[i], a[i, 0, j], a[i, 1, j], a[i, 2, j])
            else:
                g0, g1, g2 = (
                    nx * h[i, 0, 0] + ny * h[i, 0, 1],
                    nx * h[i, 1, 0] + ny * h[i, 1, 1],
                    nx * h[i, 2, 0] + ny * h[i, 2, 1],
                )
                p0, p1, p2 = _weighed(x[i], g0, g1, g2)
            for k in range(min(j + 1, 4)):
                equations[k, j] += a[i, 0, k] * p0 + a[i, 1, k] * p1 + a[i, 2, k] * p2
    l0, l1, l2, l3 = _solved(equations)
    need, e0, e1, e2, e3 = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        for q in range(3):
            gain = nx * h[i, q, 0] + ny * h[i, q, 1]
            step[i, q] = gain - (a[i, q, 0] * l0 + a[i, q, 1] * l1 + a[i, q, 2] * l2 + a[i, q, 3] * l3)
        v0, v1, v2 = step[i, 0], step[i, 1], step[i, 2]
        # (x + t P v)'J(x + t P v) = x'Jx (1 + p t + w t^2): the step leaves the cone at the first zero
        p = x[i, 0] * v0 + x[i, 1] * v1 + x[i, 2] * v2
        w = 0.5 * _half(x[i]) * (v0 * v0 - v1 * v1 - v2 * v2)
        if p * p >= 4.0 * w:
            need = max(need, 0.5 * (math.sqrt(p * p - 4.0 * w) - p))
        d0, d1, d2 = _weighed(x[i], v0, v1, v2)
        step[i, 0], step[i, 1], step[i, 2] = d0, d1, d2
        e0 += a[i, 0, 0] * d0 + a[i, 1, 0] * d1 + a[i, 2, 0] * d2
        e1 += a[i, 0, 1] * d0 + a[i, 1, 1] * d1 + a[i, 2, 1] * d2
        e2 += a[i, 0, 2] * d0 + a[i, 1, 2] * d1 + a[i, 2, 2] * d2
        e3 += a[i, 0, 3] * d0 + a[i, 1, 3] * d1 + a[i, 2, 3] * d2
    if not max(max(abs(e0), abs(e1)), max(abs(e2), abs(e3))) < BALANCED * need:
        return False
    for i in range(n):
        for q in range(3):
            x[i, q] += step[i, q] / need
    return True


@row_kernel
def _half(x: Array) -> float:
    """x'Jx / 2, not negative."""
    side = math.sqrt(x[1] * x[1] + x[2] * x[2])
    return max(0.0, 0.5 * (x[0] - side) * (x[0] + side))


@row_kernel
def _weighed(x: Array, v0: float, v1: float, v2: float) -> tuple[float, float, float]:
    """P v = x (x'v) - (x'J x) J v / 2."""
    half, along = _half(x), x[0] * v0 + x[1] * v1 + x[2] * v2
    return x[0] * along - half * v0, x[1] * along + half * v1, x[2] * along + half * v2


@row_kernel
def _solved(equations: Array) -> tuple[float, float, float, float]:
    """Solution of four symmetric equations, upper triangle given, right-hand side last; 0 in null directions."""
    floor = 0.0
    for j in range(4):
        floor = max(floor, PIVOT * equations[j, j])
    for j in range(4):
        pivot = 1.0 / equations[j, j] if equations[j, j] > floor else 0.0
        for k in range(j + 1, 4):
            share = equations[j, k] * pivot
            for c in range(k, 5):
                equations[k, c] -= share * equations[j, c]
        equations[j, j] = pivot
    l3 = equations[3, 4] * equations[3, 3]
    l2 = (equations[2, 4] - equations[2, 3] * l3) * equations[2, 2]
    l1 = (equations[1, 4] - equations[1, 2] * l2 - equations[1, 3] * l3) * equations[1, 1]
    l0 = (equations[0, 4] - equations[0, 1] * l1 - equations[0, 2] * l2 - equations[0, 3] * l3) * equations[0, 0]
    return l0, l1, l2, l3


@row_kernel
def edge_normals(corners: Array) -> Array:
    """Outward normals of the hull of the contacts if it has 3 to 8 edges, else the axes: on mild ground its edges.

    The axes for a needle, too: its normals are hardly less than half a turn apart, and the support lines between them
    cross nowhere near.
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
    """Where refinement begins: outward at each corner of the hull of the contacts, between the normals of its edges.

    On mild ground the support points are these corners at once; directions between them then go where it is curved.
    """
    edges = edge_normals(corners)
    n = edges.shape[0]
    out = np.empty((n, 2))
    for i in range(n):
        x, y = edges[i, 0] + edges[(i + 1) % n, 0], edges[i, 1] + edges[(i + 1) % n, 1]
        length = math.hypot(x, y)
        out[i, 0], out[i, 1] = x / length, y / length
    return out
