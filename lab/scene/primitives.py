"""Shapes in Foxglove's well-known messages: parts of the robot, items beside it, the ground, clouds of points."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import SurefootError
from surefoot.geometry.rotations import quat_from_matrix

from .scene import UP
from .shapes import Body, DrawnGround
from .styles import STYLES, Item

INSTALL = "pip install 'surefoot[foxglove]'"
GROUND_COLOUR = "#b9bfb4"
AROUND, APART = 8, 0.012
"""`AROUND`: number of points on a circle around a limb or ball in the robot's point clouds; `APART`: distance between
points along limbs and faces, as a share of the robot's extent."""


def sdk() -> Any:
    """Return the module `foxglove` (raises SurefootError with the command that installs it)."""
    try:
        import foxglove
        import foxglove.channels
        import foxglove.messages
    except ImportError:
        raise SurefootError("not_installed", f"Foxglove's messages need their library: {INSTALL}", "to") from None
    return foxglove


class Primitives:
    """Maker of Foxglove messages of times, poses and shapes."""

    def __init__(self) -> None:
        self.messages = sdk().messages

    def time(self, stamp_ns: int) -> Any:
        """Return the Foxglove Timestamp message of a simulated time in ns."""
        return self.messages.Timestamp(*divmod(stamp_ns, 1_000_000_000))

    def pose(self, position: Array, rot: Array) -> Any:
        """Return the Foxglove Pose message of a position (3,) m and a rotation matrix (3, 3)."""
        return self.messages.Pose(position=self.vector(position), orientation=self.turn(rot))

    def turn(self, rot: Array) -> Any:
        """Return the Foxglove Quaternion message of a rotation matrix, (3, 3)."""
        w, x, y, z = quat_from_matrix(np.ascontiguousarray(rot)).tolist()
        return self.messages.Quaternion(x=x, y=y, z=z, w=w)

    def vector(self, place: Array) -> Any:
        """Return the Foxglove Vector3 message of a position, (3,) m."""
        x, y, z = (float(each) for each in place)
        return self.messages.Vector3(x=x, y=y, z=z)

    def points(self, places: Array) -> list[Any]:
        """Return the Foxglove Point3 messages of positions, (n, 3) m."""
        point = self.messages.Point3
        return [point(x=x, y=y, z=z) for x, y, z in np.asarray(places, dtype=float).tolist()]

    def colour(self, colour: str, alpha: float = 1.0) -> Any:
        """Return the Foxglove Color message of a colour `#rrggbb` with an opacity `alpha`, 0 to 1."""
        red, green, blue = (part / 255.0 for part in _bytes_of(colour))
        return self.messages.Color(r=red, g=green, b=blue, a=alpha)

    def sphere(self, place: Array, radius: float, colour: str) -> Any:
        """Return the Foxglove sphere at a position (3,) m, with a radius, m, and a colour `#rrggbb`."""
        size = self.vector(np.full(3, 2.0 * radius))
        return self.messages.SpherePrimitive(pose=self.pose(place, np.eye(3)), size=size, color=self.colour(colour))

    def cylinder(self, begin: Array, end: Array, radius: float, colour: str) -> Any:
        """Return the Foxglove cylinder between two points (3,) m, with a radius, m, and a colour `#rrggbb`."""
        length = float(np.linalg.norm(end - begin))
        size = self.vector(np.array([2.0 * radius, 2.0 * radius, length]))
        return self.messages.CylinderPrimitive(
            pose=self.pose(0.5 * (begin + end), _towards((end - begin) / length)), size=size, bottom_scale=1.0,
            top_scale=1.0, color=self.colour(colour),
        )  # fmt: skip

    def fan(self, corners: Array, colour: str, alpha: float = 1.0) -> Any:
        """Return a convex polygon, corners (n, 3) m in order, as Foxglove triangles, opacity `alpha` 0 to 1."""
        inner = np.arange(1, len(corners) - 1)
        return self.triangles(corners, np.column_stack((0 * inner, inner, inner + 1)), colour, alpha)

    def triangles(self, corners: Array, indices: NDArray[np.int64], colour: str, alpha: float = 1.0) -> Any:
        """Return Foxglove triangles: corners (n, 3) m, three indices of them a row, opacity `alpha` 0 to 1."""
        return self.messages.TriangleListPrimitive(
            points=self.points(corners), indices=indices.ravel().tolist(), color=self.colour(colour, alpha)
        )

    def arrow(self, tail: Array, tip: Array, size: float, colour: str) -> Any:
        """Return a Foxglove arrow from tail to tip, (3,) m each, with a shaft of width `size`, m."""
        along = tip - tail
        length = max(float(np.linalg.norm(along)), 1e-9)
        head = min(3.0 * size, 0.5 * length)
        turned = _towards(along / length)[:, [2, 0, 1]]  # an arrow points along x
        return self.messages.ArrowPrimitive(
            pose=self.pose(tail, turned), shaft_length=length - head, shaft_diameter=size, head_length=head,
            head_diameter=2.0 * size, color=self.colour(colour),
        )  # fmt: skip

    def parts(self, body: Body, link: int) -> dict[str, list[Any]]:
        """Return the Foxglove primitives that draw a link, by kind, in the frame of the link."""
        limbs = [limb for limb in body.limbs if body.link[limb.begin] == link]
        balls = [ball for ball in body.balls if body.link[ball.at] == link]
        faces = [face for face in body.faces if body.link[face.corners[0]] == link]
        meshes = [mesh for mesh in body.meshes if body.link[mesh.frame[0]] == link]
        return {
            "cylinders": [self.cylinder(body.local[p.begin], body.local[p.end], p.radius, p.colour) for p in limbs],
            "spheres": [self.sphere(body.local[p.at], p.radius, p.colour) for p in balls],
            "triangles": [
                *(self.fan(body.local[list(p.corners)], p.colour) for p in faces),
                *(self.triangles(p.vertices, p.triangles, p.colour) for p in meshes),
            ],
        }

    def drawn(self, items: tuple[Item, ...], extent: float) -> dict[str, list[Any]]:
        """Return the Foxglove primitives of drawn items, by kind; `extent`: size of the robot, m, which scales them."""
        m = self.messages
        kinds = ("lines", "triangles", "spheres", "cylinders", "arrows", "texts")
        made: dict[str, list[Any]] = {kind: [] for kind in kinds}
        for item in items:
            style = STYLES[item.style]
            size = style.size * extent
            if style.kind in ("line", "fill"):
                strip = m.LinePrimitiveLineType.LineLoop if style.kind == "fill" else m.LinePrimitiveLineType.LineStrip
                points, colour = self.points(item.points), self.colour(style.colour)
                made["lines"].append(m.LinePrimitive(type=strip, thickness=size, points=points, color=colour))
            if style.kind == "fill":
                made["triangles"].append(self.fan(item.points, style.colour, 0.3))
            elif style.kind == "dot":
                made["spheres"] += [self.sphere(place, size, style.colour) for place in item.points]
            elif style.kind == "ring":
                thick = 0.05 * size * UP
                made["cylinders"] += [self.cylinder(p, p + thick, size, style.colour) for p in item.points]
            elif style.kind == "arrow":
                pairs = zip(item.points[::2], item.points[1::2], strict=True)
                made["arrows"] += [self.arrow(tail, tip, size, style.colour) for tail, tip in pairs]
            elif style.kind == "label":
                place = self.pose(item.points[0] + size * UP, np.eye(3))
                made["texts"].append(
                    m.TextPrimitive(
                        pose=place, billboard=True, font_size=size, color=self.colour(style.colour), text=item.text
                    )
                )
        return made

    def grid(self, ground: DrawnGround, frame: str, stamp_ns: int) -> Any:
        """Return the ground as the Grid message of its heights, m, in `frame`."""
        m, cols = self.messages, ground.heights.shape[1]
        corner = np.array([ground.origin[0] - 0.5 * ground.cell, ground.origin[1] - 0.5 * ground.cell, 0.0])
        kind = m.PackedElementFieldNumericType.Float32
        return m.Grid(
            timestamp=self.time(stamp_ns), frame_id=frame, pose=self.pose(corner, np.eye(3)), column_count=cols,
            cell_size=m.Vector2(x=ground.cell, y=ground.cell), row_stride=4 * cols, cell_stride=4,
            fields=[m.PackedElementField(name="elevation", offset=0, type=kind)],
            data=ground.heights.astype("<f4").tobytes(),
        )  # fmt: skip

    def mesh(self, ground: DrawnGround) -> Any:
        """Return the ground as a message of triangles between its known cells."""
        rows, cols = ground.heights.shape
        known = np.isfinite(ground.heights)
        whole = known[:-1, :-1] & known[1:, :-1] & known[:-1, 1:] & known[1:, 1:]
        at = (np.arange(rows - 1)[:, None] * cols + np.arange(cols - 1))[whole]
        index = np.column_stack((at, at + 1, at + cols + 1, at, at + cols + 1, at + cols))
        return self.triangles(centres(ground), index, GROUND_COLOUR)

    def cloud(self, places: Array, colours: list[str], frame: str, stamp_ns: int) -> Any:
        """Return a point cloud of points (n, 3) m in `frame`, each with its colour `#rrggbb`."""
        m = self.messages
        kinds = m.PackedElementFieldNumericType
        packed = np.zeros(len(places), dtype=[("place", "<f4", 3), ("colour", "u1", 4)])
        packed["place"] = places
        packed["colour"] = [(*_bytes_of(colour), 255) for colour in colours]
        names = {"x": (0, kinds.Float32), "y": (4, kinds.Float32), "z": (8, kinds.Float32)}
        names |= {name: (12 + i, kinds.Uint8) for i, name in enumerate(("red", "green", "blue", "alpha"))}
        fields = [m.PackedElementField(name=name, offset=offset, type=kind) for name, (offset, kind) in names.items()]
        return m.PointCloud(
            timestamp=self.time(stamp_ns), frame_id=frame, pose=self.pose(np.zeros(3), np.eye(3)),
            point_stride=packed.itemsize, fields=fields, data=packed.tobytes(),
        )  # fmt: skip


def surface(body: Body, link: int) -> tuple[Array, list[str]]:
    """Return points on the surface of a link in its frame, (n, 3) m, and the colour of each."""
    found, colours, step = [np.zeros((0, 3))], list[str](), APART * body.extent
    turns = np.arange(AROUND) * 2.0 * math.pi / AROUND
    ring = np.column_stack((np.cos(turns), np.sin(turns), np.zeros(AROUND)))

    def add(places: Array, colour: str) -> None:
        found.append(places)
        colours.extend([colour] * len(places))

    for limb in body.limbs:
        if body.link[limb.begin] == link:
            begin, along = body.local[limb.begin], body.local[limb.end] - body.local[limb.begin]
            length = float(np.linalg.norm(along))
            circle = limb.radius * ring @ _towards(along / length).T
            shares = np.linspace(0.0, 1.0, 2 + int(length / step))
            add((begin + shares[:, None, None] * along + circle).reshape(-1, 3), limb.colour)
    for ball in body.balls:
        if body.link[ball.at] == link:
            shell = np.vstack((ring, ring[:, [0, 2, 1]], ring[:, [2, 0, 1]]))
            add(body.local[ball.at] + ball.radius * shell, ball.colour)
    for face in body.faces:
        if body.link[face.corners[0]] == link:
            corners = body.local[list(face.corners)]
            middle = corners.mean(axis=0)
            ends = np.roll(corners, -1, axis=0)
            steps = 2 + int(float(np.linalg.norm(ends - corners, axis=1).max()) / step)
            edges = (corners + np.linspace(0.0, 1.0, steps)[:, None, None] * (ends - corners)).reshape(-1, 3)
            inward = np.linspace(0.0, 1.0, 2 + int(float(np.linalg.norm(edges - middle, axis=1).max()) / step))
            add((edges + inward[:, None, None] * (middle - edges)).reshape(-1, 3), face.colour)
    for mesh in body.meshes:
        if body.link[mesh.frame[0]] == link:
            add(np.vstack((mesh.vertices, mesh.vertices[mesh.triangles].mean(axis=1))), mesh.colour)
    return np.vstack(found), colours


def centres(ground: DrawnGround) -> Array:
    """Return the centres of all cells of a ground, (n, 3) m, row by row; unknown ones at height 0."""
    rows, cols = ground.heights.shape
    x, y = (ground.origin[i] + ground.cell * np.arange(n) for i, n in ((0, cols), (1, rows)))
    return np.dstack((*np.meshgrid(x, y), np.nan_to_num(ground.heights))).reshape(-1, 3)


def _towards(z: Array) -> Array:
    """Return a rotation matrix (3, 3) whose third column is the unit vector z (3,), by Duff et al. (JCGT 2017)."""
    x, y, height = z.tolist()
    side = math.copysign(1.0, height)
    a = -1.0 / (side + height)
    b = x * y * a
    return np.array([[1.0 + side * x * x * a, b, x], [side * b, side + y * y * a, y], [-side * x, -y, height]])


def _bytes_of(colour: str) -> tuple[int, int, int]:
    """Return red, green and blue of a colour `#rrggbb`."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
