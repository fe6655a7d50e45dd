"""Shapes of the ground: one pure function per kind of terrain.

A shape is described twice: as `surface`, all of it on the grid, and as what the physics stands on: a height field
(`ground`) or the plane through the origin, and exact boxes. Hills, noise and stones begin behind the flat pad about the
origin.
"""

import itertools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.geometry.linear import exp

from .elevation import ELEVATION_HEIGHT, elevation
from .grid import BLEND, CORRIDOR, PAD_END, Shape, ShapeSpec, TerrainBox, TerrainGrid, random_stream, slab, smooth
from .mixed import MIXED_HEIGHT, mixed

Outline = tuple[tuple[float, float], ...]

N_HILLS = 40
HILL_SIGMA = (0.06, 0.18)  # m
NOISE_WAVE = 0.04  # m, distance of the nodes of the rough noise
TREAD = 0.25  # m
N_RISERS = 3
TILE = 0.10  # m, edge of a flagstone
TILE_SLOPE = 0.1
DEMO_HILLS = 0.06  # m, highest hill of the demo in the lane
DEMO_NOISE = 0.02  # m, rough noise of the demo from peak to peak
DEMO_RISER = 0.025  # m, riser of the demo's three steps
DEMO_STEPS_AT = 0.95  # m, the first riser
ROOM = ((-1.0, -1.0), (1.5, -1.0), (1.5, 1.0), (-1.0, 1.0))  # m, corners of the floor, counter-clockwise
CORRIDOR_FLOOR = ((-1.0, -1.0), (6.5, -1.0), (6.5, 1.0), (-1.0, 1.0))  # m: 7.5 x 2 m, that of Osswald et al.
CORNER_FLOOR = ((-1.0, -1.0), (5.0, -1.0), (5.0, 5.0), (3.0, 5.0), (3.0, 1.0), (-1.0, 1.0))
"""Corners of an L-shaped floor, (x, y) m, map frame: 2 m wide, 4 m along x from (0, 0) to (4, 0), then 4 m along y to
(4, 4)."""
WALL = 0.05  # m, thickness of the walls
WALLED_CELL = 0.01  # m, of the maps of corridor and corner


def _flat(r: ShapeSpec) -> Shape:
    return Shape(np.zeros((1, 1)))


def _slope(r: ShapeSpec) -> Shape:
    x, _ = r.grid.axes()
    n = math.hypot(1.0, r.amp)
    return Shape(r.amp * x, normal=(-r.amp / n, 0.0, 1.0 / n))


def _hill_field(grid: TerrainGrid, seed: int, amp: float, end: float = math.inf) -> Array:
    """Return heights (ny, nx) m of 40 Gaussian hills, faded out on the pad at the start.

    They are scaled to [0, amp] m in the lane along x, 0.5 m wide, up to x = end.
    """
    x, y = grid.axes()
    rng = random_stream(seed, "terrain/hills")
    z = np.zeros((grid.ny, grid.nx))
    half = 0.5 * grid.cell * grid.ny
    for _ in range(N_HILLS):
        cx, cy = rng.uniform(PAD_END, grid.x0 + grid.nx * grid.cell), rng.uniform(-half, half)
        sigma, height = rng.uniform(*HILL_SIGMA), rng.uniform(0.3, 1.0)
        gx, gy = exp(-0.5 * ((x - cx) / sigma) ** 2), exp(-0.5 * ((y - cy) / sigma) ** 2)
        z += height * gx * gy
    lane = z[np.abs(y[:, 0]) <= CORRIDOR][:, (x[0] >= PAD_END + BLEND) & (x[0] <= end)]
    low, high = lane.min(), lane.max()
    z = np.clip((z - low) * (amp / max(high - low, 1e-9)), 0.0, amp)
    return z * smooth((x - PAD_END) / BLEND)


def _noise_field(grid: TerrainGrid, seed: int, amp: float) -> Array:
    """Return heights (ny, nx) m of noise: random nodes every 40 mm, smooth between, +-amp/2 m, zero on the pad."""
    x, y = grid.axes()
    rng = random_stream(seed, "terrain/rough")
    u, v = (x[0] - grid.x0) / NOISE_WAVE, (y[:, 0] - grid.y0) / NOISE_WAVE
    i, j = np.floor(u).astype(int), np.floor(v).astype(int)
    nodes = rng.uniform(-0.5 * amp, 0.5 * amp, (j[-1] + 2, i[-1] + 2))
    a, b = smooth(u - i)[None, :], smooth(v - j)[:, None]
    rows = nodes[:, i] * (1.0 - a) + nodes[:, i + 1] * a
    return (rows[j] * (1.0 - b) + rows[j + 1] * b) * smooth((x - PAD_END) / BLEND)


def _hills(r: ShapeSpec) -> Shape:
    z = _hill_field(r.grid, r.seed, r.amp)
    return Shape(z, z)


def _rough(r: ShapeSpec) -> Shape:
    z = _noise_field(r.grid, r.seed, r.amp)
    return Shape(z, z)


def _stairs(grid: TerrainGrid, first: float, riser: float) -> tuple[tuple[TerrainBox, ...], Array]:
    """Return the boxes of three steps that rise along x from `first` m on by `riser` m, and their tops (1, nx) m."""
    x, _ = grid.axes()
    end, half_y = grid.x0 + grid.nx * grid.cell, 0.5 * grid.cell * grid.ny
    boxes: list[TerrainBox] = []
    for k in range(N_RISERS):
        begin = first + k * TREAD
        half = (0.5 * (end - begin), half_y, 0.5 * (k + 1) * riser + 0.01)
        boxes.append(TerrainBox((0.5 * (end + begin), 0.0, (k + 1) * riser - half[2]), half))
    top = riser * np.clip(np.floor((x - first) / TREAD + 1e-9) + 1.0, 0.0, N_RISERS)
    return tuple(boxes), top


def _steps(r: ShapeSpec) -> Shape:
    boxes, top = _stairs(r.grid, PAD_END + BLEND, r.amp)
    return Shape(top, boxes=boxes)


def _flagstones(r: ShapeSpec) -> Shape:
    """Return tiles of 10 cm at random heights and slopes; the gaps of tilted tiles are closed by their depth."""
    x, y = r.grid.axes()
    rng = random_stream(r.seed, "terrain/flagstones")
    z = np.zeros((r.grid.ny, r.grid.nx))
    depth = 0.5 * r.amp + TILE * TILE_SLOPE + 0.01
    boxes: list[TerrainBox] = []
    n_x = math.floor((x[0, -1] - PAD_END) / TILE)
    n_y = math.ceil(-y[0, 0] / TILE)
    for i in range(n_x):
        for j in range(-n_y, n_y):
            corner = (PAD_END + i * TILE, j * TILE)
            height, sx, sy = rng.uniform(0.0, r.amp), *rng.uniform(-TILE_SLOPE, TILE_SLOPE, 2)
            middle = (corner[0] + 0.5 * TILE, corner[1] + 0.5 * TILE)
            boxes.append(slab(*middle, height, (float(sx), float(sy)), depth, (TILE, TILE)))
            cols = (x[0] >= corner[0]) & (x[0] < corner[0] + TILE)
            rows = (y[:, 0] >= corner[1]) & (y[:, 0] < corner[1] + TILE)
            dx, dy = x[:, cols] - corner[0] - 0.5 * TILE, y[rows] - corner[1] - 0.5 * TILE
            z[np.ix_(rows, cols)] = np.maximum(height + sx * dx + sy * dy, 0.0)
    return Shape(z, boxes=tuple(boxes))


def _primitive(r: ShapeSpec) -> Shape:
    """Return one of flat, slope, step edge, hill, ridge, hole, groove (1..7) about the origin; `yaw` turns it."""
    grid, amp, yaw = r.grid, r.amp, r.yaw
    x, y = grid.axes()
    u, v = math.cos(yaw) * x + math.sin(yaw) * y, -math.sin(yaw) * x + math.cos(yaw) * y
    sigma = 0.02  # m, size of hill, ridge, hole and groove: about two foot diameters
    shapes: tuple[Callable[[], Array], ...] = (
        lambda: np.zeros_like(u),
        lambda: amp * np.clip(u / 0.1, -1.0, 1.0),
        lambda: np.where(u >= -1e-9, amp, 0.0),
        lambda: amp * exp(-0.5 * (u * u + v * v) / sigma**2),
        lambda: amp * exp(-0.5 * (v / sigma) ** 2) * np.ones_like(u),
        lambda: -amp * exp(-0.5 * (u * u + v * v) / sigma**2),
        lambda: -amp * exp(-0.5 * (v / sigma) ** 2) * np.ones_like(u),
    )
    surface = np.broadcast_to(shapes[r.number - 1](), (grid.ny, grid.nx))
    if r.number == 1 or amp == 0.0:
        return Shape(surface)
    if r.number == 3:
        reach = grid.cell * max(grid.nx, grid.ny)
        centre = (0.5 * reach * math.cos(yaw), 0.5 * reach * math.sin(yaw), 0.5 * amp - 0.005)
        box = TerrainBox(
            centre, (0.5 * reach, reach, 0.5 * amp + 0.005), (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))
        )
        return Shape(surface, boxes=(box,))
    return Shape(surface, surface)


def _demo(r: ShapeSpec) -> Shape:
    """Return pad, hills with rough noise, three steps: everything on the first 1.5 m; `amp` scales all heights."""
    grid = r.grid
    x, _ = grid.axes()
    scale = r.amp / DEMO_HILLS
    fade = smooth((DEMO_STEPS_AT - x) / BLEND)
    hills = _hill_field(grid, r.seed, r.amp, DEMO_STEPS_AT - BLEND)
    z = fade * (hills + _noise_field(grid, r.seed, scale * DEMO_NOISE))
    boxes, top = _stairs(grid, DEMO_STEPS_AT, scale * DEMO_RISER)
    surface = np.where(top > 0.0, np.maximum(z, top), z)
    return Shape(surface, z, boxes)


def inside(outline: Outline, x: Array, y: Array) -> NDArray[np.bool_]:
    """Return True for the points that lie on a floor, not on its edge.

    Args:
        outline: corners of the floor, (x, y) m, map; its edges run along x and y.
        x: x of the points, m, any shape that broadcasts with `y`.
        y: y of the points, m.

    Returns:
        Flags in the shape to which `x` and `y` broadcast.
    """
    x, y = np.broadcast_arrays(x, y)
    found, edge = np.zeros(x.shape, dtype=np.bool_), np.zeros(x.shape, dtype=np.bool_)
    for (x0, y0), (x1, y1) in itertools.pairwise((*outline, outline[0])):
        low, high = min(y0, y1), max(y0, y1)
        if x0 == x1:
            found ^= (y >= low) & (y < high) & (x < x0)
        edge |= (x >= min(x0, x1)) & (x <= max(x0, x1)) & (y >= low) & (y <= high)
    return found & ~edge


def walls(outline: Outline, height: float) -> tuple[TerrainBox, ...]:
    """Return a wall outside of each edge of a floor; it also fills corners that point outwards.

    Args:
        outline: corners of the floor, counter-clockwise, (x, y) m, map; its edges run along x and y.
        height: height of the walls, m.
    """
    boxes: list[TerrainBox] = []
    for k in range(len(outline)):
        before, begin, end, after = (outline[(k + i) % len(outline)] for i in (-1, 0, 1, 2))
        length = abs(end[0] - begin[0]) + abs(end[1] - begin[1])
        along = ((end[0] - begin[0]) / length, (end[1] - begin[1]) / length)
        out = (along[1], -along[0])
        first = WALL if out[0] * (before[0] - begin[0]) + out[1] * (before[1] - begin[1]) < 0.0 else 0.0
        last = WALL if out[0] * (after[0] - end[0]) + out[1] * (after[1] - end[1]) < 0.0 else 0.0
        a = [begin[i] - first * along[i] for i in (0, 1)]
        b = [end[i] + last * along[i] + WALL * out[i] for i in (0, 1)]
        half = [0.5 * abs(b[i] - a[i]) for i in (0, 1)]
        centre = (0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * height)
        boxes.append(TerrainBox(centre, (half[0], half[1], 0.5 * height)))
    return tuple(boxes)


def _walled(outline: Outline) -> Callable[[ShapeSpec], Shape]:
    """Return a function that makes a level floor of this outline between walls of height `ShapeSpec.amp`, m."""

    def make(r: ShapeSpec) -> Shape:
        floor = np.where(inside(outline, *r.grid.axes()), 0.0, r.amp)
        return Shape(floor, boxes=walls(outline, r.amp) if r.amp > 0.0 else ())

    return make


class TerrainKind(NamedTuple):
    """One kind of terrain that a scenario may name: default amplitude, maker and least extent."""

    amp: float
    """Default size along z, m: range of heights of hills, rise of steps, height of walls; kind `slope`: slope dz/dx."""
    least_end: float
    """Least x up to which the map must reach, m; a shorter map is refused."""
    make: Callable[[ShapeSpec], Shape]
    floor: Outline = ()
    """Corners of the floor between walls, (x, y) m, frame `map`, counter-clockwise; empty = open ground without
    walls."""
    whole: bool = False
    """True: without a given size the map reaches to the outer faces of the walls, in cells of `WALLED_CELL`; False: it
    has the default size."""


SHAPES: dict[str, TerrainKind] = {
    "flat": TerrainKind(0.0, -math.inf, _flat),
    "slope": TerrainKind(math.tan(math.radians(15.0)), -math.inf, _slope),
    "hills": TerrainKind(0.06, 0.6, _hills),
    "rough": TerrainKind(0.02, 0.6, _rough),
    "steps": TerrainKind(0.025, 1.0, _steps),
    "flagstones": TerrainKind(0.03, 0.6, _flagstones),
    "primitive": TerrainKind(0.02, -math.inf, _primitive),
    "room": TerrainKind(0.5, ROOM[1][0] + WALL, _walled(ROOM), ROOM),
    "corridor": TerrainKind(0.5, -math.inf, _walled(CORRIDOR_FLOOR), CORRIDOR_FLOOR, whole=True),
    "corner": TerrainKind(0.5, -math.inf, _walled(CORNER_FLOOR), CORNER_FLOOR, whole=True),
    "mixed": TerrainKind(MIXED_HEIGHT, 0.6, mixed),
    "elevation": TerrainKind(ELEVATION_HEIGHT, 0.6, elevation),
    "demo": TerrainKind(DEMO_HILLS, DEMO_STEPS_AT + N_RISERS * TREAD, _demo),
}
