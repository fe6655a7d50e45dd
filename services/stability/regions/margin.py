"""Distances from the edge of a region: signed margin, extent along a ray."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.linear import dot, product
from surefoot.geometry.polygon import ray, signed_distance

from ..programs.contacts import StabilityError
from ..programs.interior import NO_DUAL, NO_PRIMAL
from ..programs.reference import nearest_border, solve_one
from .careful import FLAT
from .joint import apart, farthest
from .model import Region, Solved

ExtentStatus = Literal["ok", "unbounded", "infeasible", "missed"]

TOUCHING = 1e-9  # m; nearer to a region without bounds than that is inside
RAYS = 64  # directions in which the edge of a region without bounds is searched first
ON_EDGE = 1e-12  # m; a distance below it is zero (points and segments have no inside)


@dataclass(frozen=True, slots=True)
class Margin:
    """Signed distance of a point from the edge of a region."""

    value: float | None
    """Signed distance of the point to the edge, m, positive inside; None: there is no region, or no edge."""
    direction: Array | None = None
    """Unit direction from the point in which the edge of the region is nearest, (2,); None = it is not known."""


@dataclass(frozen=True, slots=True)
class Extent:
    """Distance from a point along a direction to the edge of a region."""

    value: float | None
    """Signed distance along the direction, m, negative if the region ends behind the point; None unless `ok`."""
    status: ExtentStatus
    """`ok`, `unbounded` (no edge in the direction), `infeasible` (no region), `missed` (the line misses the region)."""


def margin(region: Region, point: Array) -> Margin:
    """Return the signed distance of `point` c, (2,) m, from the edge: min over unit a of h(a) - a'c, positive inside.

    h(a) is the support value of the region in direction a, the largest a'c of its points. In a region without bounds,
    as between walls, the nearest of 64 rays from the point to the edge is refined, and no direction is returned.

    Raises:
        StabilityError: no_convergence, by field `contacts`.
    """
    if region.status == "infeasible":
        return Margin(None)
    if region.status == "unbounded":
        value = _to_the_edge(region, point)
        return Margin(value if math.isfinite(value) else None)
    if region.solved is not None:
        s = region.solved.level()
        x, y = ((point - s.anchor) / s.reduced.length).tolist()
        least, direction = nearest_border(s.reduced, s.fan, s.count, x, y)
        return Margin(least * s.reduced.length, direction)
    value = float(signed_distance(region.inner, float(point[0]), float(point[1])))
    return Margin(0.0 if abs(value) < ON_EDGE else value)


def _to_the_edge(region: Region, point: Array) -> float:
    """Return the signed distance, m, of a point (2,) m from the edge of a region without bounds; inf: it has no edge.

    A point within 1 nm of the region lies on its edge.
    """
    outside = apart([region], point)
    if outside > TOUCHING:
        return -outside

    def reach(angle: float) -> float:
        ray = np.array([math.cos(angle), math.sin(angle)])
        try:
            found = extent(region, point, ray)
        except StabilityError:  # of a region as thin as a line
            end = farthest([region], ray, TOUCHING, point)
            return math.inf if end is None else max(0.0, dot(end - point, ray))
        if found.status == "missed":  # from a point on the edge
            return 0.0
        return math.inf if found.value is None else max(0.0, found.value)

    step = 2.0 * math.pi / RAYS
    reaches = [reach(step * k) for k in range(RAYS)]
    nearest = int(np.argmin(reaches))
    if reaches[nearest] <= 2.0 * TOUCHING:
        return 0.0
    if not math.isfinite(reaches[nearest]):
        return math.inf
    low, high = step * (nearest - 1), step * (nearest + 1)
    while high - low > 1e-7:  # the edge is convex: along it the distance falls, then rises
        left, right = low + (high - low) / 3.0, high - (high - low) / 3.0
        low, high = (low, right) if reach(left) <= reach(right) else (left, high)
    return min(reaches[nearest], reach(0.5 * (low + high)))


def extent(region: Region, point: Array, direction: Array) -> Extent:
    """Return the largest t, m, with point (2,) + t a in the region, for a unit direction a (2,).

    The program of the support value h(a), with one equality more that keeps the CoM on the line (b = a turned by 90
    degrees, c0 the point, x_i the contact forces): sum h_i(b)'x_i = b'c0. Its dual has one unknown nu more: min lam_3 +
    nu b'c0 - a'c0 s.t. A_i lam + nu h_i(b) - h_i(a) in the cone Q, lam the twist.

    Raises:
        StabilityError: no_convergence, by field `contacts`.
    """
    if region.status == "infeasible":
        return Extent(None, "infeasible")
    if (s := region.solved) is None:
        _, t = ray(region.inner, float(point[0]), float(point[1]), float(direction[0]), float(direction[1]))
        return Extent(None, "missed") if math.isnan(t) else Extent(float(t), "ok")
    if (plane := s.plane) is None:
        return _edge(s, point, direction)
    along = plane.back(direction + plane.zero)
    size = math.hypot(along[0], along[1])
    found = _edge(s, plane.back(point), along / size)
    return found if found.value is None else Extent(found.value / size, found.status)


def _edge(s: Solved, point: Array, a: Array) -> Extent:
    """Return the distance from a point (2,) m along the unit direction a (2,) to the edge, by one cone program.

    Args:
        s: cone programs of the region.
        point: start, frame of the programs.
        a: direction. Free tangential forces move the CoM along a line: with them, only directions d = a - nu b (b
            across a) that they leave alone have an edge; else the extent is unbounded.
    """
    r, across = s.reduced, np.array([-a[1], a[0]])
    start = (point - s.anchor) / r.length
    gains = brakes = np.empty(0)
    if s.drift is not None:
        gains, brakes = product(s.drift, a), product(s.drift, across)
    slowed = bool(np.abs(brakes).max(initial=0.0) > FLAT)
    drifting = slowed or bool(np.abs(gains).max(initial=0.0) > FLAT)
    if drifting:
        if not slowed:
            return Extent(None, "unbounded")
        nu = dot(gains, brakes) / dot(brakes, brakes)
        if np.abs(gains - nu * brakes).max() > FLAT:
            return Extent(None, "unbounded")
        d = a - nu * across
        columns, gain, cost, passed = r.a, product(r.h, d), r.c, dot(d, start)
    else:
        columns = np.concatenate((r.a, product(r.h, across)[:, :, None]), axis=2)
        gain, cost, passed = product(r.h, a), np.append(r.c, dot(across, start)), dot(a, start)
    status, value, _, _, _ = solve_one(columns, gain, cost)
    if status == NO_PRIMAL:
        return Extent(None, "infeasible" if drifting else "missed")
    if status == NO_DUAL:
        return Extent(None, "unbounded")
    return Extent((value - passed) * r.length, "ok")
