"""Ground coefficients K1, K2 and cos K3 of Walas & Belter (2011), section 2.4.

Heights are `z[row = y, col = x]` in m; dz(p, q) is the height of the cell p columns (x) and q rows (y) away, minus
the cell's own. A cell whose 3 x 3 window touches an unknown cell or the border has no coefficients (NaN).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.heightmap_cells import patch
from surefoot.kernels.jit import row_kernel

Layer = NDArray[np.float32]
Vector = NDArray[np.float64]


class Features(NamedTuple):
    """Ground coefficients K1, K2 and cos K3 (Walas & Belter) of the cells of a window or map.

    They are made of the 3 x 3 cells about each, or of a plane fitted to more cells.
    """

    k1: Layer
    """Convexity K1, (ny, nx) m. By 3 x 3 cells: > 0 on a top edge, < 0 in a hole, 0 on a plane; by fitted planes: >=
    0."""
    k2: Layer
    """Steepness and roughness K2, (ny, nx) m; |K1| <= K2."""
    cos_k3: Layer
    """Cosine of the angle between ground normal and stroke, (ny, nx): < 0 on ground that faces the push, > 0 where it
    slips."""


def push_direction(stroke: Vector) -> tuple[float, float, float]:
    """Return the unit vector of a stroke f, (3,) m, in its axes; a zero or non-finite stroke gives (0, 0, 0)."""
    fx, fy, fz = float(stroke[0]), float(stroke[1]), float(stroke[2])
    length = math.sqrt(fx * fx + fy * fy + fz * fz)
    if not (math.isfinite(length) and length > 1e-12):
        return (0.0, 0.0, 0.0)
    return (fx / length, fy / length, fz / length)


def map_features(z: Layer, stroke: Vector, cell: float) -> Features:
    """Return the ground coefficients K1 (m), K2 (m) and cos K3 of every cell of a map, (ny, nx) each.

    Args:
        z: heights, (ny, nx) m, row along y, column along x, NaN = unknown.
        stroke: movement f of the foot relative to the body while it stands, map axes, (3,) m; zero: cos K3 is 0.
        cell: edge of a cell, m.
    """
    out = Features(np.empty_like(z), np.empty_like(z), np.empty_like(z))
    coefficients(z, np.array(push_direction(stroke), dtype=np.float32), np.float32(cell), out.k1, out.k2, out.cos_k3)
    return out


def window_features(z: Layer, row: int, col: int, rows: int, cols: int, stroke: Vector, cell: float) -> Features:
    """Return the ground coefficients K1 (m), K2 (m), cos K3 of a window of rows x cols cells that starts at (row, col).

    The window may reach beyond the map; its coefficients are NaN there.

    Args:
        z: heights of the map, (ny, nx) m, NaN = unknown.
        row: first row of the window.
        col: first column.
        rows: number of rows.
        cols: number of columns.
        stroke: movement f of the foot relative to the body while it stands, map axes, (3,) m; zero: cos K3 is 0.
        cell: edge of a cell, m.
    """
    local = np.empty((rows + 2, cols + 2), dtype=np.float32)
    patch(z, row - 1, col - 1, local)
    whole = map_features(local, stroke, cell)
    return Features(whole.k1[1:-1, 1:-1], whole.k2[1:-1, 1:-1], whole.cos_k3[1:-1, 1:-1])


class _Rows(NamedTuple):
    """Heights that one row of coefficients is made of, (nx,) m each."""

    up: Layer
    """Heights of row y - 1 of the map, (nx,) m."""
    mid: Layer
    """Heights of row y of the map, for which the coefficients are made, (nx,) m."""
    down: Layer
    """Heights of row y + 1 of the map, (nx,) m."""
    near: Layer
    """Heights of the neighbour row (y - 1 or y + 1) on the side that the push points to, (nx,) m."""
    far: Layer
    """Heights of the neighbour row (y - 1 or y + 1) on the side that the push points away from, (nx,) m."""


class _PushTerms(NamedTuple):
    """Direction of the push (unit vector of the foot's stroke), and products of it, for one pass over the cells."""

    fx: np.float32
    """x of the push's unit vector, map axes, no unit."""
    fy: np.float32
    """y of the push's unit vector, map axes, no unit."""
    n_z: np.float32
    """z of the ground normal before it is scaled to unit length: four times the edge of a cell, m."""
    lift: np.float32
    """Product of `n_z` and the z component of the push's unit vector, m."""
    ahead: bool
    """True if the push points to +x, False if it points to -x."""
    sx: np.float32
    """Sign of `fx`, 1 or -1."""
    sy: np.float32
    """Sign of `fy`, 1 or -1."""


@row_kernel
def _row(rows: _Rows, push: _PushTerms, k1: Layer, k2: Layer, cos_k3: Layer) -> None:
    """Write one row of coefficients, (nx,) each, without the first and the last cell.

    Args:
        rows: heights of the row and its neighbours, m.
        push: direction of the push.
        k1: written, m.
        k2: written, m.
        cos_k3: written, no unit.
    """
    up, mid, down, near, far = rows
    fx, fy, n_z, lift, ahead, sx, sy = push
    n = mid.shape[0] - 2
    half = np.float32(2.0)
    front, back = (2, 0) if ahead else (0, 2)
    mid_front = mid[front : front + n]
    near_front, near_back = near[front : front + n], near[back : back + n]
    near_mid, far_front = near[1 : 1 + n], far[front : front + n]
    a0, a1, a2 = up[0:n], up[1 : 1 + n], up[2 : 2 + n]
    b0, b1, b2 = mid[0:n], mid[1 : 1 + n], mid[2 : 2 + n]
    c0, c1, c2 = down[0:n], down[1 : 1 + n], down[2 : 2 + n]
    o1, o2, o3 = k1[1 : 1 + n], k2[1 : 1 + n], cos_k3[1 : 1 + n]
    for j in range(n):
        z = b1[j]
        d0, d1, d2 = z - a0[j], z - a1[j], z - a2[j]
        d3, d4 = z - b0[j], z - b2[j]
        d5, d6, d7 = z - c0[j], z - c1[j], z - c2[j]
        o1[j] = ((d0 + d1) + (d2 + d3)) + ((d4 + d5) + (d6 + d7))
        total = ((abs(d0) + abs(d1)) + (abs(d2) + abs(d3))) + ((abs(d4) + abs(d5)) + (abs(d6) + abs(d7)))
        o2[j] = total
        n_x = sx * ((near_back[j] - near_front[j]) - half * (mid_front[j] - z))
        n_y = sy * ((far_front[j] - near_front[j]) - half * (near_mid[j] - z))
        dot = n_x * fx + n_y * fy + lift
        # total - total is 0, or NaN where the window holds a NaN that the five neighbours miss
        o3[j] = dot / np.sqrt(n_x * n_x + n_y * n_y + n_z * n_z) + (total - total)


@row_kernel
def coefficients(z: Layer, push: Layer, cell: np.float32, k1: Layer, k2: Layer, cos_k3: Layer) -> None:
    """Write the ground coefficients of all cells in one pass over the rows.

    Args:
        z: heights, (ny, nx) m, NaN = unknown.
        push: direction of the stroke, unit vector or zero, map axes, (3,).
        cell: edge of a cell, m.
        k1: result K1, (ny, nx) m.
        k2: result K2, (ny, nx) m.
        cos_k3: result cos K3, (ny, nx), no unit.
    """
    ny, nx = z.shape
    fx, fy, fz = push[0], push[1], push[2]
    one = np.float32(1.0)
    ahead, left = fx >= 0.0, fy >= 0.0
    sx = one if ahead else -one
    sy = one if left else -one
    n_z = np.float32(4.0) * cell
    turned = _PushTerms(fx, fy, n_z, n_z * fz, ahead, sx, sy)
    unknown = np.float32(np.nan)
    for i in range(ny):
        if i == 0 or i == ny - 1 or nx < 3:
            for j in range(nx):
                k1[i, j] = unknown
                k2[i, j] = unknown
                cos_k3[i, j] = unknown
            continue
        for j in (0, nx - 1):
            k1[i, j] = unknown
            k2[i, j] = unknown
            cos_k3[i, j] = unknown
        near = z[i + 1] if left else z[i - 1]
        far = z[i - 1] if left else z[i + 1]
        _row(_Rows(z[i - 1], z[i], z[i + 1], near, far), turned, k1[i], k2[i], cos_k3[i])
