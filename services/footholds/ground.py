"""Terrain map prepared for the choice of footholds, once per version of the map."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.heightmap import HeightMap
from surefoot.kernels.jit import row_kernel

Layer = NDArray[np.float32]
MOST_CHANGED = 0.5
"""Share of the map in the changed rectangle above which all layers are made again."""


@dataclass(frozen=True, eq=False)
class FootholdGround:
    """Layers over one grid, map frame."""

    surface: HeightMap
    """Heights of the ground, filtered, m."""
    centres: HeightMap
    """Heights of a foot CENTRE whose sphere rests on the surface, m; a foot is sent there."""
    foot_radius: float
    """Radius of the foot sphere, m."""
    smooth: bool = True
    """True if the surface went through the 3 x 3 median."""

    @property
    def version(self) -> int:
        """Version of the map that the layers come from."""
        return self.surface.version

    def near(self, x: float, y: float) -> bool:
        """Return whether a point, m, is finite and near enough to the map to have a cell number."""
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
        heights.smooth_part(ground.surface.z, *_grown(rows, cols, 1, heights.shape))
        ground.surface.dilate_part(ground.foot_radius, ground.centres.z, *_grown(rows, cols, reach, heights.shape))
    return replace(ground, surface=heights.derived(ground.surface.z), centres=heights.derived(ground.centres.z))


def changed_cells(old: Layer, new: Layer) -> tuple[slice, slice]:
    """Return the smallest rectangle of rows and columns that holds all cells that differ; NaN equals NaN."""
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


def build_ground(heights: HeightMap, foot_radius: float, smooth: bool = True) -> FootholdGround:
    """Filter a map and dilate it by the foot sphere.

    Args:
        heights: the map as received.
        foot_radius: radius of the foot sphere, m.
        smooth: 3 x 3 median. 3 mm of noise per cell give K1 a deviation of 25 mm on flat ground, as much as a real
            edge; the filter leaves 7 mm, and straight edges stay. False suits exact maps.
    """
    surface = heights.smoothed() if smooth else heights
    return FootholdGround(surface=surface, centres=surface.dilated(foot_radius), foot_radius=foot_radius, smooth=smooth)
