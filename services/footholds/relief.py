"""Relief of the ground at the scale of a foot: planes fitted to the known cells about each cell.

The plane z = h + g . x of the (2 s + 1)^2 cells about a cell, by least squares over those that are known, leaves

    u^2 = 2 r^2 / S,   S = sum (x - mean x)^2 + sum (y - mean y)^2 over 2,

as the variance of its slope g, r the deviation of the heights from it. Coefficients like those of Walas & Belter:

    K2 = 8 cell sqrt(|g|^2 + u^2),   K1 = K2 r / (r + cell |g|),   cos K3 = n . f,

with the unit normal n and the push f. On a map with noise g and u are made smaller first, by

    sqrt(1 - FAINT^2 / (|g|^2 + u^2)),   0 where that is less,

so that what noise alone explains is no steepness, and no foot goes aside for it.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.heightmap import HeightMap
from surefoot.geometry.heightmap_cells import patch
from surefoot.kernels.jit import row_kernel

from .features import Features, Layer, push_direction

SCALES = (1, 2, 3, 4)
"""Candidate numbers of cells on each side of a fitted plane, tried in order: the first at which map noise gives the
slope a standard deviation below `SURE` is used."""
SURE = 0.06
"""Standard deviation of a fitted plane's slope by map noise, no unit, below which the size of the plane is
sufficient."""
FAINT = 0.15
"""Steepness attributed to noise on maps that need planes of more than one cell on each side, 2.5 standard deviations,
no unit (slope)."""
LOOKED_AT = 10_000
"""Least number of cells by which the noise of a large map is found: all of a map of fewer than four times as many,
and this to 2.25 times as many of a larger one."""
LEAST_KNOWN = 0.4
"""Share of known cells of a plane, 0 to 1, below which the plane counts as unknown."""


class Relief(NamedTuple):
    """Planes through the cells about each cell of a map, (ny, nx) float32 each.

    NaN where the cell or too much about it is unknown, and at the border.
    """

    slope_x: Layer
    """Slope dz/dx of the fitted plane, no unit, (ny, nx)."""
    slope_y: Layer
    """Slope dz/dy of the fitted plane, no unit, (ny, nx)."""
    rough: Layer
    """Standard deviation of the heights from the fitted plane, (ny, nx) m."""
    unsure: Layer
    """Standard deviation u of the slope, no unit, (ny, nx)."""


def scale_of(raw: HeightMap, surface: HeightMap) -> int:
    """Return the scale of a map, the number of cells on each side of a plane, 1 to 4: the noisier the map, the larger.

    `raw`: map as received; `surface`: the map after the median filter. The noise is the median, over the cells, of the
    change of their heights by the filter, m. Of a large map every n-th row and column counts, chosen symmetrically
    about its middle, so that a turned or mirrored map has the same scale.
    """
    step = max(1, math.isqrt(raw.z.size // LOOKED_AT))
    cells = np.ix_(*(_spread(n, step) for n in raw.shape))
    moved = np.abs(raw.z[cells] - surface.z[cells])
    moved = moved[np.isfinite(moved)]
    noise = float(np.sort(moved)[moved.size // 2]) if moved.size else 0.0
    for s in SCALES:
        sum_x2 = s * (s + 1) * (2 * s + 1) ** 2 / 3.0
        if noise / (surface.cell * math.sqrt(sum_x2)) < SURE:
            return s
    return SCALES[-1]


def _spread(n: int, step: int) -> NDArray[np.intp]:
    """Return every `step`-th of n cells in a row from the middle outwards, to both sides alike, in ascending order."""
    half = np.arange((n - 1) // 2, -1, -step)
    return np.unique(np.concatenate((half, n - 1 - half)))


def relief_of(z: Layer, cell: float, scale: int) -> Relief:
    """Return the planes through the cells about every cell of a map.

    Args:
        z: heights, (ny, nx) m, NaN = unknown.
        cell: edge of a cell, m.
        scale: cells on each side of a plane.
    """
    out = Relief(*(np.empty(z.shape, dtype=np.float32) for _ in Relief._fields))
    update_relief(z, cell, scale, out, (0, z.shape[0], 0, z.shape[1]))
    return out


def update_relief(z: Layer, cell: float, scale: int, out: Relief, part: tuple[int, int, int, int]) -> None:
    """Fit the planes of the cells of a part of a map again, in place.

    Args:
        z: heights, (ny, nx) m, NaN = unknown.
        cell: edge of a cell, m.
        scale: cells on each side of a plane.
        out: planes of all cells, of which the part is written.
        part: first row, row behind the last, first column, column behind the last.
    """
    _planes(z, cell, scale, part, (out.slope_x, out.slope_y, out.rough, out.unsure))


def blur_relief(relief: Relief, variance: Layer, cell: float, scale: int) -> None:
    """Raise the standard deviation of slopes where heights are less certain than those of cells beside them.

    An error that neighbouring heights have in common changes no slope, so only the variance above the least of a
    plane's cells counts; unseen cells count as their least certain neighbour.

    Args:
        relief: planes of the map; `unsure` is overwritten.
        variance: variance of the heights, (ny, nx) m^2, NaN = not seen.
        cell: edge of a cell, m.
        scale: cells on each side of a plane.
    """
    worst, least = _extreme(np.fmax, variance, 1), _extreme(np.fmin, variance, scale)
    area = cell * cell * scale * (scale + 1) * (2 * scale + 1) ** 2 / 3.0
    own = np.where(np.isnan(variance), worst, variance) - least
    np.copyto(relief.unsure, np.sqrt(relief.unsure**2 + 2.0 * np.nan_to_num(own) / area))


def _extreme(best: np.ufunc, layer: Layer, by: int) -> Layer:
    """Return the largest (`best` = fmax) or least (fmin) known value of a layer (ny, nx) within `by` cells of each."""
    ny, nx = layer.shape
    rows = layer.copy()
    for k in range(1, min(by, ny - 1) + 1):
        best(rows[k:], layer[:-k], out=rows[k:])
        best(rows[:-k], layer[k:], out=rows[:-k])
    out = rows.copy()
    for k in range(1, min(by, nx - 1) + 1):
        best(out[:, k:], rows[:, :-k], out=out[:, k:])
        best(out[:, :-k], rows[:, k:], out=out[:, :-k])
    return out


def relief_features(
    relief: Relief, window: tuple[int, int, int, int], stroke: NDArray[np.float64], cell: float, scale: int
) -> Features:
    """Return the ground coefficients K1 (m), K2 (m), cos K3 of a window of cells by fitted planes, (rows, cols) each.

    Args:
        relief: planes of the map.
        window: first row, first column, rows and columns; may leave the map, its coefficients are NaN there.
        stroke: movement f of the foot relative to the body while it stands, map axes, (3,) m.
        cell: edge of a cell, m.
        scale: cells on each side of a plane.
    """
    row, col, *shape = window
    parts = tuple(np.empty(shape, dtype=np.float32) for _ in relief)
    for layer, part in zip(relief, parts, strict=True):
        patch(layer, row, col, part)
    out = Features(*(np.empty(shape, dtype=np.float32) for _ in Features._fields))
    faint = FAINT if scale > SCALES[0] else 0.0
    _coefficients(parts, push_direction(stroke), cell, faint, out.k1, out.k2, out.cos_k3)  # type: ignore[arg-type]
    return out


def patch_features(z: Layer, scale: int, stroke: Sequence[float], cell: float, border: int) -> Features:
    """Return the ground coefficients K1 (m), K2 (m), cos K3 of the middle cells of a patch, (2 b + 1, 2 b + 1) each.

    Args:
        z: heights, (n, n) m, NaN = unknown.
        scale: cells on each side of a plane.
        stroke: movement f of the foot relative to the body while it stands, map axes, (3,) m.
        cell: edge of a cell, m.
        border: b, cells on each side of the middle.
    """
    first, edge = z.shape[0] // 2 - border, 2 * border + 1
    relief = Relief(*(np.full(z.shape, np.nan, dtype=np.float32) for _ in Relief._fields))
    update_relief(z, cell, scale, relief, (first, first + edge, first, first + edge))
    return relief_features(relief, (first, first, edge, edge), np.array(stroke, dtype=np.float64), cell, scale)


@row_kernel
def _coefficients(
    window: tuple[Layer, Layer, Layer, Layer], push: tuple[float, float, float], cell: float, faint: float, k1: Layer,
    k2: Layer, cos_k3: Layer,
) -> None:  # fmt: skip
    """Write the ground coefficients K1, K2, cos K3 of fitted planes.

    Args:
        window: slopes along x and y, deviation of the heights (m), deviation of the slope, (rows, cols) each.
        push: direction of the stroke, unit vector or zero, map axes.
        cell: edge of a cell, m.
        faint: slope attributed to noise, no unit; 0 = a map without noise.
        k1: written, (rows, cols) m.
        k2: written, (rows, cols) m.
        cos_k3: written, (rows, cols), no unit.
    """
    slope_x, slope_y, rough, unsure = window
    fx, fy, fz = push
    for i in range(k1.shape[0]):
        for j in range(k1.shape[1]):
            gx, gy, r, u = float(slope_x[i, j]), float(slope_y[i, j]), float(rough[i, j]), float(unsure[i, j])
            slope2 = gx * gx + gy * gy
            steep2, lost = slope2 + u * u, r + cell * math.sqrt(slope2)
            if faint > 0.0:
                real = math.sqrt(1.0 - faint * faint / steep2) if steep2 > faint * faint else 0.0 * steep2  # NaN stays
                gx, gy, slope2, steep2 = real * gx, real * gy, real * real * slope2, real * real * steep2
            steep = 8.0 * cell * math.sqrt(steep2)
            k1[i, j] = steep * r / lost if lost > 1e-9 else steep
            k2[i, j] = steep
            cos_k3[i, j] = (fz - gx * fx - gy * fy) / math.sqrt(slope2 + 1.0)


@row_kernel
def _planes(
    z: Layer, cell: float, scale: int, part: tuple[int, int, int, int], out: tuple[Layer, Layer, Layer, Layer]
) -> None:
    """Write the planes about the cells of a part of a map: sums over the rows of a window first, then over its columns.

    Args:
        z: heights, (ny, nx) m, NaN = unknown.
        cell: edge of a cell, m.
        scale: cells on each side of a plane.
        part: first row, row behind the last, first column, column behind the last.
        out: slopes along x and y, deviation of the heights (m), deviation of the slope, (ny, nx) each; the part is
            written.
    """
    ny, nx = z.shape
    first_row, last_row, first_col, last_col = part
    slope_x, slope_y, rough, unsure = out
    left, right = max(0, first_col - scale), min(nx, last_col + scale)
    sums = np.empty((6, right - left))  # of 1, y, y^2, z, y z, z^2 over the rows of each column
    full = (2 * scale + 1) * (2 * scale + 1)
    for i in range(first_row, last_row):
        sums[:] = 0.0
        for p in range(max(0, i - scale), min(ny, i + scale + 1)):
            y = float(p - i)
            for k in range(right - left):
                height = float(z[p, left + k])
                one = 0.0 if math.isnan(height) else 1.0
                height = height if one > 0.0 else 0.0
                sums[0, k] += one
                sums[1, k] += one * y
                sums[2, k] += one * y * y
                sums[3, k] += height
                sums[4, k] += height * y
                sums[5, k] += height * height
        for j in range(first_col, last_col):
            n, sx, sy, sxx, sxy, syy, sz, sxz, syz, szz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for q in range(max(left, j - scale), min(right, j + scale + 1)):
                x, k = float(q - j), q - left
                n += sums[0, k]
                sx += x * sums[0, k]
                sxx += x * x * sums[0, k]
                sy += sums[1, k]
                sxy += x * sums[1, k]
                syy += sums[2, k]
                sz += sums[3, k]
                sxz += x * sums[3, k]
                syz += sums[4, k]
                szz += sums[5, k]
            edge = i == 0 or j == 0 or i == ny - 1 or j == nx - 1
            if edge or n < LEAST_KNOWN * full or math.isnan(z[i, j]):
                slope_x[i, j] = slope_y[i, j] = rough[i, j] = unsure[i, j] = math.nan
                continue
            cxx, cyy, cxy = sxx - sx * sx / n, syy - sy * sy / n, sxy - sx * sy / n
            cxz, cyz, czz = sxz - sx * sz / n, syz - sy * sz / n, szz - sz * sz / n
            area = max(cxx * cyy - cxy * cxy, 1e-9)
            gx, gy = (cxz * cyy - cyz * cxy) / area, (cyz * cxx - cxz * cxy) / area
            left_over = max(czz - gx * cxz - gy * cyz, 0.0) / n
            slope_x[i, j], slope_y[i, j] = gx / cell, gy / cell
            rough[i, j] = math.sqrt(left_over)
            unsure[i, j] = math.sqrt(4.0 * left_over / (cxx + cyy)) / cell
