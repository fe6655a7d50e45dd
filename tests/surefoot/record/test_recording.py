"""Recordings are read back as they were, by any MCAP reader too; of a broken file what can be read is counted."""

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from mcap.reader import make_reader

from surefoot.bus.codec import encode, encoding_of
from surefoot.bus.interface import Raw
from surefoot.errors import SurefootError
from surefoot.record.check import check
from surefoot.record.recording import RecordingWriter, read_recording, recording_info, topic_of, verify_recording
from surefoot.record.runhash import RunHash
from surefoot.schemas.hw import Imu
from surefoot.schemas.system import Health, LogRecord
from surefoot.schemas.terrain import HeightMapMessage
from surefoot.schemas.topics import HEALTH, HW_IMU, LOG, TERRAIN_MAP
from tests.surefoot.expect import expect_error
from tests.surefoot.record.conftest import MESSAGES

MAP = HeightMapMessage(rows=2, cols=2, cell=0.1, origin=(0.0, -1.0), data=bytes(range(16))).stamped(
    0, 0, 1, 0, "driver"
)


def imu(tick: int) -> Imu:
    return Imu(acc=(tick / 3, 0.0, 9.81), gyro=(0.0, 0.0, -1e-17)).stamped(tick * 10_000_000, tick, 1, tick, "driver")


def raw(message: Imu | HeightMapMessage | LogRecord) -> Raw:
    return Raw(*encode(message), encoding_of(type(message)))


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    path = tmp_path / "deep" / "run.mcap"
    writer = RecordingWriter(path, {"robot": "ragno", "seed": "7"})
    writer.write(TERRAIN_MAP, MAP, raw(MAP))
    for tick in range(5000):
        writer.write(HW_IMU, imu(tick), raw(imu(tick)))
    log = LogRecord(source="walker", level="info", text="hello", stamp_ns=5)
    writer.write(LOG, log, raw(log))
    writer.close({"run_hash": "abc", "last_tick": "4999"})
    return path


def test_messages_are_read_back_as_they_were(bag: Path) -> None:
    found = list(read_recording(bag))
    assert len(found) == 5002
    assert [m.stamp_ns for m in found] == sorted(m.stamp_ns for m in found)
    assert [m.message() for m in found if m.key == "hw/imu"] == [imu(tick) for tick in range(5000)]
    (ground,) = read_recording(bag, ("terrain/map",))
    assert ground.message() == MAP
    assert ground.raw() == raw(MAP)
    (line,) = read_recording(bag, ("log/walker",))
    assert line.message() == LogRecord(source="walker", level="info", text="hello", stamp_ns=5)


def test_a_plain_reader_finds_json_with_its_schema(bag: Path) -> None:
    with bag.open("rb") as file:
        seen: set[str] = set()
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            assert schema.encoding == "jsonschema"
            if channel.message_encoding == "json" and channel.topic not in seen:
                seen.add(channel.topic)
                jsonschema.validate(json.loads(message.data), json.loads(schema.data))
                assert schema.name.startswith("surefoot/")
            if channel.topic == "hw/imu":
                assert message.sequence == message.log_time // 10_000_000
    assert seen == {"hw/imu", "log/walker"}


def test_info_tells_what_is_inside(bag: Path) -> None:
    info = recording_info(bag)
    assert info["messages"] == 5002
    assert info["topics"] == {"hw/imu": 5000, "log/walker": 1, "terrain/map": 1}
    assert info["metadata"]["run"] == {"robot": "ragno", "seed": "7"}
    assert info["metadata"]["surefoot"]["run_hash"] == "abc"
    assert (info["start_ns"], info["end_ns"]) == (0, 4999 * 10_000_000)


@pytest.mark.parametrize("read", [lambda path: list(read_recording(path)), recording_info], ids=["read", "info"])
@pytest.mark.parametrize("damage", ["none", "folder", "empty", "text", "cut", "torn"])
def test_a_broken_file_is_one_sentence(bag: Path, tmp_path: Path, damage: str, read: object) -> None:
    path = tmp_path / "x.mcap"
    content = bag.read_bytes()
    if damage == "folder":
        path.mkdir()
    elif damage != "none":
        torn = content[: len(content) // 3] + bytes(64) + content[len(content) // 3 + 64 :]
        path.write_bytes(
            {"empty": b"", "text": b"hello\n" * 99, "cut": content[: len(content) // 2], "torn": torn}[damage]
        )
    assert callable(read)
    if damage == "torn" and read is recording_info:
        return  # its index is whole
    with expect_error(SurefootError, text=str(path), without="\n") as caught:
        read(path)
    words = {"none": "No such file", "folder": "Is a directory", "empty": "is empty", "text": "is not an MCAP file"}
    assert words.get(damage, "is cut off or damaged") in caught.value.message


def test_what_was_written_before_a_crash_is_on_disk(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    writer = RecordingWriter(path, {})
    for tick in range(20_000):
        writer.write(HW_IMU, imu(tick), raw(imu(tick)))
    writer._file.flush()
    from mcap.stream_reader import StreamReader

    with path.open("rb") as file:
        records = [type(record).__name__ for record in _until_torn(StreamReader(file, emit_chunks=True))]
    assert records.count("Chunk") > 3
    writer.close({})


def _until_torn(reader: object) -> object:
    from mcap.exceptions import McapError

    try:
        yield from reader.records  # type: ignore[attr-defined]
    except McapError:
        return


def test_keys_belong_to_rows() -> None:
    assert topic_of("health/walker") == HEALTH
    assert topic_of("health/walker").model is Health  # type: ignore[union-attr]
    assert topic_of("state/nothing") is None


def test_hash_is_of_keys_and_bytes_not_of_the_order_between_keys() -> None:
    def run(order: list[tuple[str, int]], payload: bytes = b"{}") -> str:
        total = RunHash()
        for key, tick in order:
            total.update(key, 1, tick * 10, tick, payload, None)
        return total.hexdigest()

    ab = [(key, tick) for tick in range(5) for key in "ab"]
    assert run(ab) == run(sorted(ab))
    assert run(ab) != run([(key, tick) for tick in reversed(range(5)) for key in "ab"])
    assert run(ab) != run(ab[:-1])
    assert run(ab) != run(ab, b"{ }")
    assert run([("a", 1)]) != run([("b", 1)])


def test_a_whole_file_is_whole(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(content)
    found = check(path)
    assert found.whole
    assert (found.messages.total(), found.lost, found.damaged, found.uncounted) == (MESSAGES, 0, 0, False)
    assert found.chunks > 5
    assert list(found.messages) == ["hw/imu"]


@pytest.mark.parametrize("part", np.linspace(0.01, 0.99, 12))
def test_of_a_file_that_was_cut_off_the_whole_chunks_are_read(content: bytes, tmp_path: Path, part: float) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(content[: int(part * len(content))])
    found = check(path)
    assert not found.whole
    assert found.uncounted
    assert abs(found.messages.total() - part * MESSAGES) < 2 * MESSAGES / 5


@pytest.mark.parametrize("seed", range(40))
def test_a_wrong_byte_never_passes_and_costs_one_chunk(content: bytes, tmp_path: Path, seed: int) -> None:
    path = tmp_path / "run.mcap"
    rng = np.random.default_rng(seed)
    place = int(rng.integers(200, len(content) - 3000))  # in the data: header and summary have no checksum
    torn = bytearray(content)
    torn[place] ^= int(rng.integers(1, 256))
    path.write_bytes(torn)
    found = check(path)
    assert not found.whole
    assert found.messages.total() + found.lost == MESSAGES
    assert found.lost < MESSAGES / 4
    if found.damaged:
        with expect_error(SurefootError, text="cut off or damaged"):
            list(read_recording(path))


def test_a_hole_is_crossed_by_the_summary(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    third = len(content) // 3
    path.write_bytes(content[:third] + bytes(third) + content[2 * third :])
    found = check(path)
    assert not found.uncounted
    assert found.messages.total() + found.lost == MESSAGES
    assert 0.3 < found.lost / MESSAGES < 0.6
    with expect_error(SurefootError, text="cut off or damaged"):  # the reader by index crosses it, too
        list(read_recording(path))


@pytest.mark.parametrize(("data", "words"), [(b"", "is empty"), (b"hello", "is not an MCAP file")])
def test_what_is_no_recording_is_called_so(tmp_path: Path, data: bytes, words: str) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(data)
    with expect_error(SurefootError, text=words):
        verify_recording(path)
    with pytest.raises(SurefootError):
        verify_recording(tmp_path / "none.mcap")


@pytest.mark.parametrize(("stamp_ns", "seq"), [(-5, 0), (2**70, 0), (0, 2**40)])
def test_a_header_beyond_what_the_format_holds_ends_no_recording(tmp_path: Path, stamp_ns: int, seq: int) -> None:
    """Whoever publishes a log record chooses its header."""
    path = tmp_path / "run.mcap"
    writer = RecordingWriter(path, {})
    odd = LogRecord(source="x", level="info", text="a", stamp_ns=stamp_ns, seq=seq)
    for message in (odd, odd.model_copy(update={"stamp_ns": 7, "seq": 1})):
        writer.write(LOG, message, raw(message))
    writer.close({})
    assert sorted(item.message().stamp_ns for item in read_recording(path)) == sorted((stamp_ns, 7))


def test_a_message_of_a_channel_that_was_lost_is_one_sentence(bag: Path, tmp_path: Path) -> None:
    """Damage may take a channel or its schema and leave the messages: found by the fuzzer of files."""
    good, damaged, found = bag.read_bytes(), tmp_path / "damaged.mcap", 0
    for place in range(len(good) - 2000, len(good) - 30, 122):
        damaged.write_bytes(good[:place] + b"\x07" + good[place + 1 :])
        try:
            list(read_recording(damaged))
        except SurefootError:
            found += 1
    assert found > 0
