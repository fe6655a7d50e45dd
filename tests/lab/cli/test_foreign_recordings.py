"""Recordings that others have changed: one sentence with what was received and what is allowed, and no new file."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

Row = dict[str, Any]


def rewritten(
    source: Path, out: Path, change: Callable[[str, Row], Row], encoding: str = "json", robot: str = ""
) -> Path:
    """Write a recording again without its attachments, each JSON message changed."""
    with source.open("rb") as file, out.open("wb") as stream:
        reader, writer, channels = make_reader(file), Writer(stream), dict[str, int]()
        writer.start("", "somebody else")
        for record in reader.iter_metadata():
            table = dict(record.metadata)
            if record.name == "run" and robot:
                table["robot"] = robot
            writer.add_metadata(record.name, table)
        for schema, channel, message in reader.iter_messages():
            if channel.message_encoding != "json" or schema is None:
                continue
            if channel.topic not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, encoding, number)
            data = json.dumps(change(channel.topic, json.loads(message.data))).encode()
            writer.add_message(channels[channel.topic], message.log_time, data, message.log_time, message.sequence)
        writer.finish()
    return out


def few_joints(key: str, row: Row) -> Row:
    """Return a row with five joints."""
    return {**row, "position": row["position"][:5]} if key == "hw/joints" else row


def later_ticks(key: str, row: Row) -> Row:
    """Return a row whose tick no machine word holds."""
    return {**row, "tick": 10**30}


def before_zero(key: str, row: Row) -> Row:
    """Return a row of a clock that jumps before its beginning."""
    return {**row, "stamp_ns": row["stamp_ns"] - 10**9} if key.startswith("hw/") else row


def same(key: str, row: Row) -> Row:
    """Return a row as it is."""
    return row


CASES = [
    (few_joints, "json", "", "audit", "has 5 joints, ragno has 18"),
    (same, "json", "nao", "audit", "has 18 joints, nao has 25"),
    (later_ticks, "json", "", "estimate", "allowed are 64 bits"),
    (before_zero, "json", "", "bag export --to rosbag2 -o b", "got -1000000000, allowed is 0 or more"),
    *(
        (same, "cbor", "", words, "is encoded as 'cbor', allowed is 'json'")
        for words in ("why", "report -o r.html", "audit", "estimate", "bag export --to csv -o c.csv", "render -o p.png")
    ),
]


@pytest.fixture(scope="module")
def foreign(recorded, tmp_path_factory):
    """Maker of foreign recordings, each written once."""
    folder, made = tmp_path_factory.mktemp("foreign"), dict[Any, Path]()

    def of(change, encoding, robot):
        key = (change, encoding, robot)
        if key not in made:
            made[key] = rewritten(recorded, folder / f"{len(made)}.mcap", change, encoding, robot)
        return made[key]

    return of


@pytest.mark.parametrize(("change", "encoding", "robot", "words", "part"), CASES)
def test_a_foreign_recording_is_refused_in_one_sentence(
    complaint, foreign, tmp_path, monkeypatch, change, encoding, robot, words, part
):
    file = Path(shutil.copy(foreign(change, encoding, robot), tmp_path / "foreign.mcap"))
    monkeypatch.chdir(tmp_path)
    command, *options = words.split(" -", 1)
    err = complaint(*command.split(), file, *(f"-{options[0]}".split() if options else ()))
    assert part in err
    assert "internal error" not in err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["foreign.mcap"]
