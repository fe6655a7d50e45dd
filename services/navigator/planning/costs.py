"""Cost of walking over each cell of a floor: none within the robot's radius of an obstacle, dearer near it.

Kernels work on padded arrays: a frame of one blocked cell around the grid spares every neighbour its test of the
borders.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from surefoot.arguments import number, whole
from surefoot.errors import FieldError, Refusal
from surefoot.kernels.jit import row_kernel

from . import astar
from .astar import EVEN, HEAVIEST, UNIT
from .grid import FloorGrid

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int32]

LARGE = 300_000
"""Free cells from which on marks pay: they take 16 bytes a cell, and a second or so to make for four million."""
MARKS = 4
FARTHEST_CLEARANCE = 1e3
"""Largest distance of a clearance, m."""
WIDEST = 200
"""Cells, of the clearance that is counted; more is taken for a mistake in the units."""


@dataclass(frozen=True)
class Clearance:
    """Distances that routes keep from obstacles.

    Args:
        radius: of the robot, m: no route comes closer to an obstacle.
        comfort: distance from an obstacle from which on a cell is no cheaper, m.
        dearest: cost of a cell at `radius` over that of one at `comfort`, 1 to 4.
        obstacle: occupancy from which on a cell is an obstacle, 1 to 100.
        through_unknown: unknown cells may be walked over; the outside of the grid never.

    Raises:
        Refusal: a number is out of range; `field` names it.
    """

    radius: float = 0.15
    """Radius of the robot, m: no route comes closer to an obstacle."""
    comfort: float = 0.35
    """Distance from an obstacle from which on a cell is no cheaper, m."""
    dearest: float = 4.0
    """Cost of a cell at `radius` over that of one at `comfort`, 1 to 4."""
    obstacle: int = 65
    """Occupancy from which on a cell is an obstacle, 1 to 100."""
    through_unknown: bool = False
    """Unknown cells may be walked over; the outside of the grid never."""

    def __post_init__(self) -> None:
        try:
            radius = number(self.radius, "radius", "m", low=0.0, high=FARTHEST_CLEARANCE)
            number(self.comfort, "comfort", "m", low=radius, high=FARTHEST_CLEARANCE)
            number(self.dearest, "dearest", low=1.0, high=HEAVIEST / UNIT)
            whole(self.obstacle, "obstacle", "%", low=1, high=100)
        except FieldError as error:
            raise Refusal("bad_clearance", str(error), error.field) from None


@dataclass(frozen=True, eq=False)
class Costs:
    """A grid prepared for planning. Made once per map by `prepare`; arrays are padded by a frame of blocked cells."""

    grid: FloorGrid
    """Grid from which the costs were made."""
    clearance: Clearance
    """Distances from obstacles with which the costs were made."""
    weight: Bytes
    """Cost factors of the padded cells, (rows + 2, cols + 2): UNIT far from obstacles, 0 = not to be entered; with the
    bit EVEN, see `astar`."""
    region: Ints
    """Connected regions of free cells, numbered from 1 on, (rows + 2, cols + 2); 0 = blocked."""
    distance2: Ints
    """Squared distance of cell centres to the nearest obstacle's, (rows + 2, cols + 2) cells^2, bounded."""
    marks: Ints
    """Costs between cells that lie far apart and all others, (cells, marks), see `astar`; no marks in a small map."""
    marked: int
    """Region the marks are in."""

    @cached_property
    def scratch(self) -> Ints:
        """Return room for the costs of a search, (cells,), no unit; every search overwrites all of it."""
        return np.empty(self.weight.size, dtype=np.int32)

    def marks_of(self, region: int) -> Ints:
        """Return the costs between marks and cells, (cells, marks), no unit; (cells, 0) if no mark is in the region."""
        return self.marks if region == self.marked else self.marks[:, :0]

    def distance(self, row: int, col: int) -> float:
        """Return how far the centre of a cell is from the edge of the nearest obstacle, m; bounded by `comfort`."""
        cells = math.sqrt(float(self.distance2[row + 1, col + 1])) - 0.5
        return max(0.0, min(self.clearance.comfort, cells * self.grid.cell))


def prepare(grid: FloorGrid, clearance: Clearance | None = None, *, lasting: bool = True) -> Costs:
    """Return the costs of a grid.

    A cell whose centre is d m from the edge of the nearest obstacle may be entered if d >= radius, and then costs
    dearest at the radius, 1 at `comfort`, and linearly between.

    Args:
        grid: occupancy.
        clearance: None = the defaults of `Clearance`.
        lasting: many routes will be planned on it, so that the marks of a large map pay.

    Raises:
        Refusal: `comfort` is more than 200 cells.
    """
    clearance = clearance or Clearance()
    most = math.ceil(clearance.comfort / grid.cell + 0.5)
    if most > WIDEST:
        allowed = f"{WIDEST} cells, {WIDEST * grid.cell:g} m"
        raise Refusal("bad_clearance", f"comfort is at most {allowed}, got {clearance.comfort!r}", "comfort")
    wall = blocked(grid.cells, clearance.obstacle, clearance.through_unknown)
    distance2 = squared_distance(wall, most)
    weight = weights(distance2, _table(clearance, grid.cell, most))
    mark_even(weight, EVEN)
    region = regions(weight)
    size = np.bincount(region.ravel())
    size[0] = 0
    largest = int(size.argmax())
    many = MARKS if lasting and size[largest] >= LARGE else 0
    marks = np.empty((weight.size, many), dtype=np.int32)
    cost, far = np.empty(weight.size, dtype=np.int32), int((region.ravel() == largest).argmax())
    for i in range(many + 1 if many else 0):  # the first is only to find the one farthest from it
        astar.search(weight, far, astar.NOWHERE, marks[:, :0], cost)
        far = settled_costs(cost, marks, i - 1)
    return Costs(grid, clearance, weight, region, distance2, marks, largest)


def _table(clearance: Clearance, cell: float, most: int) -> Bytes:
    """Return the weight by squared distance in cells, ((most + 1)^2 + 1,)."""
    table, span = np.zeros((most + 1) ** 2 + 1, dtype=np.uint8), clearance.comfort - clearance.radius
    for d2 in range(1, table.size):
        d = (math.sqrt(d2) - 0.5) * cell
        if d < clearance.radius - 1e-9:
            continue
        near = min(1.0, max(0.0, (clearance.comfort - d) / span)) if span > 0.0 else 0.0
        table[d2] = round(UNIT * (1.0 + (clearance.dearest - 1.0) * near))
    return table


@row_kernel
def blocked(cells: NDArray[np.int8], obstacle: int, through_unknown: bool) -> Bytes:
    """Return 1 where a cell is an obstacle, else 0, (rows + 2, cols + 2), in a frame of ones.

    Args:
        cells: occupancy, (rows, cols): 0 free to 100 occupied, -1 unknown.
        obstacle: occupancy from which on a cell is an obstacle, 1 to 100.
        through_unknown: unknown cells are free.
    """
    rows, cols = cells.shape
    out = np.ones((rows + 2, cols + 2), dtype=np.uint8)
    for r in range(rows):
        for c in range(cols):
            value = cells[r, c]
            out[r + 1, c + 1] = value >= obstacle or (value < 0 and not through_unknown)
    return out


@row_kernel
def squared_distance(wall: Bytes, most: int) -> Ints:
    """Return the squared distance of every cell centre to the nearest wall's, cells^2: exact to `most`, then constant.

    d^2(r, c) = min over k of (k - c)^2 + down(r, k)^2, down = distance to the nearest wall of the same column.
    """
    rows, cols = wall.shape
    far = most + 1
    down = np.empty((rows, cols), dtype=np.int32)
    for r in range(rows):
        for c in range(cols):
            before = down[r - 1, c] + 1 if r > 0 else far
            down[r, c] = 0 if wall[r, c] else min(far, before)
    for r in range(rows - 2, -1, -1):
        for c in range(cols):
            down[r, c] = min(down[r, c], down[r + 1, c] + 1)
    out = np.empty((rows, cols), dtype=np.int32)
    for r in range(rows):
        for c in range(cols):
            out[r, c] = down[r, c] * down[r, c]
        for k in range(1, most + 1):
            k2 = k * k
            for c in range(cols - k):
                out[r, c] = min(out[r, c], down[r, c + k] * down[r, c + k] + k2)
            for c in range(k, cols):
                out[r, c] = min(out[r, c], down[r, c - k] * down[r, c - k] + k2)
    return out


@row_kernel
def weights(distance2: Ints, table: Bytes) -> Bytes:
    """Return the cost factor of every cell, no unit, (rows, cols), as table[d^2]; 0 = not to be entered, as its edge.

    Args:
        distance2: squared distance d^2 to the nearest obstacle, cells^2, (rows, cols).
        table: factor by d^2, (n,); larger d^2 get the last one.
    """
    rows, cols = distance2.shape
    out = np.zeros((rows, cols), dtype=np.uint8)
    last = table.size - 1
    for r in range(1, rows - 1):
        for c in range(1, cols - 1):
            out[r, c] = table[min(last, distance2[r, c])]
    return out


@row_kernel
def mark_even(weight: Bytes, bit: int) -> None:
    """Set a bit of the free cells that weigh the same as all eight neighbours, in place; weight (rows, cols)."""
    rows, cols = weight.shape
    before, this = np.zeros(cols, dtype=np.bool_), np.zeros(cols, dtype=np.bool_)
    for r in range(1, rows - 1):
        for c in range(1, cols - 1):
            w = weight[r, c]
            same = w > 0
            for i in range(-1, 2):
                for j in range(-1, 2):
                    same = same and weight[r + i, c + j] == w
            this[c] = same
        for c in range(1, cols - 1):  # a row behind, so that no mark is compared
            if before[c]:
                weight[r - 1, c] |= np.uint8(bit)
            before[c] = this[c]
    for c in range(1, cols - 1):
        if before[c]:
            weight[rows - 2, c] |= np.uint8(bit)


@row_kernel
def root(parent: Ints, i: int) -> int:
    """Return the representative of label i, an index, and shorten the way to it in `parent` (labels,), in place."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@row_kernel
def regions(weight: Bytes) -> Ints:
    """Return the number of the connected region of every free cell, from 1 on, 0 = blocked, (rows, cols).

    Neighbours share an edge: a diagonal step needs both cells beside it, so it connects nothing that edges do not.
    `weight`: cost factor of each cell, no unit, (rows, cols); 0 = not to be entered.
    """
    rows, cols = weight.shape
    label = np.zeros((rows, cols), dtype=np.int32)
    parent = np.zeros(rows * cols // 2 + 2, dtype=np.int32)
    used = 0
    for r in range(1, rows - 1):
        for c in range(1, cols - 1):
            if weight[r, c] == 0:
                continue
            left, under = label[r, c - 1], label[r - 1, c]
            if left == 0 and under == 0:
                used += 1
                parent[used] = used
                label[r, c] = used
            elif left == 0 or under == 0 or left == under:
                label[r, c] = max(left, under)
            else:
                a, b = root(parent, left), root(parent, under)
                parent[max(a, b)] = min(a, b)
                label[r, c] = min(a, b)
    names = np.zeros(used + 1, dtype=np.int32)
    count = 0
    for i in range(1, used + 1):
        at = root(parent, i)
        if names[at] == 0:
            count += 1
            names[at] = count
        names[i] = names[at]
    for r in range(1, rows - 1):
        for c in range(1, cols - 1):
            label[r, c] = names[label[r, c]]
    return label


@row_kernel
def nearest_free(weight: Bytes, label: Ints, wanted: int, row: float, col: float) -> tuple[int, int, float]:
    """Return the free cell nearest to a place.

    Args:
        weight: cost factor of each cell, (rows, cols); 0 = not to be entered.
        label: region of each cell, (rows, cols).
        wanted: region in which the cell lies; 0 = any.
        row: of the place, cells.
        col: of the place, cells.

    Returns:
        Row, column (0, 0 if there is none), distance in cells.
    """
    rows, cols = weight.shape
    best, best_r, best_c = math.inf, 0, 0
    for r in range(1, rows - 1):
        dr = (r - row) * (r - row)
        if dr >= best:
            continue
        for c in range(1, cols - 1):
            if weight[r, c] == 0 or (wanted != 0 and label[r, c] != wanted):
                continue
            d = dr + (c - col) * (c - col)
            if d < best:
                best, best_r, best_c = d, r, c
    return best_r, best_c, math.sqrt(best)


@row_kernel
def settled_costs(cost: Ints, marks: Ints, column: int) -> int:
    """Write the costs of a search of everything into a column of the marks; return the next mark's cell.

    That is the cell whose least cost to any mark so far is largest. Cells out of reach get 0 in every column.

    Args:
        cost: of `astar.search`, flattened, (cells,), no unit: -cost - 1 where it was settled.
        marks: costs between marks and cells, (cells, marks), no unit.
        column: to be written, or -1: none, and the next one is the cell farthest from this search's start.
    """
    best, farthest = 0, -1
    for i in range(cost.size):
        value = -cost[i] - 1 if cost[i] < 0 else 0
        if column >= 0:
            marks[i, column] = value
            for m in range(column):
                value = min(value, marks[i, m])
        if value > farthest:
            best, farthest = i, value
    return best
