"""Painter of the scene without a browser, with Pillow: orthographic view, parts drawn from back to front, no GL."""

import math
from typing import Any, NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from surefoot.arrays import Array

from .scene import RobotScene, Snapshot
from .shapes import DrawnGround, DrawnMesh
from .styles import STYLES, VALUES, Item

FINER = 2
"""Factor of supersampling per axis: pictures are drawn larger by it and reduced at the end, for smooth edges."""
AZIMUTH, ELEVATION = -0.95, 0.5
"""`AZIMUTH`: azimuth of the viewer in world axes, rad; `ELEVATION`: elevation of the viewer, rad; both equal the
initial view of the pages."""
SUN, LAMP = np.array([-0.42, -0.38, 0.82]), np.array([-0.35, -0.5, 0.79])
"""Directions to the light, world axes: `SUN`: of the ground; `LAMP`: of faces and meshes of the robot."""
SKY, LOW_SKY, INK, SOFT = (223, 232, 240), (247, 249, 251), (28, 39, 51), (93, 107, 120)
SQUARE = 0.1
"""Edge length of the grid squares drawn on the ground, m."""
FLAT = ("fill", "ring")
"""Kinds of items that lie on the ground, under the robot."""
SHOWN = ("margin", "tilt", "speed")
"""Names in `VALUES` of the numbers written on the picture."""


class Viewpoint(NamedTuple):
    """Orthographic view: pixels per m, the point of the world in the middle, (3,) m, and width and height in pixels."""

    scale: float
    target: Array
    size: tuple[int, int]

    @property
    def axes(self) -> Array:
        """Unit vectors of the view in world axes, (3, 3), by rows: to the right, up, and towards the viewer."""
        (sa, ca), (se, ce) = ((math.sin(x), math.cos(x)) for x in (AZIMUTH, ELEVATION))
        return np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])

    def see(self, points: Array) -> Array:
        """Return points (n, 3) m, world, in view coordinates, (n, 3) px: to the right, down, and towards the viewer."""
        seen = (points - self.target) @ self.axes.T
        middle = np.array([0.5 * self.size[0], 0.54 * self.size[1], 0.0])
        return middle + seen * [self.scale, -self.scale, self.scale]


class _Triangle(NamedTuple):
    """Triangle to be painted: places of its corners, px, and red, green, blue, 0 to 255."""

    corners: list[tuple[float, ...]]
    colour: tuple[int, int, int]


class Painter:
    """Painter of the snapshots of one scene; the ground is painted once and then shifted with the view."""

    def __init__(self, scene: RobotScene, size: tuple[int, int], *, still: tuple[Array, float] | None = None) -> None:
        """Prepare to paint a scene, with a fixed view or one that follows the robot.

        Args:
            scene: scene with body, ground and marks.
            size: width and height of the pictures, pixels.
            still: middle of a fixed view (3,) m, world, and its width, m; None = the view follows the robot.
        """
        self.scene, self.still = scene, still
        self.size = (FINER * size[0], FINER * size[1])
        width = still[1] if still else 3.4 * scene.body.extent
        self.scale = self.size[0] / width
        self._ground: tuple[Image.Image, Array] | None = None
        self._sky = Image.linear_gradient("L").resize(self.size)

    def paint(self, shown: Snapshot, past: list[Snapshot]) -> Image.Image:
        """Return the picture of a snapshot, with the path of the robot in the snapshots `past`."""
        target = self.still[0] if self.still else np.array([*shown.position[:2], 0.6 * shown.position[2]])
        camera = Viewpoint(self.scale, target, self.size)
        image = Image.composite(Image.new("RGB", self.size, LOW_SKY), Image.new("RGB", self.size, SKY), self._sky)
        self._paint_ground(image, camera)
        draw = ImageDraw.Draw(image, "RGBA")
        way = np.array([each.position for each in past]).reshape(-1, 3)
        if len(way) > 1:
            self._line(draw, camera.see(self._drop(way)), "#1f6fb2", 0.006 * self.scene.body.extent * self.scale)
        for lasting in self.scene.marks:
            if lasting.time <= shown.time:
                self._item(draw, camera, lasting.item)
        for item in shown.items:
            if STYLES[item.style].kind in FLAT:
                self._item(draw, camera, item)
        self._shadow(draw, camera, shown)
        self._robot(draw, camera, shown)
        for item in shown.items:
            if STYLES[item.style].kind not in FLAT:
                self._item(draw, camera, item)
        self._words(draw, shown)
        return image.reduce(FINER)

    def _drop(self, points: Array) -> Array:
        """Return the vertical projections of points (n, 3) m, world, to the ground, (n, 3) m."""
        ground = self.scene.ground
        height = np.zeros(len(points)) if ground is None else ground.at(points[:, :2])
        return np.column_stack((points[:, :2], height))

    def _paint_ground(self, image: Image.Image, camera: Viewpoint) -> None:
        if self._ground is None:
            self._ground = self._painted_ground(camera)
        picture, origin = self._ground
        corner = camera.see(origin[None])[0]
        image.paste(picture, (round(corner[0]), round(corner[1])), picture)

    def _painted_ground(self, camera: Viewpoint) -> tuple[Image.Image, Array]:
        """Return the ground as a picture, and the world point in its upper left corner, m."""
        ground = self.scene.ground or DrawnGround(np.zeros((81, 81)), SQUARE, (-40 * SQUARE, -40 * SQUARE))
        z, (rows, cols) = ground.heights, ground.heights.shape
        x, y = (ground.origin[i] + ground.cell * np.arange(n) for i, n in ((0, cols), (1, rows)))
        points = np.dstack((*np.meshgrid(x, y), z)).reshape(-1, 3)
        seen = camera.see(points)
        known = np.isfinite(seen).all(axis=1)
        low = np.floor(seen[known, :2].min(axis=0)) - 1.0
        size = np.ceil(seen[known, :2].max(axis=0)) - low + 2.0
        picture = Image.new("RGBA", (int(size[0]), int(size[1])))
        draw = ImageDraw.Draw(picture)
        corner = seen.reshape(rows, cols, 3)[..., :2] - low
        rise_y, rise_x = (np.nan_to_num(rise) for rise in np.gradient(z, ground.cell))  # level beside unknown cells
        normal = np.dstack((-rise_x, -rise_y, np.ones_like(z)))
        shade = np.maximum(0.0, normal @ SUN) / np.linalg.norm(normal, axis=2) / SUN[2]
        checks = 1.0 - 0.035 * ((np.floor(x / SQUARE)[None] + np.floor(y / SQUARE)[:, None]) % 2)
        height = (z - np.nanmin(z)) / max(float(np.nanmax(z) - np.nanmin(z)), 0.04)
        tint = np.array([196.0, 200.0, 192.0]) + height[..., None] * [34.0, 22.0, 2.0]
        colour = np.nan_to_num(np.minimum(255.0, tint * ((0.42 + 0.58 * shade) * checks)[..., None])).astype(int)
        for r in range(rows - 2, -1, -1):  # the far cells first: the view is from -y and +x
            for c in range(cols - 1):
                quad = corner[r : r + 2, c : c + 2].reshape(4, 2)[[0, 1, 3, 2]]
                if np.isfinite(quad).all():
                    draw.polygon([tuple(p) for p in quad.tolist()], fill=(*colour[r, c].tolist(), 255))
        back = (low - [0.5 * self.size[0], 0.54 * self.size[1]]) * [1.0, -1.0] / camera.scale
        return picture, camera.target + back @ camera.axes[:2]

    def _item(self, draw: Any, camera: Viewpoint, item: Item) -> None:
        style, seen = STYLES[item.style], camera.see(item.points)
        r = max(1.5 * FINER, style.size * self.scene.body.extent * self.scale)
        thin = min(r, 2.4 * FINER)
        if style.kind == "fill":
            places = [tuple(p) for p in seen[:, :2].tolist()]
            draw.polygon(places, fill=style.colour + "4c")
            self._line(draw, np.vstack((seen, seen[:1])), style.colour, thin)
        elif style.kind == "line":
            self._line(draw, seen, style.colour, thin)
        elif style.kind == "dot":
            for x, y, _ in seen:
                self._ball(draw, x, y, r, style.colour)
        elif style.kind == "ring":
            flat = r * max(0.25, math.sin(ELEVATION))
            for x, y, _ in seen:
                box = (x - r, y - flat, x + r, y + flat)
                draw.ellipse(box, fill=style.colour + "40", outline=style.colour, width=max(2, round(0.2 * r)))
        elif style.kind == "label":
            font = ImageFont.load_default(max(FINER * 9.0, r))
            draw.text(
                (seen[0, 0] + r, seen[0, 1] + r), item.text, fill=style.colour, font=font, stroke_width=1,
                stroke_fill=LOW_SKY,
            )  # fmt: skip
        else:
            for tail, tip in zip(seen[::2, :2], seen[1::2, :2], strict=True):
                self._arrow(draw, tail, tip, r, style.colour)

    def _arrow(self, draw: Any, tail: Array, tip: Array, r: float, colour: str) -> None:
        length = float(np.linalg.norm(tip - tail))
        if length < 2.0:
            return
        along = (tip - tail) / length
        head = min(3.2 * r, 0.6 * length)
        neck, aside = tip - head * along, 0.5 * head * np.array([-along[1], along[0]])
        self._line(draw, np.array([tail, neck]), colour, r)
        draw.polygon([tuple(p) for p in (tip, neck + aside, neck - aside)], fill=colour)

    def _line(self, draw: Any, seen: Array, colour: str | tuple[int, int, int], width: float) -> None:
        places = [tuple(p) for p in seen[:, :2].tolist()]
        draw.line(places, fill=colour, width=max(1, round(width)), joint="curve")
        if width > 2.0 * FINER:
            for x, y in (places[0], places[-1]):
                draw.ellipse((x - width / 2, y - width / 2, x + width / 2, y + width / 2), fill=colour)

    def _ball(self, draw: Any, x: float, y: float, r: float, colour: str) -> None:
        for radius, shift, factor in ((r, 0.0, 0.72), (0.84 * r, 0.11 * r, 1.0), (0.36 * r, 0.32 * r, 1.35)):
            box = (x - shift - radius, y - shift - radius, x - shift + radius, y - shift + radius)
            draw.ellipse(box, fill=shaded(colour, factor))

    def _shadow(self, draw: Any, camera: Viewpoint, shown: Snapshot) -> None:
        mask = Image.new("L", self.size)
        pen, body = ImageDraw.Draw(mask), self.scene.body
        seen = camera.see(self._drop(shown.points))
        for face in body.faces[:1]:
            pen.polygon([tuple(p) for p in seen[list(face.corners), :2].tolist()], fill=42)
        for mesh in body.meshes:
            ground = camera.see(self._drop(mesh.placed(shown.points)))[mesh.triangles, :2]
            for corners in ground.tolist():
                pen.polygon([tuple(p) for p in corners], fill=42)
        for limb in body.limbs:
            ends = [tuple(p) for p in seen[[limb.begin, limb.end], :2].tolist()]
            pen.line(ends, fill=42, width=max(1, round(2.0 * limb.radius * self.scale)))
        draw.bitmap((0, 0), mask, fill=(20, 30, 40))

    def _robot(self, draw: Any, camera: Viewpoint, shown: Snapshot) -> None:
        body, seen = self.scene.body, camera.see(shown.points)
        parts: list[tuple[float, Any]] = [(seen[[p.begin, p.end], 2].mean(), p) for p in body.limbs]
        parts += [(seen[p.at, 2] + 0.5 * p.radius * self.scale, p) for p in body.balls]
        parts += [(seen[list(p.corners), 2].mean(), p) for p in body.faces]
        for mesh in body.meshes:
            parts += self._triangles(camera, mesh, mesh.placed(shown.points))
        for _, part in sorted(parts, key=lambda entry: entry[0]):
            if isinstance(part, _Triangle):
                draw.polygon(part.corners, fill=part.colour, outline=part.colour)
            elif hasattr(part, "at"):
                self._ball(
                    draw,
                    float(seen[part.at, 0]),
                    float(seen[part.at, 1]),
                    max(1.5, part.radius * self.scale),
                    part.colour,
                )
            elif hasattr(part, "corners"):
                self._face(draw, camera, shown, part, seen)
            else:
                width = max(2.0, 2.0 * part.radius * self.scale)
                self._limb(draw, seen[[part.begin, part.end], :2], width, part.colour)

    def _limb(self, draw: Any, ends: Array, width: float, colour: str) -> None:
        along = (ends[1] - ends[0]) / max(float(np.linalg.norm(ends[1] - ends[0])), 1e-9)
        light = np.array([along[1], -along[0]]) * (-1.0 if along[1] > 0.0 else 1.0)
        light = light if light[0] < 0.0 or light[1] < 0.0 else -light
        for factor, share, shift in ((0.55, 1.0, 0.0), (0.86, 0.88, 0.0), (1.0, 0.55, 0.12), (1.18, 0.2, 0.2)):
            self._line(draw, ends + shift * width * light, shaded(colour, factor), share * width)

    def _face(self, draw: Any, camera: Viewpoint, shown: Snapshot, face: Any, seen: Array) -> None:
        a, b, c = shown.points[list(face.corners[:3])]
        normal = np.cross(b - a, c - a)
        normal /= max(float(np.linalg.norm(normal)), 1e-12)
        if normal @ camera.axes[2] > 0.0:
            lit = max(0.0, float(normal @ LAMP))
            places = [tuple(p) for p in seen[list(face.corners), :2].tolist()]
            draw.polygon(places, fill=shaded(face.colour, 0.7 + 0.5 * lit), outline=shaded(face.colour, 0.55))

    def _triangles(self, camera: Viewpoint, mesh: DrawnMesh, vertices: Array) -> list[tuple[float, "_Triangle"]]:
        """Return the triangles of a mesh that face the viewer, each with its depth, px; vertices (n, 3) m, world."""
        at = vertices[mesh.triangles]
        normal = np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0])
        front = normal @ camera.axes[2] > 0.0
        lit = np.maximum(0.0, normal[front] @ LAMP) / np.linalg.norm(normal[front], axis=1)
        seen = camera.see(vertices)[mesh.triangles[front]]
        return [
            (depth, _Triangle([tuple(p) for p in corners], shaded(mesh.colour, factor)))
            for depth, corners, factor in zip(
                seen[..., 2].mean(axis=1).tolist(), seen[..., :2].tolist(), (0.7 + 0.5 * lit).tolist(), strict=True
            )
        ]

    def _words(self, draw: Any, shown: Snapshot) -> None:
        large, small = (ImageFont.load_default(FINER * size) for size in (17, 12))
        draw.text((FINER * 12, FINER * 8), f"{shown.time:.1f} s", fill=INK, font=large)
        draw.text((FINER * 12, FINER * 30), "FALLEN" if shown.fallen else shown.text[:80], fill=SOFT, font=small)
        lines = [(VALUES[name], shown.values[name]) for name in SHOWN if name in shown.values]
        for number, ((title, unit, digits), value) in enumerate(lines):
            text = f"{title}  {value:.{digits}f} {unit}"
            place = (self.size[0] - FINER * 12, FINER * (8 + 16 * number))
            draw.text(place, text, fill=INK, font=small, anchor="ra")


def shaded(colour: str, factor: float) -> tuple[int, int, int]:
    """Return red, green, blue (0 to 255) of a colour `#rrggbb`, made darker (factor < 1) or lighter (factor > 1)."""
    parts = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    light = min(1.0, max(0.0, factor - 1.0) * 1.6)
    red, green, blue = (round(min(255.0, p * factor if factor <= 1.0 else p + (255 - p) * light)) for p in parts)
    return red, green, blue
