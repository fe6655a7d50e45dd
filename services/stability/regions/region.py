"""Support region of a contact set: status, inner and outer polygon, support values with proof.

Three ways to the same answer: the hull where it is exact (`flat`), one kernel for ordinary sets (`_ordinary`), and
`_careful` for everything that can go wrong: no contact, walls, ceilings, no friction, no area, no solution.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from surefoot.geometry.linear import product
from surefoot.geometry.polygon import area, half_planes, hull, signed_distance
from surefoot.kernels.jit import row_kernel

from ..programs.contacts import Array, ContactSet
from ..programs.directions import AXES, corner_normals, has_axes
from ..programs.fan import ANSWER, ENCLOSE, Fan, Goal, explore, new_fan
from ..programs.interior import NO_PRIMAL, SOLVED
from ..programs.lanes import LANES
from ..programs.oracle import FLAT, Oracle, Support
from ..programs.reduced import RANK, SMALL_MU, matrices
from . import flat
from .chords import beyond_chords
from .thin import THIN, WIDE, along, flat_ends, line_of

RegionStatus = Literal["ok", "infeasible", "unbounded", "point", "segment"]

SLIM = 1e-5  # area / diameter^2 below which the width is looked at
FEW, FEW_AT_ONCE = 16, 4  # with no more directions than that the batches are small, to use what the last one showed


@dataclass(frozen=True, slots=True)
class Solved:
    """The fan behind a region with an inside, for margins: scaled frame, position = anchor + length * scaled."""

    a: Array
    h: Array
    c: Array
    fan: Fan
    count: int
    anchor: Array  # (2,) m
    length: float  # m


@dataclass(frozen=True, slots=True)
class Region:
    """Where the centre of mass may be."""

    contacts: ContactSet
    status: RegionStatus
    inner: Array
    """(p, 2) m: polygon inside the region, or its point or segment."""
    outer: Array
    """(q, 2) m: polygon around the region; empty if there is none."""
    support: Support
    gap: float
    """m, largest distance of outer from inner; NaN if there is no outer."""
    exact: bool
    """inner is the region itself, to rounding (hull, segment, point)."""
    calls: int
    """Directions solved for."""
    sinking: Array | None = None
    """(4,) twist (v m, w_z) with v_z < 0 that proves infeasibility, about the origin of the frame."""
    solved: Solved | None = None


def region(
    contacts: ContactSet,
    directions: Array | None = None,
    *,
    adaptive: bool | None = None,
    tolerance: float = 1e-4,
    limit: int = 128,
) -> Region:
    """Region of a contact set.

    Args:
        contacts: 0 to 64 contacts.
        directions: (k, 2) unit directions, None = adaptive.
        adaptive: refine until outer is within `tolerance` of inner; default: when no directions are given.
        tolerance: m.
        limit: at most so many directions when adaptive (not less than it begins with: 3 to 8, and those given).
    """
    refine = directions is None if adaptive is None else adaptive
    given = np.empty((0, 2)) if directions is None else directions
    n = len(contacts)
    if n > 2:
        exact, p, q = flat.plane(contacts.position, contacts.normal, contacts.mu)
        if exact:
            return _hull_region(contacts, given if len(given) and not refine else AXES, p, q)
    first = given if not refine and has_axes(given) else np.concatenate((AXES, given))
    skip = len(first) - len(given) if not refine else 0
    if n > 1 and contacts.mu.min() > SMALL_MU and contacts.mu.max() < math.inf:
        begin = np.concatenate((corner_normals(contacts.position), given)) if refine else first
        found = _ordinary(contacts, begin, refine, tolerance, max(limit, len(begin)), skip)
        if found is not None:
            return found
    if n == 0:
        nothing = np.array([0.0, 0.0, -1.0, 0.0])
        return _infeasible(contacts, first[skip:], nothing)
    if n == 1:
        return _single(contacts, first[skip:])
    return _careful(contacts, first, skip, refine, tolerance, max(limit, len(first)))


def _ordinary(
    contacts: ContactSet, first: Array, refine: bool, tolerance: float, limit: int, skip: int
) -> Region | None:
    """Region of a set with friction that is bounded and has an area; None if it is not so simple."""
    a, h, origin, length, spread = matrices(contacts.position, contacts.normal, contacts.mu)
    if spread <= RANK * length:
        return None
    c = np.array([0.0, 0.0, 1.0, 0.0])
    fan = new_fan(limit if refine else len(first), len(contacts))
    fan.direction[: len(first)] = first
    goal = Goal(ENCLOSE if refine else ANSWER, tolerance / length, 0.0, 0.0)
    count, fine, outlook = explore(a, h, c, fan, 0, len(first), goal, limit, FEW_AT_ONCE if limit <= FEW else LANES)
    if not fine:
        return None
    near = goal.tolerance if refine else math.inf
    fine, inner, outer, direction, point, twist, force, slack = _finish(a, h, fan, count, origin, length, near, skip)
    if not fine:
        return None
    support = Support(direction, twist[:, 2], point, ("ok",) * len(direction), slack, twist, force)
    gap = outlook.best * length if outlook.best <= near < math.inf else distance(inner, outer)
    solved = Solved(a, h, c, fan, count, origin[:2], length)
    return Region(contacts, "ok", inner, outer, support, gap, False, count, None, solved)


@row_kernel
def wide(fan: Fan, count: int) -> tuple[bool, Array, float]:
    """Whether the region has an area, its inner polygon and the polygon's diameter, scaled."""
    inner, size = hull(fan.point[:count]), 0.0
    for k in range(inner.shape[0]):
        for j in range(k):
            size = max(size, math.hypot(inner[j, 0] - inner[k, 0], inner[j, 1] - inner[k, 1]))
    return size > THIN and area(inner) > SLIM * size * size, inner, size


@row_kernel
def _polygons(a: Array, h: Array, fan: Fan, count: int, tolerance: float) -> tuple[bool, Array, Array]:
    """Whether the region has an area, inner and outer polygon, scaled; outer is within tolerance of inner if it can be.

    A finite tolerance: where the directions did not suffice, points between them are added to inner.
    """
    fine, inner, size = wide(fan, count)
    if not fine:
        return False, inner, inner
    if tolerance < math.inf:
        more = beyond_chords(a, h, fan, count, tolerance, area(inner))
        if more.shape[0] > 0:
            inner = hull(np.concatenate((inner, more)))
    far = 0.0
    for k in range(count):
        far = max(far, abs(fan.value[k]))
    return True, inner, hull(half_planes(fan.direction[:count], fan.value[:count], 8.0 * (size + far)))


@row_kernel
def _finish(
    a: Array, h: Array, fan: Fan, count: int, origin: Array, length: float, tolerance: float, skip: int
) -> tuple[bool, Array, Array, Array, Array, Array, Array, Array]:
    """Polygons and answers in metres, in the frame of the request; False in front if there is no area.

    Tolerance as of `_polygons`; if it is finite, answers are sorted by angle.
    """
    fine, inner, outer = _polygons(a, h, fan, count, tolerance)
    n, k = a.shape[0], count - skip if fine else 0
    point, twist, force = np.empty((k, 2)), np.empty((k, 4)), np.zeros((k, n, 3))
    direction, slack = np.empty((k, 2)), np.empty(k)
    ox, oy, oz = origin[0], origin[1], origin[2]
    for i in range(k):
        s = fan.order[i] if tolerance < math.inf else skip + i
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
    return fine, inner, outer, direction, point, twist, force, slack


@row_kernel
def distance(inner: Array, outer: Array) -> float:
    """Largest distance of a vertex of outer from inner; NaN if there is no outer."""
    far = 0.0 if outer.shape[0] > 0 else math.nan
    for i in range(outer.shape[0]):
        far = max(far, -signed_distance(inner, outer[i, 0], outer[i, 1]))
    return far


def _hull_region(contacts: ContactSet, direction: Array, p: float, q: float) -> Region:
    value, point, twist, force = flat.support(contacts.position, direction, p, q)
    support = Support(direction, value, point, ("ok",) * len(direction), np.zeros(len(direction)), twist, force)
    polygon = hull(np.ascontiguousarray(contacts.position[:, :2]))
    return Region(contacts, "ok", polygon, polygon, support, 0.0, True, 0)


def _infeasible(contacts: ContactSet, direction: Array, sinking: Array) -> Region:
    k, n = len(direction), len(contacts)
    nan = np.full(k, np.nan)
    support = Support(
        direction, nan, np.full((k, 2), np.nan), ("infeasible",) * k, nan, np.full((k, 4), np.nan), np.zeros((k, n, 3))
    )
    empty = np.empty((0, 2))
    return Region(contacts, "infeasible", empty, empty, support, math.nan, True, 0, sinking / abs(sinking[2]))


def _single(contacts: ContactSet, direction: Array) -> Region:
    """One contact: its own point if the vertical lies in its cone."""
    normal, mu, position = contacts.normal[0], float(contacts.mu[0]), contacts.position[0]
    if not flat.holds(normal, mu):
        side = math.hypot(normal[0], normal[1])
        downhill = normal[2] * normal - np.array([0.0, 0.0, 1.0])
        ceiling = math.isinf(mu) or side == 0.0
        v = normal if ceiling else mu * normal + downhill / side
        return _infeasible(contacts, direction, np.array([v[0], v[1], v[2], 0.0]))
    k = len(direction)
    spin = np.column_stack((-direction[:, 1], direction[:, 0], np.zeros(k)))
    twist = np.column_stack((np.cross(position, spin).astype(np.float64), np.zeros(k)))
    force = np.zeros((k, 1, 3))
    force[:, 0, 2] = 1.0
    point = np.tile(position[:2], (k, 1))
    support = Support(direction, product(direction, position[:2]), point, ("ok",) * k, np.zeros(k), twist, force)
    return Region(contacts, "point", position[None, :2].copy(), position[None, :2].copy(), support, 0.0, True, 0)


def _careful(contacts: ContactSet, first: Array, skip: int, refine: bool, tolerance: float, limit: int) -> Region:
    oracle = Oracle(contacts)
    if oracle.subspace is not None and oracle.subspace.sinking is not None:
        return _infeasible(contacts, first[skip:], oracle.moved(oracle.subspace.sinking, np.zeros(2)))
    fan, count = oracle.fan(first, limit if refine else len(first)), len(first)
    status = fan.status[:count]
    drifting = np.abs(oracle.drift(first)).max(initial=0.0) > FLAT
    if np.any(status == NO_PRIMAL):
        k = int(np.flatnonzero(status == NO_PRIMAL)[0])
        twist = oracle.twist(fan.unknown[k], np.zeros(2))
        return _infeasible(contacts, first[skip:], oracle.moved(twist, np.zeros(2)))
    if drifting or np.any(status != SOLVED):
        if oracle.sinking is not None:
            return _infeasible(contacts, first[skip:], oracle.moved(oracle.sinking, np.zeros(2)))
        support = oracle.support(fan, np.arange(skip, count))
        everything = oracle.support(fan, np.arange(count))
        found = everything.point[np.array([s == "ok" for s in everything.status])]
        return Region(contacts, "unbounded", hull(found), np.empty((0, 2)), support, math.nan, False, count, None)
    ends = _ends(oracle, fan, count)
    r = oracle.reduced
    if ends is not None:
        polygon = oracle.anchor + r.length * ends
        kind: RegionStatus = "point" if len(ends) == 1 else "segment"
        support = oracle.support(fan, np.arange(skip, count))
        return Region(contacts, kind, polygon, polygon, support, 0.0, True, count)
    gap, near = math.inf, math.inf
    if refine:
        near = tolerance / r.length
        goal = Goal(ENCLOSE, near, 0.0, 0.0)
        batch = FEW_AT_ONCE if limit <= FEW else LANES
        count, _, outlook = explore(r.a, r.h, r.c, fan, count, count, goal, limit, batch)
        gap = outlook.best
    chosen = fan.order[:count] if refine else np.arange(skip, count)
    _, inner, outer = _polygons(r.a, r.h, fan, count, near)
    inner, outer = oracle.anchor + r.length * inner, oracle.anchor + r.length * outer
    solved = Solved(r.a, r.h, r.c, fan, count, oracle.anchor, r.length)
    gap = gap * r.length if gap <= near < math.inf else distance(inner, outer)
    return Region(contacts, "ok", inner, outer, oracle.support(fan, chosen), gap, False, count, None, solved)


def _ends(oracle: Oracle, fan: Fan, count: int) -> Array | None:
    """The point (1, 2) or the ends (2, 2) of a region without area, scaled frame; None if it has one."""
    points = fan.point[:count]
    span = points[:, None, :] - points[None, :, :]
    distance = np.hypot(span[..., 0], span[..., 1])
    size = float(distance.max())
    if size <= THIN:
        width = fan.value[:8] + fan.value[[4, 5, 6, 7, 0, 1, 2, 3]] if count >= 8 else np.full(1, np.inf)
        if width.max() <= THIN:
            return points.mean(axis=0, keepdims=True)
    if size > THIN and float(area(hull(points))) > SLIM * size * size:
        return None
    found, line = line_of(oracle.contacts.position)
    if not found:
        i, j = np.unravel_index(int(distance.argmax()), distance.shape)
        line = span[i, j] / max(size, 1e-300)
    probe = oracle.fan(along(line), 4)
    kind, ends = flat_ends(probe)
    return ends if kind != WIDE else None
