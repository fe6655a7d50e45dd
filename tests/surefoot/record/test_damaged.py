"""Recordings that are cut off, flipped, holed or without a summary: what is sound is read, and the loss is stated."""

import re

import numpy as np
import pytest

from surefoot.bus.codec import encode
from surefoot.bus.interface import Raw
from surefoot.errors import SurefootError
from surefoot.record.chunks import MAGIC
from surefoot.record.recording import RecordingWriter, open_readable
from surefoot.schemas.hw import Imu
from surefoot.schemas.topics import HW_IMU
from tests.surefoot.record.conftest import MESSAGES

SHARE = re.compile(r"([\d.]+) % of its (\d+ messages|bytes)")


def opened(tmp_path, content):
    path = tmp_path / "run.mcap"
    path.write_bytes(content)
    found = open_readable(path)
    read = list(found.messages(("hw/imu",)))
    assert [item.stamp_ns for item in read] == sorted(item.stamp_ns for item in read)
    return found, [item.data for item in read]


def stated(found):
    """Return the lost share that the damage states, 0 to 1, and of what it is."""
    stated_loss = SHARE.search(found.damage)
    assert stated_loss is not None
    share, of = stated_loss.groups()
    return float(share) / 100.0, of.rpartition(" ")[2]


def test_a_whole_recording_has_no_damage(whole, tmp_path):
    found, read = opened(tmp_path, whole[0])
    assert (found.damage, found.found.lost_share) == ("", 0.0)
    assert read == whole[1]


@pytest.mark.parametrize("seed", range(8))
def test_flipped_bytes_cost_their_chunks_alone(whole, tmp_path, seed):
    content, messages = whole
    random, torn = np.random.default_rng(seed), bytearray(content)
    for place in random.integers(200, len(content) - 3000, size=2):
        torn[place] ^= int(random.integers(1, 256))
    found, read = opened(tmp_path, torn)
    assert found.metadata["run"]["robot"] == "ragno"
    kept = set(messages)
    assert all(data in kept for data in read)
    assert len(read) == len(set(read)) > 0.4 * MESSAGES
    assert stated(found) == (pytest.approx(1.0 - len(read) / MESSAGES, abs=0.0006), "messages")


@pytest.mark.parametrize("seed", range(8))
def test_without_a_summary_the_chunks_behind_a_hole_are_found(whole, tmp_path, seed):
    content, messages = whole
    random, size = np.random.default_rng(seed), len(content)
    end = int(random.uniform(0.7, 0.95) * size)
    begin, length = int(random.uniform(0.1, 0.3) * size), int(random.uniform(1, 200))
    torn = content[:begin] + random.bytes(length) + content[begin + length : end]
    found, read = opened(tmp_path, torn)
    assert set(read) <= set(messages)
    assert read[-1] in messages[int(0.5 * MESSAGES) :]
    assert len(read) > 0.4 * MESSAGES
    share, of = stated(found)
    assert of == "bytes"
    assert "what followed its end is unknown" in found.damage
    assert share == pytest.approx(1.0 - len(read) / (MESSAGES * end / size), abs=0.05)


@pytest.mark.parametrize("share", [0.3, 0.42, 0.5, 0.61, 0.7])
def test_without_gaps_the_messages_end_at_the_first_loss(whole, tmp_path, share):
    content, messages = whole
    torn = bytearray(content)
    torn[int(share * len(content))] ^= 1
    found, read = opened(tmp_path, torn)
    before = [item.data for item in found.messages(gapless=True)]
    assert before == messages[: len(before)]
    lost = next((at for at, pair in enumerate(zip(read, messages, strict=False)) if pair[0] != pair[1]), MESSAGES)
    assert len(before) == lost


@pytest.mark.parametrize("kept", [1.0, 0.9])
def test_messages_of_one_stamp_in_two_chunks_keep_their_order(tmp_path, kept):
    """Of a file without a summary, too, whatever chunks are packed to."""
    path = tmp_path / "run.mcap"
    writer = RecordingWriter(path, {"robot": "ragno"})
    for seq in range(MESSAGES):
        message = Imu(acc=(0.0, 0.0, 0.0), gyro=(0.0, 0.0, 0.0)).stamped(0, 0, 1, seq, "driver")
        writer.write(HW_IMU, message, Raw(*encode(message), ""))
    writer.close({})
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content)) - 1])
    read = [item.message().seq for item in open_readable(path).messages()]
    assert len(read) > 0.5 * MESSAGES
    assert read == list(range(len(read)))


@pytest.mark.parametrize("left_out", [1, 8, 40, 500])
def test_a_missing_summary_loses_no_message(whole, tmp_path, left_out):
    found, read = opened(tmp_path, whole[0][:-left_out])
    assert read == whole[1]
    assert stated(found)[0] < 0.01


def test_the_first_bytes_may_be_wrong(whole, tmp_path):
    found, read = opened(tmp_path, b"\0" * len(MAGIC) + whole[0][len(MAGIC) :])
    assert read == whole[1]
    assert "does not begin as MCAP files do" in found.damage


@pytest.mark.parametrize("share", [0.0, 0.001, 0.02])
def test_what_holds_no_message_is_refused(whole, tmp_path, share):
    with pytest.raises(SurefootError, match=r"empty|cut off or damaged"):
        opened(tmp_path, whole[0][: int(share * len(whole[0]))])
