"""Regions of contacts on one line of which some have unlimited friction, and extents of regions without area.

No force at a contact r_i on a line has a moment about the line, so the weight has none either: the centre of mass lies
in the vertical plane of the line, whatever the friction. Across the line the support value is that of the line itself,
proved by the rotation about it, and along the line free forces may leave one end, both, or none. Solvers of cone
programs cannot decide this, since the programs have no interior across the line.
"""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.linear import dot

from .model import Line, Region, Support, SupportStatus

ALONG = 1e-9
"""Largest sine of the angle between directions that count as parallel."""
PARALLEL = 1e-6
"""Largest slope of a segment against a ray through one of its ends that counts as none."""
TOUCHING = 1e-9
"""Largest distance of a point from a region without area that counts as none, m."""


def line_region(region: Region, ends: Support, held: tuple[Array, Array], direction: Array) -> Region:
    """Return the region of contacts on one line that is not vertical.

    Args:
        region: region whose contacts, number of solver calls and cone programs the result keeps.
        ends: support values along the line, of two opposite unit directions.
        held: place (2,) m of the centre of mass, and forces (n, 3), shares of the weight, that hold it there.
        direction: unit directions of the support values to return, (k, 2).
    """
    along, contacts = ends.direction[0], region.contacts
    origin = contacts.position[0, :2].copy()
    low, high = _end(ends, 1, origin), _end(ends, 0, origin)
    line = Line(origin, along, -low, high)
    inner = np.array([ends.point[i] for i in range(2) if ends.status[i] == "ok"] or [held[0]])
    support = _supports(contacts.position, line, ends, held, direction)
    if math.isinf(low + high):
        return Region(
            contacts, "unbounded", inner, np.empty((0, 2)), support, math.nan, False, region.calls, None,
            region.solved, line,
        )  # fmt: skip
    short = low + high <= TOUCHING
    polygon = inner.mean(axis=0, keepdims=True) if short else inner
    return Region(contacts, "point" if short else "segment", polygon, polygon, support, 0.0, True, region.calls)


def _end(ends: Support, which: int, origin: Array) -> float:
    """Return the distance, m, from `origin` (2,) m to an end of the line in its direction, 0 or 1; inf: no end."""
    if ends.status[which] != "ok":
        return math.inf
    return float(ends.value[which]) - dot(ends.direction[which], origin)


def _supports(position: Array, line: Line, ends: Support, held: tuple[Array, Array], direction: Array) -> Support:
    """Return support values of a line in unit directions (k, 2), from those of its two ends, with proof.

    A direction is the sum of one along the line and one across it: so are its value and its twist. `position`: of the
    contacts, (n, 3) m; `held`: as for `line_region`.
    """
    k, (lx, ly) = len(direction), line.direction
    across = np.array([-ly, lx])
    span = position - position[0]
    far = int(np.abs(span[:, 0] * lx + span[:, 1] * ly).argmax())
    slope = float(span[far, 2] / (span[far, 0] * lx + span[far, 1] * ly))
    spin = np.array([-lx, -ly, -slope])  # rotation about the line, whose points it leaves where they are
    turn = np.array([*np.cross(position[0], spin).tolist(), -slope])
    value, point = np.full(k, np.nan), np.full((k, 2), np.nan)
    twist, force, status = np.full((k, 4), np.nan), np.zeros((k, len(position), 3)), list[SupportStatus]()
    for i, d in enumerate(direction):
        with_line, beside = dot(d, line.direction), dot(d, across)
        side, share = (0 if with_line > 0.0 else 1), abs(with_line)
        if share <= ALONG:
            status.append("ok")
            twist[i], point[i], force[i] = beside * turn, *held
        elif ends.status[side] == "ok":
            status.append("ok")
            twist[i], point[i], force[i] = share * ends.twist[side] + beside * turn, ends.point[side], ends.force[side]
        else:
            status.append("unbounded")
            force[i] = ends.force[side] / share
        value[i] = twist[i, 2]
    gap = value - (direction * point).sum(axis=1)
    return Support(direction, value, point, tuple(status), gap, twist, force)


def along_line(line: Line, point: Array, direction: Array) -> float | None:
    """Return the distance, m, from a point (2,) m along a unit direction (2,) to the far end of a line.

    inf: the line has no end there; None: the ray and its line behind the point miss it by more than `TOUCHING`.
    """
    (lx, ly), rest = line.direction, point - line.origin
    at, off = rest[0] * lx + rest[1] * ly, rest[1] * lx - rest[0] * ly
    with_line, beside = direction[0] * lx + direction[1] * ly, direction[1] * lx - direction[0] * ly
    if abs(beside) <= ALONG:
        if abs(off) > TOUCHING:
            return None
        return float(line.high - at if with_line > 0.0 else at - line.low)
    t = -off / beside
    there = line.low - TOUCHING <= at + t * with_line <= line.high + TOUCHING
    return float(t) if there else None


def from_line(line: Line, point: Array) -> float:
    """Return the signed distance, m, of a point (2,) m from a line, which has no inside: 0 on it, else negative."""
    (lx, ly), rest = line.direction, point - line.origin
    at, off = float(rest[0] * lx + rest[1] * ly), float(rest[1] * lx - rest[0] * ly)
    away = math.hypot(off, at - min(max(at, line.low), line.high))
    return -away if away > TOUCHING else 0.0


def along_flat(corners: Array, point: Array, direction: Array, hit: float) -> float:
    """Return the distance, m, from a point (2,) m along a unit direction (2,) to the far end of a point or segment.

    Args:
        corners: the point (1, 2) or ends (2, 2), m.
        point: start, (2,) m.
        direction: unit vector, (2,).
        hit: distance at which the ray crosses the segment, m; NaN: it does not, or is parallel to it.
    """
    rest = corners - point
    beside = direction[0] * rest[:, 1] - direction[1] * rest[:, 0]
    t = direction[0] * rest[:, 0] + direction[1] * rest[:, 1]
    touched = np.abs(beside) <= TOUCHING
    if touched.any() and np.ptp(beside) <= PARALLEL * np.ptp(t) + TOUCHING:
        return float(t.max())
    if touched.any() and math.isnan(hit):
        return float(t[touched].max())
    return hit
