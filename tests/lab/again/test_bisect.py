"""First difference of two recordings, in one pass, against whole lists of both."""

import json
import tracemalloc
from typing import Any

import numpy as np
import pytest

from surefoot.bus.interface import Raw
from surefoot.lab.again.bisect import ORDER, first_difference
from surefoot.record import recording
from surefoot.record.check import sound_messages
from surefoot.record.recording import RecordingWriter, read_recording, topic_of
from surefoot.schemas.base import Header

KEYS = ("hw/imu", "hw/joints", "state/gait", "sim/truth", "log/walker")
TICKS = 40


def rows_of(ticks=TICKS):
    return [(key, tick, {"tick": tick, "value": tick % 7}) for tick in range(ticks) for key in KEYS]


def write(path, rows):
    writer = RecordingWriter(path, {})
    for key, tick, content in rows:
        raw = Raw(json.dumps(content).encode(), None, "")
        topic: Any = topic_of(key)
        writer.write(topic, Header(stamp_ns=tick * 10**7, tick=tick, source="walker"), raw)
    writer.close({})
    return path


def spoilt(random, rows):
    """Return rows with some changed, left out, doubled or late."""
    found = list(rows)
    for _ in range(int(random.integers(1, 4))):
        at = int(random.integers(len(found)))
        key, tick, content = found[at]
        match int(random.integers(5)):
            case 0:
                found[at] = key, tick, {**content, "value": 99}
            case 1:
                del found[at]
            case 2:
                found.insert(at, found[at])
            case 3:
                found[at] = key, tick + 3, content
            case 4:
                found = [row for i, row in enumerate(found) if row[0] != key or i < at]
    return found


def by_lists(a, b):
    """Return key, tick and field of the first difference, from whole lists of each key."""
    held = [{key: list(read_recording(path, (key,))) for key in KEYS[:-1]} for path in (a, b)]
    found = []
    for key in KEYS[:-1]:
        one, other = (messages[key] for messages in held)
        for x, y in zip(one, other, strict=False):
            if (x.data, x.stamp_ns) != (y.data, y.stamp_ns):
                p, q = json.loads(x.data), json.loads(y.data)
                name = next((n for n in p if p[n] != q[n]), "stamp_ns")
                found.append((min(p["tick"], q["tick"]), ORDER[key], key, name))
                break
        else:
            if len(one) != len(other):
                more = (one if len(one) > len(other) else other)[min(len(one), len(other))]
                found.append((json.loads(more.data)["tick"], ORDER[key], key, ""))
    return min(found)[2:] + min(found)[:1] if found else None


@pytest.mark.parametrize("seed", range(15))
def test_the_first_difference_is_that_of_whole_lists(tmp_path, seed):
    random = np.random.default_rng(seed)
    a, b = write(tmp_path / "a.mcap", rows_of()), write(tmp_path / "b.mcap", spoilt(random, rows_of()))
    for one, other in ((a, b), (b, a)):
        found, expected = first_difference(one, other), by_lists(one, other)
        assert (None if found is None else (found.key, found.field, found.tick)) == expected


def test_logs_are_no_difference(tmp_path):
    a = write(tmp_path / "a.mcap", rows_of())
    b = write(tmp_path / "b.mcap", [row for row in rows_of() if row[0] != "log/walker"])
    assert first_difference(a, b) is None


def test_files_are_compared_in_bounded_memory(tmp_path, monkeypatch):
    """A key that ends early in one file, and whose messages have 2 kB, must not pile up from the other."""
    rows = [(key, tick, {**row, "pad": "x" * 2000}) for key, tick, row in rows_of(800)]
    a = write(tmp_path / "a.mcap", rows)
    b = write(tmp_path / "b.mcap", [row for row in rows if row[0] != "hw/imu" or row[1] < 20])
    read = []
    monkeypatch.setattr(recording, "sound_messages", lambda *words: read.append(words[0]) or sound_messages(*words))
    tracemalloc.start()
    found = first_difference(a, b)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found is not None
    assert (found.key, found.tick, found.b) == ("hw/imu", 20, "absent")
    assert sorted(read) == [a, b]
    assert peak < sum(len(row["pad"]) for _, _, row in rows) / 2
