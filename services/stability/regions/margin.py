"""Distances from the edge of a region: signed margin, extent along a ray."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.linear import combined, dot, product
from surefoot.geometry.polygon import ray, signed_distance

from ..programs.contacts import StabilityError
from ..programs.interior import NO_DUAL, NO_PRIMAL, SOLVED
from ..programs.reference import nearest_border, solve_one
from .careful import FLAT
from .joint import apart, farthest
from .line import TOUCHING, along_flat, along_line, from_line
from .model import Region, Solved

ExtentStatus = Literal["ok", "unbounded", "infeasible", "missed"]

RAYS = 16  # directions in which the edge of a region without bounds is searched first
MOST_RAYS = 400
NARROW = 1e-7  # rad, a smaller angle between two rays is not divided
CHORD = 1e-10  # relative, a chord nearer than the end of a ray by less is not searched
AROUND = 1e-3  # rad by which ways without end must surround a point
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
    as between walls, rays from the point search the nearest edge to 0.1 nm, and no direction is returned.

    Raises:
        StabilityError: no_convergence, by field `contacts`.
    """
    if region.status == "infeasible":
        return Margin(None)
    if region.line is not None:
        return Margin(from_line(region.line, point))
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

    A point within 1 nm of the region lies on its edge. Between two neighbouring rays from a point inside, the edge lies
    beyond the chord of their ends, so rays go to the nearest point of a chord until none is nearer than a ray's end.
    """
    s = region.solved
    if s is not None and _everywhere(s):
        return math.inf
    if s is None or not _held(s, point):
        outside = apart([region], point)
        if outside > TOUCHING:
            return -outside
    step = 2.0 * math.pi / RAYS
    reaches = {step * k: _reach(region, point, step * k) for k in range(RAYS)}
    if min(reaches.values()) <= 2.0 * TOUCHING:
        return 0.0
    reaches[2.0 * math.pi] = reaches[0.0]
    chords = [_chord(left, right, reaches) for left, right in pairwise(sorted(reaches))]
    best = min(reaches.values())
    for _ in range(MOST_RAYS):
        chord = min(chords, key=lambda c: c.distance)
        if math.isinf(chord.distance) or chord.distance >= best - CHORD * max(1.0, best):
            break
        chords.remove(chord)
        reaches[chord.angle] = _reach(region, point, chord.angle)
        chords += [_chord(chord.left, chord.angle, reaches), _chord(chord.angle, chord.right, reaches)]
        best = min(best, reaches[chord.angle])
    return best


class _Chord(NamedTuple):
    """Line between the ends of two neighbouring rays; inf as distance: the edge does not lie between them."""

    left: float  # rad, angle of one ray from +x
    right: float  # rad, of the next one counter-clockwise
    distance: float  # m, of the rays' origin from the chord
    angle: float  # rad, of the nearest point of the chord


def _chord(left: float, right: float, reaches: Mapping[float, float]) -> _Chord:
    """Return the chord of the rays at two angles (rad), by the distances (m) at which rays end, inf = nowhere."""
    one, two, width = reaches[left], reaches[right], right - left
    if width < NARROW or (math.isinf(one) and math.isinf(two)):
        return _Chord(left, right, math.inf, left)
    # from the end of the first ray, (one, 0) with x along it, to that of the second; an endless ray gives its direction
    if math.isinf(one) or math.isinf(two):
        x, y = (one, 0.0) if math.isinf(two) else (two * math.cos(width), two * math.sin(width))
        dx, dy = (math.cos(width), math.sin(width)) if math.isinf(two) else (1.0, 0.0)
        share, most = -(x * dx + y * dy), math.inf
    else:
        x, y, dx, dy = one, 0.0, two * math.cos(width) - one, two * math.sin(width)
        share, most = -x * dx / (dx * dx + dy * dy), 1.0
    share = min(max(share, 0.0), most)
    x, y = x + share * dx, y + share * dy
    return _Chord(left, right, math.hypot(x, y), left + math.atan2(y, x))


def _reach(region: Region, point: Array, angle: float) -> float:
    """Return the distance, m, from a point (2,) m to the far edge in a direction (rad from +x); 0: its line misses."""
    ray = np.array([math.cos(angle), math.sin(angle)])
    try:
        found = extent(region, point, ray)
    except StabilityError:  # of a region as thin as a line
        end = farthest([region], ray, TOUCHING, point)
        return math.inf if end is None else max(0.0, dot(end - point, ray))
    if found.status == "missed":
        return 0.0
    return math.inf if found.value is None else max(0.0, found.value)


def _held(s: Solved, point: Array) -> bool:
    """Return True if some forces hold the CoM at a point (2,) m, by one cone program; False also where it fails."""
    r, place = s.reduced, point if s.plane is None else s.plane.back(point)
    start = (place - s.anchor) / r.length
    across = np.eye(2)
    if s.drift is not None and np.abs(s.drift).max(initial=0.0) > FLAT:  # along it free forces move the CoM
        x, y = s.drift[int(np.argmax(np.abs(s.drift).max(axis=1)))].tolist()
        across = np.array([[-y, x]]) / math.hypot(x, y)
        if np.abs(product(s.drift, across[0])).max() > FLAT:
            return True
    columns = np.concatenate((r.a, product(r.h, across.T)), axis=2)
    try:
        cost = np.concatenate((r.c, product(across, start)))
        return solve_one(columns, np.zeros((len(r.a), 3)), cost)[0] == SOLVED
    except StabilityError:
        return False


def _everywhere(s: Solved) -> bool:
    """Return True if the ways in which forces move the CoM without end surround it: the region is the whole plane."""
    fan = s.fan
    endless = np.flatnonzero(fan.status[: s.count] == NO_DUAL)
    ways = [combined(s.reduced.h, fan.force[k]).sum(axis=0) for k in endless]
    if s.drift is not None:
        ways += [*s.drift, *-s.drift]
    turns = sorted(math.atan2(y, x) for x, y in ways if math.hypot(x, y) > FLAT)
    gaps = [after - before for before, after in pairwise([*turns, *(t + 2.0 * math.pi for t in turns[:1])])]
    return len(turns) > 2 and max(gaps) < math.pi - AROUND


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
    if region.line is not None:
        end = along_line(region.line, point, direction)
        if end is None:
            return Extent(None, "missed")
        return Extent(None, "unbounded") if math.isinf(end) else Extent(end, "ok")
    if (s := region.solved) is None:
        _, t = ray(region.inner, float(point[0]), float(point[1]), float(direction[0]), float(direction[1]))
        if len(region.inner) in (1, 2):
            t = along_flat(region.inner, point, direction, t)
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
