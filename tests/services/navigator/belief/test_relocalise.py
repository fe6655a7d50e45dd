"""Relocalisation: right poses, no confident wrong ones, copied textures, and reasons where there is no pose."""

import math

import numpy as np
import pytest

from surefoot.services.navigator.belief.landmarks import FloorLandmarks
from surefoot.services.navigator.belief.matching import DetectionError, Detections
from surefoot.services.navigator.belief.relocalise import RelocaliseLimits
from tests.services.navigator.belief.floors import EASY, LENGTH, ROUGH, Eye, Glance, floor, relocalise


def difference(pose, truth):
    d = np.asarray(pose) - truth
    d[2] = (d[2] + np.pi) % (2 * np.pi) - np.pi
    return d


def glances(eye, truth, frames, turns=(0.0,)):
    """Frames of a robot that stands, and then at other headings."""
    return [Glance(eye.look(truth + np.array([0.0, 0.0, t]))[0], (0.0, 0.0, t)) for t in turns for _ in range(frames)]


def trials(n, density, noise, frames, recognised=0.45, turns=(0.0,), first=0):
    """Relocations and errors, for robots within the floor that look along it."""
    for seed in range(first, first + n):
        world = floor(seed, density, copied=0.5)
        rng = np.random.default_rng(1000 + seed)
        truth = np.array([rng.uniform(0.0, 5.0), rng.uniform(-0.3, 0.3), rng.uniform(-0.5, 0.5)])
        eye = Eye(world, noise, seed, recognised=recognised, false=0.1)
        found = relocalise(glances(eye, truth, frames, turns), world, noise)
        yield found, None if found.pose is None else difference(found.pose, truth)


@pytest.mark.parametrize(
    ("density", "frames", "least"), [(60.0, 10, 1.0), (40.0, 1, 0.85), (40.0, 10, 1.0), (10.0, 20, 0.6)]
)
def test_half_the_looks_copied_and_a_tenth_false_is_no_obstacle(density, frames, least):
    found = list(trials(40, density, EASY, frames))
    errors = [e for _, e in found if e is not None]
    assert len(errors) >= least * 40
    assert all(math.hypot(e[0], e[1]) < 0.1 and abs(e[2]) < 0.15 for e in errors)


def test_covariance_is_that_of_the_errors():
    nees = [e @ np.linalg.inv(f.covariance) @ e for f, e in trials(60, 40.0, EASY, 5) if e is not None]
    assert len(nees) > 55
    assert 0.6 < np.mean(nees) / 3 < 1.6


def test_a_rough_camera_is_never_sure_and_wrong():
    found = list(trials(40, 40.0, ROUGH, 20, recognised=0.15))
    errors = [e for _, e in found if e is not None]
    assert len(errors) > 20
    assert all(math.hypot(e[0], e[1]) < 0.5 and abs(e[2]) < 0.7 for e in errors)


def test_turning_on_the_spot_finds_what_standing_does_not():
    standing = sum(e is not None for _, e in trials(30, 5.0, EASY, 10))
    turning = sum(e is not None for _, e in trials(30, 5.0, EASY, 5, turns=(0.0, 0.8, 1.6, 2.4, 3.2, 4.0, 4.8, 5.6)))
    assert turning > max(standing, 27)


def test_a_patch_that_is_there_twice_is_ambiguous():
    one = floor(3, 40.0, (-1.0, -1.0), (2.0, 1.0))
    twice = FloorLandmarks(
        np.vstack((one.positions, one.positions + np.array([10.0, 0.0]))), np.vstack((one.descriptors, one.descriptors))
    )
    eye = Eye(one, EASY, 4)
    found = relocalise(glances(eye, np.zeros(3), 10), twice, EASY)
    assert (found.pose, found.reason) == (None, "ambiguous")
    assert found.probability == pytest.approx(0.5, abs=0.05)
    assert sorted(round(x, 1) for x, _, _ in found.alike) == [0.0, 10.0]
    only = relocalise(glances(eye, np.zeros(3), 10), one, EASY)
    assert (only.reason, only.alike) == ("", ())


@pytest.mark.parametrize("noise", [EASY, ROUGH])
def test_another_floor_is_not_taken_for_this_one(noise):
    for seed in range(20):
        world = floor(seed, copied=0.5)
        other = Eye(floor(seed + 100, copied=0.5), noise, seed)
        assert relocalise(glances(other, np.array([1.0, 0.0, 0.0]), 10), world, noise).pose is None


@pytest.mark.parametrize("noise", [EASY, ROUGH])
def test_looks_of_this_floor_in_random_places_are_no_pose(noise):
    for seed in range(20):
        world, rng = floor(seed, copied=0.5), np.random.default_rng(seed)
        frames = []
        for _ in range(10):
            picked = rng.integers(len(world), size=9)
            looks = world.descriptors[picked] + noise.look_sd * rng.standard_normal((9, LENGTH))
            frames.append(Glance(Detections(rng.uniform(0.35, 1.18, 9), rng.uniform(-0.57, 0.57, 9), looks)))
        assert relocalise(frames, world, noise).pose is None


def test_moving_the_map_moves_the_pose():
    world, turn, shift = floor(5), 2.0, np.array([3.0, -4.0])
    rot = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    moved = FloorLandmarks(world.positions @ rot.T + shift, world.descriptors)
    seen = glances(Eye(world, EASY, 6), np.array([1.0, 0.2, 0.3]), 5)
    one, other = relocalise(seen, world, EASY), relocalise(seen, moved, EASY)
    expected = np.array([*(rot @ one.pose[:2] + shift), one.pose[2] + turn])
    assert difference(other.pose, expected) == pytest.approx(np.zeros(3), abs=1e-6)
    assert other.probability == pytest.approx(one.probability, abs=1e-3)


def test_few_or_no_sightings_have_a_reason():
    world, eye = floor(7), Eye(floor(7), EASY, 8)
    nothing = Detections(np.zeros(0), np.zeros(0), np.zeros((0, LENGTH)))
    assert relocalise([], world, EASY).reason == "unseen"
    assert relocalise([Glance(nothing)], world, EASY).reason == "unseen"
    seen, _ = eye.look((1.0, 0.0, 0.0))
    one = Detections(seen.ranges[:1], seen.bearings[:1], seen.looks[:1])
    assert relocalise([Glance(one)] * 20, world, EASY).reason == "unseen"
    two = Detections(seen.ranges[:2], seen.bearings[:2], seen.looks[:2])
    assert relocalise([Glance(two)] * 20, world, EASY).pose is None


def test_nonsense_is_left_out_and_other_descriptors_are_refused():
    world = floor(9)
    truth = np.array([1.0, 0.0, 0.0])
    seen = glances(Eye(world, EASY, 10), truth, 5)
    bad = Detections(np.array([0.0, np.nan, 1e300]), np.zeros(3), np.ones((3, LENGTH)))
    assert relocalise([*seen, Glance(bad)], world, EASY).pose == relocalise(seen, world, EASY).pose
    with pytest.raises(DetectionError):
        relocalise([Glance(Detections(np.ones(1), np.zeros(1), np.ones((1, 3))))], world, EASY)


def test_a_map_that_looks_everywhere_the_same_ends_in_time_without_a_pose():
    rng = np.random.default_rng(11)
    world = FloorLandmarks(rng.uniform(-2, 2, (400, 2)), np.tile(np.eye(LENGTH)[:4], (100, 1)))
    seen = glances(Eye(world, EASY, 12), np.zeros(3), 5)
    assert relocalise(seen, world, EASY).pose is None
    many = RelocaliseLimits(candidates=200, tries=2000)
    assert relocalise(seen, world, EASY, many).reason in ("ambiguous", "unsure", "unknown")
