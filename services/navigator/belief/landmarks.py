"""Map of landmarks on the floor: position and descriptor of each, and an index of the positions."""

import hashlib
import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from surefoot.arrays import Array, Ints
from surefoot.errors import Refusal

from .gate import MapTables

MOST_LANDMARKS = 100_000
LONGEST_DESCRIPTOR = 256
FARTHEST = 1e5
"""Largest coordinate of a landmark, m; a larger one is refused, as float32 no longer resolves a centimetre there."""
SMALLEST_SPREAD = 0.01
"""Least extent of a landmark map, m; a smaller one is refused, as landmarks in one point determine no heading."""
PER_BUCKET = 4.0
"""Mean number of landmarks in a cell of the grid that indexes their positions."""


class LandmarkMapError(Refusal):
    """Error for a landmark map that cannot be used; `field` names what is wrong with it."""


@dataclass(frozen=True, eq=False)
class FloorLandmarks:
    """Map of the landmarks on the floor by which a camera finds the robot's place, in frame map; immutable.

    Raises:
        LandmarkMapError: no landmarks or too many, arrays that do not fit each other, values that are not finite, all
            landmarks in one point.
    """

    positions: Array
    """Positions of the landmarks on the floor, (n, 2) m, frame map."""
    descriptors: Array
    """Descriptors (k numbers that describe how a landmark looks) of the landmarks, (n, k), no unit."""
    version: int = 0
    """Version number of the map; it rises with every change of content."""
    source: str = ""
    """Origin of the map, in words."""
    sd: Array = field(default_factory=lambda: np.zeros(0))
    """Standard deviation of each landmark's position along one axis, (n,) m; empty = the positions are exact."""

    def __post_init__(self) -> None:
        positions = np.array(self.positions, dtype=np.float64, order="C", copy=True)
        descriptors = np.array(self.descriptors, dtype=np.float64, order="C", copy=True)
        _check(positions, descriptors)
        sd = np.array(self.sd if len(self.sd) else np.zeros(len(positions)), dtype=np.float64, copy=True)
        if sd.shape != (len(positions),) or not (np.isfinite(sd) & (sd >= 0.0)).all():
            text = f"a finite standard deviation >= 0 for each of {len(positions)} landmarks, got shape {sd.shape}"
            raise LandmarkMapError("bad_map", text, "sd")
        positions.flags.writeable = descriptors.flags.writeable = sd.flags.writeable = False
        object.__setattr__(self, "sd", sd)
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "descriptors", descriptors)

    def __len__(self) -> int:
        return self.positions.shape[0]

    @property
    def descriptor_length(self) -> int:
        """Number of elements of a descriptor."""
        return self.descriptors.shape[1]

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Extent of the landmarks: x_min, y_min, x_max, y_max, m, frame map."""
        low, high = self.positions.min(axis=0), self.positions.max(axis=0)
        return (float(low[0]), float(low[1]), float(high[0]), float(high[1]))

    @property
    def area(self) -> float:
        """Area of the rectangle that holds all landmarks, m^2, at least 1e-4 m^2."""
        x0, y0, x1, y1 = self.bounds
        return max((x1 - x0) * (y1 - y0), SMALLEST_SPREAD**2)

    @cached_property
    def tables(self) -> MapTables:
        """Landmarks with a grid of cells that lists which lie in each, as arrays for kernels."""
        return MapTables(self.positions, self.descriptors, *_sorted_by_place(self.positions))

    @cached_property
    def columns(self) -> Array:
        """Descriptors of the landmarks, transposed, (k, n), no unit."""
        return np.ascontiguousarray(self.descriptors.T)

    @cached_property
    def sha256(self) -> str:
        """SHA-256 digest of positions and descriptors; version and source do not count."""
        return hashlib.sha256(f"{self.descriptors.shape} ".encode() + self.to_bytes()).hexdigest()

    def to_bytes(self) -> bytes:
        """Return rows (x, y in m, then the k numbers of the descriptor) of little-endian float32: 4 n (2 + k) bytes."""
        return np.hstack((self.positions, self.descriptors)).astype("<f4").tobytes()

    @classmethod
    def from_bytes(cls, data: bytes, count: int, length: int, version: int = 0, source: str = "") -> "FloorLandmarks":
        """Return the landmark map of rows of float32, one per landmark: x, y in m, frame map, then its descriptor.

        Args:
            data: the rows, little-endian, one after the other.
            count: number of landmarks.
            length: elements of a descriptor.
            version: version of the map.
            source: origin of the map, in words.

        Raises:
            LandmarkMapError: another number of bytes, or content that is no map.
        """
        expected = 4 * count * (2 + length)
        if len(data) != expected:
            raise LandmarkMapError(
                "bad_map", f"{count} landmarks with {length} numbers need {expected} bytes, got {len(data)}", "data"
            )
        rows = np.frombuffer(data, dtype="<f4").reshape(count, 2 + length).astype(np.float64)
        return cls(rows[:, :2], rows[:, 2:], version, source)


def _check(positions: Array, descriptors: Array) -> None:
    if positions.ndim != 2 or positions.shape[1] != 2:
        raise LandmarkMapError("bad_map", f"positions are (n, 2), got {positions.shape}", "positions")
    n = positions.shape[0]
    if not 2 <= n <= MOST_LANDMARKS:
        raise LandmarkMapError("bad_map", f"a map has 2 to {MOST_LANDMARKS} landmarks, got {n}", "positions")
    if descriptors.ndim != 2 or descriptors.shape[0] != n or not 1 <= descriptors.shape[1] <= LONGEST_DESCRIPTOR:
        allowed = f"({n}, 1 to {LONGEST_DESCRIPTOR})"
        raise LandmarkMapError("bad_map", f"descriptors are {allowed}, got {descriptors.shape}", "descriptors")
    for name, values in (("positions", positions), ("descriptors", descriptors)):
        bad = ~np.isfinite(values).all(axis=1)
        if bad.any():
            first = int(np.flatnonzero(bad)[0])
            shown = values[first, :4].tolist()
            raise LandmarkMapError("bad_map", f"landmark {first} is not finite: {shown}", name)
    farthest = float(np.abs(positions).max())
    if farthest > FARTHEST:
        raise LandmarkMapError("bad_map", f"coordinates are within {FARTHEST:g} m, got {farthest:g} m", "positions")
    spread = float((positions.max(axis=0) - positions.min(axis=0)).max())
    if spread < SMALLEST_SPREAD:
        where = f"({positions[0, 0]:g}, {positions[0, 1]:g})"
        text = f"all {n} landmarks are within {spread:.2g} m of {where}, a map extends over {SMALLEST_SPREAD} m or more"
        raise LandmarkMapError("bad_map", text, "positions")


def _sorted_by_place(positions: Array) -> tuple[Array, Ints, Ints]:
    """Return an index of landmarks by the square cells of a grid that they lie in.

    Args:
        positions: positions of the landmarks, (n, 2) m, frame map.

    Returns:
        x and y of the grid's corner, m, edge of a cell, m, rows, columns, (5,); first member of each cell, (rows *
        columns + 1,); members: landmarks cell by cell, (n,).
    """
    n = positions.shape[0]
    low, size = positions.min(axis=0), np.ptp(positions, axis=0)
    edge = max(
        math.sqrt(PER_BUCKET * max(float(size[0] * size[1]), 1e-6) / n), float(size.max()) * PER_BUCKET / n, 0.02
    )
    rows, cols = int(size[1] / edge) + 1, int(size[0] / edge) + 1
    cell = np.floor((positions - low) / edge).astype(np.int64)
    number = cell[:, 1] * cols + cell[:, 0]
    starts = np.zeros(rows * cols + 1, dtype=np.int64)
    np.cumsum(np.bincount(number, minlength=rows * cols), out=starts[1:])
    members = np.argsort(number, kind="stable").astype(np.int64)
    return np.array([low[0], low[1], edge, rows, cols], dtype=np.float64), starts, members
