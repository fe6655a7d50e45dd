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


def rewritten(source: Path, out: Path, change: Callable[[str, Row], Any], encoding: str = "json", **run: str) -> Path:
    """Write a recording again without its attachments, each JSON message changed, or left out for None.

    Entries of `run` are put into the metadata of this name.
    """
    with source.open("rb") as file, out.open("wb") as stream:
        reader, writer, channels = make_reader(file), Writer(stream), dict[str, int]()
        writer.start("", "somebody else")
        for record in reader.iter_metadata():
            table = dict(record.metadata)
            if record.name == "run":
                table |= run
            writer.add_metadata(record.name, table)
        for schema, channel, message in reader.iter_messages():
            if channel.message_encoding != "json" or schema is None:
                continue
            row = change(channel.topic, json.loads(message.data))
            if row is None:
                continue
            if channel.topic not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, encoding, number)
            data = json.dumps(row).encode()
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


def all_before_zero(key: str, row: Row) -> Row:
    """Return a row of a driver whose whole clock begins a second early."""
    return {**row, "stamp_ns": row["stamp_ns"] - 10**9}


def nothing(key: str, row: Row) -> None:
    """Leave a row out."""


def no_turn(key: str, row: Row) -> Row:
    """Return a row whose true attitude is no rotation."""
    return {**row, "quat_wxyz": [0.0] * 4} if key == "sim/truth" else row


def no_object(key: str, row: Row) -> Any:
    """Return a list in the place of a row of the gait."""
    return [row] if key == "state/gait" else row


def later(ticks: int, stamps: int) -> Callable[[str, Row], Row]:
    """Return a change of the clocks from tick 200 on."""

    def change(key: str, row: Row) -> Row:
        jumps = row["tick"] > 200
        return {**row, "tick": row["tick"] + jumps * ticks, "stamp_ns": row["stamp_ns"] + jumps * stamps * 10**7}

    return change


TICKS_BACK, AN_HOUR, STAMPS_BACK = later(-100, -100), later(0, 360_000), later(0, -100)

CASES = [
    (all_before_zero, "json", "", "bag export --to foxglove -o f.mcap", "a pose at -1 s, allowed is 0 or more"),
    (nothing, "json", "", "bag export --to tum -o t.tum", "has no state/odometry"),
    (nothing, "json", "", "bag export --to rosbag2 -o b", "has none of hw/imu"),
    (nothing, "json", "", "why", "has none of hw/tick"),
    (same, "json", "nao", "render -o p.png", "hw/joints has 18 joints, nao has 25"),
    (same, "json", "nao", "bag export --to foxglove -o f.mcap", "hw/joints has 18 joints, nao has 25"),
    (same, "json", "nao", "estimate", "foreign has 18 joints, nao has 25"),
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
            made[key] = rewritten(
                recorded, folder / f"{len(made)}.mcap", change, encoding, **({"robot": robot} if robot else {})
            )
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


@pytest.mark.parametrize(
    ("change", "words", "code", "part"),
    [
        (
            no_turn,
            "render -o p.png",
            0,
            "could not be read and are left out: Truth.quat_wxyz",
        ),
        (AN_HOUR, "render -o p.webp --fps 2 --width 160", 0, "s to 3602.0"),
        (no_object, "why", 1, "only a part can be read: "),
        (TICKS_BACK, "why", 1, "the clock jumps: hw/tick from 2.00 to 1.01 s"),
        (STAMPS_BACK, "why", 1, "the clock jumps: hw/tick from 2.00 to 1.01 s"),
        (AN_HOUR, "why", 1, "the clock jumps: hw/tick from 2.00 to 3602.01 s"),
        (same, "why", 0, "nothing went wrong"),
    ],
)
def test_what_a_foreign_recording_lacks_is_stated(
    in_process, foreign, tmp_path, monkeypatch, change, words, code, part
):
    file = Path(shutil.copy(foreign(change, "json", ""), tmp_path / "foreign.mcap"))
    monkeypatch.chdir(tmp_path)
    command, *options = words.split()
    found, out, err = in_process(command, file, *options)
    assert (found, "internal error" in err) == (code, False)
    assert part in " ".join(out.split())
    assert ("jumps" in out) == ("jumps" in part)


@pytest.mark.parametrize(
    ("change", "robot", "code", "part"),
    [
        (no_turn, "", 1, "sim/truth for its pictures could not be read"),
        (AN_HOUR, "", 1, "the clock jumps: hw/tick from 2.00 to 3602.01 s"),
        (same, "nao", 0, "No replay: hw/joints has 18 joints, nao has 25."),
    ],
)
def test_a_report_states_what_its_recording_lacks(in_process, foreign, tmp_path, change, robot, code, part):
    assert in_process("report", foreign(change, "json", robot), "-o", tmp_path / "r.html")[0] == code
    assert part in (tmp_path / "r.html").read_text()
