"""Slip where a foot may land: averaged over landings, and raised beside unknown ground.

The part of a foot's disc that lies on unknown cells counts as slip 1.
"""

from functools import lru_cache

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.heightmap_cells import patch
from surefoot.kernels.jit import kernel

from .features import Layer
from .ground import FootholdGround

PARTS = 16
"""Number of parts along an edge of a cell by which the part of a foot's disc on it is measured."""


@kernel
def average_landings(around: Layer, blur: Array, mean: Layer) -> None:
    """Write the mean of the slip P over landings where P is known (negative: unknown) into `mean` (r, c).

    `blur`: weights of the landings around a cell, (s, s); `around`: P with a border for them, (r + s - 1, c + s - 1).
    """
    size = blur.shape[0]
    for i in range(mean.shape[0]):
        for j in range(mean.shape[1]):
            p, known = 0.0, 0.0
            for r in range(size):
                for c in range(size):
                    near = around[i + r, j + c]
                    if near >= 0.0:
                        p += blur[r, c] * min(near, 1.0)
                        known += blur[r, c]
            mean[i, j] = p / known if known > 0.0 else around[i + size // 2, j + size // 2]


@lru_cache(maxsize=64)
def footprint(radius: float, cell: float) -> Array:
    """Return the part of a foot's disc that lies on each cell about the one at whose centre it stands, (n, n), sum 1.

    Args:
        radius: radius of the foot sphere, m.
        cell: edge of a cell, m.
    """
    reach = int(radius / cell + 0.5)
    n = 2 * reach + 1
    at = (np.arange(n * PARTS) + 0.5) / PARTS - (reach + 0.5)
    inside = np.add.outer(at * at, at * at) <= (radius / cell) ** 2
    parts = inside.reshape(n, PARTS, n, PARTS).sum(axis=(1, 3)).astype(np.float64)
    parts[reach, reach] += not parts.any()  # a foot smaller than a part of a cell
    return parts / float(parts.sum())


def add_unsupported(ground: FootholdGround, window: tuple[int, int, int, int], slip: Layer) -> None:
    """Count unknown ground under a foot as slip 1: raise the slip P of each cell to P + U (1 - P), in place.

    U is the part of the disc of a foot in the middle of the cell that lies on unknown cells or outside the map.

    Args:
        ground: layers of the map.
        window: first row, first column, rows and columns; may leave the map.
        slip: slip P per stroke, (rows, cols), no unit; negative = unknown, which stays.
    """
    row, col, rows, cols = window
    disc = footprint(ground.foot_radius, ground.surface.cell)
    b = disc.shape[0] // 2
    around = np.empty((rows + 2 * b, cols + 2 * b), dtype=np.float32)
    patch(ground.surface.z, row - b, col - b, around)
    _add(around, disc, slip)


@kernel
def _add(around: Layer, disc: Array, slip: Layer) -> None:
    """Raise `slip` (r, c) to P + U (1 - P), U the part of the `disc` (n, n) on unknown cells.

    `around`: heights, (r + n - 1, c + n - 1) m, NaN = unknown.
    """
    n = disc.shape[0]
    for i in range(slip.shape[0]):
        for j in range(slip.shape[1]):
            total = 0.0
            for r in range(n):
                for c in range(n):
                    if np.isnan(around[i + r, j + c]):
                        total += disc[r, c]
            if total > 0.0 and slip[i, j] >= 0.0:
                slip[i, j] += np.float32(total * (1.0 - min(float(slip[i, j]), 1.0)))
