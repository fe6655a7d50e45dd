"""Cost of walking over each cell of a floor: blocked within the robot's radius of an obstacle, raised near it.

Kernels work on padded arrays: a frame of one blocked cell around the grid spares every neighbour its test of the
borders.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from surefoot.arguments import flag, number, whole
from surefoot.arrays import Array, Flags
from surefoot.errors import FieldError, Refusal
from surefoot.kernels.jit import row_kernel

from . import astar
from .astar import EVEN, HEAVIEST, UNIT, Bytes, Ints32
from .gap import gap
from .grid import FloorGrid

LARGE = 300_000
"""Number of free cells from which on a map gets marks, i.e. cells with stored costs to all others that speed up
searches; they take 16 bytes a cell, and about a second to make for four million."""
MARKS = 4
"""Number of marks, i.e. cells with stored costs to all others, in a large map."""
FARTHEST_CLEARANCE = 1e3
"""Largest distance from obstacles that a configuration may require, m; a larger one is refused."""
WIDEST = 200
"""Largest `Clearance.comfort` in cells; more is refused as a wrong unit."""


@dataclass(frozen=True)
class Clearance:
    """Distances that routes keep from obstacles.

    Raises:
        Refusal: a number is out of range; `field` names it.
    """

    radius: float = 0.15
    """Radius of the robot, m: no part of a route comes closer to an edge of an obstacle, or, unless `exact`, 0.21 cells
    closer to a corner; except between start or goal and the centre of the cell about it, where these are closer."""
    comfort: float = 0.35
    """Distance from an obstacle, m, from which on a cell has the least cost; below it, the nearer the dearer."""
    dearest: float = 4.0
    """Cost of a cell at `radius` from an obstacle over that of one at `comfort`, 1 to 4."""
    obstacle: int = 65
    """Occupancy from which on a cell is an obstacle, in percent, 1 to 100."""
    through_unknown: bool = False
    """True if routes may cross unknown cells, False if these block; outside the grid is always blocked."""
    exact: bool = False
    """True if a cell is as far from an obstacle as its centre from the obstacle's square; False if as its centre from
    the obstacle's centre less half a cell: equal beside an edge, 0.21 cells more beside a corner. The former closes
    doors askew to the grid that are up to two cells wider than the robot."""

    def __post_init__(self) -> None:
        try:
            radius = number(self.radius, "radius", "m", low=0.0, high=FARTHEST_CLEARANCE)
            number(self.comfort, "comfort", "m", low=radius, high=FARTHEST_CLEARANCE)
            number(self.dearest, "dearest", low=1.0, high=HEAVIEST / UNIT)
            whole(self.obstacle, "obstacle", "%", low=1, high=100)
            flag(self.through_unknown, "through_unknown")
            flag(self.exact, "exact")
        except FieldError as error:
            raise Refusal("bad_clearance", str(error), error.field) from None


@dataclass(frozen=True, eq=False)
class Costs:
    """Costs of walking over the cells of a map, prepared once per map for planning.

    Arrays are padded by a frame of one blocked cell: element [row + 1, col + 1] belongs to cell [row, col] of the grid.
    """

    grid: FloorGrid
    """Occupancy grid from which the costs were made."""
    clearance: Clearance
    """Distances from obstacles that the costs keep."""
    weight: Bytes
    """Cost factors of the padded cells, (rows + 2, cols + 2).

    The low 7 bits are 4 far from obstacles, up to 16 near them, 0 = not to be entered; bit 128 is set where all eight
    neighbours weigh the same."""
    region: Ints32
    """Number of the connected region of each free cell, from 1 on, (rows + 2, cols + 2); 0 = blocked."""
    distance2: Ints32
    """Squared distance of each cell's centre from the nearest obstacle's, or from its square if `clearance.exact`,
    (rows + 2, cols + 2) half cells^2, bounded above; 0 = an obstacle itself."""
    marks: Ints32
    """Costs from each mark to every padded cell, (cells, marks); no marks in a small map.

    A mark is a cell far from the other marks: costs to it bound the rest of a path and speed up a search."""
    marked: int
    """Number of the connected region that holds the marks."""

    @cached_property
    def scratch(self) -> Ints32:
        """Array for the costs from the start that a search writes, (cells,), no unit; every search overwrites it."""
        return np.empty(self.weight.size, dtype=np.int32)

    @cached_property
    def wall(self) -> Flags:
        """Flags of the padded cells that are obstacles, unknown (unless routes may cross these) or outside the grid."""
        return self.distance2 == 0

    def clearance_of(self, path: Ints32) -> float:
        """Return the least distance, m, of a path's cells from an obstacle; at most `comfort`.

        It is that of the centres of its cells; `clearance_along` measures the exact one of the whole line.

        `path`: indices of its cells in the flattened padded array, (n,).
        """
        cells = 0.5 * (math.sqrt(float(self.distance2.ravel()[path].min())) - (not self.clearance.exact))
        return max(0.0, min(self.clearance.comfort, cells * self.grid.cell))

    def clearance_along(self, points: Array) -> float:
        """Return the exact least distance, m, of a line from the squares of blocked cells; at most `comfort`.

        Unknown cells count unless routes may cross them, and so does all outside of the grid.

        `points`: ends of its straight parts in order, x and y, (n, 2) m, frame map, n at least 1.
        """
        (x0, y0), cell = self.grid.origin, self.grid.cell
        along = (self.grid.aligned(x, y) for x, y in points.tolist())
        padded = [((y - y0) / cell + 1.0, (x - x0) / cell + 1.0) for x, y in along]
        return min(self.clearance.comfort, cell * gap(self.wall, padded, self.clearance.comfort / cell))


def prepare(grid: FloorGrid, clearance: Clearance | None = None, *, lasting: bool = True) -> Costs:
    """Return the costs of walking over the cells of a grid.

    A cell may be entered if d >= radius, and then costs `dearest` at the radius, 1 at `comfort`, and linearly between.
    d is its distance from the nearest obstacle, m, see `Clearance.exact`. A step between two such cells is nowhere
    closer than these and, over a corner, the two cells beside it.

    Args:
        grid: occupancy of the floor.
        clearance: distances from obstacles; None = the defaults.
        lasting: True = many routes will be planned, so that a large map gets marks (stored costs); False: it gets none.

    Raises:
        Refusal: `comfort` is more than `WIDEST` = 200 cells.
    """
    clearance = clearance or Clearance()
    most = math.ceil(clearance.comfort / grid.cell + 0.5)
    if clearance.comfort > WIDEST * grid.cell:
        allowed = f"{WIDEST} cells, {WIDEST * grid.cell:g} m"
        raise Refusal("bad_clearance", f"comfort is at most {allowed}, got {clearance.comfort!r}", "comfort")
    wall = grid.cells >= clearance.obstacle
    if not clearance.through_unknown:
        wall |= grid.cells < 0
    distance2 = squared_distance(np.pad(wall, 1, constant_values=True), most, int(clearance.exact))
    weight = _table(clearance, grid.cell, most).take(distance2)
    _mark_even(weight)
    region = regions(weight)
    size = np.bincount(region.ravel())
    size[0] = 0
    largest = int(size.argmax())
    many = MARKS if lasting and size[largest] >= LARGE else 0
    marks = np.empty((weight.size, many), dtype=np.int32)
    cost, far = np.empty(weight.size, dtype=np.int32), int((region.ravel() == largest).argmax())
    least = np.full(weight.size, astar.UNSEEN, dtype=np.int32)
    for i in range(-1, many) if many else ():  # the first is only to find the one farthest from it
        astar.search(weight, far, astar.NOWHERE, marks[:, :0], cost)
        found = np.where(cost < 0, -cost - 1, 0)
        if i >= 0:
            marks[:, i] = found
            np.minimum(least, found, out=least)
        far = int((found if i < 0 else least).argmax())
    return Costs(grid, clearance, weight, region, distance2, marks, largest)


def _table(clearance: Clearance, cell: float, most: int) -> Bytes:
    """Return the weight (4 far from obstacles, more near them, 0 = not to be entered) by distance2.

    Args:
        clearance: distances from obstacles, m.
        cell: edge of a cell, m.
        most: largest number of cells from an obstacle that counts; the result has (2 most + 2)^2 + 1 elements.
    """
    halves = np.sqrt(np.arange((2 * most + 2) ** 2 + 1)) - (not clearance.exact)
    d, span = 0.5 * halves * cell, clearance.comfort - clearance.radius
    near = np.clip((clearance.comfort - d) / span, 0.0, 1.0) if span > 0.0 else 0.0
    table = np.rint(UNIT * (1.0 + (clearance.dearest - 1.0) * near)).astype(np.uint8)
    blocked = d < clearance.radius - 1e-9
    blocked[0] = True  # an obstacle, for a robot without a radius too
    return np.where(blocked, np.uint8(0), table)


def _mark_even(weight: Bytes) -> None:
    """Set bit 128 of the free cells that weigh the same as all eight neighbours; `weight` is changed in place.

    `weight`: cost factor of each cell, 0 = blocked, padded by a frame of zeros, (rows + 2, cols + 2).
    """
    inner = weight[1:-1, 1:-1]
    (rows, cols), even = inner.shape, inner > 0
    for r in range(3):
        for c in range(3):
            even &= weight[r : r + rows, c : c + cols] == inner
    inner |= even * np.uint8(EVEN)


@row_kernel
def squared_distance(wall: Flags, most: int, square: int) -> Ints32:
    """Return the squared distance of every cell centre from the nearest wall, half cells^2, (rows, cols).

    It is exact up to `most` - 1/2 cells, then constant. A wall n cells away along an axis is e(n) = 2 n - square half
    cells away, e(0) = 0: d^2(r, c) = min over k of e(|k - c|)^2 + e(down(r, k))^2, with down(r, k) the number of cells
    from (r, k) to the nearest wall in its column.

    Args:
        wall: True where a cell is blocked, (rows, cols).
        most: largest number of cells along an axis that counts.
        square: 1 = distance from the square of the wall's cell, 0 = from its centre.
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
            halves = max(0, 2 * down[r, c] - square)
            down[r, c] = out[r, c] = halves * halves
        for k in range(1, most + 1):
            e2 = (2 * k - square) * (2 * k - square)
            for c in range(cols - k):
                out[r, c] = min(out[r, c], down[r, c + k] + e2)
            for c in range(k, cols):
                out[r, c] = min(out[r, c], down[r, c - k] + e2)
    return out


@row_kernel
def root(parent: Ints32, i: int) -> int:
    """Return the label that represents all labels joined with label i, and shorten the chain to it, in place.

    `parent`: of each label, the label it was joined to, itself if none, (labels,).
    """
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@row_kernel
def regions(weight: Bytes) -> Ints32:
    """Return the number of the connected region of every free cell, from 1 on, 0 = blocked, (rows, cols).

    Neighbours share an edge: a diagonal step needs both cells beside it, so it connects nothing that edges do not.
    `weight`: cost factor of each cell, no unit, (rows, cols); 0 = not to be entered, as all cells at the border.
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
                parent[used] = label[r, c] = used
            elif left == 0 or under == 0 or left == under:
                label[r, c] = max(left, under)
            else:
                a, b = root(parent, left), root(parent, under)
                parent[max(a, b)] = label[r, c] = min(a, b)
    count = 0
    for i in range(1, used + 1):  # a parent has the smaller label: by now it is the number of its region
        count += parent[i] == i
        parent[i] = count if parent[i] == i else parent[parent[i]]
    for r in range(1, rows - 1):
        for c in range(1, cols - 1):
            label[r, c] = parent[label[r, c]]
    return label


@row_kernel
def nearest_free(free: Flags, row: float, col: float) -> tuple[int, int, float]:
    """Return row, column and distance, in cells, of the free cell nearest to a place.

    Args:
        free: True where a cell may be taken, (rows, cols).
        row: row of the place, in cells; whole at the centre of a cell.
        col: column of the place, in cells; whole at the centre of a cell.

    Returns:
        Row, column (0, 0 if there is none), distance in cells (inf if there is none).
    """
    best, best_r, best_c = math.inf, 0, 0
    for r in range(free.shape[0]):
        dr = (r - row) * (r - row)
        if dr >= best:
            continue
        for c in range(free.shape[1]):
            d = dr + (c - col) * (c - col)
            if free[r, c] and d < best:
                best, best_r, best_c = d, r, c
    return best_r, best_c, math.sqrt(best)
