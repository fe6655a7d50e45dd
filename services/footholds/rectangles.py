"""Convex regions of free ground: the largest rectangle of free cells that holds a foothold."""

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.heightmap import HeightMap


def largest_rectangle(free: NDArray[np.bool_], row: int, col: int) -> tuple[int, int, int, int]:
    """Return first and last row, first and last column of the largest rectangle of free cells that holds a free cell.

    Args:
        free: True for cells that may be stepped on, (ny, nx) bool.
        row: row of the cell that the rectangle holds.
        col: column of that cell.
    """
    best, area = (row, row, col, col), 0
    above = free[row].copy()
    for top in range(row, -1, -1):
        above &= free[top]
        if not above[col]:
            break
        open_ = above.copy()
        for bottom in range(row, free.shape[0]):
            open_ &= free[bottom]
            if not open_[col]:
                break
            left = int(np.flatnonzero(~open_[:col])[-1]) + 1 if not open_[:col].all() else 0
            right = col + int(np.flatnonzero(~open_[col:])[0]) - 1 if not open_[col:].all() else len(open_) - 1
            size = (bottom - top + 1) * (right - left + 1)
            if size > area:
                best, area = (top, bottom, left, right), size
    return best


def in_metres(surface: HeightMap, cells: tuple[int, int, int, int]) -> tuple[float, float, float, float]:
    """Return x_min, y_min, x_max, y_max, m, map frame, of a rectangle, between the centres of its outermost cells.

    `cells`: first and last row, first and last column; `surface`: map that they belong to.
    """
    top, bottom, left, right = cells
    return (*surface.centre(top, left), *surface.centre(bottom, right))
