"""Search for the first message and field in which two recordings differ."""

import json
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from surefoot.bus.interface import Raw
from surefoot.errors import SurefootError
from surefoot.record.recording import LATEST_NS, ReadableRecording, Recorded, open_readable
from surefoot.schemas.base import Bulk
from surefoot.schemas.topics import TOPICS, Kind

ORDER = {topic.key: place for place, topic in enumerate(TOPICS)}
"""Index of each topic in the table of topics, by key; it orders differences within one control tick."""
COMPARED = tuple(topic.key for topic in TOPICS if topic.deterministic and topic.kind is not Kind.STATUS)
"""Keys of the topics that are compared: their messages are identical whenever a run is repeated."""


@dataclass(frozen=True)
class FirstDifference:
    """First message and field in which two recordings differ.

    Attributes:
        key, tick: key of the topic, and control tick of the message.
        field: path of the field in the message; empty if one recording lacks the message.
        a, b: value of the field in each recording, or `there` and `absent` if one lacks the message.
    """

    key: str
    tick: int
    field: str
    a: str
    b: str

    @property
    def sentence(self) -> str:
        """Difference as a sentence: topic, tick, field, and the value in each recording."""
        where = f"field {self.field}" if self.field else "the message"
        return f"{self.key} at tick {self.tick}, {where}: {self.a} in the first, {self.b} in the second"


def first_difference(
    a: Path | ReadableRecording,
    b: Path | ReadableRecording,
    progress: Callable[[float], None] | None = None,
    keys: Collection[str] | None = None,
) -> FirstDifference | None:
    """Return the first difference of the deterministic messages of two recordings; None = there is none.

    Both files are read side by side in the order of their stamps. Of a file that is cut off or damaged only the part
    before the first loss is compared; later messages do not count as absent.

    Args:
        a, b: MCAP files, or recordings that are open.
        progress: called with the share of `a` that has been read, 0 to 1.
        keys: keys of the topics to compare; None = all deterministic ones.

    Raises:
        SurefootError: a file cannot be read, or both have no key in common.
    """
    x, y = open_readable(a), open_readable(b)
    both = _keys(x, keys), _keys(y, keys)
    if not both[0] & both[1]:
        raise SurefootError("invalid", f"{x.path} and {y.path} have no deterministic topic in common", "recording")
    pairing = _Pairing(both, (bool(x.damage), bool(y.damage)))
    one, other = (tuple(sorted(own)) for own in both)
    streams = x.messages(one, progress, gapless=True), y.messages(other, gapless=True)
    ahead = [next(stream, None) for stream in streams]
    while (side := _earlier(ahead)) is not None:
        item = ahead[side]
        assert item is not None
        facing = ahead[1 - side]
        pairing.take(side, item, LATEST_NS + 1 if facing is None else facing.stamp_ns)
        ahead[side] = next(streams[side], None)
    pairing.end()
    return min(pairing.found, key=lambda each: (each.tick, ORDER.get(each.key, len(ORDER))), default=None)


def _earlier(ahead: list[Recorded | None]) -> int | None:
    """Return the index, 0 or 1, of the stream whose next message is earlier; None = both streams have ended."""
    one, other = ahead
    if one is None:
        return None if other is None else 1
    return 0 if other is None or one.stamp_ns <= other.stamp_ns else 1


class _Pairing:
    """Comparison that pairs the n-th message of a key in one file with the n-th in the other, until they differ.

    Attributes:
        found: first difference of each key that has one.
    """

    def __init__(self, keys: tuple[set[str], set[str]], cut: tuple[bool, bool]) -> None:
        self.found: list[FirstDifference] = []
        self._keys, self._ended, self._cut = keys, set[str](), cut
        self._waiting: dict[str, tuple[int, deque[Recorded]]] = {}

    def take(self, side: int, item: Recorded, now_ns: int) -> None:
        """Pair the next message of file `side` (0 or 1); the next stamp of the other file is `now_ns`."""
        key = item.key
        if key in self._ended:
            return
        owner, waiting = self._waiting.get(key) or self._waiting.setdefault(key, (side, deque()))
        if waiting and owner != side:
            before = waiting.popleft()
            if before.data != item.data or before.stamp_ns != item.stamp_ns:
                pair = (before, item) if owner == 0 else (item, before)
                self._end(_field(key, _content(pair[0]), _content(pair[1]), *pair))
            return
        if key not in self._keys[1 - side]:
            self._miss(item, side)
        elif not waiting:
            self._waiting[key] = side, deque((item,))
        elif waiting[0].stamp_ns >= now_ns:  # else what waits differs from all that the other can have
            waiting.append(item)

    def end(self) -> None:
        """Record the messages left without a partner as absent in the other file; called when both files are read."""
        for side, waiting in list(self._waiting.values()):
            if waiting and waiting[0].key not in self._ended:
                self._miss(waiting[0], side)

    def _miss(self, item: Recorded, side: int) -> None:
        """Record a message of file `side` as absent in the other file, unless that file is damaged or cut off."""
        if self._cut[1 - side]:
            self._ended.add(item.key)
        else:
            self._end(_absent(item, side))

    def _end(self, difference: FirstDifference) -> None:
        self.found.append(difference)
        self._ended.add(difference.key)
        self._waiting.pop(difference.key, None)


def _absent(item: Recorded, side: int) -> FirstDifference:
    """Return the difference of a message that only one file has; `side`: index of that file, 0 or 1."""
    there = ("there", "absent") if side == 0 else ("absent", "there")
    return FirstDifference(item.key, int(_content(item).get("tick", -1)), "", *there)


def _keys(recording: ReadableRecording, wanted: Collection[str] | None) -> set[str]:
    return {key for key in recording.found.messages if key in COMPARED and (wanted is None or key in wanted)}


def _content(item: Recorded) -> dict[str, Any]:
    """Return a message as JSON values; of a message with a raw array only the header."""
    raw: Raw = item.raw()
    bulk = item.model is not None and issubclass(item.model, Bulk)
    try:
        return json.loads((raw.attachment if bulk else raw.payload) or b"{}")
    except ValueError:
        return {}


def _field(key: str, a: dict[str, Any], b: dict[str, Any], x: Recorded, y: Recorded) -> FirstDifference:
    tick = min(int(a.get("tick", -1)), int(b.get("tick", -1)))
    for path, one, other in _departures(a, b, ""):
        return FirstDifference(key, tick, path, one, other)
    if x.stamp_ns != y.stamp_ns:
        return FirstDifference(key, tick, "stamp_ns", str(x.stamp_ns), str(y.stamp_ns))
    return FirstDifference(key, tick, "data", f"{len(x.data)} bytes", f"{len(y.data)} other bytes")


def _departures(a: Any, b: Any, path: str) -> Iterator[tuple[str, str, str]]:
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        for name in [*a, *(name for name in b if name not in a)]:
            yield from _departures(a.get(name, "absent"), b.get(name, "absent"), f"{path}.{name}".removeprefix("."))
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for number, (one, other) in enumerate(zip(a, b, strict=True)):
            yield from _departures(one, other, f"{path}.{number}")
    elif a != b:
        yield path, json.dumps(a)[:80], json.dumps(b)[:80]
