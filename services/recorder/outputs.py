"""Files of the recorder: one of a whole run, or one of the last seconds at each fall, stop or request."""

import json
import math
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from surefoot.bus.interface import Raw
from surefoot.errors import Refusal
from surefoot.record.recording import RecordingWriter
from surefoot.schemas.topics import SIM_STATUS, SIM_TRUTH, STATE_VELOCITY, TICK_S, Kind, Topic
from surefoot.version import VERSION

from .config import RecorderConfig

FALLEN_RAD = math.radians(45.0)
"""Estimated tilt of the trunk, rad, above which a robot without ground truth counts as fallen, as in `surefoot why`."""
LOOK_TICKS = 10
"""Control ticks between two checks of the estimated tilt for a fall."""


class Output(Protocol):
    """Destination of the recorder: a file per run, or a ring of the last seconds."""

    path: str
    """Path of the file that was written last; empty = none yet."""

    @property
    def unsaved(self) -> int | None:
        """First tick of which messages are not in a file yet; None = there is none."""
        ...

    def begin(self, epoch: int, seed: int, *, begun: bool) -> None:
        """Begin run number `epoch`; ``begun``: True if an earlier process recorded its first part (raises OSError)."""
        ...

    def write(self, topic: Topic[Any], header: Any, raw: Raw, tick: int) -> None:
        """Record a message of a tick (raises OSError)."""
        ...

    def end(self, summary: dict[str, str], hashes: Mapping[str, str]) -> None:
        """End the recording of the epoch (raises OSError).

        `summary`: facts on the run; `hashes`: digest of each key.
        """
        ...

    def save(self, reason: str) -> tuple[str, int]:
        """Write the messages in memory to a file; return its path and their number (raises OSError, Refusal)."""
        ...


class _Description:
    """Metadata and attached files that every file of a recorder carries."""

    def __init__(self, config: RecorderConfig) -> None:
        self._config = config

    def writer(self, path: Path, **more: str) -> RecordingWriter:
        """Create a recording with the metadata of the run and `more`; return its writer (raises OSError)."""
        tables = self._config.tables
        run = {"robot": self._config.robot, **tables.pop("run", {}), **more, "version": VERSION}
        files: dict[str, bytes] = {}
        for name, place in tables.pop("files", {}).items():
            try:
                files[name] = Path(place).read_bytes()
            except OSError as error:
                run[f"not attached: {name}"] = error.strerror or str(error)
        return RecordingWriter(path, run, tables, files)


class WholeRun:
    """Output that writes one file for each run (epoch) and never overwrites a part that an earlier process wrote."""

    def __init__(self, config: RecorderConfig, path: Path) -> None:
        self._description, self._path, self.path = _Description(config), path, str(path)
        self._writer: RecordingWriter | None = None
        self._files = 0
        self.unsaved: int | None = None

    def begin(self, epoch: int, seed: int, *, begun: bool) -> None:
        """Begin the file of a run, `epoch` its number, unless it is open already.

        `begun`: True if an earlier process recorded the run until now; its file is not overwritten.
        """
        if self._writer is not None:
            return
        self._files += 1
        path = _free(self._path, self._files) if self._files > 1 or begun else self._path
        self._writer = self._description.writer(path, epoch=str(epoch), seed=str(seed))
        self.path, self.unsaved = str(path), None

    def write(self, topic: Topic[Any], header: Any, raw: Raw, tick: int) -> None:
        """Append a message to the open file of the run, if there is one (raises OSError)."""
        try:
            if self._writer is not None:
                self.unsaved = tick if self.unsaved is None else self.unsaved
                self._writer.write(topic, header, raw)
                if not self._writer.waiting:
                    self.unsaved = None
        except OSError:
            if self._writer is not None:
                self._writer.give_up()
            self._writer = None
            raise

    def end(self, summary: dict[str, str], hashes: Mapping[str, str]) -> None:
        """Write summary and index of the recording and close its file (raises OSError)."""
        writer, self._writer = self._writer, None
        if writer is None:
            return
        try:
            writer.close(summary, hashes)
        except OSError:
            writer.give_up()
            raise

    def save(self, reason: str) -> tuple[str, int]:
        """Refuse the request (raises Refusal): all of the run is written anyway."""
        raise Refusal("refused", "ring_s is 0: the whole run is written, to recorder/status.path", "ring_s")


class _RingMessage(NamedTuple):
    tick: int
    topic: Topic[Any]
    header: Any
    raw: Raw


class LastSeconds:
    """Output that holds the last seconds of a run in memory and writes a file at each fall, stop and request."""

    def __init__(self, config: RecorderConfig, path: Path, facts: Callable[[], dict[str, str]]) -> None:
        """Prepare an empty buffer; `path`: of the files; `facts`: returns facts on the run so far, for each file."""
        self._description, self._path, self.path, self._facts = _Description(config), path, "", facts
        self._span = max(1, round(config.ring_s / TICK_S))
        self._ring_s = config.ring_s
        self._begin(0, 0)

    def _begin(self, epoch: int, seed: int) -> None:
        self._epoch, self._seed, self._tick = epoch, seed, -1
        self._ring: deque[_RingMessage] = deque()
        self._latched: dict[str, _RingMessage] = {}
        self._fallen, self._stopped = False, ""
        self._saved = -1  # last tick of the last file

    @property
    def unsaved(self) -> int | None:
        """First tick of which messages are held in memory only; None = there is none."""
        return next((kept.tick for kept in self._ring if kept.tick > self._saved), None)

    def begin(self, epoch: int, seed: int, *, begun: bool) -> None:
        """Drop the messages in memory if they are of another run than `epoch`; `begun` has no effect."""
        if epoch != self._epoch:
            self._begin(epoch, seed)

    def write(self, topic: Topic[Any], header: Any, raw: Raw, tick: int) -> None:
        """Keep a message, drop those older than the ring's span, and write all to a file when a fall or stop begins."""
        kept = _RingMessage(tick, topic, header, raw)
        if topic.kind is Kind.LATCHED:
            self._latched[topic.key] = kept
        else:
            self._ring.append(kept)
        self._tick = max(self._tick, tick)
        while self._ring and self._ring[0].tick <= self._tick - self._span:
            self._ring.popleft()
        if event := self._event(topic, raw, tick):
            self.save(event)

    def _event(self, topic: Topic[Any], raw: Raw, tick: int) -> str:
        """Return the event that begins with a message: `fall` or `stop`; empty if none does."""
        if topic is SIM_STATUS:
            before, self._stopped = self._stopped, str(_content(raw).get("stopped") or "")
            return "stop" if self._stopped and not before else ""
        if topic is SIM_TRUTH:
            fallen = b'"fallen":true' in raw.payload
        elif topic is STATE_VELOCITY and SIM_TRUTH.key not in self._seen and tick % LOOK_TICKS == 0:
            fallen = _tilt(_content(raw).get("g_up")) > FALLEN_RAD
        else:
            return ""
        before, self._fallen = self._fallen, fallen
        return "fall" if fallen and not before else ""

    @property
    def _seen(self) -> set[str]:
        """Return the keys of the messages that the ring holds of the last tick."""
        found = set[str]()
        for kept in reversed(self._ring):
            if kept.tick < self._tick - 1:
                break
            found.add(kept.topic.key)
        return found

    def end(self, summary: dict[str, str], hashes: Mapping[str, str]) -> None:
        """Do nothing: the end of a run writes no file."""

    def save(self, reason: str) -> tuple[str, int]:
        """Write the messages of the ring to a file; return its path and their number."""
        path = _free(self._path.with_stem(f"{self._path.stem}-{reason}"), 1)
        facts = {"reason": reason, "ring_s": f"{self._ring_s:g}", "epoch": str(self._epoch), "seed": str(self._seed)}
        writer = self._description.writer(path, **facts)
        for kept in (*self._latched.values(), *self._ring):
            writer.write(kept.topic, kept.header, kept.raw)
        writer.close(self._facts())
        self.path, self._saved = str(path), self._tick
        return self.path, writer.messages


def output_of(config: RecorderConfig, facts: Callable[[], dict[str, str]]) -> Output | None:
    """Return the output for a configuration of the recorder; None: no file is written.

    `facts`: returns what is known of the run so far, for files that are written before its end.
    """
    if not config.path:
        return None
    return LastSeconds(config, Path(config.path), facts) if config.ring_s else WholeRun(config, Path(config.path))


def _content(raw: Raw) -> dict[str, Any]:
    try:
        return json.loads(raw.payload)
    except ValueError:
        return {}


def _tilt(up: Any) -> float:
    """Return the angle between the up direction (3,), base_link, and the trunk's z axis, rad; 0 if it is unknown."""
    match up:
        case [int() | float() as x, int() | float() as y, int() | float() as z]:
            return math.atan2(math.hypot(x, y), z) if (x, y, z) != (0.0, 0.0, 0.0) else 0.0
        case _:
            return 0.0


def _free(path: Path, number: int) -> Path:
    """Return the first path with a number from ``number`` on that no file has; number 1 leaves the name unchanged."""
    found = path if number == 1 else path.with_stem(f"{path.stem}-{number}")
    return _free(path, number + 1) if found.exists() else found
