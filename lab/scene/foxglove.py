"""The scene in Foxglove's well-known messages (Protobuf), for recordings and live: Foxglove, Lichtblick, rerun.

Frames: ``world`` holds ``base_link`` and ``estimate``, ``base_link`` holds the links by their names.
"""

from pathlib import Path
from typing import Any

import numpy as np

from surefoot.errors import SurefootError
from surefoot.geometry.rotations import quat_from_matrix
from surefoot.record.recording import ReadableRecording, open_readable
from surefoot.robot.description import Robot

from .film import film_of_recording
from .scene import STYLES, UP, Item, RobotScene, Snapshot
from .shapes import Array, Body, DrawnGround

RATE_HZ, MOST = 50.0, 100_000
"""Snapshots of a second of simulated time, and of a whole recording."""
GROUND_COLOUR = "#b9bfb4"
LEVELS = {"debug": "Debug", "info": "Info", "warning": "Warning", "error": "Error"}
INSTALL = "pip install 'surefoot[foxglove]'"


def sdk() -> Any:
    """Return the module `foxglove` (raises SurefootError with the command that installs it)."""
    try:
        import foxglove
        import foxglove.channels
        import foxglove.messages
    except ImportError:
        raise SurefootError("not_installed", f"Foxglove's messages need their library: {INSTALL}", "to") from None
    return foxglove


class FoxgloveScene:
    """Publishes snapshots on channels of a context, to whatever file or server listens there."""

    def __init__(self, scene: RobotScene, context: Any) -> None:
        self._scene, self._sdk = scene, sdk()
        kinds = {
            "/tf": "FrameTransforms", "/robot": "SceneUpdate", "/scene": "SceneUpdate", "/ground": "SceneUpdate",
            "/map": "Grid", "/odometry": "Odometry", "/joint_states": "JointStates", "/pose": "PoseInFrame",
            "/log": "Log",
        }  # fmt: skip
        channels = self._sdk.channels
        self._to = {topic: getattr(channels, f"{kind}Channel")(topic, context=context) for topic, kind in kinds.items()}
        self._ground: DrawnGround | None = None
        self._marks, self._begun, self._text = 0, False, ""

    def publish(self, shown: Snapshot) -> None:
        """Publish a snapshot; the robot's shape and the ground when they are new."""
        stamp = round(shown.time * 1e9)
        if not self._begun:
            self._begun = True
            self._send("/robot", self._robot(stamp), stamp)
        if self._scene.ground is not None and self._scene.ground is not self._ground:
            self._ground = self._scene.ground
            self._send_ground(self._ground, stamp)
        self._send("/tf", self._transforms(shown, stamp), stamp)
        self._send("/pose", self._pose_in_frame(shown.position, shown.rot, stamp), stamp)
        self._send("/scene", self._items(shown, stamp), stamp)
        m = self._sdk.messages
        joints = [
            m.JointState(name=name, position=float(angle))
            for name, angle in zip(self._scene.robot.joint_names, shown.joints, strict=True)
        ]
        self._send("/joint_states", m.JointStates(timestamp=self._time(stamp), joints=joints), stamp)
        if shown.estimate is not None:
            place = self._pose(*shown.estimate)
            odometry = m.Odometry(timestamp=self._time(stamp), frame_id="world", body_frame_id="estimate", pose=place)
            self._send("/odometry", odometry, stamp)
        if shown.text and shown.text != self._text:
            self._text = shown.text
            self.log(stamp, "warning" if shown.fallen else "info", "walker", shown.text)

    def log(self, stamp_ns: int, level: str, name: str, text: str) -> None:
        """Publish a line of a log."""
        m = self._sdk.messages
        kind = getattr(m.LogLevel, LEVELS.get(level, "Info"))
        self._send("/log", m.Log(timestamp=self._time(stamp_ns), level=kind, name=name, message=text), stamp_ns)

    def _send(self, topic: str, message: Any, stamp_ns: int) -> None:
        self._to[topic].log(message, log_time=stamp_ns)

    def _time(self, stamp_ns: int) -> Any:
        return self._sdk.messages.Timestamp(*divmod(stamp_ns, 1_000_000_000))

    def _pose(self, position: Array, rot: Array) -> Any:
        return self._sdk.messages.Pose(position=self._vector(position), orientation=self._turn(rot))

    def _turn(self, rot: Array) -> Any:
        w, x, y, z = quat_from_matrix(np.ascontiguousarray(rot)).tolist()
        return self._sdk.messages.Quaternion(x=x, y=y, z=z, w=w)

    def _vector(self, place: Array) -> Any:
        x, y, z = (float(each) for each in place)
        return self._sdk.messages.Vector3(x=x, y=y, z=z)

    def _points(self, places: Array) -> list[Any]:
        point = self._sdk.messages.Point3
        return [point(x=x, y=y, z=z) for x, y, z in np.asarray(places, dtype=float).tolist()]

    def _colour(self, colour: str, alpha: float = 1.0) -> Any:
        red, green, blue = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
        return self._sdk.messages.Color(r=red, g=green, b=blue, a=alpha)

    def _pose_in_frame(self, position: Array, rot: Array, stamp: int) -> Any:
        return self._sdk.messages.PoseInFrame(
            timestamp=self._time(stamp), frame_id="world", pose=self._pose(position, rot)
        )

    def _transforms(self, shown: Snapshot, stamp: int) -> Any:
        """Return the poses of trunk and estimate in the world, and of the links in the trunk."""
        m, links = self._sdk.messages, self._scene.robot.links
        found = [("world", "base_link", shown.position, shown.rot)]
        if shown.estimate is not None:
            found.append(("world", "estimate", *shown.estimate))
        for i in range(1, len(links)):
            place = shown.rot.T @ (shown.link_position[i] - shown.position)
            found.append(("base_link", links[i].name, place, shown.rot.T @ shown.link_rot[i]))
        made: list[Any] = []
        for parent, child, position, rot in found:
            made.append(
                m.FrameTransform(
                    timestamp=self._time(stamp), parent_frame_id=parent, child_frame_id=child,
                    translation=self._vector(position), rotation=self._turn(rot),
                )
            )  # fmt: skip
        return m.FrameTransforms(transforms=made)

    def _robot(self, stamp: int) -> Any:
        """Return the shape of each link, fixed to its frame."""
        m, body = self._sdk.messages, self._scene.body
        entities: list[Any] = []
        for number, link in enumerate(self._scene.robot.links):
            parts = self._parts(body, number)
            name = "base_link" if number == 0 else link.name
            entities.append(
                m.SceneEntity(timestamp=self._time(stamp), frame_id=name, id=name, frame_locked=True, **parts)
            )
        return m.SceneUpdate(entities=entities)

    def _parts(self, body: Body, link: int) -> dict[str, list[Any]]:
        """Return the primitives of a link in its frame."""
        limbs = [limb for limb in body.limbs if body.link[limb.begin] == link]
        balls = [ball for ball in body.balls if body.link[ball.at] == link]
        faces = [face for face in body.faces if body.link[face.corners[0]] == link]
        return {
            "cylinders": [self._cylinder(body.local[p.begin], body.local[p.end], p.radius, p.colour) for p in limbs],
            "spheres": [self._sphere(body.local[p.at], p.radius, p.colour) for p in balls],
            "triangles": [self._fan(body.local[list(p.corners)], p.colour) for p in faces],
        }

    def _sphere(self, place: Array, radius: float, colour: str) -> Any:
        size = self._vector(np.full(3, 2.0 * radius))
        return self._sdk.messages.SpherePrimitive(
            pose=self._pose(place, np.eye(3)), size=size, color=self._colour(colour)
        )

    def _cylinder(self, begin: Array, end: Array, radius: float, colour: str) -> Any:
        along = end - begin
        length = float(np.linalg.norm(along))
        size = self._vector(np.array([2.0 * radius, 2.0 * radius, length]))
        return self._sdk.messages.CylinderPrimitive(
            pose=self._pose(0.5 * (begin + end), _towards(along / length)), size=size, bottom_scale=1.0, top_scale=1.0,
            color=self._colour(colour),
        )  # fmt: skip

    def _fan(self, corners: Array, colour: str, alpha: float = 1.0) -> Any:
        """Return a convex polygon as triangles."""
        inner = range(1, len(corners) - 1)
        indices = [index for i in inner for index in (0, i, i + 1)]
        return self._sdk.messages.TriangleListPrimitive(
            points=self._points(corners), indices=indices, color=self._colour(colour, alpha)
        )

    def _items(self, shown: Snapshot, stamp: int) -> Any:
        """Return what is drawn beside the robot, and marks that are new."""
        m = self._sdk.messages
        entity = {"timestamp": self._time(stamp), "frame_id": "world"}
        entities = [m.SceneEntity(id="now", **entity, **self._drawn(shown.items))]
        if len(self._scene.marks) < self._marks:
            self._marks = 0
        for number in range(self._marks, len(self._scene.marks)):
            lasting = self._scene.marks[number]
            if lasting.time > shown.time:
                break
            entities.append(m.SceneEntity(id=f"mark {number}", **entity, **self._drawn((lasting.item,))))
            self._marks = number + 1
        return m.SceneUpdate(entities=entities)

    def _drawn(self, items: tuple[Item, ...]) -> dict[str, list[Any]]:
        m, extent = self._sdk.messages, self._scene.body.extent
        made: dict[str, list[Any]] = {"lines": [], "triangles": [], "spheres": [], "cylinders": [], "arrows": []}
        for item in items:
            style = STYLES[item.style]
            size = style.size * extent
            if style.kind in ("line", "fill"):
                strip = m.LinePrimitiveLineType.LineLoop if style.kind == "fill" else m.LinePrimitiveLineType.LineStrip
                points, colour = self._points(item.points), self._colour(style.colour)
                made["lines"].append(m.LinePrimitive(type=strip, thickness=size, points=points, color=colour))
            if style.kind == "fill":
                made["triangles"].append(self._fan(item.points, style.colour, 0.3))
            elif style.kind == "dot":
                made["spheres"] += [self._sphere(place, size, style.colour) for place in item.points]
            elif style.kind == "ring":
                thick = 0.05 * size * UP
                made["cylinders"] += [self._cylinder(p, p + thick, size, style.colour) for p in item.points]
            elif style.kind == "arrow":
                pairs = zip(item.points[::2], item.points[1::2], strict=True)
                made["arrows"] += [self._arrow(tail, tip, size, style.colour) for tail, tip in pairs]
        return made

    def _arrow(self, tail: Array, tip: Array, size: float, colour: str) -> Any:
        along = tip - tail
        length = max(float(np.linalg.norm(along)), 1e-9)
        head = min(3.0 * size, 0.5 * length)
        turned = _towards(along / length)[:, [2, 0, 1]]  # an arrow points along x
        return self._sdk.messages.ArrowPrimitive(
            pose=self._pose(tail, turned), shaft_length=length - head, shaft_diameter=size, head_length=head,
            head_diameter=2.0 * size, color=self._colour(colour),
        )  # fmt: skip

    def _send_ground(self, ground: DrawnGround, stamp: int) -> None:
        """Publish the ground as a grid of heights, and as triangles that a 3-D panel shows."""
        m, (rows, cols) = self._sdk.messages, ground.heights.shape
        corner = np.array([ground.origin[0] - 0.5 * ground.cell, ground.origin[1] - 0.5 * ground.cell, 0.0])
        kind = m.PackedElementFieldNumericType.Float32
        grid = m.Grid(
            timestamp=self._time(stamp), frame_id="world", pose=self._pose(corner, np.eye(3)), column_count=cols,
            cell_size=m.Vector2(x=ground.cell, y=ground.cell), row_stride=4 * cols, cell_stride=4,
            fields=[m.PackedElementField(name="elevation", offset=0, type=kind)],
            data=ground.heights.astype("<f4").tobytes(),
        )  # fmt: skip
        self._send("/map", grid, stamp)
        x, y = (ground.origin[i] + ground.cell * np.arange(n) for i, n in ((0, cols), (1, rows)))
        points = np.dstack((*np.meshgrid(x, y), np.nan_to_num(ground.heights))).reshape(-1, 3)
        known = np.isfinite(ground.heights)
        whole = known[:-1, :-1] & known[1:, :-1] & known[:-1, 1:] & known[1:, 1:]
        at = (np.arange(rows - 1)[:, None] * cols + np.arange(cols - 1))[whole]
        index = np.column_stack((at, at + 1, at + cols + 1, at, at + cols + 1, at + cols)).ravel()
        colour = self._colour(GROUND_COLOUR)
        mesh = m.TriangleListPrimitive(points=self._points(points), indices=index.tolist(), color=colour)
        entity = m.SceneEntity(timestamp=self._time(stamp), frame_id="world", id="ground", triangles=[mesh])
        self._send("/ground", m.SceneUpdate(entities=[entity]), stamp)


def _towards(z: Array) -> Array:
    """Return a rotation whose third axis is the unit vector z, (3, 3)."""
    other = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = np.cross(other, z)
    x /= np.linalg.norm(x)
    return np.column_stack((x, np.cross(z, x), z))


def write_foxglove(recording: Path, out: Path, robot: Robot) -> None:
    """Write a recording as an MCAP file of Foxglove's messages.

    Raises:
        SurefootError: the library is missing, or the recording cannot be read.
    """
    library, opened = sdk(), open_readable(recording)
    film = film_of_recording(opened, robot, rate_hz=RATE_HZ, most=MOST)
    context = library.Context()
    with library.open_mcap(out, context=context):
        to = FoxgloveScene(film.scene, context)
        lines = _log_lines(opened)
        for shown in film.snapshots:
            to.publish(shown)
            while lines and lines[0][0] <= shown.time * 1e9:
                to.log(*lines.pop(0))


def _log_lines(recording: ReadableRecording) -> list[tuple[int, str, str, str]]:
    """Return stamp, level, source and text of each line that was logged."""
    found: list[tuple[int, str, str, str]] = []
    for item in recording.messages():
        if item.key.startswith("log/"):
            line: Any = item.message()
            found.append((item.stamp_ns, line.level, line.source, line.text))
    return found
