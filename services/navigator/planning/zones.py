"""Zones of a floor: keepout, which no route enters, and speed limits. Names and meaning are those of Nav2's filters.

A zone is a polygon, or a mask: an occupancy grid. A keepout mask holds the cells of 65 % and more. A cell of v > 0 % of
a speed mask limits the speed to base + multiplier v, in % or m/s (nav2_costmap_2d, KeepoutFilter, SpeedFilter).
"""

import math
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from surefoot.arrays import Array, Flags

from .costs import Clearance
from .gap import gap, meets
from .grid import OCCUPIED, FloorGrid, Point

Kind = Literal["keepout", "speed_limit"]


@dataclass(frozen=True)
class SpeedLimit:
    """Limit of the walking speed: `share`, 0 to 1, of an action's own, and `most` m/s."""

    share: float = 1.0
    most: float = math.inf

    def least(self, other: "SpeedLimit") -> "SpeedLimit":
        """Return the limit that obeys this one and another."""
        return SpeedLimit(min(self.share, other.share), min(self.most, other.most))

    def of(self, speed: float) -> float:
        """Return the allowed speed of an action whose own speed is `speed`, both m/s."""
        return min(speed * self.share, self.most)


INNER = 1e-6
"""Part of a cell's edge that counts as beside the cell: zones drawn along its edges do not touch it."""
FREELY = SpeedLimit()
"""No limit of the speed."""


@dataclass(frozen=True, eq=False)
class Zone:
    """Part of the floor that the robot does not enter, or where it walks slowly."""

    name: str
    """Name of the zone, in refusals and logs."""
    kind: Kind
    """keepout, or speed_limit."""
    polygon: Array = field(default_factory=lambda: np.zeros((0, 2)))
    """Corners in order, (n, 2) m, frame map; (0, 2) = the zone is a mask."""
    mask: FloorGrid | None = None
    """Mask of the zone; None = it is a polygon."""
    speed_limit: float = 0.0
    """Largest speed in a polygon, in % or m/s."""
    percentage: bool = True
    """True: a speed is in % of that of the action that is walked; False: in m/s."""
    base: float = 0.0
    """Speed limit that a mask's value of 0 % would give, in % or m/s."""
    multiplier: float = 1.0
    """Speed limit added for each % of a mask's value, in % or m/s."""

    def inside(self, x: Array, y: Array) -> Flags:
        """Return True for each point in the zone, (n,); those of a mask of speed limits are in cells above 0 %.

        `x`, `y`: m, frame map, (n,).
        """
        if self.mask is not None:
            return _values(self.mask, x, y) >= (1 if self.kind == "speed_limit" else Clearance().obstacle)
        odd = np.zeros(len(x), dtype=bool)
        for (ax, ay), (bx, by) in self.edges():
            if ay != by:
                odd ^= ((ay > y) != (by > y)) & (x < ax + (y - ay) * (bx - ax) / (by - ay))
        return odd

    def edges(self) -> list[tuple[Point, Point]]:
        """Return the ends of each edge of the polygon, x, y in m, frame map; none of a mask."""
        corners = [(float(x), float(y)) for x, y in self.polygon]
        return list(zip(corners, [*corners[1:], *corners[:1]], strict=True))

    def pace(self, point: Point) -> SpeedLimit:
        """Return the speed limit of the zone at a place, x, y in m, frame map."""
        x, y = np.array([point[0]]), np.array([point[1]])
        if self.kind != "speed_limit" or not self.inside(x, y)[0]:
            return FREELY
        limit = self.speed_limit
        if self.mask is not None:
            limit = max(0.0, self.base + self.multiplier * float(_values(self.mask, x, y)[0]))
            if limit == 0.0:  # as in Nav2
                return FREELY
        return SpeedLimit(share=min(1.0, 0.01 * limit)) if self.percentage else SpeedLimit(most=limit)


@dataclass(frozen=True, eq=False)
class Zones:
    """Zones of a floor, in the order of their file; false if there are none."""

    all: tuple[Zone, ...] = ()

    def __len__(self) -> int:
        return len(self.all)

    @property
    def keepout(self) -> tuple[Zone, ...]:
        """Zones that no route enters."""
        return tuple(zone for zone in self.all if zone.kind == "keepout")

    def pace(self, *points: Point) -> SpeedLimit:
        """Return the speed limit that holds at any of some places, x, y in m, frame map."""
        found = FREELY
        for zone in self.all:
            for point in points if zone.kind == "speed_limit" else ():
                found = found.least(zone.pace(point))
        return found


class KeptOut:
    """Cells of a grid that the keepout zones of a floor touch.

    Args:
        zones: zones of the floor; those of speed do not count.
        grid: occupancy of the floor, m, frame map.
    """

    def __init__(self, zones: Zones, grid: FloorGrid) -> None:
        self.grid, self.names = grid, tuple(zone.name for zone in zones.keepout)
        self._number = np.zeros(grid.shape, dtype=np.int16)
        """Number of the zone that each cell belongs to, from 1 on; 0 = none, (rows, cols)."""
        for number, zone in enumerate(zones.keepout, 1):
            self._number[(self._number == 0) & _touched(zone, grid)] = number
        self.cells: Flags = self._number > 0
        """True for each cell that a zone touches, (rows, cols)."""

    def closed(self, grid: FloorGrid) -> FloorGrid:
        """Return a copy of a grid of the same cells in which those of the zones are occupied."""
        cells = grid.cells.copy()
        cells[self.cells] = OCCUPIED
        return replace(grid, cells=cells)

    def name_at(self, point: Point) -> str:
        """Return the name of the zone that touches the cell at a place, x, y in m, frame map; empty = none does."""
        row, col = self.grid.index(*point)
        number = int(self._number[row, col]) if self.grid.inside(row, col) else 0
        return self.names[number - 1] if number else ""

    def nearest(self, point: Point) -> tuple[str, float]:
        """Return name and distance, m, of the nearest zone; empty and infinite without any. `point`: m, frame map."""
        at = np.argwhere(self.cells)
        if not at.size:
            return "", math.inf
        row, col = _cells(self.grid, point)
        apart = np.hypot(*np.maximum(np.abs(at + 0.5 - (row, col)) - 0.5, 0.0).T)
        k = int(apart.argmin())
        return self.names[int(self._number[tuple(at[k])]) - 1], float(apart[k]) * self.grid.cell

    def open(self, here: Point, end: Point, margin: float) -> bool:
        """Return True if a straight line comes no nearer to a zone than `margin` m, or than its begin does.

        `here`, `end`: begin and end of the line, x, y in m, frame map.
        """
        most, (a, b) = margin / self.grid.cell, (_cells(self.grid, here), _cells(self.grid, end))
        least = gap(self.cells, [a, b], most)
        return least >= most or least >= gap(self.cells, [a], most) - 1e-6


def _values(mask: FloorGrid, x: Array, y: Array) -> Array:
    """Return the occupancy, %, of a mask at each point, -1 outside, (n,). `x`, `y`: m, frame map, (n,)."""
    (x0, y0), (x, y) = mask.origin, mask.aligned(x, y)
    col, row = (np.floor((v - v0) / mask.cell).astype(np.int64) for v, v0 in ((x, x0), (y, y0)))
    found = np.full(len(x), -1.0)
    on = (row >= 0) & (col >= 0) & (row < mask.shape[0]) & (col < mask.shape[1])
    found[on] = mask.cells[row[on], col[on]]
    return found


def _cells(grid: FloorGrid, point: Point) -> Point:
    """Return row and column of a place, m, frame map, in a grid, cell i reaching from i to i + 1."""
    (x0, y0), (x, y) = grid.origin, grid.aligned(*point)
    return (y - y0) / grid.cell, (x - x0) / grid.cell


def _touched(zone: Zone, grid: FloorGrid) -> Flags:
    """Return True for each cell of a grid that overlaps with a zone, (rows, cols)."""
    x0, y0, x1, y1 = (*zone.polygon.min(axis=0), *zone.polygon.max(axis=0)) if zone.mask is None else zone.mask.bounds
    corners = [grid.index(float(x), float(y)) for x in (x0, x1) for y in (y0, y1)]
    r0, c0 = np.clip(np.min(corners, axis=0), 0, grid.shape).tolist()
    r1, c1 = np.clip(np.max(corners, axis=0) + 1, 0, grid.shape).tolist()
    rows, cols = (part.ravel() for part in np.mgrid[r0:r1, c0:c1])
    found = np.zeros(rows.size, dtype=bool)
    points = 1 if zone.mask is None else 1 + math.ceil(grid.cell / zone.mask.cell)  # of a cell, along each edge
    shares = [0.5] if points == 1 else np.linspace(INNER, 1.0 - INNER, points).tolist()
    for dr in shares:
        for dc in shares:
            right, upper = (grid.origin[i] + (v + d) * grid.cell for i, v, d in ((0, cols, dc), (1, rows, dr)))
            found |= zone.inside(*grid.turned(right, upper))
    for a, b in zone.edges():
        found |= meets(rows + 0.5, cols + 0.5, _cells(grid, a), _cells(grid, b), 0.5 - INNER)
    whole = np.zeros(grid.shape, dtype=bool)
    whole[r0:r1, c0:c1] = found.reshape(r1 - r0, c1 - c0)
    return whole
