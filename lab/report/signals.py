"""Content of a recording as arrays: the messages of the last epoch (a reset begins a new one), as far as readable."""

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic_core import from_json

from surefoot.arrays import Array
from surefoot.errors import SurefootError
from surefoot.record.recording import ReadableRecording, open_readable
from surefoot.record.robots import robot_of
from surefoot.schemas.topics import TICK_S

READ = (
    "hw/tick", "hw/imu", "hw/joints", "hw/contacts", "cmd/joints", "state/gait", "state/velocity", "state/stability",
    "navigator/feedback", "sim/truth", "sim/status", "state/pose", "state/landmarks", "hw/landmarks", "hw/image",
    "hw/range",
)  # fmt: skip

LARGE = "pixels"
"""Name of the field of images that is left out: a recording has hundreds of megabytes of it."""
NEEDED = {"hw/imu": {"gyro", "acc"}, "hw/joints": {"position"}, "hw/contacts": {"touch"}}
"""Names of the fields without which a recorded message is skipped, by topic key; all other fields may be missing."""
CLOCKS = ("hw/tick", "sim/truth", "hw/imu")
"""Keys of topics with one message in each control tick, which serve as clocks of a recording."""
JUMP_S, BACK_S = 60.0, 0.05
"""`JUMP_S`: time from one message of a clock to the next, s, above which the clock jumps forward; `BACK_S`: step back,
s, above which it jumps back."""


@dataclass
class Signals:
    """Messages of a recorded run by topic key, as decoded JSON objects, in the order of their stamps."""

    rows: dict[str, list[dict[str, Any]]] = field(default_factory=lambda: defaultdict(list))
    joints: tuple[str, ...] = ()
    """Joint names of the recorded robot in message order; empty = the robot is unknown."""
    feet: tuple[str, ...] = ()
    """Leg names of the recorded robot in message order; empty = the robot is unknown."""
    damage: str = ""
    """Reason why a part of the recording cannot be read, in words; empty = all of it can be read."""
    jumps: str = ""
    """Clock jumps of the recording in words: back, or forward by more than `JUMP_S`; empty = none."""
    version: str = ""
    """Version of surefoot that made the recording, where it differs from the running version; else empty."""

    def joint(self, index: int) -> str:
        """Return the name of a joint, or `joint <index>` where the robot is unknown."""
        return self.joints[index] if index < len(self.joints) else f"joint {index}"

    def foot(self, index: int) -> str:
        """Return `foot <name>`, or `foot <index>` where the robot is unknown."""
        return f"foot {self.feet[index] if index < len(self.feet) else index}"

    def times(self, key: str) -> Array:
        """Return the control ticks of the messages of a key as times, (n,) s."""
        return TICK_S * np.array([row.get("tick", -1) for row in self.rows[key]], dtype=np.float64)

    def column(self, key: str, name: str) -> Array:
        """Return the field `name` of each message of a key as numbers, (n, ...), in its unit; null or absent is NaN.

        Lists of unequal length are cut to the shortest.

        Raises:
            SurefootError: the field holds other things than numbers.
        """
        found = [row.get(name) for row in self.rows[key]]
        size = min((len(v) for v in found if isinstance(v, Sequence)), default=0)
        blank: Any = [np.nan] * size if size else np.nan
        cut = [blank if v is None else v[:size] if isinstance(v, Sequence) else v for v in found]
        try:
            return np.array(cut, dtype=np.float64)
        except (ValueError, TypeError):
            raise SurefootError("malformed", f"{key}.{name} of the recording holds no numbers", name) from None

    @property
    def stands_statically(self) -> bool:
        """True if the recording has margins of a robot with four or more legs; those of a biped, which walks
        dynamically, fall below zero in each step and are no sign of a fault."""
        return len(next(iter(self.rows["state/stability"]), {}).get("stance", ())) >= 4

    @property
    def end(self) -> float:
        """Simulated time of the last control tick of the recording, s."""
        return max((float(self.times(key).max()) for key in CLOCKS if self.rows[key]), default=0.0)


def read_signals(path: Path | ReadableRecording, progress: Callable[[float], None] | None = None) -> Signals:
    """Return the messages of the last epoch of a recording: those after the last reset of the system.

    A file that is cut off or damaged is read as far as possible.

    Args:
        path: MCAP file, or the opened recording.
        progress: gets the share of the recorded time that is read.

    Raises:
        SurefootError: no message of the topics `READ` can be read.
    """
    recording = open_readable(path)
    joints, feet = _names(recording)
    found, epoch, lost = Signals(joints=joints, feet=feet, version=recording.version), -1, Counter[str]()
    for item in recording.messages(READ, progress):
        try:
            row = from_json(item.data, allow_inf_nan=False)
            now = int(row["epoch"])
            if not row.keys() >= NEEDED.get(item.key, frozenset()):
                raise ValueError(item.key)
        except (ValueError, KeyError, TypeError, OverflowError):
            lost[item.key] += 1
            continue
        if now > epoch:
            found.rows.clear()
            epoch = now
        if now == epoch:
            row.pop(LARGE, None)
            found.rows[item.key].append(row)
    broken = [f"{count} of {key} are no messages" for key, count in sorted(lost.items())]
    found.damage = "; ".join(filter(None, (recording.damage, *broken)))
    if not found.rows:
        raise SurefootError("invalid", f"{recording.path} has none of {', '.join(READ)}", "recording")
    found.jumps = _jumps(found)
    return found


def _names(recording: ReadableRecording) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of joints and legs of the recorded robot, where it is known."""
    try:
        robot = robot_of(recording)
    except SurefootError:
        return (), ()
    return tuple(joint.name for joint in robot.joints), robot.leg_names


def _jumps(s: Signals) -> str:
    """Return a sentence on the first jump of ticks, else of stamps, of each clock in `CLOCKS`; empty = none."""
    found: list[str] = []
    for key in CLOCKS:
        for times in (s.times(key), 1e-9 * s.column(key, "stamp_ns")) if s.rows[key] else ():
            steps = np.diff(times)
            if len(at := np.flatnonzero((steps < -BACK_S) | (steps > JUMP_S))):
                found.append(f"{key} from {times[at[0]]:.2f} to {times[at[0] + 1]:.2f} s")
                break
    return ", ".join(found)


def spans(times: Array, flags: NDArray[np.bool_], least_s: float) -> list[tuple[float, float]]:
    """Return begin and end, s, of each stretch of true flags (n,) at times (n,) s that lasts at least `least_s` s."""
    if not len(flags):
        return []
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    pairs = [(float(times[a]), float(times[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return [(a, b) for a, b in pairs if b - a >= least_s]
