"""Terrains as pure functions of (kind, seed, amplitude, size, cell).

A terrain has two faces. `map` is the whole surface on a grid, what a mapper would measure. The physics stands on an
endless plane or a height field (`ground`) and on exact boxes: a vertical edge would become a one-cell ramp in a
height field. All in frame `map` = the simulated world: x forward, y left, z up, metres. The robot starts on the flat
pad about the origin.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from surefoot.heightmap import HeightMap
from surefoot.rotations import matrix_from_quat, quat_from_matrix

Array = NDArray[np.float64]
Kind = Literal["flat", "slope", "hills", "rough", "steps", "flagstones", "primitive", "demo"]
KINDS: tuple[str, ...] = get_args(Kind)
MapProfile = Literal["exact", "noise", "shifted"]
MAP_PROFILES: tuple[str, ...] = get_args(MapProfile)

PAD_END = 0.25  # m, the ground is flat for x below this: the feet of Ragno reach to .17 m ahead of the trunk centre
BLEND = 0.10  # m, over which hills grow behind the pad
CORRIDOR = 0.25  # m, half the width of the lane in which hills are scaled to their nominal height
N_HILLS = 40
HILL_SIGMA = (0.06, 0.18)  # m
NOISE_WAVE = 0.04  # m, distance of the nodes of the rough noise
TREAD = 0.25  # m
N_RISERS = 3
TILE = 0.10  # m, edge of a flagstone
TILE_SLOPE = 0.1
DEMO_HILLS = 0.06  # m, version 1 of the demo: highest hill in the lane,
DEMO_NOISE = 0.02  # m, rough noise from peak to peak,
DEMO_RISER = 0.025  # m, and three steps
DEMO_STEPS_AT = 0.95  # m, the first riser
MAP_NOISE = 0.003  # m, standard deviation of the height noise of the `noise` map
MAP_UNKNOWN = 0.01  # share of single cells without a height
MAP_HOLES_PER_M2 = 4.0  # and round patches without heights
MAP_HOLE_RADIUS = (0.01, 0.025)  # m
MAP_SHIFT = (0.010, 0.010, 0.005)  # m, standard deviations of the offset of the `shifted` map


class TerrainError(ValueError):
    """A terrain that cannot be made: `field` names what is wrong."""

    def __init__(self, field_name: str, message: str) -> None:
        super().__init__(f"{field_name}: {message}")
        self.field = field_name


@dataclass(frozen=True, eq=False)
class Box:
    """One solid box of the ground."""

    position: tuple[float, float, float]
    """Centre, m, frame `map`."""
    half_size: tuple[float, float, float]
    """Half edges, m."""
    quat_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    """rot_map_from_box."""


@dataclass(frozen=True, eq=False)
class Terrain:
    """Ground of a world."""

    kind: str
    seed: int
    amp: float
    """Height that the kind scales with, m (slope: rise per metre)."""
    map: HeightMap
    """The whole surface, exact at the cell centres."""
    ground: HeightMap | None = None
    """Height field of the physics; None: the endless plane through the origin with `normal`."""
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Unit normal of the plane where there is no height field."""
    boxes: tuple[Box, ...] = field(default=())

    @property
    def name(self) -> str:
        """Kind and seed, for tables."""
        return f"{self.kind}-{self.seed}"


def make_terrain(
    kind: str,
    seed: int = 0,
    amp: float | None = None,
    size: tuple[float, float] = (3.0, 1.6),
    cell: float = 0.005,
    start_x: float = -0.6,
    number: int = 1,
    yaw: float = 0.0,
) -> Terrain:
    """Make a terrain; equal arguments give equal bits.

    Args:
        kind: one of `KINDS`.
        seed: of the random kinds.
        amp: scale, m: hills highest hill, rough and flagstones height from peak to peak, steps riser, primitive
            height, demo highest hill (noise and risers grow with it), slope rise per metre. None = the kind's own.
        size: extent along x and y, m.
        cell: edge of a cell, m.
        start_x: x of the first column of cells, m; the rows lie symmetric about y = 0.
        number: which primitive, 1..7: flat, slope, step edge, hill, ridge, hole, groove.
        yaw: heading of the primitive, rad.

    Raises:
        TerrainError: unknown kind or impossible numbers.
    """
    if kind not in _KINDS:
        raise TerrainError("kind", f"got {kind!r}, known are {', '.join(KINDS)}")
    if not (math.isfinite(cell) and 0.0 < cell <= 0.1):
        raise TerrainError("cell", f"must be in (0, 0.1] m, got {cell!r}")
    if seed < 0:
        raise TerrainError("seed", f"must be >= 0, got {seed!r}")
    default, make = _KINDS[kind]
    amp = default if amp is None else float(amp)
    if not math.isfinite(amp) or amp < 0.0 or amp > 1.0:
        raise TerrainError("amp", f"must be in [0, 1], got {amp!r}")
    nx, ny = round(size[0] / cell) + 1, 2 * round(size[1] / (2.0 * cell)) + 1
    if not (4 <= nx <= 4000 and 4 <= ny <= 4000):
        raise TerrainError("size", f"must give 4 to 4000 cells a side, got {nx} x {ny} for {size!r} m")
    if kind == "primitive":
        if number not in range(1, 8):
            raise TerrainError("number", f"must be 1..7, got {number!r}")
        start_x = -0.5 * (nx - 1) * cell
    grid = _Grid(start_x, -0.5 * (ny - 1) * cell, nx, ny, cell)
    return make(grid, seed, amp, number, yaw)


def terrain_from_map(ground: HeightMap) -> Terrain:
    """A terrain that is one height field, such as a file; unknown cells become the lowest known height."""
    known = np.isfinite(ground.z)
    if not known.any():
        raise TerrainError("map", "has no known cell")
    z = np.where(known, ground.z, ground.z[known].min())
    full = ground.with_z(z.astype(np.float32))
    return Terrain("file", 0, float(np.ptp(z)), full, full)


def observed_map(terrain: Terrain, profile: str, seed: int) -> HeightMap:
    """What a mapper hands to the robot.

    Args:
        terrain: the true one.
        profile: `exact`; `noise`: 3 mm per cell and unknown cells; `shifted`: the whole map displaced.
        seed: of noise and shift.

    Raises:
        TerrainError: unknown profile.
    """
    if profile not in MAP_PROFILES:
        raise TerrainError("profile", f"got {profile!r}, known are {', '.join(MAP_PROFILES)}")
    exact = terrain.map
    if profile == "exact":
        return exact
    rng = random_stream(seed, f"map/{profile}")
    if profile == "shifted":
        dx, dy, dz = np.array(MAP_SHIFT) * rng.standard_normal(3)
        z = exact.z.astype(np.float64) + dz
        return replace(exact, z=z.astype(np.float32), origin=(exact.origin[0] + dx, exact.origin[1] + dy))
    z = exact.z + MAP_NOISE * rng.standard_normal(exact.shape)
    z[rng.random(exact.shape) < MAP_UNKNOWN] = np.nan
    x0, y0, x1, y1 = exact.bounds
    for _ in range(rng.poisson(MAP_HOLES_PER_M2 * (x1 - x0) * (y1 - y0))):
        x, y, r = rng.uniform(x0, x1), rng.uniform(y0, y1), rng.uniform(*MAP_HOLE_RADIUS)
        z[np.hypot(exact.xs()[None, :] - x, exact.ys()[:, None] - y) <= r] = np.nan
    return exact.with_z(z.astype(np.float32))


def random_stream(seed: int, name: str) -> np.random.Generator:
    """The random stream of one named part of the simulation: equal (seed, name) give equal numbers."""
    return np.random.default_rng([seed, *name.encode()])


@dataclass(frozen=True)
class _Grid:
    x0: float
    y0: float
    nx: int
    ny: int
    cell: float

    def axes(self) -> tuple[Array, Array]:
        """x (1, nx) and y (ny, 1) of the cell centres, for broadcasting."""
        return (
            (self.x0 + self.cell * np.arange(self.nx))[None, :],
            (self.y0 + self.cell * np.arange(self.ny))[:, None],
        )

    def map(self, z: Array) -> HeightMap:
        z = np.broadcast_to(z, (self.ny, self.nx))
        return HeightMap(z=z.astype(np.float32), cell=self.cell, origin=(self.x0, self.y0))


def _smooth(u: Array) -> Array:
    """3u^2 - 2u^3, clipped to [0, 1]."""
    u = np.clip(u, 0.0, 1.0)
    return u * u * (3.0 - 2.0 * u)


def _flat(grid: _Grid, seed: int, amp: float, number: int, yaw: float) -> Terrain:
    return Terrain("flat", seed, 0.0, grid.map(np.zeros((1, 1))))


def _slope(grid: _Grid, seed: int, amp: float, number: int, yaw: float) -> Terrain:
    x, _ = grid.axes()
    n = math.hypot(1.0, amp)
    return Terrain("slope", seed, amp, grid.map(amp * x), normal=(-amp / n, 0.0, 1.0 / n))


def _hill_field(grid: _Grid, seed: int, amp: float) -> Array:
    """Sum of 40 Gaussians, scaled to [0, amp] in the lane and faded out on the pad. (ny, nx)"""
    x, y = grid.axes()
    rng = random_stream(seed, "terrain/hills")
    z = np.zeros((grid.ny, grid.nx))
    half = 0.5 * grid.cell * grid.ny
    for _ in range(N_HILLS):
        cx, cy = rng.uniform(PAD_END, grid.x0 + grid.nx * grid.cell), rng.uniform(-half, half)
        sigma, height = rng.uniform(*HILL_SIGMA), rng.uniform(0.3, 1.0)
        gx, gy = np.exp(-0.5 * ((x - cx) / sigma) ** 2), np.exp(-0.5 * ((y - cy) / sigma) ** 2)
        z += height * gx * gy
    lane = z[np.abs(y[:, 0]) <= CORRIDOR][:, x[0] >= PAD_END + BLEND]
    low, high = lane.min(), lane.max()
    z = np.clip((z - low) * (amp / max(high - low, 1e-9)), 0.0, amp)
    return z * _smooth((x - PAD_END) / BLEND)


def _noise_field(grid: _Grid, seed: int, amp: float) -> Array:
    """Value noise: random nodes every 40 mm, smooth between, +-amp/2, zero on the pad. (ny, nx)"""
    x, y = grid.axes()
    rng = random_stream(seed, "terrain/rough")
    u, v = (x[0] - grid.x0) / NOISE_WAVE, (y[:, 0] - grid.y0) / NOISE_WAVE
    i, j = np.floor(u).astype(int), np.floor(v).astype(int)
    nodes = rng.uniform(-0.5 * amp, 0.5 * amp, (j[-1] + 2, i[-1] + 2))
    a, b = _smooth(u - i)[None, :], _smooth(v - j)[:, None]
    rows = nodes[:, i] * (1.0 - a) + nodes[:, i + 1] * a
    return (rows[j] * (1.0 - b) + rows[j + 1] * b) * _smooth((x - PAD_END) / BLEND)


def _hills(grid: _Grid, seed: int, amp: float, number: int, yaw: float) -> Terrain:
    ground = grid.map(_hill_field(grid, seed, amp))
    return Terrain("hills", seed, amp, ground, ground)


def _rough(grid: _Grid, seed: int, amp: float, number: int, yaw: float) -> Terrain:
    ground = grid.map(_noise_field(grid, seed, amp))
    return Terrain("rough", seed, amp, ground, ground)


def _stairs(grid: _Grid, first: float, riser: float) -> tuple[tuple[Box, ...], Array]:
    """Boxes of N_RISERS steps that rise along x and the height of their tops over the grid (1, nx)."""
    x, _ = grid.axes()
    end, half_y = grid.x0 + grid.nx * grid.cell, 0.5 * grid.cell * grid.ny
    boxes: list[Box] = []
    for k in range(N_RISERS):
        begin = first + k * TREAD
        half = (0.5 * (end - begin), half_y, 0.5 * (k + 1) * riser + 0.01)
        boxes.append(Box((0.5 * (end + begin), 0.0, (k + 1) * riser - half[2]), half))
    top = riser * np.clip(np.floor((x - first) / TREAD + 1e-9) + 1.0, 0.0, N_RISERS)
    return tuple(boxes), top


def _steps(grid: _Grid, seed: int, amp: float, number: int, yaw: float) -> Terrain:
    boxes, top = _stairs(grid, PAD_END + BLEND, amp)
    return Terrain("steps", seed, amp, grid.map(top), boxes=boxes)


def _flagstones(grid: _Grid, seed: int, amp: float, number: int, yaw: float) -> Terrain:
    """Tiles of 10 cm at random heights and slopes; the gaps of tilted tiles are closed by their depth."""
    x, y = grid.axes()
    rng = random_stream(seed, "terrain/flagstones")
    z = np.zeros((grid.ny, grid.nx))
    depth = 0.5 * amp + TILE * TILE_SLOPE + 0.01
    boxes: list[Box] = []
    n_x = math.floor((x[0, -1] - PAD_END) / TILE)
    n_y = math.ceil(-y[0, 0] / TILE)
    for i in range(n_x):
        for j in range(-n_y, n_y):
            corner = (PAD_END + i * TILE, j * TILE)
            height, sx, sy = rng.uniform(0.0, amp), *rng.uniform(-TILE_SLOPE, TILE_SLOPE, 2)
            boxes.append(_tile(corner, height, float(sx), float(sy), depth))
            cols = (x[0] >= corner[0]) & (x[0] < corner[0] + TILE)
            rows = (y[:, 0] >= corner[1]) & (y[:, 0] < corner[1] + TILE)
            dx, dy = x[:, cols] - corner[0] - 0.5 * TILE, y[rows] - corner[1] - 0.5 * TILE
            z[np.ix_(rows, cols)] = np.maximum(height + sx * dx + sy * dy, 0.0)
    return Terrain("flagstones", seed, amp, grid.map(z), boxes=tuple(boxes))


def _tile(corner: tuple[float, float], height: float, slope_x: float, slope_y: float, depth: float) -> Box:
    """A box whose top face has the given height and slopes over the middle of its square."""
    normal = np.array([-slope_x, -slope_y, 1.0]) / math.sqrt(1.0 + slope_x**2 + slope_y**2)
    along_x = np.array([normal[2], 0.0, -normal[0]]) / math.hypot(normal[0], normal[2])
    rot = np.column_stack((along_x, np.cross(normal, along_x), normal))
    top = np.array([corner[0] + 0.5 * TILE, corner[1] + 0.5 * TILE, height])
    centre = top - depth * normal
    half = (0.5 * TILE / along_x[0], 0.5 * TILE / rot[1, 1], depth)
    q = quat_from_matrix(rot)
    return Box((centre[0], centre[1], centre[2]), half, (q[0], q[1], q[2], q[3]))


def _primitive(grid: _Grid, seed: int, amp: float, number: int, yaw: float) -> Terrain:
    """Flat, slope, step edge, hill, ridge, hole, groove about the origin; `yaw` turns them."""
    x, y = grid.axes()
    u, v = math.cos(yaw) * x + math.sin(yaw) * y, -math.sin(yaw) * x + math.cos(yaw) * y
    sigma = 0.02  # m, size of hill, ridge, hole and groove: about two foot diameters
    shapes: tuple[Callable[[], Array], ...] = (
        lambda: np.zeros_like(u),
        lambda: amp * np.clip(u / 0.1, -1.0, 1.0),
        lambda: amp * (u >= 0.0),
        lambda: amp * np.exp(-0.5 * (u * u + v * v) / sigma**2),
        lambda: amp * np.exp(-0.5 * (v / sigma) ** 2) * np.ones_like(u),
        lambda: -amp * np.exp(-0.5 * (u * u + v * v) / sigma**2),
        lambda: -amp * np.exp(-0.5 * (v / sigma) ** 2) * np.ones_like(u),
    )
    surface = grid.map(shapes[number - 1]())
    if number == 1 or amp == 0.0:
        return Terrain("primitive", seed, amp, surface)
    if number == 3:
        reach = grid.cell * max(grid.nx, grid.ny)
        centre = (0.5 * reach * math.cos(yaw), 0.5 * reach * math.sin(yaw), 0.5 * amp - 0.005)
        box = Box(centre, (0.5 * reach, reach, 0.5 * amp + 0.005), (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)))
        return Terrain("primitive", seed, amp, surface, boxes=(box,))
    return Terrain("primitive", seed, amp, surface, surface)


def _demo(grid: _Grid, seed: int, amp: float, number: int, yaw: float) -> Terrain:
    """Pad, hills with rough noise, three steps: everything on the first 1.5 m; `amp` scales all heights."""
    x, _ = grid.axes()
    scale = amp / DEMO_HILLS
    fade = _smooth((DEMO_STEPS_AT - x) / BLEND)
    z = fade * (_hill_field(grid, seed, amp) + _noise_field(grid, seed, scale * DEMO_NOISE))
    boxes, top = _stairs(grid, DEMO_STEPS_AT, scale * DEMO_RISER)
    surface = np.where(top > 0.0, np.maximum(z, top), z)
    return Terrain("demo", seed, amp, grid.map(surface), grid.map(z), boxes=boxes)


def box_top(box: Box, x: Array, y: Array) -> Array:
    """Height of a box's top face over the points (x, y), NaN beside it; m."""
    rot = matrix_from_quat(np.array(box.quat_wxyz))
    top = np.array(box.position) + box.half_size[2] * rot[:, 2]
    dx, dy = x - top[0], y - top[1]
    z = top[2] - (rot[0, 2] * dx + rot[1, 2] * dy) / rot[2, 2]
    rel = np.stack((dx, dy, z - top[2]), axis=-1) @ rot
    inside = (np.abs(rel[..., 0]) <= box.half_size[0]) & (np.abs(rel[..., 1]) <= box.half_size[1])
    return np.where(inside, z, np.nan)


_KINDS: dict[str, tuple[float, Callable[[_Grid, int, float, int, float], Terrain]]] = {
    "flat": (0.0, _flat),
    "slope": (math.tan(math.radians(15.0)), _slope),
    "hills": (0.06, _hills),
    "rough": (0.02, _rough),
    "steps": (0.025, _steps),
    "flagstones": (0.03, _flagstones),
    "primitive": (0.02, _primitive),
    "demo": (DEMO_HILLS, _demo),
}
