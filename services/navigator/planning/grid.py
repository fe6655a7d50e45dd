"""Occupancy of the floor on a regular grid, for planning routes."""

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from surefoot.arguments import array, instance, number, shown, whole
from surefoot.arrays import Array
from surefoot.errors import FieldError, Refusal
from surefoot.geometry.heightmap import MAX_CELLS, SMALLEST_CELL, HeightMap

Cells = NDArray[np.int8]
Point = tuple[float, float]
"""x and y in m, frame map."""
Coordinate = TypeVar("Coordinate", float, Array)

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
MOST_TURNED = 6.3
"""Largest absolute yaw of a grid, rad; a larger one is refused, as probably in degrees."""
LARGEST_CELL = 10.0
"""Largest edge of a grid cell, m; larger ones are refused."""
STEP = 0.04
"""Height above or depth below the floor, m, beyond which ground is an obstacle: a biped lifts its feet less."""


class GridError(Refusal):
    """Error for an invalid occupancy grid; `field` names what is wrong with it."""


@dataclass(frozen=True, eq=False)
class FloorGrid:
    """Occupancy of the floor in frame `map`, as map_server publishes it; immutable.

    Rows and columns may be turned in frame `map`: indices and centres of cells account for it.

    Raises:
        GridError: no cells or too many, values outside -1 to 100, a cell size or an origin that cannot be.
    """

    cells: Cells
    """Occupancy of the cells in percent, (rows, cols), row 0 = least y: 0 free to 100 occupied, -1 unknown."""
    cell: float
    """Edge length of a cell, m."""
    origin: tuple[float, float] = (0.0, 0.0)
    """x, y of the lower-left corner of cell [0, 0], m, frame map."""
    source: str = ""
    """Origin of the grid, in words."""
    yaw: float = 0.0
    """Angle from the x axis of frame `map` to the rows of the grid, rad, about the corner `origin`, left positive."""

    def __post_init__(self) -> None:
        given = self.cells
        try:
            if getattr(given, "dtype", None) != np.int8:
                array(given, "cells", ("rows", "cols"), low=UNKNOWN, high=OCCUPIED)
            number(self.cell, "cell", "m", low=SMALLEST_CELL, high=LARGEST_CELL)
            x, y = array(self.origin, "origin", (2,), "m").tolist()
            number(self.yaw, "yaw", "rad", low=-MOST_TURNED, high=MOST_TURNED)
            instance(self.source, "source", str, "a text")
        except FieldError as error:
            raise GridError("bad_grid", str(error), error.field) from None
        cells = np.array(given, dtype=np.int8, order="C", copy=True)
        if cells.ndim != 2 or not 1 <= cells.size <= MAX_CELLS:
            text = f"cells: got shape {cells.shape}, a grid has 2 dimensions and 1 to {MAX_CELLS} cells"
            raise GridError("bad_grid", text, "cells")
        low, high = int(cells.min()), int(cells.max())
        if low < UNKNOWN or high > OCCUPIED:
            raise GridError("bad_grid", f"cells: got {low} to {high}, allowed are -1 (unknown), 0 to 100", "cells")
        cells.flags.writeable = False
        object.__setattr__(self, "cells", cells)
        object.__setattr__(self, "origin", (x, y))

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows (along y) and columns (along x)."""
        return (self.cells.shape[0], self.cells.shape[1])

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Least rectangle along the axes that holds the grid: x_min, y_min, x_max, y_max, m, frame map."""
        rows, cols = self.shape
        x, y = self.origin
        sides = (x, x + cols * self.cell), (y, y + rows * self.cell)
        corners = [self.turned(right, upper) for right in sides[0] for upper in sides[1]]
        (x0, x1), (y0, y1) = ((min(values), max(values)) for values in zip(*corners, strict=True))
        return (x0, y0, x1, y1)

    def turned(self, x: Coordinate, y: Coordinate) -> tuple[Coordinate, Coordinate]:
        """Return a point turned about the corner `origin` by `yaw`: from axes along rows and columns to frame map.

        `x`, `y`: m, numbers or arrays (n,), both in axes with the origin of frame map; with a yaw of 0 they are
        returned as they are.
        """
        return _about(self.origin, self.yaw, x, y)

    def aligned(self, x: Coordinate, y: Coordinate) -> tuple[Coordinate, Coordinate]:
        """Return a point of frame map, m, turned about the corner `origin` by -`yaw`, the inverse of `turned`.

        There rows and columns lie along x and y. `x`, `y`: m, numbers or arrays (n,); with a yaw of 0 they are
        returned as they are.
        """
        return _about(self.origin, -self.yaw, x, y)

    def index(self, x: float, y: float) -> tuple[int, int]:
        """Return (row, col) of the cell that holds a point x, y (m, frame map); it may lie outside of the grid.

        Raises:
            FieldError: x or y is no finite number.
        """
        try:
            ahead, left = self.aligned(x, y)
            return (math.floor((left - self.origin[1]) / self.cell), math.floor((ahead - self.origin[0]) / self.cell))
        except (TypeError, ValueError, OverflowError):
            number(x, "x", "m")
            number(y, "y", "m")
            raise

    def inside(self, row: int, col: int) -> bool:
        """Return True if a cell (row, col) lies inside the grid (raises FieldError: no whole numbers)."""
        _check_cell(row, col)
        return 0 <= row < self.cells.shape[0] and 0 <= col < self.cells.shape[1]

    def centre(self, row: int, col: int) -> tuple[float, float]:
        """Return x, y of the centre of a cell, m, frame map (raises FieldError: no whole numbers)."""
        _check_cell(row, col)
        return self.turned(self.origin[0] + (col + 0.5) * self.cell, self.origin[1] + (row + 0.5) * self.cell)

    def to_bytes(self) -> bytes:
        """Return the cells as int8 (0 free to 100 occupied, -1 unknown), row by row from y-min."""
        return self.cells.tobytes()

    @classmethod
    def from_bytes(
        cls, data: bytes, rows: int, cols: int, cell: float, origin: tuple[float, float], source: str = "",
        yaw: float = 0.0,
    ) -> "FloorGrid":  # fmt: skip
        """Return the grid of occupancy as bytes.

        Args:
            data: int8, 0 free to 100 occupied, -1 unknown, row by row from y-min.
            rows: number of cells along y.
            cols: number of cells along x.
            cell: edge of a cell, m.
            origin: x, y of the lower-left corner of cell [0, 0], m, frame map.
            source: origin of the grid, in words.
            yaw: angle from the x axis of frame map to the rows, rad, as in the field of that name.

        Raises:
            GridError: too few bytes or too many, or values that are no grid.
        """
        if not isinstance(data, bytes | bytearray | memoryview):
            raise GridError("bad_grid", f"data: got {shown(data)}, expected bytes", "data")
        try:
            rows, cols = whole(rows, "rows"), whole(cols, "cols")
        except FieldError as error:
            raise GridError("bad_grid", str(error), error.field) from None
        if rows < 1 or cols < 1 or len(data) != rows * cols:
            raise GridError("bad_grid", f"{rows} x {cols} cells need {rows * cols} bytes, got {len(data)}", "data")
        return cls(np.frombuffer(data, dtype=np.int8).reshape(rows, cols), cell, origin, source, yaw)


def _check_cell(row: int, col: int) -> None:
    if type(row) is not int or type(col) is not int:  # these two need no check, and most are such
        whole(row, "row")
        whole(col, "col")


def _about(origin: Point, angle: float, x: Coordinate, y: Coordinate) -> tuple[Coordinate, Coordinate]:
    """Return a point x, y (m, numbers or arrays) turned about `origin`, m, by `angle`, rad, left positive."""
    if angle == 0.0:
        return (x, y)
    c, s, dx, dy = math.cos(angle), math.sin(angle), x - origin[0], y - origin[1]
    return (origin[0] + c * dx - s * dy, origin[1] + s * dx + c * dy)


def grid_of(ground: HeightMap) -> FloorGrid:
    """Return the occupancy of a height map: ground more than 4 cm above or below the median height is occupied.

    Cells without a height are unknown.

    Raises:
        GridError: no height is known.
    """
    z, known = ground.z.astype(np.float64), ~np.isnan(ground.z)
    if not known.any():
        raise GridError("bad_grid", "the height map has no known cell", "cells")
    cells = np.full(z.shape, UNKNOWN, dtype=np.int8)
    cells[known] = np.where(np.abs(z[known] - float(np.median(z[known]))) > STEP, OCCUPIED, FREE)
    half = 0.5 * ground.cell
    return FloorGrid(cells, ground.cell, (ground.origin[0] - half, ground.origin[1] - half), "terrain/map")
