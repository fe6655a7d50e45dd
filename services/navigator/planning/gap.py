"""Exact distance of a route from obstacles: of its straight legs from the squares of the occupied cells."""

import math
from itertools import pairwise

import numpy as np

from surefoot.arrays import Array, Flags

from .grid import Point

PIECE = 64
"""Largest extent, in cells, of the part of a leg that is compared with the cells around it at once."""


def gap(wall: Flags, points: list[Point], most: float) -> float:
    """Return the least distance of a line through points from the squares of the occupied cells, in cells.

    Args:
        wall: True where a cell is occupied, (rows, cols); cell [i, j] reaches from row i to i + 1 and column j to
            j + 1.
        points: ends of the line's legs in order, at least one, row and column in cells.
        most: largest distance that counts, in cells; it is returned where no obstacle is nearer.

    Returns:
        Distance from 0 (the line touches or crosses an obstacle) to `most`, in cells.
    """
    least = most
    for (r0, c0), (r1, c1) in pairwise([points[0], *points]):
        pieces = max(1, math.ceil(max(abs(r1 - r0), abs(c1 - c0)) / PIECE))
        step_r, step_c = (r1 - r0) / pieces, (c1 - c0) / pieces
        for k in range(pieces):
            a = (r0 + k * step_r, c0 + k * step_c)
            least = min(least, _of_piece(wall, a, (a[0] + step_r, a[1] + step_c), least))
    return least


def _of_piece(wall: Flags, a: Point, b: Point, most: float) -> float:
    """Return the least distance of the line from a to b (row, column) from an occupied cell, in cells, up to `most`."""
    first = [max(0, math.floor(min(a[i], b[i]) - most)) for i in range(2)]
    last = [max(0, math.ceil(max(a[i], b[i]) + most)) for i in range(2)]
    rows, cols = np.nonzero(wall[first[0] : last[0], first[1] : last[1]])
    if not rows.size:
        return most
    r, c = rows.astype(np.float64) + (first[0] + 0.5), cols.astype(np.float64) + (first[1] + 0.5)  # centres
    corners = [_to_line(r + dr, c + dc, a, b) for dr in (-0.5, 0.5) for dc in (-0.5, 0.5)]
    apart = np.minimum.reduce([_to_square(r - a[0], c - a[1]), _to_square(r - b[0], c - b[1]), *corners])
    return min(most, float(np.where(meets(r, c, a, b), 0.0, apart).min()))


def meets(r: Array, c: Array, a: Point, b: Point, half: float = 0.5) -> Flags:
    """Return True for each square that the line from a to b (row, column) touches, (n,).

    `r`, `c`: row and column of the squares' centres, (n,); `half`: half of their edge, in cells.
    """
    along_r, along_c = 0.5 * (b[0] - a[0]), 0.5 * (b[1] - a[1])
    dr, dc = r - 0.5 * (a[0] + b[0]), c - 0.5 * (a[1] + b[1])
    met = (np.abs(dr) <= half + abs(along_r)) & (np.abs(dc) <= half + abs(along_c))
    return met & (np.abs(dr * along_c - dc * along_r) <= half * (abs(along_r) + abs(along_c)))


def _to_square(dr: Array, dc: Array) -> Array:
    """Return the distance of a point from squares of edge 1 whose centres lie dr and dc from it, in cells, (n,)."""
    return np.hypot(np.maximum(np.abs(dr) - 0.5, 0.0), np.maximum(np.abs(dc) - 0.5, 0.0))


def _to_line(r: Array, c: Array, a: Point, b: Point) -> Array:
    """Return the distance of points (row r, column c) from the line from a to b (row, column), in cells, (n,)."""
    dr, dc = b[0] - a[0], b[1] - a[1]
    squared = dr * dr + dc * dc
    share = np.clip(((r - a[0]) * dr + (c - a[1]) * dc) / squared, 0.0, 1.0) if squared > 0.0 else np.zeros_like(r)
    return np.hypot(r - a[0] - share * dr, c - a[1] - share * dc)
