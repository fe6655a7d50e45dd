"""Turn of a depth camera that was knocked aside, and scale of its depths, found by fitting its points to the map.

A point p at a = p - c from the camera c lies e above the map, whose slope there is g. A small turn w about the level
axes through the camera changes that by w . J, so that each step of Gauss and Newton is

    w = -(sum k J J^T)^-1 sum k J e,   J = (a_y + g_y a_z, -a_x - g_x a_z),   k = 1 / (1 + (e / s)^2),

with s of the size of the residuals e, so that new objects on the ground count little. As long as the points lie far
from their true places the slopes there are of no use: the first steps set them to 0. A turn about the vertical is not
estimated: level ground does not show it. A scale x of the depths is estimated likewise, x -= sum k J e / sum k J J with
J = a_z - g . (a_x, a_y).
"""

from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.linear import product
from surefoot.geometry.rotations import matrix_from_rotvec

from .elevation import Grid

STEPS = 12
"""Number of Gauss-Newton steps of a fit; in the first half of them the slopes of the map are taken for 0."""
MOST_POINTS = 1000
"""Approximate number of points, evenly over the image, that a fit uses; a fit takes 4 ms."""
SPAN = 4
"""Number of cells on each side of a cell over which its slope is measured; over fewer, noise of the map dominates."""
LEAST_SIZE = 0.002
"""Least residual of a point, m, from which on its weight in a fit is below one half."""
LEAST_SCALE = 0.5
"""Least scale factor of the depths that a fit may return; the largest is its inverse."""


class CameraError(NamedTuple):
    """Estimated error of a depth camera: turn from its stated orientation, and scale of its depths."""

    turn: Array
    """Rotation from the stated rays of the camera to the true ones, (3, 3), axes of base_link."""
    scale: float
    """Ratio of the camera's depths to the true ones, no unit."""


class _Residuals(NamedTuple):
    """Ground points of one image with their heights over the map and the slopes of the map below them."""

    arm: Array
    """Vectors from the camera to the points, (n, 3) m, axes of the map."""
    slope: Array
    """Slopes of the map below the points along x and y, (n, 2), no unit."""
    off: Array
    """Heights of the points above the map, (n,) m."""
    weight: Array
    """Weight of each point in the fit, (n,), 0 to 1."""


def _residuals(height: Array, grid: Grid, arm: Array, camera: Array, level: bool) -> _Residuals:
    """Return the residuals of a camera's points over the cells of the map that are known.

    Args:
        height: heights of the map, (ny, nx) m, NaN = unknown.
        grid: place of its cells.
        arm: vectors from the camera to the points, (n, 3) m, axes of the map.
        camera: position of the camera, (3,) m, frame of the map.
        level: True takes the slopes of the map for 0, False measures them.
    """
    ny, nx = height.shape
    x, y = ((arm + camera)[:, :2] / grid.cell - (grid.col, grid.row)).T
    rows, cols = np.floor(y + 0.5).astype(np.int64), np.floor(x + 0.5).astype(np.int64)
    inside = (np.minimum(rows, cols) >= SPAN) & (rows < ny - SPAN) & (cols < nx - SPAN)
    a, rows, cols = arm[inside], rows[inside], cols[inside]
    gx = np.nan_to_num(height[rows, cols + SPAN] - height[rows, cols - SPAN]) / (2 * SPAN * grid.cell)
    gy = np.nan_to_num(height[rows + SPAN, cols] - height[rows - SPAN, cols]) / (2 * SPAN * grid.cell)
    off = a[:, 2] + camera[2] - height[rows, cols]
    if level:
        gx, gy = np.zeros_like(gx), np.zeros_like(gy)
    else:
        off = off - grid.cell * (gx * (x[inside] - cols) + gy * (y[inside] - rows))
    known = np.isfinite(off)
    a, off, slope = a[known], off[known], np.stack((gx[known], gy[known]), 1)
    size = max(1.5 * float(np.sort(np.abs(off))[off.size // 2]), LEAST_SIZE) if off.size else LEAST_SIZE
    return _Residuals(a, slope, off, 1.0 / (1.0 + (off / size) ** 2))


def turn_onto(height: Array, grid: Grid, place: Array, camera: Array) -> Array:
    """Return the rotation (3, 3), axes of the map, about a camera by which its points fit a height map best.

    Args:
        height: heights of the map, (ny, nx) m, NaN = unknown.
        grid: place of its cells.
        place: points that the camera shows, (n, 3) m, frame of the map.
        camera: place of the camera, (3,) m, frame of the map.
    """
    arm, rot = place[:: 1 + len(place) // MOST_POINTS] - camera, np.eye(3)
    for step in range(STEPS):
        a, g, off, share = _residuals(height, grid, product(arm, rot.T), camera, 2 * step < STEPS)
        jx, jy = a[:, 1] + g[:, 1] * a[:, 2], -a[:, 0] - g[:, 0] * a[:, 2]
        xx, xy, yy = (share * jx * jx).sum(), (share * jx * jy).sum(), (share * jy * jy).sum()
        xe, ye, area = (share * jx * off).sum(), (share * jy * off).sum(), xx * yy - xy * xy
        if not area > 0.0:
            return rot
        turn = np.array([xy * ye - yy * xe, xy * xe - xx * ye, 0.0]) / area
        rot = product(matrix_from_rotvec(turn), rot)
    return rot


def scale_onto(height: Array, grid: Grid, place: Array, camera: Array) -> float:
    """Return the factor of the distances of points from a camera by which they fit a height map best, no unit.

    Args:
        height: heights of the map, (ny, nx) m, NaN = unknown.
        grid: place of its cells.
        place: points that the camera shows, (n, 3) m, frame of the map.
        camera: place of the camera, (3,) m, frame of the map.
    """
    arm, scale = place[:: 1 + len(place) // MOST_POINTS] - camera, 1.0
    for step in range(STEPS):
        a, g, off, share = _residuals(height, grid, scale * arm, camera, 2 * step < STEPS)
        j = (a[:, 2] - g[:, 0] * a[:, 0] - g[:, 1] * a[:, 1]) / scale
        steep = float((share * j * j).sum())
        if not steep > 0.0:
            return scale
        scale = min(max(scale - float((share * j * off).sum()) / steep, LEAST_SCALE), 1.0 / LEAST_SCALE)
    return scale
