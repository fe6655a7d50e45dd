"""Whatever happens to a recording, what can be read is counted, and never more than that."""

from pathlib import Path

import numpy as np
import pytest

from surefoot.bus.codec import encode
from surefoot.bus.interface import Raw
from surefoot.errors import SurefootError
from surefoot.record.check import check
from surefoot.record.recording import RecordingWriter, read_recording, verify_recording
from surefoot.schemas.hw import Imu
from surefoot.schemas.topics import HW_IMU

MESSAGES = 9000


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A recording of several chunks of noise, which packs badly: damage hits data."""
    path = tmp_path_factory.mktemp("bag") / "run.mcap"
    writer = RecordingWriter(path, {"robot": "ragno"})
    noise = np.random.default_rng(1).normal(size=(MESSAGES, 6)).tolist()
    for tick, values in enumerate(noise):
        message = Imu(acc=values[:3], gyro=values[3:]).stamped(tick * 10_000_000, tick, 1, tick, "driver")
        writer.write(HW_IMU, message, Raw(*encode(message), ""))
    writer.close({})
    return path.read_bytes()


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
        with pytest.raises(SurefootError) as caught:
            list(read_recording(path))
        assert "cut off or damaged" in caught.value.message


def test_a_hole_is_crossed_by_the_summary(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    third = len(content) // 3
    path.write_bytes(content[:third] + bytes(third) + content[2 * third :])
    found = check(path)
    assert not found.uncounted
    assert found.messages.total() + found.lost == MESSAGES
    assert 0.3 < found.lost / MESSAGES < 0.6
    with pytest.raises(SurefootError) as caught:  # the reader by index crosses it, too: it must not be silent
        list(read_recording(path))
    assert "cut off or damaged" in caught.value.message


@pytest.mark.parametrize(("data", "words"), [(b"", "is empty"), (b"hello", "is not an MCAP file")])
def test_what_is_no_recording_is_called_so(tmp_path: Path, data: bytes, words: str) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(data)
    with pytest.raises(SurefootError) as caught:
        verify_recording(path)
    assert words in caught.value.message
    with pytest.raises(SurefootError):
        verify_recording(tmp_path / "none.mcap")
