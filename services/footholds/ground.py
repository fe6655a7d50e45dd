"""Terrain map prepared for the choice of footholds, once per version of the map."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.heightmap import HeightMap
from surefoot.geometry.heightmap_cells import even_edges
from surefoot.kernels.jit import row_kernel

from .features import Features, map_features, window_features
from .relief import Relief, blur_relief, relief_features, relief_of, scale_of, update_relief

Layer = NDArray[np.float32]
MOST_CHANGED = 0.5
"""Share of the map in the rectangle of changed cells, 0 to 1, above which all layers are computed again, not a part."""


@dataclass(frozen=True, eq=False)
class FootholdGround:
    """Layers over one grid on which footholds are chosen, map frame, (ny, nx) each."""

    surface: HeightMap
    """Heights of the ground after the median filter, m, map frame."""
    centres: HeightMap
    """Heights of the centre of a foot whose sphere rests on the surface, m, map frame; legs are sent to these
    points."""
    foot_radius: float
    """Radius of the foot sphere, m."""
    smooth: bool
    """True if the heights went through the 3 x 3 median filter, False if they are as received."""
    even: Layer
    """Heights that the planes are fitted to, (ny, nx) m: those of the surface but for cells whose 3 x 3 window touches
    unknown ground or the border. These are medians of opposite cells, so that no slope is less steep there."""
    relief: Relief
    """Planes fitted to the cells around every cell."""
    scale: int
    """Cells on each side of the middle of a fitted plane, 1 to 4; the noisier the map, the larger."""

    @property
    def version(self) -> int:
        """Version of the map that the layers come from."""
        return self.surface.version

    def near(self, x: float, y: float) -> bool:
        """Return True if a point x, y (m, map frame) is finite and near enough to the map to have a cell number."""
        far = 1e6 * self.surface.cell
        x0, y0 = self.surface.origin
        return abs(x - x0) <= far and abs(y - y0) <= far


def updated_ground(ground: FootholdGround, raw: HeightMap, heights: HeightMap) -> FootholdGround:
    """Return the layers of a new version of a map, computed again only where it differs.

    Args:
        ground: layers of `raw`; its arrays are overwritten and must not be used any more.
        raw: the map as received before.
        heights: the map as received now.
    """
    same = (raw.shape, raw.cell, raw.origin) == (heights.shape, heights.cell, heights.origin)
    if not same or not ground.smooth:
        return build_ground(heights, ground.foot_radius, ground.smooth)
    rows, cols = changed_cells(raw.z, heights.z)
    if rows.stop > rows.start:
        reach = 1 + int(ground.foot_radius / heights.cell + 1e-9)
        if (rows.stop - rows.start) * (cols.stop - cols.start) > MOST_CHANGED * heights.z.size:
            return build_ground(heights, ground.foot_radius, ground.smooth)
        for layer in (ground.surface.z, ground.centres.z):
            layer.flags.writeable = True
        filtered = _grown(rows, cols, 1, heights.shape)
        heights.smooth_part(ground.surface.z, *filtered)
        _even(heights, ground.surface.z, filtered, ground.even)
        ground.surface.dilate_part(ground.foot_radius, ground.centres.z, *_grown(rows, cols, reach, heights.shape))
        scale = scale_of(heights, ground.surface)
        every = (slice(0, heights.shape[0]), slice(0, heights.shape[1]))
        moved = (rows, cols) if scale == ground.scale else every
        near = _grown(*moved, 1 + scale, heights.shape)
        update_relief(ground.even, heights.cell, scale, ground.relief, near)
        ground = replace(ground, scale=scale)
    return replace(ground, surface=heights.derived(ground.surface.z), centres=heights.derived(ground.centres.z))


def _even(raw: HeightMap, filtered: Layer, part: tuple[int, int, int, int], out: Layer) -> None:
    """Write the heights that planes are fitted to, see `FootholdGround.even`, into a part of `out`, (ny, nx) m.

    `raw`: map as received; `filtered`: its heights after the median filter; `part`: first row, row behind the last,
    first column, column behind the last.
    """
    row0, row1, col0, col1 = part
    out[row0:row1, col0:col1] = filtered[row0:row1, col0:col1]
    even_edges(raw.z, 6, part, out)


def changed_cells(old: Layer, new: Layer) -> tuple[slice, slice]:
    """Return the smallest rectangle of rows and columns that holds all cells that differ; NaN equals NaN.

    old, new: layers of equal shape (ny, nx) and unit.
    """
    first, last, left, right = _changed(old, new)
    return slice(first, last), slice(left, right)


@row_kernel
def _changed(old: Layer, new: Layer) -> tuple[int, int, int, int]:
    ny, nx = new.shape
    first, last, left, right = ny, 0, nx, 0
    for i in range(ny):
        a, b = old[i], new[i]
        unequal = 0
        for j in range(nx):
            unequal += 1 if a[j] != b[j] else 0  # NaN as well
        if unequal == 0:
            continue
        for j in range(nx):
            if a[j] != b[j] and not (np.isnan(a[j]) and np.isnan(b[j])):
                first, last = min(first, i), i + 1
                left, right = min(left, j), max(right, j + 1)
    if last == 0:
        return 0, 0, 0, 0
    return first, last, left, right


def _grown(rows: slice, cols: slice, by: int, shape: tuple[int, int]) -> tuple[int, int, int, int]:
    return (
        max(0, rows.start - by), min(shape[0], rows.stop + by), max(0, cols.start - by), min(shape[1], cols.stop + by)
    )  # fmt: skip


def build_ground(
    heights: HeightMap, foot_radius: float, smooth: bool = True, variance: Layer | None = None
) -> FootholdGround:
    """Return a map as ground for the choice of footholds: filtered, and dilated by the foot sphere.

    Args:
        heights: the map as received.
        foot_radius: radius of the foot sphere, m.
        smooth: 3 x 3 median. 3 mm of noise per cell give K1 a deviation of 25 mm on flat ground, as much as a real
            edge; the filter leaves 7 mm, and straight edges stay. False suits exact maps.
        variance: variance of the heights, (ny, nx) m^2, NaN = not seen; None = not known.
    """
    surface = heights.smoothed() if smooth else heights
    scale = scale_of(heights, surface)
    even = surface.z
    if smooth:
        even = np.empty_like(surface.z)
        _even(heights, surface.z, (0, heights.shape[0], 0, heights.shape[1]), even)
    relief = relief_of(even, surface.cell, scale)
    if variance is not None:
        blur_relief(relief, variance, surface.cell, scale)
    return FootholdGround(surface, surface.dilated(foot_radius), foot_radius, smooth, even, relief, scale)


def ground_features(
    ground: FootholdGround, relief: bool, window: tuple[int, int, int, int], stroke: NDArray[np.float64]
) -> Features:
    """Return the ground coefficients K1 (m), K2 (m) and cos K3 of a window, (rows, cols) each.

    Args:
        ground: layers of the map.
        relief: True: by planes at the scale of the map; False: by 3 x 3 cells, as Walas & Belter do.
        window: first row, first column, rows and columns; may leave the map, its coefficients are NaN there.
        stroke: movement f of the foot relative to the body while it stands, map axes, (3,) m.
    """
    surface = ground.surface
    if relief:
        return relief_features(ground.relief, window, stroke, surface.cell, ground.scale)
    if window == (0, 0, *surface.shape):
        return map_features(surface.z, stroke, surface.cell)
    return window_features(surface.z, *window, stroke, surface.cell)
