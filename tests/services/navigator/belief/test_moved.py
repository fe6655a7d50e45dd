"""Landmarks that moved: known once a sure robot saw them twice at one other place, and only from a right pose."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from surefoot.services.navigator.belief.landmarks import FloorLandmarks
from surefoot.services.navigator.belief.lost import LostModel, LostState, evidence_of, observed, passed
from surefoot.services.navigator.belief.matching import Detections, Matches, SightNoise, match
from surefoot.services.navigator.belief.moved import MovedLandmarks, Sight
from surefoot.services.navigator.localiser import SURE
from tests.services.navigator.belief import floors

NOISE = SightNoise(0.0, 0.03, math.radians(1.5), look_sd=0.05)
COV = 1e-6 * np.eye(3)
MOVED = 4


class Copies(NamedTuple):
    """A robot on a floor of landmarks that look the same in groups."""

    copies: int
    """Landmarks of a group."""
    sd: float
    """Standard deviation of the believed position, m."""
    noise: SightNoise
    recognised: float


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


def noticed(seed: int, case: Copies, *, memory: bool) -> int:
    """Return the frame, of a camera of 1.7 s, by which a robot that was displaced before the first knows that it is."""
    model, cov = LostModel(), np.diag([case.sd**2, case.sd**2, math.radians(3) ** 2])
    world = floors.floor(seed, copied=0.9, copies=case.copies)
    eye, believed = floors.Eye(world, case.noise, seed, recognised=case.recognised), (2.0, 0.0, 0.0)
    moved, state = MovedLandmarks(world), LostState()
    for i in range(30):
        seen, _ = eye.look((2.3, 0.6, -0.5 * math.pi))
        found, sure = match(np.array(believed), cov, seen, world, case.noise), state.probability < SURE
        if memory:
            found = moved.left_out(found, seen, Sight(believed, cov, case.noise, 1.7 * i), sure=sure)
        state = observed(passed(state, 1.7, model), evidence_of(found, cov, seen, world, case.noise), model)
        if state.probability > model.threshold:
            return i
    return 30


@pytest.mark.parametrize(
    ("case", "late"), [(Copies(60, 0.1, floors.EASY, 0.2), 0), (Copies(20, 0.03, floors.ROUGH, 0.45), 2)]
)
def test_a_displaced_robot_that_recognises_copies_is_lost_as_soon_as_without_memory(case: Copies, late: int) -> None:
    found = [(noticed(seed, case, memory=True), noticed(seed, case, memory=False)) for seed in range(20)]
    assert all(ours <= plain + late for ours, plain in found)
    assert sum(plain < 30 for _, plain in found) >= 15


def test_a_place_is_known_only_from_frames_that_show_more_here_than_elsewhere() -> None:
    rng, (places, world) = np.random.default_rng(0), floor(0)
    memory = MovedLandmarks(world)
    seen = frame(places, (0.0, 0.0, 0.0), rng)
    few = Detections(seen.ranges[-MOVED - 3 :], seen.bearings[-MOVED - 3 :], seen.looks[-MOVED - 3 :])
    assert [away(memory, world, few, time) for time in (0.0, 2.0, 4.0)] == [MOVED] * 3
    assert [away(memory, world, one, time) for time, one in ((6.0, seen), (8.0, few), (10.0, seen), (12.0, few))] == [
        MOVED, MOVED, 0, 0,
    ]  # fmt: skip
