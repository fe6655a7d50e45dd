"""A scene over time, as JSON for the pages, and its compact text inside one HTML file."""

import base64
import gzip
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from surefoot.record.recording import ReadableRecording
from surefoot.robot.description import Robot

from .scene import KEYS, Item, Lasting, RobotScene, Snapshot
from .shapes import DrawnGround
from .styles import STYLES, VALUES

UNITS_PER_M = 10_000
"""Lengths on a page are whole tenths of a millimetre: they are short, and more cannot be seen."""
FRAMES_HZ, MOST_FRAMES = 25.0, 2500
"""Frames of a second of simulated time, and of a whole film, whose frames are then further apart."""
NS = 1e-9
STYLE_NUMBERS = {name: number for number, name in enumerate(STYLES)}


class Undecoded(Protocol):
    """A message as it was recorded or kept."""

    @property
    def key(self) -> str:
        """Key of the recorded message's topic."""
        ...

    def message(self) -> Any:
        """Return the decoded message."""
        ...


@dataclass(frozen=True)
class Film:
    """Snapshots in the order of time, with the marks that stay and the ground."""

    scene: RobotScene
    snapshots: list[Snapshot]


def film_of_recording(recording: ReadableRecording, robot: Robot) -> Film:
    """Return the film of a recording."""
    messages = ((item.stamp_ns * NS, item) for item in recording.messages(KEYS))
    return film_of(robot, messages, (recording.end_ns - recording.start_ns) * NS)


def film_of(robot: Robot, messages: Iterable[tuple[float, Undecoded]], duration_s: float) -> Film:
    """Return the film of one epoch, the last one.

    Args:
        robot: the robot that was recorded.
        messages: each with its simulated time, s, in the order of time.
        duration_s: how long the recording is, for the distance of the frames.
    """
    scene, shown, epoch = RobotScene(robot), list[Snapshot](), -1
    for snapshot in snapshots(scene, messages, max(1.0 / FRAMES_HZ, duration_s / MOST_FRAMES)):
        if scene.epoch > epoch:
            epoch = scene.epoch
            shown.clear()
        shown.append(snapshot)
    return Film(scene, shown)


def snapshots(scene: RobotScene, messages: Iterable[tuple[float, Undecoded]], period_s: float) -> Iterator[Snapshot]:
    """Yield the scene about each `period_s` of simulated time; within an epoch each is later than the one before.

    Args:
        scene: gets the messages.
        messages: each with its simulated time, s, in the order of time.
        period_s: time between snapshots, s.
    """
    due, epoch, before = -np.inf, -1, -np.inf

    def later() -> Iterator[Snapshot]:
        nonlocal epoch, before
        snapshot = scene.snapshot()
        if scene.epoch > epoch:
            epoch, before = scene.epoch, -np.inf
        if snapshot is not None and snapshot.time > before:
            before = snapshot.time
            yield snapshot

    for time_s, item in messages:
        if time_s > due or time_s < due - 2.0 * period_s:  # the latter: time began anew
            yield from later()
            due = time_s + period_s - NS
        scene.feed(item.key, item.message)
    yield from later()


def reel(film: Film) -> dict[str, Any]:
    """Return a film as the page of a report reads it."""
    return {
        "head": header(film.scene),
        "marks": [mark(each) for each in film.scene.marks],
        "frames": [frame(shown) for shown in film.snapshots],
    }


def header(scene: RobotScene) -> dict[str, Any]:
    """Return what holds for a whole film: body, styles, values, ground."""
    body = scene.body
    return {
        "robot": scene.robot.name,
        "unit": UNITS_PER_M,
        "extent": round(body.extent * UNITS_PER_M),
        "limbs": [(*limb[:2], round(limb.radius * UNITS_PER_M), limb.colour) for limb in body.limbs],
        "balls": [(ball.at, round(ball.radius * UNITS_PER_M), ball.colour) for ball in body.balls],
        "faces": body.faces,
        "styles": [{"name": name, **style._asdict()} for name, style in STYLES.items()],
        "values": [{"name": name, "title": v[0], "unit": v[1], "digits": v[2]} for name, v in VALUES.items()],
        "ground": None if scene.ground is None else _ground(scene.ground),
    }


def _ground(ground: DrawnGround) -> dict[str, Any]:
    rows, cols = ground.heights.shape
    heights = np.round(np.nan_to_num(ground.heights, nan=-100.0) * UNITS_PER_M).astype(int)
    origin = [round(x * UNITS_PER_M) for x in ground.origin]
    return {
        "rows": rows,
        "cols": cols,
        "cell": ground.cell * UNITS_PER_M,
        "origin": origin,
        "z": heights.ravel().tolist(),
    }


def frame(shown: Snapshot) -> dict[str, Any]:
    """Return a snapshot as a page reads it."""
    return {
        "t": round(shown.time, 3),
        "base": _whole(shown.position),
        "points": _whole(shown.points),
        "items": [encoded(item) for item in shown.items],
        "values": [None if (v := shown.values.get(name)) is None else round(v, 4) for name in VALUES],
        "text": shown.text,
        **({"fallen": True} if shown.fallen else {}),
    }


def mark(each: Lasting) -> list[Any]:
    """Return a mark as a page reads it."""
    return [round(each.time, 3), *encoded(each.item)]


def encoded(item: Item) -> list[Any]:
    """Return an item as the number of its style, the coordinates of its points, and the text of a label."""
    return [STYLE_NUMBERS[item.style], *_whole(item.points), *([item.text] if item.text else [])]


def _whole(metres: Any) -> list[int]:
    return np.round(np.asarray(metres) * UNITS_PER_M).astype(int).ravel().tolist()


def packed(content: Any) -> str:
    """Return JSON, compressed, as base64: safe inside an HTML page whatever names it holds."""
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    return base64.b64encode(gzip.compress(text.encode(), 7, mtime=0)).decode()
