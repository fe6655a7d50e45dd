"""The height map: ground heights on a grid, as used in code, in messages and in files.

`z[row, col]` is the height of the ground in metres over the CENTRE of cell (row, col); row runs along y, column
along x, row 0 is y-min; `origin` is the centre of cell [0, 0] in frame `map`; NaN is unknown. The cell centres are
the vertices of a MuJoCo height field, so both describe the same surface. Between the centres the surface is
bilinear; the outermost half cell continues the border value.
"""

import hashlib
import math
from base64 import b64decode
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, Self, cast, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surefoot.arguments import NO_NUMBERS, array, choice, number, shown, whole
from surefoot.errors import FieldError, InvalidField
from surefoot.geometry import heightmap_cells as cells

FRAME = "map"
SMALLEST_CELL, WIDEST_CELL = 1e-6, 1e3
"""`SMALLEST_CELL`: smallest allowed edge of a map's cell, m; `WIDEST_CELL`: largest one, m; other maps are refused."""
MAX_CELLS = 16_000_000
"""Largest allowed number of cells of a map (4000 x 4000, 64 MB); a larger map is refused."""

LARGEST_PATCH, WIDEST_BALL = 3999, 500
"""`LARGEST_PATCH`: largest number of cells along an edge of a patch of a map, which is odd; `WIDEST_BALL`: largest
radius of a sphere on the ground, cells; larger ones are refused."""

Interpolation = Literal["bilinear", "nearest"]
"""Ways by which a height between the centres of cells is computed."""

FLOATS: tuple[type[Any], ...] = (float, np.floating)
"""Types that count as floating-point numbers when fields of a map are checked."""


def _integer(value: Any) -> Any:
    """Return a float that is a whole number as an integer, and anything else as it is."""
    return int(value) if isinstance(value, FLOATS) and float(value).is_integer() else value


class HeightMapError(InvalidField):
    """Error of data from which no height map can be made; `field` names the wrong part."""


@dataclass(frozen=True, eq=False)
class HeightMap:
    """Ground heights on a regular grid in frame `map`; immutable.

    Args:
        z: heights, (ny, nx) m, row 0 = y-min, NaN = unknown.
        cell: edge of a cell, m.
        origin: x and y of the centre of cell [0, 0], m, frame `map`.
        version: number that rises with every change of the heights.

    Raises:
        HeightMapError: a shape, size or number that is not allowed; names the field.
    """

    z: NDArray[np.float32]
    """Heights, (ny, nx), m, NaN = unknown, row 0 = y-min; stored as a read-only contiguous copy."""
    cell: float
    """Edge of a cell of the map, m."""
    origin: tuple[float, float] = (0.0, 0.0)
    """x and y of the centre of cell [0, 0], m, frame `map`."""
    version: int = 0
    """Version number of the heights, which the map's owner raises with every change."""

    def __post_init__(self) -> None:
        z: NDArray[np.float32] = self._numbers("z", self.z)
        if z.ndim != 2 or z.size == 0 or z.size > MAX_CELLS:
            raise HeightMapError("z", f"a map has 2 dimensions and 1 to {MAX_CELLS} cells, got shape {z.shape}")
        if np.isinf(z).any():
            raise HeightMapError("z", "heights must be finite, or NaN where unknown; got infinity")
        try:
            cell = number(self.cell, "cell", "m", low=SMALLEST_CELL, high=WIDEST_CELL)
            x, y = array(self.origin, "origin", (2,), "m").tolist()
            version = whole(_integer(self.version), "version", low=0)
        except FieldError as error:
            raise HeightMapError(error.field, error.message) from None
        z.flags.writeable = False
        object.__setattr__(self, "z", z)
        object.__setattr__(self, "cell", cell)
        object.__setattr__(self, "origin", (x, y))
        object.__setattr__(self, "version", version)

    @staticmethod
    def _numbers(name: str, value: Any) -> NDArray[np.float32]:
        """Return a copy of a field as float32 of its shape, NaN where masked (raises HeightMapError: no numbers)."""
        try:
            if np.iscomplexobj(value):
                raise TypeError("complex")
            if np.ma.is_masked(value):
                value = np.ma.filled(value.astype(np.float64), np.nan)
            with np.errstate(over="ignore"):  # what overflows is infinite, and refused as such
                return np.array(value, dtype=np.float32, order="C", copy=True)
        except (TypeError, ValueError, OverflowError):
            raise HeightMapError(name, f"got {shown(value)}, expected numbers in m") from None

    @staticmethod
    def _places(value: Any, field: str) -> NDArray[np.float64]:
        """Return coordinates, m, as an array of their shape (raises HeightMapError: no numbers)."""
        try:
            if value is None or np.asarray(value).dtype.kind in NO_NUMBERS:
                raise TypeError("none, complex, text or times")
            return np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            raise HeightMapError(field, f"got {shown(value)}, expected numbers in m") from None

    @staticmethod
    def _argument(check: Callable[..., Any], value: Any, *wanted: Any, **limits: Any) -> Any:
        """Return an argument after a check of `surefoot.arguments` with what it wants (raises HeightMapError)."""
        try:
            return check(value, *wanted, **limits)
        except FieldError as error:
            raise HeightMapError(error.field, error.message) from None

    # --- geometry -----------------------------------------------------------------------------------------------

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows (along y) and columns (along x), (ny, nx)."""
        return (self.z.shape[0], self.z.shape[1])

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """x_min, y_min, x_max, y_max of the outermost cell CENTRES, m, frame `map`."""
        ny, nx = self.shape
        x0, y0 = self.origin
        return (x0, y0, x0 + (nx - 1) * self.cell, y0 + (ny - 1) * self.cell)

    def index(self, x: float, y: float) -> tuple[int, int]:
        """Return (row, col) of the cell that holds the point (x, y), m, frame `map`; it may lie outside the map.

        Raises:
            HeightMapError: x or y is no finite number.
        """
        try:
            return (self._nearest(y, self.origin[1]), self._nearest(x, self.origin[0]))
        except (TypeError, ValueError, OverflowError):
            self._argument(number, x, "x", "m")
            self._argument(number, y, "y", "m")
            raise

    def inside(self, row: int, col: int) -> bool:
        """Return True if the cell (row, col) belongs to the map (raises HeightMapError: no whole numbers)."""
        self._check_cell(row, col)
        return 0 <= row < self.z.shape[0] and 0 <= col < self.z.shape[1]

    def centre(self, row: int, col: int) -> tuple[float, float]:
        """Return x, y of the centre of cell (row, col), m, frame `map`; the cell may lie outside the map.

        Raises:
            HeightMapError: row or col is no whole number.
        """
        self._check_cell(row, col)
        try:
            return (self.origin[0] + col * self.cell, self.origin[1] + row * self.cell)
        except OverflowError:
            self._argument(whole, row, "row")
            self._argument(whole, col, "col")
            raise

    def _check_cell(self, row: int, col: int) -> None:
        if type(row) is not int or type(col) is not int:  # these two need no check, and most are such
            self._argument(whole, row, "row")
            self._argument(whole, col, "col")

    def xs(self) -> NDArray[np.float64]:
        """Return x of the columns' centres, (nx,) m, frame `map`."""
        return self.origin[0] + self.cell * np.arange(self.z.shape[1], dtype=np.float64)

    def ys(self) -> NDArray[np.float64]:
        """Return y of the rows' centres, (ny,) m, frame `map`."""
        return self.origin[1] + self.cell * np.arange(self.z.shape[0], dtype=np.float64)

    def _nearest(self, value: float, start: float) -> int:
        """Return the index of the row or column nearest to a coordinate `value`, m; `start`: that of index 0, m."""
        return math.floor((value - start) / self.cell + 0.5)

    # --- heights ------------------------------------------------------------------------------------------------

    def height(self, x: ArrayLike, y: ArrayLike, method: Interpolation = "bilinear") -> NDArray[np.float64]:
        """Return heights of the ground at points, m; NaN outside the map, or where a cell used for one is unknown.

        Args:
            x: x of the points, any shape that broadcasts with y, m, frame `map`.
            y: y of the points, m, frame `map`.
            method: "bilinear" between the four nearest centres, or the "nearest" cell's own height.

        Returns:
            Array of the broadcast shape (zero-dimensional for scalars: `float()` it).

        Raises:
            FieldError: another method.
            HeightMapError: x or y are no numbers, or their shapes do not go together.
        """
        choice(method, "method", get_args(Interpolation))
        one, two = self._places(x, "x"), self._places(y, "y")
        try:
            xs, ys = np.broadcast_arrays(one, two)
        except ValueError:
            text = f"got x {one.shape} and y {two.shape}, expected shapes that go together"
            raise HeightMapError("x, y", text) from None
        out = np.empty(xs.shape, dtype=np.float64)
        cells.heights(self.z, self.cell, *self.origin, xs.ravel(), ys.ravel(), method == "bilinear", out.reshape(-1))
        return out

    def height_at(self, x: float, y: float) -> float:
        """Return the bilinear height of the ground at a point, m; NaN outside the map, or where a cell is unknown.

        `x`, `y`: the point, m, frame `map`.

        Raises:
            HeightMapError: x or y is no number.
        """
        try:
            return cells.bilinear(self.z, self.cell, self.origin[0], self.origin[1], float(x + 0.0), float(y + 0.0))
        except (TypeError, ValueError, OverflowError):
            for value, field in ((x, "x"), (y, "y")):
                self._places(value, field)
                self._argument(array, value, field, (), "m", nan=True, inf=True)
            return float(self.height(x, y))  # a number that is added to none, as Decimal

    def patch(self, x: float, y: float, n: int) -> NDArray[np.float32]:
        """Return a copy of the n x n heights about the cell that holds (x, y) m, n odd, (n, n) m, frame `map`.

        They are NaN outside the map, all of them where x or y is NaN or infinite.

        Raises:
            HeightMapError: n is no odd whole number from 1 to 3999; x or y is no number.
        """
        size = self._argument(whole, n, "n", low=1, high=LARGEST_PATCH)
        if size % 2 == 0:
            raise HeightMapError("n", f"a patch has an odd number of cells, got {n!r}")
        place = self._argument(array, (x, y), "x, y", (2,), "m", nan=True, inf=True)
        out = np.full((size, size), np.nan, dtype=np.float32)
        if np.isfinite(place).all():
            row, col = self.index(*place.tolist())
            if -size < row < self.shape[0] + size and -size < col < self.shape[1] + size:
                cells.patch(self.z, row - size // 2, col - size // 2, out)
        return out

    def dilated(self, radius: float) -> "HeightMap":
        """Return a map of the height at which the centre of a sphere (a foot) lies when the sphere rests on the ground.

        c[i, j] = max over cells n within `radius` of z_n + sqrt(radius^2 - d_n^2), z_n the height of cell n and d_n its
        distance from cell (i, j). Subtract `radius` for the lowest point of that sphere. Unknown neighbours are left
        out; a cell is NaN when it is itself unknown.

        Args:
            radius: of the sphere, m, at most 500 cells.

        Raises:
            HeightMapError: the radius is negative, not finite or longer.
        """
        radius = self._argument(number, radius, "radius", "m", low=0.0, high=WIDEST_BALL * self.cell)
        out = np.empty_like(self.z)
        self.dilate_part(radius, out, *self._whole)
        return self.derived(out)

    def smoothed(self, min_known: int = 6) -> "HeightMap":
        """Return the map with the noise of single cells filtered: the median of the known cells of 3 x 3 windows.

        Straight edges stay where they are. An unknown cell is filled when at least `min_known` of its 8 neighbours
        are known (a drop-out of the sensor); 9 fills none.

        Raises:
            HeightMapError: `min_known` is no whole number of 0 to 9.
        """
        min_known = self._argument(whole, min_known, "min_known", low=0, high=9)
        out = np.empty_like(self.z)
        cells.median3(self.z, min_known, self._whole, out)
        return self.derived(out)

    def smooth_part(self, out: NDArray[np.float32], row0: int, row1: int, col0: int, col1: int) -> None:
        """Write the map filtered by the median of the known cells of 3 x 3 windows into a part of `out`, (ny, nx) m.

        The part is rows row0 .. row1 - 1 and columns col0 .. col1 - 1. An unknown cell with 6 known neighbours is
        filled.
        """
        cells.median3(self.z, 6, (row0, row1, col0, col1), out)

    def dilate_part(self, radius: float, out: NDArray[np.float32], row0: int, row1: int, col0: int, col1: int) -> None:
        """Write the height of the centre of a sphere of `radius` m on the ground into a part of `out`, (ny, nx) m.

        The part is rows row0 .. row1 - 1 and columns col0 .. col1 - 1.
        """
        cells.dilate(self.z, cells.ball(radius, self.cell), (row0, row1, col0, col1), out)

    @property
    def _whole(self) -> cells.Part:
        """Return all cells as a part: first row, end of the rows, first column, end of the columns (ends excluded)."""
        return (0, self.z.shape[0], 0, self.z.shape[1])

    def derived(self, z: NDArray[np.float32]) -> "HeightMap":
        """Return a map of the same grid and version with heights z (rows, cols) m, which are not copied or checked."""
        made = object.__new__(HeightMap)
        z.flags.writeable = False
        for name, value in (("z", z), ("cell", self.cell), ("origin", self.origin), ("version", self.version)):
            object.__setattr__(made, name, value)
        return made

    def with_z(self, z: NDArray[np.float32], version: int | None = None) -> "HeightMap":
        """Return a map of the same grid with other heights z, (ny, nx) m; `version`: None keeps the present one.

        Raises:
            HeightMapError: z are no numbers or infinite, or have another shape; a version that is no whole number.
        """
        given = getattr(z, "shape", None)
        if given is None:
            given = self._numbers("z", z).shape
        if given != self.z.shape:
            raise HeightMapError("z", f"must keep the shape {self.z.shape}, got {given}")
        return replace(self, z=z, version=self.version if version is None else version)

    # --- wire and files -----------------------------------------------------------------------------------------

    @cached_property
    def sha256(self) -> str:
        """Return the sha256 of geometry and heights, hexadecimal; it does not depend on the version of the map."""
        head = f"{self.z.shape[0]} {self.z.shape[1]} {self.cell!r} {self.origin[0]!r} {self.origin[1]!r} "
        return hashlib.sha256(head.encode() + self.to_bytes()).hexdigest()

    def header(self) -> dict[str, Any]:
        """Return frame, shape, cell, origin and version as plain JSON values: the header of the payload."""
        ny, nx = self.shape
        return {
            "frame": FRAME,
            "rows": ny,
            "cols": nx,
            "cell": self.cell,
            "origin": [self.origin[0], self.origin[1]],
            "version": self.version,
        }

    def to_bytes(self) -> bytes:
        """Return the heights as little-endian float32, row by row from y-min, NaN = unknown; 4 ny nx bytes."""
        return self.z.astype("<f4", copy=False).tobytes()

    @classmethod
    def from_wire(cls, header: Mapping[str, Any], payload: bytes | bytearray | memoryview) -> Self:
        """Return the map made from a header and its payload of float32 heights, as `header` and `to_bytes` return them.

        Args:
            header: frame, rows, cols, cell (m), origin (x, y of the centre of cell [0, 0], m) and optionally version.
            payload: heights, little-endian float32, m, row by row from y-min, NaN = unknown.

        Raises:
            HeightMapError: a header field is absent or wrong, or the payload has another length.
        """
        try:
            frame, ny, nx = header["frame"], int(header["rows"]), int(header["cols"])
            origin = (float(header["origin"][0]), float(header["origin"][1]))
            cell, version = float(header["cell"]), int(header.get("version", 0))
        except KeyError as error:
            raise HeightMapError(str(error.args[0]), "absent from the header") from error
        except (TypeError, ValueError, IndexError) as error:
            raise HeightMapError("header", f"not a height-map header: {error}") from error
        if frame != FRAME:
            raise HeightMapError("frame", f"must be {FRAME!r}, got {frame!r}")
        if ny < 1 or nx < 1 or ny * nx > MAX_CELLS:
            raise HeightMapError("rows, cols", f"must be >= 1 with a product <= {MAX_CELLS}, got {ny} x {nx}")
        if len(payload) != 4 * ny * nx:
            raise HeightMapError("payload", f"{ny} x {nx} cells need {4 * ny * nx} bytes, got {len(payload)}")
        z = np.frombuffer(payload, dtype="<f4").reshape(ny, nx)
        return cls(z=cast("NDArray[np.float32]", z), cell=cell, origin=origin, version=version)

    @classmethod
    def from_base64(cls, header: Mapping[str, Any], text: str) -> Self:
        """Return the map made from a header and its float32 heights, row by row from y-min, in base64.

        Raises:
            HeightMapError: a header field is absent or wrong, the heights have another length, or the text is no
                base64.
        """
        try:
            payload = b64decode(text, validate=True)
        except ValueError as error:
            raise HeightMapError("heights", f"no base64: {error}") from None
        return cls.from_wire(header, payload)
