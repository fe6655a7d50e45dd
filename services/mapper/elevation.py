"""Map of heights about a robot that walks, from depths: one Kalman filter a cell (Fankhauser et al. 2014).

The grid lies in the frame of the odometry and moves on with the robot by whole cells. A cell holds

    h    height, m
    v    variance of the independent errors of its measurements, m^2
    D    drift of the odometry when the cell was seen last: growth of the variance of z, of x and y, and of yaw.

An image gives a cell the mean m of its points with the variance r. The growth of the drift since adds to the prior,

    p = v + (D_z' - D_z) + s^2 (D_xy' - D_xy),   k = p / (p + r),   h += k (m - h),   v = (1 - k) p,

where s is the usual slope (`SLOPE`). A mean further than `GATE` standard deviations from the height begins the cell
anew: the ground has moved, or the cell lies on an edge. Published is the variance relative to the robot now,

    v + t d^2 + (D_z' - D_z) + g^2 ((D_xy' - D_xy) + d^2 (D_yaw' - D_yaw)),

with the slope g of the map in the cell, the distance d of the cell from the robot, and the variance t of the tilt. A
constant error of the tilt turns the map and the robot's path alike. So the distance at which a cell was seen does not
count, nor does the error of height that the odometry gathers by that tilt (`MapPose.free`).
"""

import math
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.kernels.jit import kernel

SLOPE = 0.4
"""Assumed slope of the ground (tangent): turns a horizontal error, m, into an error of height, m."""
GATE = 3.0
"""Difference between a cell's height and a new mean, in standard deviations, above which the cell begins anew."""


class OdometryDrift(NamedTuple):
    """Growth of the variances of the odometry's pose since the odometry began."""

    z: float = 0.0
    """Growth of the variance of the odometry's z since the odometry began, m^2."""
    xy: float = 0.0
    """Growth of the variance of the odometry's x, and of its y, since the odometry began, m^2."""
    yaw: float = 0.0
    """Growth of the variance of the odometry's yaw since the odometry began, rad^2."""


class Elevation(NamedTuple):
    """Layers of an elevation map, (n, n) each, row along y: heights, their variances, and drift when last seen."""

    height: Array
    """Height of the ground in each cell, (n, n) m, frame of the map; NaN = not seen."""
    variance: Array
    """Variance of each height by errors that are independent between its measurements, (n, n) m^2."""
    drift_z: Array
    """Growth of the odometry's variance of z, since its beginning, when each cell was seen last, (n, n) m^2."""
    drift_xy: Array
    """Growth of the odometry's variance of x or y, since its beginning, when each cell was seen last, (n, n) m^2."""
    drift_yaw: Array
    """Growth of the odometry's variance of yaw, since its beginning, when each cell was seen last, (n, n) rad^2."""


class Grid(NamedTuple):
    """Place of the cells of an elevation map in its frame, that of the odometry until the odometry begins anew."""

    cell: float
    """Edge length of a square cell, m."""
    row: int
    """Index of the first row, counted from the frame's origin: its cell centres lie at y = row * cell."""
    col: int
    """Index of the first column, counted from the frame's origin: its cell centres lie at x = col * cell."""


class GroundPoints(NamedTuple):
    """Measured points of the ground in one image, frame of the map."""

    place: Array
    """Positions of the points, (n, 3) m, frame of the map."""
    variance: Array
    """Variances of the heights of the points by errors that are independent between points, (n,) m^2."""
    common: Array
    """Standard deviation of each height by the error of tilt that all points of the image share, (n,) m."""


class GroundMeans(NamedTuple):
    """Means of the points of one image in each cell of a map, (n, n) each, NaN = none."""

    height: Array
    """Mean height of the points in each cell, (n, n) m, frame of the map; NaN = no point."""
    variance: Array
    """Variance of each mean height, (n, n) m^2: of the noise of its points and of how far they lie apart."""
    common: Array
    """Standard deviation of each mean height by the error of tilt that all points of the image share, (n, n) m."""


def empty(n: int) -> Elevation:
    """Return a map of n x n cells, none of them seen."""
    return Elevation(*(np.full((n, n), math.nan) for _ in Elevation._fields))


def around(grid: Grid, n: int, x: float, y: float) -> Grid:
    """Return the grid of n x n cells whose middle is the cell of the point x, y, m, frame of the map.

    `grid`: gives the edge of a cell, m.
    """
    return Grid(grid.cell, math.floor(y / grid.cell + 0.5) - n // 2, math.floor(x / grid.cell + 0.5) - n // 2)


def moved(layers: Elevation, old: Grid, new: Grid) -> Elevation:
    """Return the layers of a map, (n, n) each, whose grid has moved by whole cells; cells outside are dropped.

    `old`, `new`: place of the cells before and after.
    """
    n, rows, cols = layers.height.shape[0], new.row - old.row, new.col - old.col
    if rows == 0 and cols == 0:
        return layers
    out = empty(n)
    if abs(rows) < n and abs(cols) < n:
        here = slice(max(0, -rows), min(n, n - rows)), slice(max(0, -cols), min(n, n - cols))
        there = slice(max(0, rows), min(n, n + rows)), slice(max(0, cols), min(n, n + cols))
        for layer, before in zip(out, layers, strict=True):
            layer[here] = before[there]
    return out


def lay(
    layers: Elevation, grid: Grid, plane: tuple[float, float, float], half: Array, variance: float, drift: OdometryDrift
) -> None:
    """Set the unseen cells near the middle of a map to the heights of a plane: `layers` are changed.

    Args:
        layers: layers of the map, (n, n) each.
        grid: place of the cells.
        plane: height over (0, 0), m, and its slopes along x and y, no unit.
        half: half edges of the rectangle along x and y that is set, (2,) m.
        variance: variance of the heights of the plane, m^2.
        drift: drift of the odometry now: growth of its variances since its beginning.
    """
    n, c = layers.height.shape[0], grid.cell
    x, y = c * (grid.col + np.arange(n))[None, :], c * (grid.row + np.arange(n))[:, None]
    middle = c * (grid.col + n // 2), c * (grid.row + n // 2)
    near = (np.abs(x - middle[0]) <= half[0]) & (np.abs(y - middle[1]) <= half[1]) & np.isnan(layers.height)
    values = (plane[0] + plane[1] * x + plane[2] * y, variance, *drift)
    for layer, value in zip(layers, values, strict=True):
        layer[near] = np.broadcast_to(value, layer.shape)[near]


@kernel
def means(n: int, grid: Grid, points: GroundPoints) -> GroundMeans:
    """Return the means of the points of one image in the n x n cells of a grid, frame of the map.

    Args:
        n: cells along an edge.
        grid: place of the cells.
        points: measured points and their variances, frame of the map.
    """
    cell, row0, col0 = grid
    place, spread, shared = points
    weight, mean, square, bias = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
    for k in range(place.shape[0]):
        i, j = math.floor(place[k, 1] / cell + 0.5) - row0, math.floor(place[k, 0] / cell + 0.5) - col0
        if i < 0 or j < 0 or i >= n or j >= n:
            continue
        w, z = 1.0 / spread[k], place[k, 2]
        weight[i, j] += w
        off = z - mean[i, j]
        mean[i, j] += off * w / weight[i, j]
        square[i, j] += w * off * (z - mean[i, j])
        bias[i, j] += w * shared[k]
    for i in range(n):
        for j in range(n):
            w = weight[i, j] if weight[i, j] > 0.0 else math.nan
            mean[i, j] += 0.0 * w
            square[i, j] = (1.0 + square[i, j]) / w
            bias[i, j] /= w
    return GroundMeans(mean, square, bias)


@kernel
def _prior(layers: Elevation, i: int, j: int, drift: OdometryDrift) -> float:
    """Return the variance of the height of cell [i, j] in the frame of the map now, m^2.

    `layers`: of the map; `drift`: growth of the odometry's variances since its beginning.
    """
    spread = layers.variance[i, j] + drift.z - layers.drift_z[i, j]
    return spread + SLOPE * SLOPE * (drift.xy - layers.drift_xy[i, j])


@kernel
def _agrees(layers: Elevation, i: int, j: int, found: GroundMeans, drift: OdometryDrift) -> bool:
    """Return True if an image's mean in cell [i, j] lies within 3 deviations of the map's height; False for NaN."""
    off, shared = found.height[i, j] - layers.height[i, j], found.common[i, j]
    within = _prior(layers, i, j, drift) + found.variance[i, j] + 2.0 * shared * shared  # of tilts that differ
    return off * off <= GATE * GATE * within


@kernel
def compared(layers: Elevation, found: GroundMeans, drift: OdometryDrift) -> tuple[int, int]:
    """Return the number of cells that map and image both show, and of those whose heights agree."""
    both, alike = 0, 0
    for i in range(layers.height.shape[0]):
        for j in range(layers.height.shape[1]):
            if not math.isnan(found.height[i, j] + layers.height[i, j]):
                both += 1
                alike += 1 if _agrees(layers, i, j, found, drift) else 0
    return both, alike


@kernel
def fuse(layers: Elevation, found: GroundMeans, drift: OdometryDrift) -> int:
    """Fuse the means of one image into the map: `layers` are changed; return how many cells the image shows.

    A cell that the mean contradicts by more than 3 standard deviations begins anew.

    Args:
        layers: the map, (n, n) each.
        found: means of the points of the image in each cell.
        drift: drift of the odometry now: growth of its variances since its beginning.
    """
    seen = 0
    for i in range(layers.height.shape[0]):
        for j in range(layers.height.shape[1]):
            height, r = found.height[i, j], found.variance[i, j]
            if math.isnan(height):
                continue
            seen += 1
            if _agrees(layers, i, j, found, drift):
                prior = _prior(layers, i, j, drift)
                gain = prior / (prior + r)
                layers.height[i, j] += gain * (height - layers.height[i, j])
                layers.variance[i, j] = (1.0 - gain) * prior
            else:  # not seen before, or no longer what it was
                layers.height[i, j], layers.variance[i, j] = height, r
            layers.drift_z[i, j], layers.drift_xy[i, j], layers.drift_yaw[i, j] = drift.z, drift.xy, drift.yaw
    return seen


@kernel
def variances(layers: Elevation, grid: Grid, drift: OdometryDrift, robot: tuple[float, float, float]) -> Array:
    """Return the variance of each height relative to the robot now, (n, n) m^2, NaN = not seen.

    Args:
        layers: layers of the map, (n, n) each.
        grid: place of the cells.
        drift: drift of the odometry now: growth of its variances since its beginning.
        robot: x, y, m, frame of the map, and variance of its tilt about a level axis, rad^2.
    """
    height, variance, drift_z, drift_xy, drift_yaw = layers
    x, y, tilt = robot
    cell, row0, col0 = grid
    ny, nx = height.shape
    out = np.empty((ny, nx))
    for i in range(ny):
        for j in range(nx):
            slope2 = 0.0
            for below, above in ((height[max(i - 1, 0), j], height[min(i + 1, ny - 1), j]),
                                 (height[i, max(j - 1, 0)], height[i, min(j + 1, nx - 1)])):  # fmt: skip
                g = (above - below) / (2.0 * cell)
                slope2 += 0.5 * SLOPE * SLOPE if math.isnan(g) else g * g
            dx, dy = (col0 + j) * cell - x, (row0 + i) * cell - y
            away2 = dx * dx + dy * dy
            along = drift.xy - drift_xy[i, j] + away2 * (drift.yaw - drift_yaw[i, j])
            out[i, j] = variance[i, j] + tilt * away2 + drift.z - drift_z[i, j] + slope2 * along
    return out
