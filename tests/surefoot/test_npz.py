"""Damaged NPZ files of every way of packing: each reader refuses them with a typed error, and none waits for a pipe."""

import os
import re
import zipfile
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.geometry.heightmap_files import load as load_map
from surefoot.lab.estimation.differences import load_estimated
from surefoot.record.tables import read_table
from surefoot.services.navigator.belief.landmark_files import SCHEMA
from surefoot.services.navigator.belief.landmark_files import load as load_landmarks
from surefoot.services.vision.feature_map import load as load_features

READERS = [read_table, load_map, load_landmarks, load_features, load_estimated]
N = 60
ARRAYS = {
    read_table: {
        "t": 0.01 * np.arange(N), "gyro": np.random.default_rng(0).normal(size=(N, 3)), "acc": np.full((N, 3), 5.7)
    },
    load_map: {
        "z": np.zeros((9, 9), dtype=np.float32), "origin": np.zeros(2), "cell": np.array(0.01),
        "version": np.array(1), "frame": np.array("map"),
    },
}  # fmt: skip
ARRAYS[load_landmarks] = {
    "schema": np.array(SCHEMA), "positions": np.random.default_rng(0).normal(size=(9, 2)), "version": np.array(1),
    "descriptors": np.random.default_rng(1).normal(size=(9, 8)), "source": np.array("test"),
}  # fmt: skip
"""Content that a reader takes when it is sound; the others get that of `read_table`, which they refuse."""
METHODS = {
    "stored": zipfile.ZIP_STORED,
    "zlib": zipfile.ZIP_DEFLATED,
    "bzip2": zipfile.ZIP_BZIP2,
    "lzma": zipfile.ZIP_LZMA,
}


def named(reader) -> str:
    return reader.__module__.rpartition(".")[2]


def packed(arrays: dict[str, np.ndarray], method: int = zipfile.ZIP_STORED) -> bytes:
    stream = BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        for name, values in arrays.items():
            member = BytesIO()
            np.save(member, values)
            archive.writestr(f"{name}.npy", member.getvalue())
    return stream.getvalue()


def complaint_of(reader, path: Path, content: bytes) -> str:
    """Return what a reader complains about, empty when it takes the file; what it raises has to be typed."""
    path.write_bytes(content)
    try:
        reader(path)
    except SurefootError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("reader", READERS, ids=named)
def test_wrong_bytes_are_refused(tmp_path, reader, method):
    whole = packed(ARRAYS.get(reader, ARRAYS[read_table]), METHODS[method])
    assert bool(complaint_of(reader, tmp_path / "log.npz", whole)) == (reader not in ARRAYS)
    random = np.random.default_rng(1)
    for _ in range(60):
        torn = bytearray(whole)
        for place in random.integers(0, len(torn), size=3):
            torn[place] = random.integers(256)
        assert "None" not in complaint_of(reader, tmp_path / "log.npz", bytes(torn))


LIES = {
    "more memory than there is": (rb"\(\d+, \d\), } +", b"(99999999999999,), }"),
    "encrypted": (b"PK\x01\x02\x14\x03\x14\x00\x00", b"PK\x01\x02\x14\x03\x14\x00\x01"),
    "another version of zip": (b"PK\x01\x02\x14\x03\x14", b"PK\x01\x02\x14\x03\xff"),
}


@pytest.mark.parametrize("lie", LIES)
@pytest.mark.parametrize("reader", READERS, ids=named)
def test_an_archive_that_lies_is_refused(tmp_path, reader, lie):
    honest, lying = LIES[lie]
    content = packed(ARRAYS.get(reader, ARRAYS[read_table]))
    made, count = re.subn(honest, lambda found: lying.ljust(len(found[0])), content)
    assert count
    assert complaint_of(reader, tmp_path / "log.npz", made)


@pytest.mark.parametrize("reader", READERS, ids=named)
def test_a_pipe_is_refused_at_once(tmp_path, reader):
    path = tmp_path / "log.npz"
    os.mkfifo(path)
    with pytest.raises(SurefootError):
        reader(path)
