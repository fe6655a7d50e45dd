"""First message and field in which two recordings differ."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from surefoot.bus.interface import Raw
from surefoot.errors import SurefootError
from surefoot.record.recording import Recorded, read_recording, recording_info
from surefoot.schemas.base import Bulk
from surefoot.schemas.topics import TOPICS, Kind

ORDER = {topic.key: place for place, topic in enumerate(TOPICS)}
"""Place of a topic in the table, by which differences in one tick are ordered."""
COMPARED = tuple(topic.key for topic in TOPICS if topic.deterministic and topic.kind is not Kind.STATUS)
"""Keys that are the same whenever a run is repeated."""


@dataclass(frozen=True)
class FirstDifference:
    """First difference of two recordings.

    Attributes:
        key, tick: topic and control tick of the message.
        field: path in the message, empty where one recording lacks it.
        a, b: what stands there, `absent` where a recording lacks it.
    """

    key: str
    tick: int
    field: str
    a: str
    b: str

    @property
    def sentence(self) -> str:
        """Return the difference in words."""
        where = f"field {self.field}" if self.field else "the message"
        return f"{self.key} at tick {self.tick}, {where}: {self.a} in the first, {self.b} in the second"


def first_difference(a: Path, b: Path) -> FirstDifference | None:
    """Return the first difference in what is the same whenever a run is repeated; None: there is none.

    Raises:
        SurefootError: a file cannot be read, or both have no key in common.
    """
    keys = _keys(a) | _keys(b)
    if not _keys(a) & _keys(b):
        raise SurefootError("invalid", f"{a} and {b} have no deterministic topic in common", "recording")
    found = [each for key in sorted(keys) if (each := _first_of(key, a, b)) is not None]
    return min(found, key=lambda each: (each.tick, ORDER.get(each.key, len(ORDER))), default=None)


def _keys(path: Path) -> set[str]:
    return {key for key in recording_info(path)["topics"] if key in COMPARED}


def _first_of(key: str, a: Path, b: Path) -> FirstDifference | None:
    one, other = _messages(key, a), _messages(key, b)
    while True:
        x, y = next(one, None), next(other, None)
        if x is None and y is None:
            return None
        if x is None or y is None:
            left = _content(x or y)
            there = ("absent", "there") if x is None else ("there", "absent")
            return FirstDifference(key, int(left.get("tick", -1)), "", *there)
        if x.data != y.data or x.stamp_ns != y.stamp_ns:
            return _field(key, _content(x), _content(y), x, y)


def _messages(key: str, path: Path) -> Iterator[Recorded]:
    return read_recording(path, (key,)) if key in recording_info(path)["topics"] else iter(())


def _content(item: Recorded | None) -> dict[str, Any]:
    """Return the JSON of a message: the header of an array."""
    if item is None:
        return {}
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
