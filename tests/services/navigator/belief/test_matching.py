"""Data association: gate against its definition, looks within the gate, rigid motions, and what must not change it."""

import math

import numpy as np
import pytest

from surefoot.services.navigator.belief import gate
from surefoot.services.navigator.belief.landmarks import FloorLandmarks, LandmarkMapError
from surefoot.services.navigator.belief.matching import (
    FATES,
    DetectionError,
    Detections,
    MatchLimits,
    SightNoise,
    look_alikes,
    match,
)
from tests.services.navigator.belief.floors import EASY, LENGTH, ROUGH, Eye, floor, unit
from tests.services.refusals import refused

COV = np.diag([0.03**2, 0.03**2, math.radians(3.0) ** 2])
MANY = MatchLimits(most=256)


def drawn(rng, cov=COV, low=(0.0, -0.5, -3.1), high=(5.0, 0.5, 3.1)):
    """A true pose and what is believed of it."""
    truth = rng.uniform(low, high)
    return truth, truth + np.linalg.cholesky(cov) @ rng.standard_normal(3)


def frames(eye, rng, count, cov=COV):
    """Return the belief about `count` true poses, and what a camera sees there: detections and ids of landmarks."""
    for _ in range(count):
        truth, mean = drawn(rng, cov)
        yield mean, *eye.look(truth)


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def innovation(mean, landmark, r, b):
    d = landmark - mean[:2]
    return np.array([r - np.hypot(*d), wrap(b - np.arctan2(d[1], d[0]) + mean[2])])


def test_gate_is_the_quadratic_form_with_a_jacobian_by_finite_differences():
    rng = np.random.default_rng(1)
    for _ in range(50):
        root = rng.standard_normal((3, 3)) * [[0.1], [0.1], [0.2]]
        cov, mean, place = root @ root.T, rng.uniform(-2, 2, 3), rng.uniform(-2, 2, 2)
        r, b, vr, vb = rng.uniform(0.3, 1.2), rng.uniform(-1, 1), 0.02, 0.03
        jacobian = np.empty((2, 3))
        for i in range(3):
            step = np.eye(3)[i] * 1e-6
            nu = innovation(mean + step, place, r, b) - innovation(mean - step, place, r, b)
            jacobian[:, i] = -np.array([nu[0], wrap(nu[1])]) / 2e-6
        nu = innovation(mean, place, r, b)
        expected = nu @ np.linalg.inv(jacobian @ cov @ jacobian.T + np.diag([vr, vb])) @ nu
        assert gate.gated(mean, cov, *place, r, b, vr, vb) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("noise", [EASY, ROUGH])
@pytest.mark.parametrize("scale", [0.2, 1.0, 10.0])
def test_index_finds_what_a_search_of_the_whole_map_finds(noise, scale):
    rng, world = np.random.default_rng(2), floor(2, copied=0.3)
    eye, cov = Eye(world, noise, 3), COV * scale**2
    for mean, seen, _ in frames(eye, rng, 20, cov):
        for r, b, look in zip(seen.ranges, seen.bearings, seen.looks, strict=True):
            vr, vb = gate.variances(r, noise)
            nis = np.array([gate.gated(mean, cov, *p, r, b, vr, vb) for p in world.positions])
            inside = np.flatnonzero(nis < 9.21)
            found, fate, _, gap = gate.nearest_look(mean, cov, r, b, look, world.tables, noise, MANY)
            gaps = np.sort(((world.descriptors[inside] - look) ** 2).sum(axis=1))
            if not inside.size:
                assert fate == gate.FAR
            elif gaps[0] > MANY.look(noise, LENGTH) ** 2:
                assert fate == gate.UNLIKE
            elif gaps.size > 1 and gaps[0] > 0.64 * gaps[1]:
                assert fate == gate.AMBIGUOUS
            else:
                assert (fate, gap) == (gate.MATCHED, pytest.approx(gaps[0]))
                assert found in inside


def test_nearly_all_of_a_sharp_frame_is_matched_rightly():
    rng, world = np.random.default_rng(4), floor(4)
    eye, right, wrong, total = Eye(world, EASY, 5), 0, 0, 0
    for mean, seen, ids in frames(eye, rng, 200):
        found = match(mean, COV, seen, world, EASY, MANY)
        right += int((ids[found.detections] == found.landmarks).sum())
        wrong += int((ids[found.detections] != found.landmarks).sum())
        total += len(seen)
    assert total > 1000
    assert right > 0.95 * total
    assert wrong < 0.002 * total


@pytest.mark.parametrize(("noise", "most"), [(EASY, 0.002), (ROUGH, 0.025)])
def test_a_tenth_of_false_detections_is_rejected(noise, most):
    """A gate of the rough camera covers 1 m2: one of ten copies of a false look is often alone in it."""
    rng, world = np.random.default_rng(6), floor(6, copied=0.5)
    eye = Eye(world, noise, 7, false=0.1)
    wrong = right = false = 0
    for mean, seen, ids in frames(eye, rng, 400):
        found = match(mean, COV, seen, world, noise, MANY)
        wrong += int((ids[found.detections] != found.landmarks).sum())
        right += int((ids[found.detections] == found.landmarks).sum())
        false += int((ids < 0).sum())
    assert false > 200
    assert wrong < most * (right + wrong)


def test_rigid_motion_rejects_what_gate_and_look_pass():
    """Detections that look right and fall within a wide gate, but not with the others."""
    rng, world = np.random.default_rng(8), floor(8)
    cov, rejected, lost, total = COV * 9, 0, 0, 0
    eye = Eye(world, EASY, 9)
    for mean, seen, _ in frames(eye, rng, 100, COV):
        if len(seen) < 6:
            continue
        bearings = seen.bearings.copy()
        bearings[0] += 0.2  # 12 deg: within the gate by the heading's 9
        found = match(mean, cov, Detections(seen.ranges, bearings, seen.looks), world, EASY, MANY)
        total += 1
        rejected += FATES[found.fates[0]] != "matched"
        lost += found.counts["outlier"] - (FATES[found.fates[0]] == "outlier")
    assert total > 50
    assert rejected > 0.95 * total
    assert lost < 0.1 * total


def test_copies_within_a_gate_are_ambiguous_and_others_are_not():
    look = unit(np.random.default_rng(1).standard_normal((4, LENGTH)))
    looks = look[[0, 0, 1, 2, 2]]
    positions = np.array([[0.6, 0.0], [0.65, 0.02], [0.7, 0.1], [0.6, -0.1], [3.0, 0.0]])
    world = FloorLandmarks(positions, looks)
    seen = Detections(np.hypot(*positions[[0, 3]].T), np.arctan2(*positions[[0, 3]].T[::-1]), looks[[0, 3]])
    found = match(np.zeros(3), COV, seen, world, EASY)
    assert [FATES[f] for f in found.fates] == ["ambiguous", "matched"]
    assert found.landmarks.tolist() == [3]


def test_order_of_detections_changes_nothing():
    rng, world = np.random.default_rng(10), floor(10, copied=0.5)
    eye = Eye(world, ROUGH, 11, recognised=1.0, false=0.1, most=60)
    for limits in (MatchLimits(pairs=30), MANY):
        for mean, seen, _ in frames(eye, rng, 20):
            order = rng.permutation(len(seen))
            mixed = Detections(seen.ranges[order], seen.bearings[order], seen.looks[order])
            one, other = match(mean, COV, seen, world, ROUGH, limits), match(mean, COV, mixed, world, ROUGH, limits)
            assert one.landmarks.tolist() == other.landmarks.tolist()
            assert one.detections.tolist() == order[other.detections].tolist()
            assert one.counts == other.counts


def test_moving_map_and_belief_together_changes_nothing():
    rng, world = np.random.default_rng(12), floor(12)
    eye, turn, shift = Eye(world, EASY, 13, false=0.1), 2.0, np.array([3.0, -4.0])
    rot = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    moved = FloorLandmarks(world.positions @ rot.T + shift, world.descriptors)
    cov = np.eye(3)
    cov[:2, :2] = rot @ COV[:2, :2] @ rot.T
    cov[2, 2] = COV[2, 2]
    for mean, seen, _ in frames(eye, rng, 20):
        there = np.array([*(rot @ mean[:2] + shift), mean[2] + turn])
        one, other = match(mean, COV, seen, world, EASY), match(there, cov, seen, moved, EASY)
        assert one.landmarks.tolist() == other.landmarks.tolist()
        assert one.nis == pytest.approx(other.nis, abs=1e-6)


def test_doubled_detections_count_once_and_the_maximum_keeps_the_most_alike():
    world = floor(14)
    seen, _ = Eye(world, EASY, 15).look((1.0, 0.0, 0.0))
    twice = Detections(np.tile(seen.ranges, 2), np.tile(seen.bearings, 2), np.tile(seen.looks, (2, 1)))
    one = match(np.array([1.0, 0.0, 0.0]), COV, seen, world, EASY, MANY)
    two = match(np.array([1.0, 0.0, 0.0]), COV, twice, world, EASY, MANY)
    assert one.landmarks.tolist() == two.landmarks.tolist()
    assert two.counts["doubled"] == len(one.landmarks)
    few = match(np.array([1.0, 0.0, 0.0]), COV, seen, world, EASY, MatchLimits(most=3))
    assert few.landmarks.tolist() == one.landmarks[:3].tolist()
    assert few.counts["surplus"] == len(one.landmarks) - 3


def test_a_frame_of_256_with_nonsense_in_it_is_survived():
    world, rng = floor(16), np.random.default_rng(17)
    ranges, bearings = rng.uniform(0, 2, 256), rng.uniform(-50, 50, 256)
    looks = unit(rng.standard_normal((256, LENGTH)))
    ranges[:5] = [0.0, -1.0, np.nan, np.inf, 1e300]
    bearings[5:7] = [np.nan, np.inf]
    looks[7, 0] = np.nan
    found = match(np.array([1.0, 0.0, 0.0]), COV, Detections(ranges, bearings, looks), world, EASY)
    assert found.counts["invalid"] >= 8
    assert sum(found.counts.values()) == 256
    assert found.counts["matched"] < 10


@pytest.mark.parametrize("scale", [1e3, 1e12])
def test_a_belief_wider_than_the_map_is_survived(scale):
    world = floor(18)
    seen, _ = Eye(world, EASY, 19).look((1.0, 0.0, 0.0))
    found = match(np.array([1e6, 0.0, 0.0]), np.eye(3) * scale, seen, world, EASY)
    assert sum(found.counts.values()) == len(seen)


def test_nothing_seen_matches_nothing():
    found = match(np.zeros(3), COV, Detections(np.zeros(0), np.zeros(0), np.zeros((0, 0))), floor(1), EASY)
    assert found.landmarks.size == 0
    assert sum(found.counts.values()) == 0


def test_detections_that_cannot_be_are_refused():
    world = floor(1)
    with refused(DetectionError, field="descriptor"):
        match(np.zeros(3), COV, Detections(np.ones(2), np.zeros(2), np.zeros((2, 5))), world, EASY)
    for ranges, bearings, looks in (
        (np.ones(257), np.zeros(257), np.zeros((257, 8))),
        (np.ones(2), np.zeros(3), np.zeros((2, 8))),
        (np.ones(2), np.zeros(2), np.zeros((3, 8))),
    ):
        with pytest.raises(DetectionError):
            Detections(ranges, bearings, looks)


@pytest.mark.parametrize("bad", [{"bearing_sd": 0.0}, {"range_share": 0.0}, {"look_sd": -1.0}, {"range_sd": math.nan}])
def test_noise_that_cannot_be_is_refused(bad):
    with pytest.raises(DetectionError):
        SightNoise(**bad)


def elsewhere(found, seen, world):
    """Number of detections that look like a landmark of the map, but like none where they were seen."""
    away = np.isin(found.fates, [FATES.index("far"), FATES.index("unlike")])
    return int((away & (look_alikes(found, seen, world, EASY) > 0)).sum())


def test_a_wrong_pose_shows_in_what_is_known_elsewhere():
    rng, world = np.random.default_rng(20), floor(20, copied=0.5)
    eye, right, wrong, total = Eye(world, EASY, 21, false=0.1), 0, 0, 0
    for mean, seen, _ in frames(eye, rng, 100):
        away = mean + np.array([0.7, 0.0, math.pi / 2])
        right += elsewhere(match(mean, COV, seen, world, EASY), seen, world)
        wrong += elsewhere(match(away, COV, seen, world, EASY), seen, world)
        total += len(seen)
    assert right < 0.2 * total
    assert wrong > 0.8 * total


def test_an_error_common_to_a_frame_is_allowed_for():
    rng, world = np.random.default_rng(22), floor(22)
    tight = np.diag([0.005**2, 0.005**2, math.radians(0.5) ** 2])
    noise = SightNoise(range_share=0.01, bearing_sd=math.radians(0.5))
    allowing = SightNoise(range_share=0.01, bearing_sd=math.radians(0.5), common_range_sd=0.03)
    eye, plain, wide, total = Eye(world, noise, 23, tilt=0.03), 0, 0, 0
    for mean, seen, _ in frames(eye, rng, 100, tight):
        plain += match(mean, tight, seen, world, noise, MANY).counts["matched"]
        wide += match(mean, tight, seen, world, allowing, MANY).counts["matched"]
        total += len(seen)
    assert wide > 0.95 * total
    assert plain < wide


@pytest.mark.parametrize(
    ("positions", "looks", "field"),
    [
        (np.zeros((0, 2)), np.zeros((0, 8)), "positions"),
        (np.zeros((3, 2)), np.zeros((3, 8)), "positions"),
        (np.array([[0.0, 0.0], [np.nan, 1.0]]), np.zeros((2, 8)), "positions"),
        (np.array([[0.0, 0.0], [1e9, 1.0]]), np.zeros((2, 8)), "positions"),
        (np.array([[0.0, 0.0], [1.0, 1.0]]), np.zeros((3, 8)), "descriptors"),
        (np.array([[0.0, 0.0], [1.0, 1.0]]), np.zeros((2, 0)), "descriptors"),
        (np.array([[0.0, 0.0], [1.0, 1.0]]), np.full((2, 8), np.inf), "descriptors"),
        (np.zeros((3, 3)), np.zeros((3, 8)), "positions"),
    ],
)
def test_maps_that_cannot_be_are_refused(positions, looks, field):
    with refused(LandmarkMapError, field=field):
        FloorLandmarks(positions, looks)


def test_a_map_survives_the_wire():
    world = floor(24)
    there = FloorLandmarks.from_bytes(world.to_bytes(), len(world), LENGTH, 3, "test")
    assert there.positions == pytest.approx(world.positions, abs=1e-6)
    assert there.to_bytes() == world.to_bytes()
    assert (there.version, there.source) == (3, "test")
    with pytest.raises(LandmarkMapError):
        FloorLandmarks.from_bytes(world.to_bytes()[:-1], len(world), LENGTH)


def test_two_far_apart_landmarks_make_no_large_index():
    world = FloorLandmarks(np.array([[0.0, 0.0], [1e4, 1e4], [0.1, 0.0]]), np.eye(3))
    assert world.tables.starts.size < 100
    assert sorted(world.tables.members.tolist()) == [0, 1, 2]
