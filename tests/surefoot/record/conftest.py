"""A recording that tests spoil."""

import numpy as np
import pytest

from surefoot.bus.codec import encode
from surefoot.bus.interface import Raw
from surefoot.record.recording import RecordingWriter, read_recording
from surefoot.schemas.hw import Imu
from surefoot.schemas.topics import HW_IMU

MESSAGES = 12_000


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, list[bytes]]:
    """A recording of several chunks of noise, which packs badly, so that damage hits data; and its messages."""
    path = tmp_path_factory.mktemp("bag") / "run.mcap"
    writer = RecordingWriter(path, {"robot": "ragno"})
    for tick, values in enumerate(np.random.default_rng(1).normal(size=(MESSAGES, 6)).tolist()):
        message = Imu(acc=values[:3], gyro=values[3:]).stamped(tick * 10_000_000, tick, 1, tick, "driver")
        writer.write(HW_IMU, message, Raw(*encode(message), ""))
    writer.close({})
    return path.read_bytes(), [item.data for item in read_recording(path)]


@pytest.fixture(scope="session")
def content(whole: tuple[bytes, list[bytes]]) -> bytes:
    """The recording alone."""
    return whole[0]
