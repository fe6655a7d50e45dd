"""The ground of Walas & Belter (2011), section 3.4: flagstones, mild and pointed hills, depressions, stones.

Heights are +8.7 to -0.35 cm there. Hills and depressions are the height field; flagstones and stones are boxes, so
that their edges are sharp. All that is drawn is independent of the grid: another cell samples the same ground.
"""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.linear import dot, exp

from .grid import BLEND, PAD_END, Shape, ShapeSpec, TerrainBox, TerrainGrid, box_heights, random_stream, slab, smooth

MIXED_HEIGHT = 0.087  # m, the highest point (section 3.4); all heights scale with it
LOWEST = -0.0035 / MIXED_HEIGHT  # of the amplitude
HILLS_TOP = 0.75  # of the amplitude, the height field ends here: what is left is for the stones on it
WIDE = 6.0  # per m2, wide mild hills
WIDE_SIGMA = (0.10, 0.22)  # m
WIDE_HEIGHT = (0.10, 0.40)  # of the amplitude
POINTED = 30.0  # per m2, cones
POINTED_RADIUS = (0.025, 0.05)  # m
POINTED_SLOPE = (0.3, 0.8)  # at the paper's amplitude
HOLLOWS = 15.0  # per m2, depressions
HOLLOW_SIGMA = (0.02, 0.05)  # m
HOLLOW_DEPTH = (0.05, 0.25)  # of the amplitude
FLAGSTONES = 14.0  # per m2
FLAGSTONE_EDGE = (0.07, 0.13)  # m
FLAGSTONE_RISE = (0.03, 0.20)  # of the amplitude, above the ground under its middle
FLAGSTONE_SLOPE = 0.1
STONES = 40.0  # per m2
STONE_EDGE = (0.015, 0.04)  # m
STONE_RISE = (0.03, 0.20)  # of the amplitude
STONE_SLOPE = 0.3
EDGES = 0.15  # m, no stone is nearer to the pad's end than this


def mixed(r: ShapeSpec) -> Shape:
    """Return the ground of flagstones, hills, depressions and stones of a seed; `amp` of `r` scales all heights."""
    grid = r.grid
    x, y = grid.axes()
    hills = _Hills(grid, r.seed, r.amp)
    z = hills.heights(x, y)
    surface = z.copy()
    boxes = _stones(grid, r.seed, r.amp, hills)
    for box in boxes:
        reach = math.hypot(*box.half_size)
        cols = np.flatnonzero(np.abs(x[0] - box.position[0]) <= reach)
        rows = np.flatnonzero(np.abs(y[:, 0] - box.position[1]) <= reach)
        if cols.size and rows.size:
            part = (slice(rows[0], rows[-1] + 1), slice(cols[0], cols[-1] + 1))
            surface[part] = np.maximum(surface[part], box_heights(box, x[:, part[1]], y[part[0]]))
    return Shape(surface, z, boxes)


class _Hills:
    """Wide hills, cones and depressions as a function of the plane, drawn from a seed."""

    def __init__(self, grid: TerrainGrid, seed: int, amp: float) -> None:
        rng = random_stream(seed, "terrain/mixed/hills")
        self.amp = amp
        scale = amp / MIXED_HEIGHT
        n = _number(grid, WIDE)
        self.wide = np.column_stack((_places(rng, grid, n), rng.uniform(*WIDE_SIGMA, n), rng.uniform(*WIDE_HEIGHT, n)))
        n = _number(grid, HOLLOWS)
        depth = rng.uniform(*HOLLOW_DEPTH, n)
        self.hollows = np.column_stack((_places(rng, grid, n), rng.uniform(*HOLLOW_SIGMA, n), -depth))
        n = _number(grid, POINTED)
        radius = rng.uniform(*POINTED_RADIUS, n)
        self.cones = np.column_stack((_places(rng, grid, n), radius, scale * radius * rng.uniform(*POINTED_SLOPE, n)))

    def heights(self, x: Array, y: Array) -> Array:
        """Return the heights over x (1, nx) and y (ny, 1) m, (ny, nx) m."""
        z = np.zeros((y.shape[0], x.shape[1]))
        for cx, cy, sigma, height in (*self.wide, *self.hollows):
            z += self.amp * height * exp(-0.5 * ((x - cx) / sigma) ** 2) * exp(-0.5 * ((y - cy) / sigma) ** 2)
        for cx, cy, radius, height in self.cones:
            z += height * np.maximum(1.0 - np.sqrt((x - cx) ** 2 + (y - cy) ** 2) / radius, 0.0)
        return np.clip(z, LOWEST * self.amp, HILLS_TOP * self.amp) * smooth((x - PAD_END) / BLEND)


def _stones(grid: TerrainGrid, seed: int, amp: float, hills: _Hills) -> tuple[TerrainBox, ...]:
    """Return flagstones and stones as boxes; each lies on the ground under its middle and reaches below all ground.

    `amp`: height of the highest point of the terrain, m, with which all heights scale.
    """
    rng = random_stream(seed, "terrain/mixed/stones")
    boxes: list[TerrainBox] = []
    if amp == 0.0:
        return ()
    for density, edge, rise, slope in (
        (FLAGSTONES, FLAGSTONE_EDGE, FLAGSTONE_RISE, FLAGSTONE_SLOPE),
        (STONES, STONE_EDGE, STONE_RISE, STONE_SLOPE),
    ):
        for cx, cy in _places(rng, grid, _number(grid, density)):
            edges, up, yaw = rng.uniform(*edge, 2), rng.uniform(*rise), rng.uniform(0.0, math.pi)
            tilt = rng.uniform(-slope, slope, 2)
            if cx < PAD_END + EDGES:
                continue
            ground = float(hills.heights(np.array([[cx]]), np.array([[cy]]))[0, 0])
            corner = 0.5 * dot(np.abs(tilt), edges)  # how much the highest corner is above the middle
            top = min(ground + up * amp, amp - corner)
            depth = 0.5 * (top - LOWEST * amp) + corner + 0.01
            boxes.append(slab(cx, cy, top, (float(tilt[0]), float(tilt[1])), depth, (edges[0], edges[1]), yaw))
    return tuple(boxes)


def _number(grid: TerrainGrid, density: float) -> int:
    """Return the number of objects of a density, 1/m^2, on the part of the grid behind the pad at the start."""
    end, half = _extent(grid)
    return round(density * max(0.0, end - PAD_END) * 2.0 * half)


def _places(rng: np.random.Generator, grid: TerrainGrid, n: int) -> Array:
    """Return n random points on the part of the grid behind the pad at the start, (n, 2) m."""
    end, half = _extent(grid)
    return np.column_stack((rng.uniform(PAD_END, max(end, PAD_END), n), rng.uniform(-half, half, n)))


def _extent(grid: TerrainGrid) -> tuple[float, float]:
    """Return the last x of a grid and half its width, m, which do not depend on the size of a cell."""
    return grid.x0 + (grid.nx - 1) * grid.cell, 0.5 * (grid.ny - 1) * grid.cell
