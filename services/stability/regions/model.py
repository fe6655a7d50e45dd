"""Answers about regions: status, polygons, support values with proof."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.linear import product, solve
from surefoot.geometry.polygon import area

from ..programs.contacts import ContactSet
from ..programs.fan import Fan, insert
from ..programs.reduced import Reduced

RegionStatus = Literal["ok", "infeasible", "unbounded", "point", "segment"]
SupportStatus = Literal["ok", "unbounded", "infeasible"]


@dataclass(frozen=True, slots=True)
class Support:
    """Support values h(a) of a region in k directions a, with proof."""

    direction: Array
    """Unit directions a of the support values, (k, 2)."""
    value: Array
    """Support values h(a), the largest a'p of points p of the region, (k,) m; NaN unless `status` is ok."""
    point: Array
    """Points p of the region with the largest a'p of each direction a, (k, 2) m."""
    status: tuple[SupportStatus, ...]
    """Status of each of the k directions: `ok` = its value is known."""
    gap: Array
    """Duality gap: support value less a'p of the point p found in direction a, (k,) m; >= 0 up to rounding."""
    twist: Array
    """Certificate of each value about the origin of the frame, (k, 4) (v m, w_z), or (k, 6) (v m, Om) with an
    acceleration; NaN unless ok; (k, 0) with torque limits, which have none."""
    force: Array
    """Contact forces at `point` in units of the weight, (k, n, 3); unbounded: forces that shift the CoM and hold
    nothing."""
    torque: Array | None = None
    """Joint torques of each contact's leg at `point`, (k, n, 3) Nm; None without torque limits."""


@dataclass(frozen=True, slots=True)
class Plane:
    """Map of points p (2,) m of the frame along effective gravity to a level plane of the world: matrix p + zero."""

    matrix: Array
    """Derivative of world x, y by x, y of the leaning frame, (2, 2), no unit, determinant > 0."""
    zero: Array
    """World x, y of the origin of the leaning frame's plane, seen along gravity, (2,) m."""

    def back(self, c: Array) -> Array:
        """Return the point p (2,) m of the leaning frame that lies at c (2,) m in the level plane: the inverse map."""
        return solve(self.matrix, (c - self.zero)[:, None])[:, 0]


@dataclass(frozen=True, slots=True)
class Solved:
    """Cone programs of a region that has an area or no bound, and their solutions in a fan of directions."""

    reduced: Reduced
    """Cone programs of the contacts, scaled frame."""
    fan: Fan
    """Answers of all directions, in the scaled frame of `reduced`."""
    count: int
    """Number of directions of the fan that have answers."""
    anchor: Array
    """Origin of the scaled frame, (2,) m: position = anchor + length * scaled."""
    drift: Array | None = None
    """Shift of the CoM by free tangential forces of j contacts, (2 j, 2): no bound where it is not 0; None: no such."""
    plane: Plane | None = None
    """Map from the leaning frame of the programs to the level plane of the region; None: their frames are equal."""

    def level(self) -> "Solved":
        """Return the answers turned into the level plane of the region: h(d) = h(a) / |M^-T a|, d = M^-T a / |M^-T a|.

        h: support values, a, d: unit directions of the leaning frame and of the plane, M: matrix of the map between
        them.
        """
        if self.plane is None:
            return self
        own, count, matrix = self.fan, self.count, self.plane.matrix
        fan = Fan(
            own.direction[:count].copy(), own.value[:count].copy(), own.point[:count].copy(),
            own.unknown[:count].copy(), own.force[:count].copy(), own.error[:count].copy(),
            own.status[:count].copy(), own.order[:count].copy(),
        )  # fmt: skip
        direction = solve(matrix.T, fan.direction.T).T
        size = np.hypot(direction[:, 0], direction[:, 1])
        fan.direction[:], fan.value[:] = direction / size[:, None], fan.value / size
        fan.point[:], fan.unknown[:] = product(fan.point, matrix.T), fan.unknown / size[:, None]
        insert(fan, 0, count)
        reduced = self.reduced._replace(h=product(self.reduced.h, matrix.T))
        return Solved(reduced, fan, count, product(matrix, self.anchor) + self.plane.zero)


class Line(NamedTuple):
    """Part of a horizontal line: places origin + t direction with low <= t <= high."""

    origin: Array
    """Point of the line, (2,) m."""
    direction: Array
    """Unit vector along the line, (2,), no unit."""
    low: float
    """Least t, m; -inf = no end."""
    high: float
    """Largest t, m; inf = no end."""


@dataclass(frozen=True, slots=True)
class Region:
    """Places of the centre of mass at which the contacts hold the robot: polygons and support values."""

    contacts: ContactSet
    """Contacts of the region, in the region's frame."""
    status: RegionStatus
    """Status of the region: ok (it has an area), infeasible, unbounded, point or segment."""
    inner: Array
    """Corners of the polygon inside the region, or its point or segment, (p, 2) m."""
    outer: Array
    """Corners of the polygon around the region, (q, 2) m; empty if there is none."""
    support: Support
    """Support values in the requested directions, or without such in those that were solved for."""
    gap: float
    """Largest distance of outer from inner polygon, m; NaN if there is no outer."""
    exact: bool
    """True if no refinement is possible (exact region, torque limits, several gravities); False: `solved` refines."""
    calls: int
    """Number of directions in which the region was solved for."""
    sinking: Array | None = None
    """Twist about the origin of the frame that proves infeasibility, (4,) (v m, w_z) with v_z < 0, or (6,) (v m, Om)
    with an acceleration."""
    solved: Solved | None = None
    """Cone programs and fan, for margins and extents; None for a region that is exact or empty."""
    line: Line | None = None
    """Region without bounds of contacts on one line; None: any other region."""

    @property
    def area(self) -> float:
        """Area of the inner polygon, m^2."""
        return max(0.0, float(area(self.inner)))

    @property
    def area_outer(self) -> float | None:
        """Area of the outer polygon, m^2; None if there is none."""
        return max(0.0, float(area(self.outer))) if len(self.outer) else None

    @property
    def areas(self) -> dict[str, float | None]:
        """Areas of the inner and outer polygon, m^2, by the names `area` and `area_outer`; None = no such polygon."""
        return {"area": self.area, "area_outer": self.area_outer}
