"""Maps of features: files that vision and the navigator both read, union, pruning, refusals."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.errors import Refusal
from surefoot.services.navigator.belief import landmark_files
from surefoot.services.vision.feature_map import has_features, load, merged, save
from tests.services.vision.test_recognise import made


def test_one_file_serves_vision_and_the_navigator(tmp_path):
    world = made(50)
    path = save(world, tmp_path / "floor")
    again, marks = load(path), landmark_files.load(path)
    assert np.array_equal(again.descriptors, world.descriptors)
    assert np.array_equal(again.positions, world.positions)
    assert (again.kind, again.pixel, again.opencv, again.version) == ("orb", 0.003, "5.0.0", 1)
    assert np.array_equal(marks.positions, world.positions)
    assert marks.descriptors == pytest.approx(world.codes)
    assert np.hypot.reduce(world.codes, axis=1) == pytest.approx(np.ones(50))
    assert has_features(path)


def test_a_union_keeps_what_both_saw_once():
    world = made(60)
    part, rest = world.chosen(np.arange(40)), world.chosen(np.arange(30, 60))
    both = merged(part, replace(rest, positions=rest.positions + 0.004))
    assert len(both) == 60
    assert both.seen.sum() == part.seen.sum() + rest.seen.sum()
    assert np.abs(both.positions[30:40] - world.positions[30:40]).max() == pytest.approx(0.002, abs=1e-9)
    with pytest.raises(Refusal, match="do not go together"):
        merged(world, replace(world, pixel=0.005))


def test_pruning_keeps_the_most_seen_of_each_place():
    world = replace(made(400), seen=np.arange(400))
    kept = world.pruned(100, 8.0)
    assert kept.seen.min() >= 100
    cells = np.unique(np.floor(kept.positions / 0.25), axis=0, return_counts=True)[1]
    assert cells.max() == 1


def test_what_is_no_map_of_features_is_refused(tmp_path):
    world = made(10)
    path = save(world, tmp_path / "whole.npz")
    (tmp_path / "cut.npz").write_bytes(path.read_bytes()[:300])
    np.savez(tmp_path / "other.npz", positions=world.positions)
    save(replace(world, descriptors=world.descriptors[:, :16]), tmp_path / "short.npz")
    save(replace(world, descriptors=world.descriptors.astype(np.float32)), tmp_path / "float.npz")
    with np.errstate(invalid="ignore"):
        save(replace(world, positions=world.positions * np.nan), tmp_path / "nan.npz")
        for name in ("cut", "other", "short", "float", "nan", "absent"):
            with pytest.raises(Refusal, match=f"{name}.npz"):
                load(tmp_path / f"{name}.npz")
    assert not has_features(tmp_path / "absent.npz")


@pytest.mark.parametrize("key", ["positions", "seen", "sd", "pixel", "version", "drift"])
@pytest.mark.parametrize("value", [np.asarray("x"), np.full((3, 3), np.inf), np.asarray(1j), np.asarray(-1.0)])
def test_a_map_whose_numbers_are_none_is_refused(tmp_path, key, value):
    path = save(made(10), tmp_path / "whole.npz")
    with np.load(path) as archive:
        content = {name: archive[name] for name in archive} | {key: value}
    np.savez(tmp_path / "odd.npz", **content)
    with pytest.raises(Refusal, match=r"odd\.npz"):
        load(tmp_path / "odd.npz")


def test_a_map_from_before_drift_was_kept_has_none(tmp_path):
    path = save(replace(made(10), drift=0.2), tmp_path / "whole.npz")
    assert load(path).drift == 0.2
    with np.load(path) as archive:
        np.savez(tmp_path / "old.npz", **{name: archive[name] for name in archive if name != "drift"})
    assert load(tmp_path / "old.npz").drift == 0.0
