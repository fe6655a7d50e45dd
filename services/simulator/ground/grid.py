"""Parts of shapes of the ground: a grid, boxes, and the flat pad on which the robot starts."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.linear import product
from surefoot.geometry.rotations import matrix_from_quat, multiply, quat_from_matrix, quat_from_rpy

PAD_END = 0.25  # m, the ground is flat for x below this: the feet of Ragno reach to .17 m ahead of the trunk centre
BLEND = 0.10  # m, over which hills grow behind the pad
CORRIDOR = 0.25  # m, half the width of the lane in which hills are scaled to their nominal height


@dataclass(frozen=True, eq=False)
class TerrainBox:
    """Solid box that is part of the ground, placed and turned in frame `map`."""

    position: tuple[float, float, float]
    """Centre of the box, (x, y, z) m, frame `map`."""
    half_size: tuple[float, float, float]
    """Half lengths of the edges along the box's own x, y, z, m."""
    quat_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    """Rotation from the box's axes to frame `map` as a unit quaternion w, x, y, z."""


class Shape(NamedTuple):
    """Result of a terrain's shape function: its surface, and what the physics stands on; heights in m, (ny, nx)."""

    surface: Array
    ground: Array | None = None
    """Height field on which the physics stands, (ny, nx) m; None = the plane through the origin."""
    boxes: tuple[TerrainBox, ...] = ()
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Unit normal of the plane on which the physics stands, frame `map`; used without a height field."""


def random_stream(seed: int, name: str) -> np.random.Generator:
    """Return the random stream of one named part of the simulation: equal (seed, name) give equal numbers."""
    return np.random.default_rng([seed, *name.encode()])


@dataclass(frozen=True)
class TerrainGrid:
    """Cells of a map: centre (x0, y0) of the first, nx along x, ny along y, edge `cell`; lengths in m, frame `map`."""

    x0: float
    y0: float
    nx: int
    ny: int
    cell: float

    def axes(self) -> tuple[Array, Array]:
        """Return x (1, nx) and y (ny, 1) of the cell centres, m, for broadcasting."""
        return (
            (self.x0 + self.cell * np.arange(self.nx, dtype=np.float64))[None, :],
            (self.y0 + self.cell * np.arange(self.ny, dtype=np.float64))[:, None],
        )


@dataclass(frozen=True)
class ShapeSpec:
    """Arguments of a terrain's shape: equal ones give equal ground.

    `amp` is the scale of the kind (mostly its highest point, m), `number` the primitive of a kind that has several,
    1..7, `yaw` its heading, rad.
    """

    grid: TerrainGrid
    seed: int
    amp: float
    number: int
    yaw: float


def smooth(u: Array) -> Array:
    """Return 3u^2 - 2u^3 with u, of any shape, no unit, clipped to [0, 1]."""
    u = np.clip(u, 0.0, 1.0)
    return u * u * (3.0 - 2.0 * u)


def slab(
    x: float, y: float, height: float, slope: tuple[float, float], depth: float, edges: tuple[float, float],
    yaw: float = 0.0,
) -> TerrainBox:  # fmt: skip
    """Return a box whose top face has the given height over its middle (x, y).

    Args:
        x: x of the middle of the top face, m, map.
        y: y of the middle of the top face, m.
        height: height of the top face, m.
        slope: rise per metre along x and y of the box.
        depth: half the thickness, m.
        edges: lengths of the edges of the top face seen from above, along x and y of the box, m.
        yaw: heading of the box's x, rad.
    """
    slope_x, slope_y = slope
    normal = np.array([-slope_x, -slope_y, 1.0]) / math.sqrt(1.0 + slope_x**2 + slope_y**2)
    along_x = np.array([normal[2], 0.0, -normal[0]]) / math.hypot(normal[0], normal[2])
    rot = np.column_stack((along_x, np.cross(normal, along_x), normal))
    centre = np.array([x, y, height]) - depth * normal
    half = (0.5 * edges[0] / along_x[0], 0.5 * edges[1] / rot[1, 1], depth)
    q = quat_from_matrix(rot)
    if yaw != 0.0:
        turn = quat_from_rpy(0.0, 0.0, yaw)
        q, centre = multiply(turn, q), np.array([x, y, height]) - depth * product(matrix_from_quat(turn), normal)
    return TerrainBox((centre[0], centre[1], centre[2]), half, (q[0], q[1], q[2], q[3]))


def box_heights(box: TerrainBox, x: Array, y: Array) -> Array:
    """Return the height, m, of the highest point of a box over each point, -inf beside it.

    A vertical line meets the box where it is within the three pairs of faces at once.

    Args:
        box: may be turned in any way.
        x: x of the points, m, map, any shape that broadcasts with `y`.
        y: y of the points, m, map.

    Returns:
        Heights in the shape to which `x` and `y` broadcast, m.
    """
    rot = matrix_from_quat(np.array(box.quat_wxyz))
    dx, dy = np.broadcast_arrays(x - box.position[0], y - box.position[1])
    top, bottom, beside = np.full(dx.shape, np.inf), np.full(dx.shape, -np.inf), np.zeros(dx.shape, dtype=np.bool_)
    for axis in range(3):
        across, up, half = dx * rot[0, axis] + dy * rot[1, axis], float(rot[2, axis]), box.half_size[axis]
        if abs(up) < 1e-9:
            beside |= np.abs(across) > half
            continue
        ends = (half - across) / up, (-half - across) / up
        top, bottom = np.minimum(top, np.maximum(*ends)), np.maximum(bottom, np.minimum(*ends))
    return np.where(beside | (top < bottom), -np.inf, box.position[2] + top)
