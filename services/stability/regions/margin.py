"""Distances from the edge of a region: signed margin, extent along a ray."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from surefoot.geometry.linear import dot, product, solve
from surefoot.geometry.polygon import ray, signed_distance

from ..programs.contacts import Array
from ..programs.fan import APPROACH, FanGoal, explore, insert, settled, with_room
from ..programs.interior import NO_DUAL, NO_PRIMAL
from ..programs.lanes import LANES
from ..programs.reference import MARGIN_DIRECTIONS, approach, solve_one
from .careful import FLAT
from .model import Region, Solved

ExtentStatus = Literal["ok", "unbounded", "infeasible", "missed"]

MARGIN_TOLERANCE = 2e-9  # in units of the stance; the solver's own accuracy is 1e-9
ON_EDGE = 1e-12  # m; a distance below it is zero (points and segments have no inside)


@dataclass(frozen=True, slots=True)
class Margin:
    """Signed distance of a point from the edge of a region."""

    value: float | None
    """m, positive inside; None: there is no region, or no edge."""
    direction: Array | None = None
    """(2,) unit direction in which the edge is nearest, when known."""


@dataclass(frozen=True, slots=True)
class Extent:
    """Way from a point along a direction to the edge of a region."""

    value: float | None
    """m, signed: negative when the region ends behind the point; None unless status is ok."""
    status: ExtentStatus
    """`missed`: the line does not meet the region."""


@dataclass(frozen=True, slots=True)
class Plane:
    """Where a region of a leaning frame lies in a horizontal plane: c = matrix p + zero for its points p."""

    matrix: Array
    """(2, 2), determinant > 0."""
    zero: Array
    """(2,) m."""

    def back(self, c: Array) -> Array:
        """The point (2,) of the region that lies at c (2,) in the plane."""
        return solve(self.matrix, (c - self.zero)[:, None])[:, 0]

    def solved(self, s: Solved) -> Solved:
        """The answers of a region seen in the plane: h(d) = h(a) / |M^-T a| for d = M^-T a / |M^-T a|."""
        direction = solve(self.matrix.T, s.fan.direction[: s.count].T).T
        size = np.hypot(direction[:, 0], direction[:, 1])
        fan = with_room(s.fan, s.count, s.count)
        fan.direction[:], fan.value[:] = direction / size[:, None], s.fan.value[: s.count] / size
        fan.point[:], fan.unknown[:] = (
            product(s.fan.point[: s.count], self.matrix.T),
            s.fan.unknown[: s.count] / size[:, None],
        )
        insert(fan, 0, s.count)
        h = product(s.reduced.h, self.matrix.T)
        return Solved(s.reduced._replace(h=h), fan, s.count, product(self.matrix, s.anchor) + self.zero)


def margin(region: Region, point: Array, plane: Plane | None = None) -> Margin:
    """min over unit a of h(a) - a'c: the distance to the edge inside, minus the distance to the region outside.

    With a plane both distance and point are in it.

    Raises:
        StabilityError: no_convergence, by field `contacts`.
    """
    if region.status in ("infeasible", "unbounded"):
        return Margin(None)
    if region.solved is not None:
        s = region.solved if plane is None else plane.solved(region.solved)
        x, y = (point - s.anchor) / s.reduced.length
        capacity = s.count + MARGIN_DIRECTIONS
        fan = with_room(s.fan, s.count, capacity)
        goal = FanGoal(APPROACH, MARGIN_TOLERANCE, float(x), float(y))
        count, _, outlook = explore(s.reduced, fan, s.count, s.count, goal, capacity, LANES)
        if not settled(fan, count, outlook):
            outlook, fan = approach(s.reduced, fan, count, goal)
        return Margin(outlook.best * s.reduced.length, fan.direction[outlook.arg].copy())
    inner = region.inner if plane is None else product(region.inner, plane.matrix.T) + plane.zero
    value = float(signed_distance(inner, float(point[0]), float(point[1])))
    return Margin(0.0 if abs(value) < ON_EDGE else value)


def nearest_edge(polygon: Array, point: Array) -> Array:
    """Unit direction from a point to the nearest edge inside, from the polygon's nearest point outside."""
    along = np.roll(polygon, -1, axis=0) - polygon
    out = np.column_stack((along[:, 1], -along[:, 0])) / np.hypot(along[:, 0], along[:, 1])[:, None]
    slack = np.add.reduce(out * (polygon - point), axis=1)
    if slack.min() >= 0.0:
        return out[int(slack.argmin())]
    share = np.clip(np.add.reduce((point - polygon) * along, axis=1) / np.add.reduce(along * along, axis=1), 0.0, 1.0)
    away = point - (polygon + share[:, None] * along)
    length = np.hypot(away[:, 0], away[:, 1])
    k = int(length.argmin())
    return away[k] / length[k]


def extent(region: Region, point: Array, direction: Array, plane: Plane | None = None) -> Extent:
    """Largest t with point + t a in the region, for a unit direction a.

    One equality more than the support program (b = a turned by 90 degrees): sum h_i(b)'x_i = b'c0; its dual has one
    unknown nu more: min lam_3 + nu b'c0 - a'c0 s.t. A_i lam + nu h_i(b) - h_i(a) in Q. With a plane the ray lies in it.
    """
    size = 1.0
    if plane is not None:
        along = plane.back(direction + plane.zero)
        size = math.hypot(along[0], along[1])
        point, direction = plane.back(point), along / size
    if region.status == "infeasible":
        return Extent(None, "infeasible")
    if region.solved is not None:
        found = _edge(region.solved, point, direction)
    else:
        _, t = ray(region.inner, float(point[0]), float(point[1]), float(direction[0]), float(direction[1]))
        found = Extent(None, "missed") if math.isnan(t) else Extent(float(t), "ok")
    return found if plane is None or found.value is None else Extent(found.value / size, found.status)


def _edge(s: Solved, point: Array, a: Array) -> Extent:
    """Extent by one program.

    Free forces move the CoM along a line: only directions d = a - nu b that they leave alone have an edge.
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
