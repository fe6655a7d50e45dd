"""Recognition among made-up features: gate, ratio, common motion, refusals."""

import math
from dataclasses import replace

import numpy as np
import pytest

from surefoot.errors import Refusal
from surefoot.services.vision.feature_map import FeatureMap
from surefoot.services.vision.recognise import Believed, RecogniseParams, consensus, recognise

PARAMS = RecogniseParams()
POSE = np.array([1.0, -0.5, 0.7])


def made(n=400, seed=0, copies=1) -> FeatureMap:
    rng = np.random.default_rng(seed)
    looks = rng.integers(0, 256, (n // copies, 32)).astype(np.uint8)
    places = rng.uniform(-2.0, 3.0, (n, 2))
    return FeatureMap(
        "orb", places, np.tile(looks, (copies, 1)), np.full(n, 3), np.full(n, 0.002), 0.003, "c", opencv="5.0.0"
    )


def seen_from(world: FeatureMap, pose, count=30, seed=1, noise=0.003, scale=1.0):
    """Places and looks of the nearest map features, a few bits of each look flipped."""
    rng = np.random.default_rng(seed)
    d = world.positions - pose[:2]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    local = np.stack((c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1]), axis=1)
    which = np.argsort(np.hypot(*local.T))[:count]
    looks = world.descriptors[which] ^ (np.uint8(1) << rng.integers(0, 8, (count, 32), dtype=np.uint8))
    return which, scale * local[which] + noise * rng.standard_normal((count, 2)), looks


def belief(error=(0.0, 0.0, 0.0), sd=0.05):
    return Believed(POSE + np.array(error), np.diag([sd**2, sd**2, sd**2]))


def test_features_are_recognised_in_the_gate_and_anywhere():
    world = made()
    which, places, looks = seen_from(world, POSE)
    for believed in (belief((0.05, -0.04, 0.05)), None):
        found = recognise(places, looks, world, believed, PARAMS)
        assert len(found.features) == PARAMS.most
        assert (which[found.features] == found.landmarks).all()
        assert found.anywhere is (believed is None)
        assert found.scale == pytest.approx(1.0, abs=0.02)


def test_a_sure_belief_elsewhere_recognises_nothing_there():
    world = made()
    _, places, looks = seen_from(world, POSE)
    found = recognise(places, looks, world, belief((1.0, 0.8, 0.0), sd=0.02), PARAMS)
    assert len(found.features) == 0


def test_copies_are_told_apart_by_the_gate_only():
    world = made(copies=4)
    which, places, looks = seen_from(world, POSE)
    found = recognise(places, looks, world, belief(), PARAMS)
    assert (which[found.features] == found.landmarks).all()
    assert len(found.features) > 10
    assert len(recognise(places, looks, world, None, PARAMS).features) == 0


def test_an_unknown_floor_is_not_recognised():
    world, rng = made(), np.random.default_rng(5)
    looks = rng.integers(0, 256, (100, 32)).astype(np.uint8)
    places = rng.uniform(-0.5, 1.0, (100, 2))
    for believed in (belief(sd=0.3), None):
        assert len(recognise(places, looks, world, believed, PARAMS).features) == 0


def test_a_common_motion_leaves_out_what_moved_otherwise_and_measures_scale():
    rng = np.random.default_rng(2)
    here = rng.uniform(-0.4, 0.4, (30, 2))
    turn = np.array([[math.cos(1.0), -math.sin(1.0)], [math.sin(1.0), math.cos(1.0)]])
    there = here @ turn.T + np.array([3.0, 1.0])
    there[:10] += rng.uniform(0.1, 0.5, (10, 2))
    agree, scale = consensus(here, there, PARAMS)
    assert agree.tolist() == [False] * 10 + [True] * 20
    assert scale == pytest.approx(1.0, abs=1e-6)
    assert consensus(here, here * 1.04, PARAMS)[1] == pytest.approx(1.04, abs=0.02)
    assert not consensus(here[:1], there[:1], PARAMS)[0].any()


def test_other_descriptors_and_too_many_features_are_refused():
    world = made()
    with pytest.raises(Refusal, match="orb features, the picture others of 128"):
        recognise(np.zeros((3, 2)), np.zeros((3, 128), np.float32), world, None, PARAMS)
    many = 100_001
    with pytest.raises(Refusal, match="at most 100000"):
        recognise(np.zeros((many, 2)), np.zeros((many, 32), np.uint8), made(2), None, PARAMS)


@pytest.mark.parametrize(("pitch", "zoom"), [(0.02, 1.0), (-0.02, 1.0), (0.0, 1.08), (0.015, 0.92)])
def test_a_wrong_pitch_is_no_wrong_scale(pitch: float, zoom: float) -> None:
    rng, height = np.random.default_rng(4), 0.45
    there = rng.uniform((0.5, -0.3), (1.0, 0.3), (60, 2))
    x, y = there.T
    here = zoom * (there + pitch * np.stack((height + x * x / height, x * y / height), axis=1))
    _, scale = consensus(here + 0.002 * rng.standard_normal(here.shape), there, replace(PARAMS, inlier=0.1))
    assert scale == pytest.approx(1.0 / zoom, abs=0.012)
