"""Records that lie about themselves: a wrong checksum, a wrong length, or a summary that counts nothing."""

import random
import struct
import zlib
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk
from mcap.writer import CompressionType, IndexType, Writer

from surefoot.errors import SurefootError
from surefoot.record.check import Findings, check
from surefoot.record.chunks import MAGIC
from surefoot.record.recording import Recorded, open_readable, read_recording, recording_info
from tests.surefoot.expect import expect_error

NO_SUMMARY = {
    "use_statistics": False, "repeat_channels": False, "repeat_schemas": False, "use_summary_offsets": False,
    "index_types": IndexType.NONE,
}  # fmt: skip
MESSAGE = struct.Struct("<BQHIQQ")
"""Head of a message: code, length, channel, number, and its two stamps."""


def found_in(tmp_path: Path, content: bytes) -> Findings:
    path = tmp_path / "run.mcap"
    path.write_bytes(content)
    return check(path)


def written(attachment: bytes = b"", **given: Any) -> bytes:
    stream = BytesIO()
    writer = Writer(stream, compression=CompressionType.NONE, **given)
    writer.start()
    channel = writer.register_channel("a", "json", writer.register_schema("a", "jsonschema", b"{}"))
    for stamp in range(3):
        writer.add_message(channel, stamp, b"{}", stamp)
    if attachment:
        writer.add_attachment(0, 0, "robot.toml", "text/plain", attachment)
    writer.finish()
    return stream.getvalue()


def test_an_attachment_with_a_wrong_byte_is_left_out_and_named(tmp_path):
    content = written(b"mass_kg = 3.2")
    assert found_in(tmp_path, content).attachments == {"robot.toml": b"mass_kg = 3.2"}
    found = found_in(tmp_path, content.replace(b"mass_kg = 3.2", b"mass_kg = 9.2"))
    assert found.attachments == {}
    assert not found.whole
    assert any("checksum is wrong" in problem for problem in found.problems)
    assert found.messages == {"a": 3}


def test_a_summary_without_numbers_of_messages_counts_none(tmp_path):
    found = found_in(tmp_path, written(use_statistics=False))
    assert found.messages == {"a": 3}
    assert found.uncounted
    assert not found_in(tmp_path, written()).uncounted


def test_a_record_that_goes_beyond_its_chunk_is_damage(tmp_path):
    sound = MESSAGE.pack(5, 22 + 2, 1, 0, 0, 0) + b"{}"
    for more, damaged in ((0, 0), (1, 1)):
        records = sound + MESSAGE.pack(5, 22 + 2 + more, 1, 1, 1, 1) + b"{}"
        builder = RecordBuilder()
        Chunk(
            compression="", data=records, message_start_time=0, message_end_time=1,
            uncompressed_crc=zlib.crc32(records), uncompressed_size=len(records),
        ).write(builder)  # fmt: skip
        found = found_in(tmp_path, MAGIC + builder.end())
        assert (found.chunks, found.damaged) == (1, damaged)
        assert any("goes beyond the end of its chunk" in problem for problem in found.problems) == bool(more)


@pytest.mark.parametrize("given", [{"use_statistics": False}, NO_SUMMARY], ids=["no statistics", "no summary"])
def test_facts_of_a_recording_without_counts_are_refused(tmp_path, given):
    path = tmp_path / "run.mcap"
    path.write_bytes(written(**given))
    with expect_error(SurefootError, "malformed", text="the recorder did not finish"):
        recording_info(path)


def test_a_message_of_an_unknown_key_is_refused_by_its_key():
    with expect_error(SurefootError, "unknown_key", text="'hw/none'"):
        Recorded("hw/none", 0, None, b"{}").message()


def test_a_whole_recording_without_chunks_is_read(tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(written(use_chunking=False))
    assert [item.stamp_ns for item in open_readable(path).messages()] == [0, 1, 2]


@pytest.mark.parametrize("seed", range(20))
def test_messages_of_overlapping_chunks_come_in_the_order_of_the_librarys_reader(tmp_path: Path, seed: int) -> None:
    draw, path, stamp = random.Random(seed), tmp_path / "run.mcap", 0
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=draw.choice((60, 200, 2000)))
        writer.start()
        channels = [writer.register_channel(f"t/{k}", "json", 0) for k in range(3)]
        for number in range(draw.randrange(1, 200)):
            stamp = max(0, stamp + draw.choice((0, 1, 5, -20, 40)))
            writer.add_message(draw.choice(channels), stamp, b"%d" % number, stamp, number)
        writer.finish()
    assert list(open_readable(path).messages()) == list(read_recording(path))
