"""Landmarks that moved: known once a sure robot saw them twice at one other place, and only from a right pose."""

import math
from dataclasses import replace

import numpy as np
import pytest

from surefoot.services.navigator.belief.landmarks import FloorLandmarks
from surefoot.services.navigator.belief.matching import Detections, Matches, SightNoise, match
from surefoot.services.navigator.belief.moved import MovedLandmarks, Sight

NOISE = SightNoise(0.0, 0.03, math.radians(1.5), look_sd=0.05)
COV = 1e-6 * np.eye(3)
MOVED = 4


def floor(seed: int) -> tuple[np.ndarray, FloorLandmarks]:
    """Return where landmarks stand, and a map in which the last MOVED of them are elsewhere."""
    rng = np.random.default_rng(seed)
    places, looks = rng.uniform((0.4, -0.4), (1.1, 0.4), (12, 2)), np.eye(12)
    old = places.copy()
    old[-MOVED:] += (2.0, 1.0)
    return places, FloorLandmarks(old, looks)


def frame(places: np.ndarray, pose: tuple[float, float, float], rng: np.random.Generator) -> Detections:
    """Return what is seen from a pose."""
    d = places - pose[:2]
    r, a = np.hypot(*d.T), np.arctan2(d[:, 1], d[:, 0]) - pose[2]
    n = len(places)
    return Detections(r * (1.0 + 0.02 * rng.standard_normal(n)), a + 0.02 * rng.standard_normal(n), np.eye(n))


def away(
    memory: MovedLandmarks, world: FloorLandmarks, seen: Detections, time: float,
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0), *, sure: bool = True,
) -> int:  # fmt: skip
    """Return the number of detections of a frame that count as elsewhere."""
    found: Matches = match(np.array(pose), COV, seen, world, NOISE)
    left = memory.left_out(found, seen, Sight(pose, COV, NOISE, time), sure=sure)
    assert len(left.detections) == len(found.detections)
    assert sum(left.counts.values()) == len(seen)
    return left.counts["far"] + left.counts["unlike"]


@pytest.mark.parametrize("seed", range(5))
def test_moved_landmarks_count_until_they_were_seen_a_second_later(seed: int) -> None:
    rng, (places, world) = np.random.default_rng(seed), floor(seed)
    memory = MovedLandmarks(world)
    counted = [away(memory, world, frame(places, (0.0, 0.0, 0.0), rng), time) for time in (0.0, 0.5, 1.0, 2.0, 60.0)]
    assert counted == [MOVED, MOVED, 0, 0, 0]


@pytest.mark.parametrize("seed", range(5))
def test_from_a_wrong_pose_moved_landmarks_count_as_all_others_do(seed: int) -> None:
    rng, (places, world) = np.random.default_rng(seed), floor(seed)
    memory = MovedLandmarks(world)
    for time in (0.0, 1.5):
        away(memory, world, frame(places, (0.0, 0.0, 0.0), rng), time)
    seen = frame(places, (0.6, 0.8, 1.5), rng)  # believed to be at the origin still
    assert [away(memory, world, seen, time) for time in (2.0, 3.5)] == [len(places)] * 2


def test_an_unsure_robot_learns_nothing_and_no_more_one_that_recognises_nothing() -> None:
    rng, (places, world) = np.random.default_rng(0), floor(0)
    memory = MovedLandmarks(world)
    for time in (0.0, 2.0):
        assert away(memory, world, frame(places, (0.0, 0.0, 0.0), rng), time, sure=False) == MOVED
    seen = frame(places, (0.0, 0.0, 0.0), rng)
    only = Detections(seen.ranges[-MOVED:], seen.bearings[-MOVED:], seen.looks[-MOVED:])
    assert [away(memory, world, only, time) for time in (4.0, 6.0)] == [MOVED, MOVED]


def test_strange_looks_are_no_moved_landmarks() -> None:
    rng, (places, world) = np.random.default_rng(0), floor(0)
    seen = frame(places, (0.0, 0.0, 0.0), rng)
    strange = replace(seen, looks=np.vstack((seen.looks[:-MOVED], 3.0 * np.ones((MOVED, 12)))))
    memory = MovedLandmarks(world)
    assert [away(memory, world, strange, time) for time in (0.0, 2.0, 4.0)] == [MOVED] * 3
