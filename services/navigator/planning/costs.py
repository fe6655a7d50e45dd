"""What a cell of the floor costs to walk over: free of obstacles by the robot's radius, dearer near them."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from surefoot.errors import Refusal

from . import astar_kernel as astar
from . import costs_kernel as kernel
from .astar_kernel import EVEN, HEAVIEST, UNIT
from .grid import FloorGrid

LARGE = 300_000
"""Free cells from which on marks pay: they take 16 bytes a cell, and a second or so to make for four million."""
MARKS = 4
WIDEST = 200
"""Cells, of the clearance that is counted; more is taken for a mistake in the units."""


@dataclass(frozen=True)
class Clearance:
    """How far routes keep from obstacles.

    Raises:
        Refusal: a number that cannot be; names the field.
    """

    radius: float = 0.15
    """m, of the robot: no route comes closer to an obstacle."""
    comfort: float = 0.35
    """m, from which on distance makes a cell no cheaper."""
    dearest: float = 4.0
    """Cost of a cell at `radius` over that of one at `comfort`, 1 to 4."""
    obstacle: int = 65
    """Occupancy from which on a cell is an obstacle, 1 to 100."""
    through_unknown: bool = False
    """Cells of which nothing is known may be walked over; the outside of the grid never."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.radius) and self.radius >= 0.0):
            raise Refusal("bad_clearance", f"radius is finite and >= 0 m, got {self.radius!r}", "radius")
        if not (math.isfinite(self.comfort) and self.comfort >= self.radius):
            text = f"comfort is finite and >= the radius {self.radius!r} m, got {self.comfort!r}"
            raise Refusal("bad_clearance", text, "comfort")
        if not 1.0 <= self.dearest <= HEAVIEST / UNIT:
            raise Refusal("bad_clearance", f"dearest is 1 to {HEAVIEST // UNIT}, got {self.dearest!r}", "dearest")
        if not 1 <= self.obstacle <= 100:
            raise Refusal("bad_clearance", f"obstacle is 1 to 100, got {self.obstacle!r}", "obstacle")


@dataclass(frozen=True, eq=False)
class Costs:
    """A grid prepared for planning. Made once per map by `prepare`; arrays are padded by a frame of blocked cells."""

    grid: FloorGrid
    """The grid it was made of."""
    clearance: Clearance
    """And with what."""
    weight: NDArray[np.uint8]
    """(rows + 2, cols + 2) cost factors, UNIT far from obstacles, 0 = not to be entered; with the bit EVEN, see
    `astar_kernel`."""
    region: NDArray[np.int32]
    """(rows + 2, cols + 2) connected regions of free cells from 1 on, 0 = blocked."""
    distance2: NDArray[np.int32]
    """(rows + 2, cols + 2) squared distance of cell centres to the nearest obstacle's, cells^2, bounded."""
    marks: NDArray[np.int32]
    """(cells, marks) costs between cells that lie far apart and all others, see `astar_kernel`; no marks in a small
    map."""
    marked: int
    """Region the marks are in."""

    @cached_property
    def scratch(self) -> NDArray[np.int32]:
        """Room for the costs of a search, flattened; every search overwrites all of it."""
        return np.empty(self.weight.size, dtype=np.int32)

    def marks_of(self, region: int) -> NDArray[np.int32]:
        """Return the marks that serve a search in a region: all or none."""
        return self.marks if region == self.marked else self.marks[:, :0]

    def distance(self, row: int, col: int) -> float:
        """Return how far the centre of a cell is from the edge of the nearest obstacle, m; bounded by `comfort`."""
        cells = math.sqrt(float(self.distance2[row + 1, col + 1])) - 0.5
        return max(0.0, min(self.clearance.comfort, cells * self.grid.cell))


def prepare(grid: FloorGrid, clearance: Clearance | None = None) -> Costs:
    """Return the costs of a grid.

    A cell whose centre is d m from the edge of the nearest obstacle may be entered if d >= radius, and then costs
    dearest at the radius, 1 at `comfort`, and linearly between.

    Args:
        grid: occupancy.
        clearance: None = the defaults of `Clearance`.

    Raises:
        Refusal: `comfort` is more than 200 cells.
    """
    clearance = clearance or Clearance()
    most = math.ceil(clearance.comfort / grid.cell + 0.5)
    if most > WIDEST:
        allowed = f"{WIDEST} cells, {WIDEST * grid.cell:g} m"
        raise Refusal("bad_clearance", f"comfort is at most {allowed}, got {clearance.comfort!r}", "comfort")
    wall = kernel.blocked(grid.cells, clearance.obstacle, clearance.through_unknown)
    distance2 = kernel.squared_distance(wall, most)
    weight = kernel.weights(distance2, _table(clearance, grid.cell, most))
    kernel.mark_even(weight, EVEN)
    region = kernel.regions(weight)
    size = np.bincount(region.ravel())
    size[0] = 0
    largest = int(size.argmax())
    many = MARKS if size[largest] >= LARGE else 0
    marks = np.empty((weight.size, many), dtype=np.int32)
    cost, far = np.empty(weight.size, dtype=np.int32), int((region.ravel() == largest).argmax())
    for i in range(many + 1 if many else 0):  # the first is only to find the one farthest from it
        astar.search(weight, far, astar.NOWHERE, marks[:, :0], cost)
        far = kernel.settled_costs(cost, marks, i - 1)
    return Costs(grid, clearance, weight, region, distance2, marks, largest)


def _table(clearance: Clearance, cell: float, most: int) -> NDArray[np.uint8]:
    """Weight by squared distance in cells, ((most + 1)^2 + 1,)."""
    table, span = np.zeros((most + 1) ** 2 + 1, dtype=np.uint8), clearance.comfort - clearance.radius
    for d2 in range(1, table.size):
        d = (math.sqrt(d2) - 0.5) * cell
        if d < clearance.radius - 1e-9:
            continue
        near = min(1.0, max(0.0, (clearance.comfort - d) / span)) if span > 0.0 else 0.0
        table[d2] = round(UNIT * (1.0 + (clearance.dearest - 1.0) * near))
    return table
