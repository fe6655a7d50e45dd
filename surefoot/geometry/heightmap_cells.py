"""Compiled loops over the cells of a height map.

Throughout z is (ny, nx) float32 in m, `cell` the edge of a cell and (x0, y0) the centre of cell [0, 0], m.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import kernel, row_kernel

Heights = NDArray[np.float32]
Part = tuple[int, int, int, int]
"""Rectangle of cells of a map: first row, end of the rows, first column, end of the columns; the ends are excluded."""


Ball = tuple[NDArray[np.int64], NDArray[np.int64], Heights]
"""Cells within a sphere about a cell: row offsets, column offsets, and the sphere's height over its middle there, m."""


@kernel
def bilinear(z: Heights, cell: float, x0: float, y0: float, x: float, y: float) -> float:
    """Return the bilinear height at (x, y), m; NaN outside the map, or where a cell used for the point is NaN.

    The outermost half cell continues the border value.

    Args:
        z: heights, (ny, nx) m, NaN = unknown.
        cell: edge of a cell, m.
        x0: x of the centre of cell [0, 0], m.
        y0: y of the centre of cell [0, 0], m.
        x: x of the point, m.
        y: y of the point, m.
    """
    ny, nx = z.shape
    u = (x - x0) / cell
    v = (y - y0) / cell
    if not (u >= -0.5 and u < nx - 0.5 and v >= -0.5 and v < ny - 0.5):  # also refuses NaN
        return math.nan
    u = min(max(u, 0.0), nx - 1.0)
    v = min(max(v, 0.0), ny - 1.0)
    col = min(int(u), max(nx - 2, 0))
    row = min(int(v), max(ny - 2, 0))
    a = u - col
    b = v - row
    total = 0.0
    for i in range(2):  # a corner of weight 0 must not poison the sum with its NaN
        wy = b if i == 1 else 1.0 - b
        for j in range(2):
            w = wy * (a if j == 1 else 1.0 - a)
            if w > 0.0:
                total += w * z[row + i, col + j]
    return total


@kernel
def heights(
    z: Heights, cell: float, x0: float, y0: float, xs: NDArray[np.float64], ys: NDArray[np.float64], smooth: bool,
    out: NDArray[np.float64],
) -> None:  # fmt: skip
    """Write the height of the ground at every point (xs[k], ys[k]) into out[k], m; NaN outside the map.

    Args:
        z: heights of the cells, (ny, nx) m, NaN = unknown.
        cell: edge of a cell, m.
        x0: x of the centre of cell [0, 0], m.
        y0: y of the centre of cell [0, 0], m.
        xs: x of the points, (n,) m.
        ys: y of the points, (n,) m.
        smooth: bilinear between the four nearest centres; False: the height of the nearest cell.
        out: (n,), overwritten.
    """
    ny, nx = z.shape
    for k in range(xs.shape[0]):
        if smooth:
            out[k] = bilinear(z, cell, x0, y0, xs[k], ys[k])
        else:
            out[k] = math.nan
            u = (xs[k] - x0) / cell + 0.5
            v = (ys[k] - y0) / cell + 0.5
            if u >= 0.0 and u < nx and v >= 0.0 and v < ny:
                out[k] = z[int(v), int(u)]


@kernel
def patch(z: Heights, row: int, col: int, out: Heights) -> None:
    """Copy the window of a map that begins at cell (row, col) into `out`, NaN outside the map.

    Args:
        z: heights of the cells, (ny, nx) m.
        row: first row of the window; it may lie outside the map.
        col: first column of the window; it may lie outside the map.
        out: the window, (rows, cols) m, overwritten.
    """
    ny, nx = z.shape
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            r = row + i
            c = col + j
            if r >= 0 and r < ny and c >= 0 and c < nx:
                out[i, j] = z[r, c]
            else:
                out[i, j] = math.nan


def ball(radius: float, cell: float) -> Ball:
    """Return the cells within a sphere about a cell centre: row and column offsets, and the sphere's height there, m.

    Each array is (k,); the height is that of the upper surface of the sphere over its centre.

    Args:
        radius: of the sphere, m.
        cell: edge of a cell, m.
    """
    reach = int(radius / cell + 1e-9)
    rows, cols = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    rest = radius**2 - cell**2 * (rows**2 + cols**2)
    near = rest >= -1e-12
    lift = np.sqrt(np.maximum(rest[near], 0.0)).astype(np.float32)
    return rows[near].astype(np.int64), cols[near].astype(np.int64), lift


@row_kernel
def _raise(source: Heights, lift: np.float32, target: Heights) -> None:
    """Set target = max(target, source + lift) for rows of heights, (n,) m, in place; NaN in source changes nothing."""
    for j in range(target.shape[0]):
        value = source[j] + lift
        target[j] = value if value > target[j] else target[j]


@row_kernel
def dilate(z: Heights, ball: Ball, part: Part, out: Heights) -> None:
    """Write the height of the centre of a sphere that rests on the ground, m, into `out` for the cells of a part.

    It is out[i, j] = max over k of z[i + rows[k], j + cols[k]] + lift[k]. NaN neighbours are left out, and a cell that
    is NaN stays NaN.

    Args:
        z: heights of the ground, (ny, nx) m, NaN = unknown.
        ball: cells within the sphere about a cell: offsets rows and cols, (k,), and the sphere's height lift there,
            (k,) m.
        part: first row, end of the rows, first column, end of the columns; the ends are left out.
        out: (ny, nx) m; the part is overwritten.
    """
    row0, row1, col0, col1 = part
    rows, cols, lift = ball
    ny, nx = z.shape
    lowest, unknown = np.float32(-np.inf), np.float32(np.nan)
    for i in range(row0, row1):
        here, target = z[i, col0:col1], out[i, col0:col1]
        for j in range(target.shape[0]):
            target[j] = lowest
        for k in range(rows.shape[0]):
            r, shift = i + rows[k], cols[k]
            if r < 0 or r >= ny:
                continue
            first, last = max(col0, -shift), min(col1, nx - shift)
            if first < last:
                _raise(z[r, first + shift : last + shift], lift[k], target[first - col0 : last - col0])
        for j in range(target.shape[0]):
            target[j] = unknown if np.isnan(here[j]) else target[j]


@row_kernel
def _columns(up: Heights, mid: Heights, down: Heights, low: Heights, middle: Heights, high: Heights) -> None:
    """Sort three rows of heights, (n,) m, cell by cell into `low`, `middle` and `high`, (n,) m.

    A NaN or infinity in one of the rows makes the middle of its cell NaN; low and high have no meaning there.

    Args:
        up: first row.
        mid: second row.
        down: third row.
        low: least of the three, overwritten.
        middle: median of the three, overwritten.
        high: largest of the three, overwritten.
    """
    for j in range(mid.shape[0]):
        a, b, c = up[j], mid[j], down[j]
        small, large = min(a, b), max(a, b)
        low[j], high[j] = min(small, c), max(large, c)
        middle[j] = max(small, min(large, c)) + ((a - a) + (b - b) + (c - c))


@row_kernel
def _medians(low: Heights, middle: Heights, high: Heights, out: Heights) -> None:
    """Write the median of the nine cells of three sorted columns j, j + 1, j + 2 into out[j].

    It is the median of the largest low, the median middle and the smallest high; NaN where a middle is NaN.

    Args:
        low: least of the three cells of each column, (n + 2,) m.
        middle: median of them, (n + 2,) m, NaN where one is unknown.
        high: largest of them, (n + 2,) m.
        out: (n,) m, overwritten.
    """
    for j in range(out.shape[0]):
        a = max(max(low[j], low[j + 1]), low[j + 2])
        c = min(min(high[j], high[j + 1]), high[j + 2])
        p, q, r = middle[j], middle[j + 1], middle[j + 2]
        b = max(min(p, q), min(max(p, q), r))
        small, large = min(a, b), max(a, b)
        out[j] = max(small, min(large, c)) + ((p - p) + (q - q) + (r - r))


@row_kernel
def median3(z: Heights, min_known: int, part: Part, out: Heights) -> None:
    """Write the median of the known heights in the 3 x 3 window about each cell of a part into `out`.

    Complete windows are computed row by row, with sorted columns shared by three windows, the others cell by cell.

    Args:
        z: heights of the ground, (ny, nx) m, NaN = unknown.
        min_known: an unknown cell needs so many known neighbours, otherwise it stays NaN.
        part: first row, end of the rows, first column, end of the columns; the ends are left out.
        out: (ny, nx) m; the part is overwritten.
    """
    row0, row1, col0, col1 = part
    ny, nx = z.shape
    window = np.empty(9, dtype=np.float32)
    first, last = max(col0, 1), min(col1, nx - 1)
    n = max(0, last - first)
    low, middle, high = np.empty(n + 2, np.float32), np.empty(n + 2, np.float32), np.empty(n + 2, np.float32)
    unknown = np.float32(np.nan)
    for i in range(row0, row1):
        target = out[i]
        if n > 0 and i > 0 and i < ny - 1:
            a, b = first - 1, last + 1
            _columns(z[i - 1, a:b], z[i, a:b], z[i + 1, a:b], low, middle, high)
            _medians(low, middle, high, target[first:last])
            if col0 == 0:
                target[0] = unknown
            if col1 == nx:
                target[nx - 1] = unknown
        else:
            for j in range(col0, col1):
                target[j] = unknown
        for j in range(col0, col1):
            if np.isnan(target[j]):
                target[j] = _median_of(z, i, j, min_known, False, window)


@row_kernel
def even_edges(z: Heights, min_known: int, part: Part, out: Heights) -> None:
    """Write the median of pairs of opposite cells in incomplete 3 x 3 windows about the cells of a part into `out`.

    Such windows touch unknown ground or the border. A pair counts if both of its cells are known, so that a slope is as
    steep there as elsewhere. Cells with complete windows are left as they are.

    Args:
        z: heights of the ground, (ny, nx) m, NaN = unknown.
        min_known: an unknown cell needs so many known neighbours, otherwise it is NaN.
        part: first row, end of the rows, first column, end of the columns; the ends are left out.
        out: heights filtered by `median3`, (ny, nx) m; those of incomplete windows in the part are overwritten.
    """
    row0, row1, col0, col1 = part
    ny, nx = z.shape
    window, sums = np.empty(9, dtype=np.float32), np.empty(nx, dtype=np.float32)  # of three rows: NaN if one cell is
    for i in range(row0, row1):
        inner = 0 < i < ny - 1
        if inner:
            for j in range(max(col0 - 1, 0), min(col1 + 1, nx)):
                sums[j] = z[i - 1, j] + z[i, j] + z[i + 1, j]
        for j in range(col0, col1):
            if not inner or j == 0 or j == nx - 1 or np.isnan(sums[j - 1] + sums[j] + sums[j + 1]):
                out[i, j] = _median_of(z, i, j, min_known, True, window)


@row_kernel
def _median_of(z: Heights, i: int, j: int, min_known: int, pairs: bool, window: Heights) -> np.float32:
    """Return the median of the known heights in the 3 x 3 window about cell (i, j), m; NaN where too few are known.

    Args:
        z: heights of the ground, (ny, nx) m, NaN = unknown.
        i: row of the cell.
        j: column of the cell.
        min_known: if the cell is unknown, it needs so many known neighbours.
        pairs: True: a height counts only if that of the cell opposite is known too.
        window: (9,), overwritten by the heights that count, in rising order.
    """
    ny, nx = z.shape
    n, known = 0, 0
    for r in range(max(0, i - 1), min(ny, i + 2)):
        for c in range(max(0, j - 1), min(nx, j + 2)):
            value = z[r, c]
            if np.isnan(value):
                continue
            known += 1
            r2, c2 = 2 * i - r, 2 * j - c
            if pairs and (r2 < 0 or c2 < 0 or r2 >= ny or c2 >= nx or np.isnan(z[r2, c2])):
                continue
            k = n
            while k > 0 and window[k - 1] > value:
                window[k] = window[k - 1]
                k -= 1
            window[k] = value
            n += 1
    if n == 0 or (np.isnan(z[i, j]) and known < min_known):
        return np.float32(np.nan)
    return np.float32(0.5) * (window[(n - 1) // 2] + window[n // 2])
