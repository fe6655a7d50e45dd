"""Film: snapshots of a scene over time, as JSON for the web pages, and its compact text inside an HTML file."""

import base64
import gzip
import json
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np

from surefoot.errors import SurefootError
from surefoot.record.recording import ReadableRecording
from surefoot.robot.description import Robot

from .scene import KEYS, POSTURE, RobotScene, Snapshot
from .shapes import DrawnGround
from .styles import STYLES, VALUES, Item, Lasting

UNITS_PER_M = 10_000
"""Resolution of lengths in the data of a page, units per metre: lengths are integers in tenths of a millimetre."""
FRAMES_HZ, MOST_FRAMES = 25.0, 2500
"""`FRAMES_HZ`: frames per second of simulated time; `MOST_FRAMES`: largest number of frames of a film; frames of
a longer run are further apart."""
NS = 1e-9
SLOWEST_POSE_S = 0.1
"""Longest time between two messages of a pose topic at its nominal rate, s."""
STYLE_NUMBERS = {name: number for number, name in enumerate(STYLES)}


class Undecoded(Protocol):
    """Recorded message that is decoded only when it is needed."""

    @property
    def key(self) -> str:
        """Key of the recorded message's topic."""
        ...

    def message(self) -> Any:
        """Return the decoded message."""
        ...


@dataclass(frozen=True)
class Film:
    """Film of a run: its scene (body, ground, permanent marks) and snapshots of it in the order of time.

    Attributes:
        notes: what the pictures lack: messages that could not be read, joints of another robot, meshes.
    """

    scene: RobotScene
    snapshots: list[Snapshot]
    notes: tuple[str, ...] = ()


class ReadCount:
    """Counter of the decoded messages of each key, and of those that could not be read."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._looked, self._lost = Counter[str](), Counter[str]()
        self._first, self._joints = dict[str, str](), 0

    def reading(self, item: Undecoded) -> "_CountedMessage":
        """Return a wrapper of a recorded message, which is counted when it is decoded."""
        return _CountedMessage(item, self)

    def decode(self, item: Undecoded) -> Any:
        """Return the decoded message, and count it (raises SurefootError: it cannot be read)."""
        self._looked[item.key] += 1
        try:
            message = item.message()
        except SurefootError as error:
            self._lost[item.key] += 1
            self._first.setdefault(item.key, error.message)
            raise
        if item.key == "hw/joints":
            self._joints = len(message.position)
        return message

    def notes(self) -> tuple[str, ...]:
        """Return a sentence for each key with messages that could not be read, and one on joints of another robot."""
        found = [
            f"{count} of {self._looked[key]} {key} for its pictures could not be read and are left out: "
            f"{self._first[key]}"
            for key, count in sorted(self._lost.items())
        ]
        if self._joints not in (0, self._robot.nj):
            found.append(f"hw/joints has {self._joints} joints, {self._robot.name} has {self._robot.nj}")
        return tuple(found)


class _CountedMessage(NamedTuple):
    item: Undecoded
    account: ReadCount

    @property
    def key(self) -> str:
        return self.item.key

    def message(self) -> Any:
        return self.account.decode(self.item)


def film_of_recording(recording: ReadableRecording, robot: Robot) -> Film:
    """Return the film of the last epoch of a recording."""
    messages = ((item.stamp_ns * NS, item) for item in recording.messages(KEYS))
    poses = max((recording.found.messages[key] for key in POSTURE), default=0)
    duration_s = min((recording.end_ns - recording.start_ns) * NS, poses * SLOWEST_POSE_S)  # of a clock that jumps
    return film_of(robot, messages, duration_s)


def film_of(robot: Robot, messages: Iterable[tuple[float, Undecoded]], duration_s: float) -> Film:
    """Return the film of the last epoch in some messages: what follows the last reset.

    Args:
        robot: the robot that was recorded.
        messages: each with its simulated time, s, in the order of time.
        duration_s: how long the recording is, for the distance of the frames.
    """
    scene, shown, epoch, account = RobotScene(robot), list[Snapshot](), -1, ReadCount(robot)
    counted = ((time_s, account.reading(item)) for time_s, item in messages)
    for snapshot in snapshots(scene, counted, max(1.0 / FRAMES_HZ, duration_s / MOST_FRAMES)):
        if scene.epoch > epoch:
            epoch = scene.epoch
            shown.clear()
        shown.append(snapshot)
    return Film(scene, shown, (*account.notes(), *scene.body.notes))


def snapshots(scene: RobotScene, messages: Iterable[tuple[float, Undecoded]], period_s: float) -> Iterator[Snapshot]:
    """Yield a snapshot of the scene about each `period_s` of simulated time; times rise within an epoch.

    Args:
        scene: scene that gets the messages.
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
    """Return a film as the JSON object that the page of a report plays."""
    return {
        "head": header(film.scene),
        "marks": [mark(each) for each in film.scene.marks],
        "frames": [frame(shown) for shown in film.snapshots],
    }


def header(scene: RobotScene) -> dict[str, Any]:
    """Return the constant parts of a film as a JSON object: body, styles, names of values, ground."""
    body = scene.body
    return {
        "robot": scene.robot.name,
        "unit": UNITS_PER_M,
        "extent": round(body.extent * UNITS_PER_M),
        "limbs": [(*limb[:2], round(limb.radius * UNITS_PER_M), limb.colour) for limb in body.limbs],
        "balls": [(ball.at, round(ball.radius * UNITS_PER_M), ball.colour) for ball in body.balls],
        "faces": body.faces,
        "meshes": [(m.frame, _whole(m.vertices), m.triangles.ravel().tolist(), m.colour) for m in body.meshes],
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
    """Return a snapshot as the JSON object that a page draws."""
    places = [shown.position[None], shown.points, *(item.points for item in shown.items)]
    numbers, ends = _whole(np.concatenate(places)), accumulate(3 * len(each) for each in places)
    base, points, *items = (numbers[begin:end] for begin, end in pairwise((0, *ends)))
    return {
        "t": round(shown.time, 3),
        "base": base,
        "points": points,
        "items": [_coded(item, place) for item, place in zip(shown.items, items, strict=True)],
        "values": [None if (v := shown.values.get(name)) is None else round(v, 4) for name in VALUES],
        "text": shown.text,
        **({"fallen": True} if shown.fallen else {}),
    }


def mark(each: Lasting) -> list[Any]:
    """Return a permanent item (footprint, landmark) as the JSON list that a page draws."""
    return [round(each.time, 3), *encoded(each.item)]


def encoded(item: Item) -> list[Any]:
    """Return an item as the number of its style, the coordinates of its points, and the text of a label."""
    return _coded(item, _whole(item.points))


def _coded(item: Item, numbers: list[int]) -> list[Any]:
    """Return an item as in `encoded`; numbers: coordinates of its points in units of a page, one after the other."""
    return [STYLE_NUMBERS[item.style], *numbers, *([item.text] if item.text else [])]


def _whole(metres: Any) -> list[int]:
    return np.rint(np.asarray(metres) * UNITS_PER_M).astype(int).ravel().tolist()


def packed(content: Any) -> str:
    """Return an object as JSON, compressed, in base64, which is safe inside an HTML page."""
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    return base64.b64encode(gzip.compress(text.encode(), 7, mtime=0)).decode()
