"""Landmark maps in files: round trips, and files that are refused."""

import pickle
import zipfile

import numpy as np
import pytest

from surefoot.services.navigator.belief.landmark_files import MAX_ARCHIVE_BYTES, SCHEMA, load, save
from surefoot.services.navigator.belief.landmarks import FloorLandmarks, LandmarkMapError
from tests.services.navigator.belief.floors import floor
from tests.services.refusals import refused

WORLD = floor(1)
GOOD = {
    "schema": np.asarray(SCHEMA), "positions": WORLD.positions, "descriptors": WORLD.descriptors,
    "version": np.asarray(2), "source": np.asarray("test"),
}  # fmt: skip


def test_what_is_saved_is_loaded(tmp_path):
    world = FloorLandmarks(WORLD.positions, WORLD.descriptors, 5, "a run")
    there = load(save(world, tmp_path / "floor"))
    assert np.array_equal(there.positions, world.positions)
    assert np.array_equal(there.descriptors, world.descriptors)
    assert (there.version, there.source, there.sha256) == (5, "a run", world.sha256)
    assert not there.sd.any()
    unsure = FloorLandmarks(WORLD.positions, WORLD.descriptors, sd=np.linspace(0.0, 0.1, len(WORLD)))
    assert np.array_equal(load(save(unsure, tmp_path / "unsure")).sd, unsure.sd)


def test_a_map_without_deviations_has_exact_places(tmp_path):
    np.savez(tmp_path / "old.npz", **GOOD)
    assert np.array_equal(load(tmp_path / "old.npz").sd, np.zeros(len(WORLD)))


@pytest.mark.parametrize(
    ("key", "value", "field"),
    [
        ("schema", "surefoot.landmarks/2", "schema"),
        ("positions", np.zeros((0, 2)), "positions"),
        ("positions", np.zeros_like(WORLD.positions), "positions"),
        ("positions", np.full_like(WORLD.positions, np.nan), "positions"),
        ("positions", WORLD.positions[:-1], "descriptors"),
        ("positions", np.array(["a", "b"]), "positions"),
        ("descriptors", np.full_like(WORLD.descriptors, np.inf), "descriptors"),
        ("version", 1.5, "version"),
        ("version", np.array([2]), "version"),
        ("sd", np.full(len(WORLD), -0.01), "sd"),
        ("sd", np.zeros(len(WORLD) - 1), "sd"),
        ("sd", np.array(["a"]), "sd"),
        ("source", None, "file"),
        ("positions", None, "file"),
    ],
)
def test_what_is_no_map_is_refused(tmp_path, key, value, field):
    arrays = {**GOOD, key: np.asarray(value)}
    if value is None:
        del arrays[key]
    np.savez(tmp_path / "map.npz", allow_pickle=False, **arrays)
    with refused(LandmarkMapError, field=field):
        load(tmp_path / "map.npz")


class Opened:
    """A pickle that would write a file if it were loaded."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (open, (self.path, "w"))


def test_pickles_are_never_loaded(tmp_path):
    trap = tmp_path / "sprung"
    (tmp_path / "plain.npz").write_bytes(pickle.dumps(Opened(str(trap))))
    arrays = {**GOOD, "positions": np.array([Opened(str(trap))], dtype=object)}
    np.savez(tmp_path / "inside.npz", allow_pickle=True, **arrays)
    for name in ("plain.npz", "inside.npz"):
        with pytest.raises(LandmarkMapError):
            load(tmp_path / name)
    assert not trap.exists()


def test_damaged_and_missing_files_are_refused(tmp_path):
    whole = save(WORLD, tmp_path / "map").read_bytes()
    for content in (
        b"",
        b"x",
        whole[:10],
        whole[: len(whole) // 2],
        whole[:-30],
        whole[:200] + b"x" * 500 + whole[700:],
    ):
        (tmp_path / "map.npz").write_bytes(content)
        with pytest.raises(LandmarkMapError):
            load(tmp_path / "map.npz")
    np.save(tmp_path / "array.npy", WORLD.positions)
    with pytest.raises(LandmarkMapError):
        load(tmp_path / "array.npy")
    with refused(LandmarkMapError, "not_found"):
        load(tmp_path / "none.npz")
    with pytest.raises(LandmarkMapError):
        load(tmp_path)


def test_an_archive_of_too_many_bytes_is_refused_unread(tmp_path):
    np.savez(tmp_path / "map.npz", **GOOD)
    with (tmp_path / "map.npz").open("r+b") as stream:
        stream.truncate(MAX_ARCHIVE_BYTES + 1)
    with pytest.raises(LandmarkMapError, match=f"allowed are {MAX_ARCHIVE_BYTES}"):
        load(tmp_path / "map.npz")


def test_an_archive_that_unpacks_to_too_much_is_refused_unread(tmp_path):
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("positions.npy", bytes(300_000_000))
    with pytest.raises(LandmarkMapError, match="unpacks"):
        load(tmp_path / "bomb.npz")
