"""Walks whose poses drift, of a camera that is tilted: both found together, from what is seen again."""

import math
from itertools import pairwise

import numpy as np
import pytest

from surefoot.lab.maps.images import map_of
from surefoot.lab.maps.loops import closed
from surefoot.lab.maps.tracks import track
from surefoot.lab.maps.turned import FloorLook
from surefoot.services.vision.eye import Eye
from tests.services.vision.shots import extractor

from .test_turned import walk

LEVEL = (0.0,) * 7
WAY = [(0.02 * k, 0.0, 0.0) for k in range(60)] + [(1.2, 0.0, 0.2 * k) for k in range(1, 16)] + [
    (1.2 - 0.02 * k, 0.0, math.pi) for k in range(50)
]  # fmt: skip


def stated(looks: list[FloorLook], longer: float, bend: float) -> list[FloorLook]:
    """Return looks whose poses are those of an odometry: all ways `longer`, the heading bent by `bend` rad/m."""
    made, pose, heading = [looks[0]], looks[0].pose, looks[0].pose[2]
    for before, now in pairwise(looks):
        dx, dy = now.pose[0] - before.pose[0], now.pose[1] - before.pose[1]
        c, s = math.cos(heading - before.pose[2]), math.sin(heading - before.pose[2])
        x = pose[0] + (1.0 + longer) * (c * dx - s * dy)
        y = pose[1] + (1.0 + longer) * (s * dx + c * dy)
        heading += now.pose[2] - before.pose[2] + bend * math.hypot(dx, dy)
        pose = (x, y, heading)
        made.append(now._replace(pose=pose))
    return made


def off(looks: list[FloorLook], truth: list[FloorLook]) -> float:
    """Return the largest distance of a pose from the true one, m."""
    return max(math.dist(a.pose[:2], b.pose[:2]) for a, b in zip(looks, truth, strict=True))


@pytest.mark.parametrize(("tilt", "longer", "bend"), [
    ((0.02, -0.01), 0.0, 0.0), ((0.0, 0.0), 0.03, 0.0), ((0.02, 0.01), 0.03, 0.02), ((-0.02, 0.015), -0.03, -0.03),
])  # fmt: skip
def test_a_drift_and_a_tilt_are_told_apart_by_the_floor_that_is_seen_again(tilt, longer, bend):
    truth, *_ = walk((*tilt, *LEVEL[2:]), WAY)
    drifted = stated(truth, longer, bend)
    found, _ = closed(drifted, "orb", 3)
    assert off(found, truth) < 0.02
    assert off(drifted, truth) > 0.02 or longer == bend == 0.0
    level, *_ = walk(LEVEL, WAY)
    left = np.concatenate([a.places - b.places for a, b in zip(found, level, strict=True)])
    assert np.hypot(*left.T).mean() < 0.012


def test_a_map_of_a_drifting_walk_is_close_to_that_of_the_true_poses():
    truth, *_ = walk(LEVEL, WAY)
    eye = Eye(extractor(), None)
    plain = map_of(truth, eye, "c", "s", exact=True)
    drifted = map_of(stated(truth, 0.03, 0.02), eye, "c", "s", exact=False)
    assert len(drifted) > 0.9 * len(plain)
    gap = np.hypot(*(drifted.positions[:, None] - plain.positions[None]).transpose(2, 0, 1)).min(axis=1)
    assert np.median(gap) < 0.015


@pytest.mark.parametrize(("together", "features"), [(True, 20), (False, 40)])
def test_features_come_again_where_many_agree_on_one_motion(together, features):
    rng = np.random.default_rng(3)
    places, looks = rng.uniform((0.4, -0.4), (1.0, 0.4), (20, 2)), rng.integers(0, 256, (20, 32)).astype(np.uint8)
    blank = FloorLook((0.4, 0.0, 0.0), np.zeros((0, 2)), np.zeros((0, 32), np.uint8))
    moved = places + ((0.06, 0.03) if together else rng.uniform(-0.12, 0.12, (20, 2)))
    seen = [FloorLook((0.0, 0.0, 0.0), where, looks) for where in (places, moved)]
    walked = [*[seen[0]] * 3, *[blank._replace(pose=(0.2 * k, 0.0, 0.0)) for k in (1, 2, 3, 4, 5, 4, 3, 2, 1)], seen[1]]
    found, tracks = track(walked, "orb", 0.02)
    assert len(found.count) == features
    assert len(tracks) == 80


def seen_at(way: list[float], shown: dict[int, FloorLook]) -> list[FloorLook]:
    """Return looks along x, m, of blank images but those that are given by number, from the poses of the way."""
    blank = FloorLook((0.0, 0.0, 0.0), np.zeros((0, 2)), np.zeros((0, 32), np.uint8))
    return [shown.get(k, blank)._replace(pose=(x, 0.0, 0.0)) for k, x in enumerate(way)]


def some(n: int, seed: int) -> FloorLook:
    """Return a look of n features whose descriptors and places are drawn from a seed."""
    rng = np.random.default_rng(seed)
    looks = rng.integers(0, 256, (n, 32)).astype(np.uint8)
    return FloorLook((0.0, 0.0, 0.0), rng.uniform((0.4, -0.4), (1.0, 0.4), (n, 2)), looks)


def both(a: FloorLook, b: FloorLook) -> FloorLook:
    """Return the look that shows the features of two."""
    return a._replace(places=np.vstack((a.places, b.places)), descriptors=np.vstack((a.descriptors, b.descriptors)))


def test_features_of_one_passage_do_not_vouch_for_one_of_another():
    late, old = some(8, 3), some(1, 4)
    far = [0.0] * 3 + [0.3 * k for k in (1, 2, 3, 4, 5, 4, 3, 2, 1)]
    near = [0.0] * 3 + [0.2, 0.4, 0.2, 0.0]
    shown = {0: old, 1: old, 2: old, 12: late, 13: late, 14: late}
    moved = old._replace(places=old.places + np.array([0.03, 0.02]))
    found, _ = track(seen_at(far + near, {**shown, 18: both(late, moved)}), "orb", 0.02)
    assert len(found.count) == 10
    assert (found.count == 4).sum() == 8


@pytest.mark.parametrize(("features", "again"), [(9, False), (14, True)])
def test_few_features_do_not_close_a_loop_that_may_be_far_off(features, again):
    look, far = some(features, 5), [0.0] * 3 + [0.3 * k for k in (1, 2, 3, 4, 5, 4, 3, 2, 1)] + [0.0]
    moved = look._replace(places=look.places + np.array([0.1, 0.05]))
    found, _ = track(seen_at(far, {0: look, 1: look, 2: look, 12: moved}), "orb", 0.02)
    assert len(found.count) == (features if again else 2 * features)
    near, _ = track(seen_at(far, {0: look, 1: look, 2: look, 12: look}), "orb", 0.01)
    assert len(near.count) == features


def test_a_way_without_a_floor_that_is_seen_again_states_its_drift():
    there = [(0.03 * k, 0.0, 0.0) for k in range(60)]
    truth, *_ = walk(LEVEL, there)
    found, drift = closed(stated(truth, 0.02, 0.02), "orb", 3)
    _, known = closed(stated(walk(LEVEL, WAY)[0], 0.02, 0.02), "orb", 3)
    assert off(found, truth) < 2.5 * drift
    assert 0.0 < known < drift < 0.1
