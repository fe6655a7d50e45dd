"""Terrains as pure functions of (kind, seed, amplitude, size, cell).

A terrain is described twice. `map` is the whole surface on a grid, what a mapper would measure. The physics stands on
an endless plane or a height field (`ground`) and on exact boxes: a vertical edge would become a one-cell ramp in a
height field. All in frame `map` = the simulated world: x forward, y left, z up, metres. The robot starts on the flat
pad about the origin.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import InvalidField
from surefoot.geometry.heightmap import HeightMap
from surefoot.geometry.rotations import quat_from_rotvec
from surefoot.tables import UNIT_SLACK

from .grid import ShapeSpec, TerrainBox, TerrainGrid, random_stream, slab
from .shapes import SHAPES, WALL, WALLED_CELL, Outline, TerrainKind, inside

__all__ = [
    "KINDS",
    "MAP_PROFILES",
    "Terrain",
    "TerrainBox",
    "TerrainError",
    "make_terrain",
    "observed_map",
    "random_stream",
    "terrain_from_map",
]

KINDS = tuple(SHAPES)
MAP_PROFILES = ("exact", "noise", "shifted")

OWN_SIZE = (3.0, 1.6)  # m, of a map along x and y
OWN_CELL = 0.005  # m

MAP_NOISE = 0.003  # m, standard deviation of the height noise of the `noise` map
MAP_UNKNOWN = 0.01  # share of single cells without a height
MAP_HOLES_PER_M2 = 4.0  # 1/m2, round patches without heights
MAP_HOLE_RADIUS = (0.01, 0.025)  # m
MAP_SHIFT = (0.010, 0.010, 0.005)  # m, standard deviations of the offset of the `shifted` map


class TerrainError(InvalidField):
    """Refusal of a terrain that cannot be made; `field` names the wrong argument."""


@dataclass(frozen=True, eq=False)
class Terrain:
    """Ground of a simulated world: height field, boxes, map, friction."""

    kind: str
    seed: int
    amp: float
    """Amplitude with which all heights of the kind scale, m; for kind `slope` the slope dz/dx, no unit."""
    map: HeightMap
    """Heights of the whole surface, exact at the cell centres, m, frame `map`."""
    ground: HeightMap | None = None
    """Height field on which the physics stands; None: the endless plane through the origin with `normal`."""
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Unit normal of the plane on which the physics stands, frame `map`; used without a height field."""
    boxes: tuple[TerrainBox, ...] = ()
    floor: Outline = ()
    """Corners of the floor between walls, (x, y) m, frame `map`, counter-clockwise; empty = open ground without
    walls."""

    def on_floor(self, points: Array) -> NDArray[np.bool_]:
        """Return True for the points (n, 2) m, map, that are not in or behind a wall, (n,)."""
        return inside(self.floor, points[:, 0], points[:, 1]) if self.floor else np.ones(len(points), dtype=np.bool_)

    @property
    def name(self) -> str:
        """Name of the terrain for tables: its kind and seed."""
        return f"{self.kind}-{self.seed}"

    @property
    def quat_wxyz(self) -> Array:
        """Shortest rotation that turns z onto the plane's normal, (4,) (raises TerrainError: no upward unit vector)."""
        nx, ny, nz = self.normal
        if not (nz > 0.0 and abs(nx * nx + ny * ny + nz * nz - 1.0) < UNIT_SLACK):
            raise TerrainError("normal", f"got {self.normal!r}, expected an upward unit vector")
        sine = math.hypot(nx, ny)
        if sine == 0.0:
            return np.array([1.0, 0.0, 0.0, 0.0])
        return quat_from_rotvec(np.array([-ny, nx, 0.0]) * (math.atan2(sine, nz) / sine))


def make_terrain(
    kind: str,
    seed: int = 0,
    amp: float | None = None,
    size: tuple[float, float] | None = None,
    cell: float | None = None,
    start_x: float = -0.6,
    number: int = 1,
    yaw: float = 0.0,
) -> Terrain:
    """Return a terrain; equal arguments give equal bits.

    Args:
        kind: one of `KINDS`.
        seed: seed of the random kinds.
        amp: scale, m: hills highest hill, rough and flagstones height from peak to peak, steps riser, primitive
            height, demo highest hill (noise and risers grow with it), mixed and elevation highest point, slope rise per
            metre. None = the kind's own.
        size: extent along x and y, m; None = 3.0 x 1.6 m, or the whole of a corridor or corner with its walls.
        cell: edge of a cell, m; None = 5 mm, 10 mm for the whole of a corridor or corner.
        start_x: x of the first column of cells, m; the rows lie symmetric about y = 0.
        number: which primitive, 1..7: flat, slope, step edge, hill, ridge, hole, groove.
        yaw: heading of the primitive, rad.

    Raises:
        TerrainError: unknown kind or impossible numbers, or the data of the kind is not installed.
    """
    if kind not in SHAPES:
        raise TerrainError("kind", f"got {kind!r}, known are {', '.join(KINDS)}")
    whole = SHAPES[kind].whole and size is None
    cell = (WALLED_CELL if whole else OWN_CELL) if cell is None else cell
    if not (math.isfinite(cell) and 0.0 < cell <= 0.1):
        raise TerrainError("cell", f"must be in (0, 0.1] m, got {cell!r}")
    if seed < 0:
        raise TerrainError("seed", f"must be >= 0, got {seed!r}")
    known = SHAPES[kind]
    amp = known.amp if amp is None else float(amp) + 0.0  # no -0, which random numbers do not take
    if not math.isfinite(amp) or amp < 0.0 or amp > 1.0:
        raise TerrainError("amp", f"must be in [0, 1], got {amp!r}")
    size = size or OWN_SIZE
    nx, ny = round(size[0] / cell) + 1, 2 * round(size[1] / (2.0 * cell)) + 1
    if not (4 <= nx <= 4000 and 4 <= ny <= 4000):
        raise TerrainError("size", f"must give 4 to 4000 cells a side, got {nx} x {ny} for {size!r} m")
    if kind == "primitive":
        if number not in range(1, 8):
            raise TerrainError("number", f"must be 1..7, got {number!r}")
        start_x = -0.5 * (nx - 1) * cell
    if start_x + size[0] < known.least_end:
        raise TerrainError("size", f"{kind} needs ground up to x = {known.least_end} m, got {start_x + size[0]:g} m")
    grid = _around(known, cell) if whole else TerrainGrid(start_x, -0.5 * (ny - 1) * cell, nx, ny, cell)
    try:
        shape = known.make(ShapeSpec(grid, seed, amp, number, yaw))
    except FileNotFoundError as error:
        raise TerrainError("kind", f"{kind} cannot be made here: {error}") from None
    surface = _map(grid, shape.surface)
    ground = None if shape.ground is None else surface if shape.ground is shape.surface else _map(grid, shape.ground)
    return Terrain(kind, seed, amp, surface, ground, shape.normal, shape.boxes, known.floor)


def _around(kind: TerrainKind, cell: float) -> TerrainGrid:
    """Return the cells, `cell` m wide, of a grid that reaches over a walled floor to the outer faces of its walls."""
    (x0, x1), (y0, y1) = ((min(side) - WALL, max(side) + WALL) for side in zip(*kind.floor, strict=True))
    return TerrainGrid(x0, y0, round((x1 - x0) / cell) + 1, round((y1 - y0) / cell) + 1, cell)


def _map(grid: TerrainGrid, z: Array) -> HeightMap:
    z = np.broadcast_to(z, (grid.ny, grid.nx))
    return HeightMap(z=z.astype(np.float32), cell=grid.cell, origin=(grid.x0, grid.y0))


def terrain_from_map(ground: HeightMap) -> Terrain:
    """Return a terrain that is one height field, such as a file; unknown cells become the lowest known height.

    Raises:
        TerrainError: no cell is known.
    """
    known = np.isfinite(ground.z)
    if not known.any():
        raise TerrainError("map", "has no known cell")
    z = np.where(known, ground.z, ground.z[known].min())
    full = ground.with_z(z.astype(np.float32))
    return Terrain("file", 0, float(np.ptp(z)), full, full)


def observed_map(terrain: Terrain, profile: str, seed: int) -> HeightMap:
    """Return the height map that the robot gets: the true one, or with errors of the kind that a mapper makes.

    Args:
        terrain: the true ground.
        profile: `exact`; `noise`: 3 mm per cell and unknown cells; `shifted`: the whole map displaced.
        seed: seed of noise and shift.

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


def rehearse() -> None:
    """Call the kernels of sloping ground and turned slabs once with made-up arguments, so that they are loaded."""
    quat_from_rotvec(np.zeros(3))
    slab(0.0, 0.0, 0.0, slope=(0.0, 0.0), depth=1.0, edges=(1.0, 1.0), yaw=1.0)
