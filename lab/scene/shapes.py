"""Drawable shape of a robot: points on its links, with limbs, balls, faces and meshes on them; and a coarse ground."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import foot_positions

from .surfaces import surfaces_of

TRUNK, LEG, SERVO, FOOT, NOSE = "#3d5a80", "#9fb3c8", "#46566a", "#2b3a4a", "#ee9b3a"
"""Colours of the drawn parts of the robot, `#rrggbb`; `LEG`: limbs; `SERVO`: balls at the joints; `NOSE`: arrow on the
trunk that points forward."""
THIN, THICK = 0.012, 0.045
"""`THIN`: smallest radius of a drawn leg segment, as a share of the robot's extent; `THICK`: largest one."""
ROUND = 1.5
"""Ratio of longest to shortest edge of a last link's inertia box below which the link is drawn as a ball."""
MOST_CELLS = 14_000
"""Largest number of ground cells that are drawn; a larger grid is made coarser, as each new view redraws all cells."""


class Limb(NamedTuple):
    """Segment of a robot's shape between two points, by their indices, with a radius, m, and a colour."""

    begin: int
    end: int
    radius: float
    colour: str


class Ball(NamedTuple):
    """Sphere of a robot's shape about a point, by its index, with a radius, m, and a colour."""

    at: int
    radius: float
    colour: str


class Face(NamedTuple):
    """Flat polygon of a robot's shape: indices of its points, counter-clockwise seen from outside, and a colour."""

    corners: tuple[int, ...]
    colour: str


class DrawnMesh(NamedTuple):
    """Triangles of a robot's shape on one link.

    Attributes:
        frame: indices of four points: origin of the link, and the points 1 m from it along its axes x, y, z.
        vertices: (n, 3) m, frame of the link.
        triangles: (m, 3) indices of vertices, counter-clockwise seen from outside.
        colour: `#rrggbb`.
    """

    frame: tuple[int, int, int, int]
    vertices: Array
    triangles: NDArray[np.int64]
    colour: str

    def placed(self, points: Array) -> Array:
        """Return the vertices (n, 3) m in the frame of the body's points (k, 3) m."""
        origin, *tips = points[list(self.frame)]
        return origin + self.vertices @ (np.array(tips) - origin)


class Body(NamedTuple):
    """Shape of a robot: a link has the meshes with which it was imported, else limbs, balls and faces.

    Attributes:
        link: link that carries each point, (n,).
        local: place of each point in its link, (n, 3) m.
        limbs, balls, faces, meshes: drawn parts, which refer to the points by index.
        extent: size of the robot at its neutral posture, m.
        solid: number of points that lie on drawn parts; those after them are of the frames of meshes.
        notes: a sentence on links whose meshes cannot be drawn, if there are any.
    """

    link: NDArray[np.int64]
    local: Array
    limbs: tuple[Limb, ...]
    balls: tuple[Ball, ...]
    faces: tuple[Face, ...]
    meshes: tuple[DrawnMesh, ...]
    extent: float
    solid: int
    notes: tuple[str, ...]


class DrawnGround(NamedTuple):
    """Ground to be drawn: heights (ny, nx) m, NaN = unknown, edge of a cell, m, and centre (x, y) m of cell [0, 0]."""

    heights: Array
    cell: float
    origin: tuple[float, float]

    def at(self, places: Array) -> Array:
        """Return the height of the cell at each place (n, 2) m, (n,); 0 where it is unknown."""
        index = np.round((places - self.origin) / self.cell).astype(int)
        rows, cols = np.clip(index[:, 1], 0, len(self.heights) - 1), np.clip(index[:, 0], 0, self.heights.shape[1] - 1)
        return np.nan_to_num(self.heights[rows, cols])

    def coarse(self, most: int = MOST_CELLS) -> "DrawnGround":
        """Return the ground with at most `most` cells, each the mean of the known cells that it covers."""
        step = max(1, int(np.ceil(np.sqrt(self.heights.size / most))))
        if step == 1:
            return self
        rows, cols = (n // step for n in self.heights.shape)
        blocks = self.heights[: rows * step, : cols * step].reshape(rows, step, cols, step)
        known = np.isfinite(blocks)
        count = known.sum(axis=(1, 3))
        mean = np.where(known, blocks, 0.0).sum(axis=(1, 3)) / np.maximum(count, 1)
        shift = 0.5 * (step - 1) * self.cell
        heights = np.where(count > 0, mean, np.nan)
        return DrawnGround(heights, step * self.cell, (self.origin[0] + shift, self.origin[1] + shift))


class _Points:
    """Collector of the points of a robot's shape, which keeps each distinct point once."""

    def __init__(self) -> None:
        self.found: dict[tuple[int, tuple[float, ...]], int] = {}

    def add(self, link: int, local: Array) -> int:
        """Return the index of a point of a link, position (3,) m in the link's axes; a new point is added."""
        place = tuple(round(float(x), 6) + 0.0 for x in local)
        return self.found.setdefault((link, place), len(self.found))


def body_of(robot: Robot) -> Body:
    """Return the shape of a robot: balls at its feet; meshes, else a trunk, segments of links and balls at joints."""
    points, limbs, balls = _Points(), list[Limb](), list[Ball]()
    feet = foot_positions(robot.model, robot.neutral)
    extent = float(np.ptp(np.vstack((feet, robot.trunk.box / 2.0, -robot.trunk.box / 2.0)), axis=0).max())
    surfaces, notes = surfaces_of(robot, extent)
    covered = {surface.link for surface in surfaces}
    faces = [] if 0 in covered else _trunk(points, robot)
    for number in range(1, len(robot.links)):
        if number not in covered:
            _add_link(points, robot, number, extent, (limbs, balls))
    for leg in robot.legs:
        corners = [points.add(leg.foot.link, point) for point in leg.foot.points]
        balls += [Ball(corner, leg.foot.radius, FOOT) for corner in corners]
        if len(corners) > 2:
            around = leg.foot.points - leg.foot.points.mean(axis=0)
            order = np.argsort(np.arctan2(around[:, 1], around[:, 0]))
            faces.append(Face(tuple(corners[i] for i in order), FOOT))
    solid, meshes = len(points.found), list[DrawnMesh]()
    for surface in surfaces:
        o, x, y, z = (points.add(surface.link, tip) for tip in np.vstack((np.zeros(3), np.eye(3))))
        meshes.append(DrawnMesh((o, x, y, z), surface.vertices, surface.triangles, LEG if surface.link else TRUNK))
    carried = list(points.found)
    return Body(
        np.array([link for link, _ in carried]), np.array([local for _, local in carried]),
        tuple(limbs), tuple(balls), tuple(faces), tuple(meshes), extent, solid, notes,
    )  # fmt: skip


def _add_link(points: _Points, robot: Robot, number: int, extent: float, to: tuple[list[Limb], list[Ball]]) -> None:
    """Add segments and balls of a link without meshes, by its index, to those of a robot of size `extent`, m."""
    limbs, balls = to
    link = robot.links[number]
    radius = float(np.clip(0.45 * link.inertia_box.min(), THIN * extent, THICK * extent))
    origin = points.add(number, np.zeros(3))
    balls.append(Ball(origin, 1.25 * radius if link.joint >= 0 else radius, SERVO))
    ends = [child.position for child in robot.links if child.parent == number]
    ends += [leg.foot.position for leg in robot.legs if leg.foot.link == number]
    if not ends and link.inertia_box.max() < ROUND * link.inertia_box.min():  # a head
        balls.append(Ball(points.add(number, link.com), 0.5 * float(link.inertia_box.mean()), LEG))
        return
    for end in ends or [2.0 * link.com]:
        if np.linalg.norm(end) > radius:
            limbs.append(Limb(origin, points.add(number, end), radius, LEG))


def outline_of(box: Array) -> Array:
    """Return one line along all edges of a box of edges (3,) m about the origin, (16, 3) m."""
    ends = [
        (0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 0, 0), (1, 0, 1),
        (1, 1, 1), (1, 1, 0), (1, 1, 1), (0, 1, 1), (0, 1, 0), (0, 1, 1), (0, 0, 1),
    ]  # fmt: skip
    return (np.array(ends) - 0.5) * box


def _trunk(points: _Points, robot: Robot) -> list[Face]:
    """Return the faces of the trunk, a box with its upright edges cut, and an arrow on top that points forward."""
    half = robot.trunk.box / 2.0
    cut = 0.45 * half[:2].min()
    x, y = half[0], half[1]
    outline = [
        (x, cut - y), (x, y - cut), (x - cut, y), (cut - x, y),
        (-x, y - cut), (-x, cut - y), (cut - x, -y), (x - cut, -y),
    ]  # fmt: skip
    low, high = ([points.add(0, np.array([*place, z])) for place in outline] for z in (-half[2], half[2]))
    sides = [(low[i], low[(i + 1) % 8], high[(i + 1) % 8], high[i]) for i in range(8)]
    top, size = 1.01 * half[2], 0.45 * half[1]
    nose = [(x - 0.3 * size, 0.0), (x - 1.3 * size, 0.7 * size), (x - 1.3 * size, -0.7 * size)]
    arrow = tuple(points.add(0, np.array([*place, top])) for place in nose)
    return [
        Face(tuple(high), TRUNK),
        Face(tuple(low[::-1]), TRUNK),
        *(Face(side, TRUNK) for side in sides),
        Face(arrow, NOSE),
    ]
