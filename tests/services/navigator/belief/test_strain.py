"""Check of map and camera: stretched maps and turned cameras are distinguished and measured, right ones stay right."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from surefoot.services.navigator.belief import strain
from surefoot.services.navigator.belief.common_errors import CommonErrors
from surefoot.services.navigator.belief.landmarks import FloorLandmarks
from surefoot.services.navigator.belief.matching import Detections, SightNoise
from surefoot.services.navigator.belief.strain import (
    ASIDE,
    DISPLACED,
    RIGHT,
    STRAINED,
    TILTED,
    FrameLines,
    MapStrain,
    turned_back,
)
from tests.services.navigator.belief.floors import EASY, Eye, floor

HEIGHT = 0.45
SHARED = CommonErrors(math.radians(0.22), tilt_fade=0.3, height=HEIGHT)
COV = np.diag([0.03, 0.03, math.radians(3.0)]) ** 2


def looked(seed, stretch=((1.0, 0.0), (0.0, 1.0)), turn=(0.0, 0.0, 0.0), frames=20, way=0.0, share=0.3):
    """Check after frames of a robot that walks `way` m by true poses; the map is the floor, stretched."""
    world = floor(seed)
    drawn = FloorLandmarks(world.positions @ np.asarray(stretch), world.descriptors)
    eye, check, pose = Eye(world, EASY, seed, share, false=0.1), MapStrain(SHARED), np.zeros(3)
    for k in range(frames):
        seen, _ = eye.look(pose)
        seen = turned_back(seen, (-turn[0], -turn[1], -turn[2]), HEIGHT)
        check.look(seen, drawn, tuple(pose.tolist()), COV, EASY, 0.1 * k)
        step = way / frames
        pose[0] += step
        check.moved((step, 0.0), 1e-6, 1e-7)
    return check


@pytest.mark.parametrize("seed", range(6))
def test_a_right_map_and_camera_stay_right(seed):
    check = looked(seed, frames=60, way=1.0)
    assert check.probabilities[RIGHT] > 0.97
    assert check.sure_turn is None
    assert check.reason == ""
    assert sum(check.probabilities) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("stretch", "size", "along"),
    [
        (np.diag([1.15, 1.0]), 0.13, 0.0),
        (np.diag([1.0, 1.15]), 0.13, 90.0),
        (1.15 * np.eye(2), 0.13, None),
        (np.array([[1.07, 0.07], [0.07, 1.07]]), 0.13, 45.0),
        (0.87 * np.eye(2), -0.15, None),
    ],
)
def test_a_stretched_or_sheared_map_is_named_with_size_and_direction(stretch, size, along):
    check = looked(3, stretch)
    assert check.probabilities[STRAINED] > 0.9
    values, vectors = np.linalg.eigh([[check.strain[0], check.strain[2]], [check.strain[2], check.strain[1]]])
    most = int(np.argmax(np.abs(values)))
    assert values[most] == pytest.approx(size, abs=0.04)
    assert f"{100 * abs(values[most]):.0f} % {'longer' if size > 0 else 'shorter'}" in check.reason
    if along is not None:
        angle = math.degrees(math.atan2(vectors[1, most], vectors[0, most]))
        assert abs((angle - along + 90.0) % 180.0 - 90.0) < 15.0


@pytest.mark.parametrize("turn", [(3.0, 0.0, 0.0), (-3.0, 0.0, 0.0), (2.0, -3.0, 0.0)])
def test_a_tilted_camera_is_measured(turn):
    check = looked(4, turn=np.radians(turn))
    assert check.probabilities[TILTED] > 0.99
    assert np.degrees(check.sure_turn) == pytest.approx(turn, abs=1.0)


def test_a_turn_that_a_right_camera_may_have_is_not_corrected():
    check = looked(4, turn=np.radians((3.0, 0.0, 0.0)))
    case = check._cases[TILTED]
    case.mean[strain.TURN : strain.TURN + 2] *= 0.3 / 3.0
    assert check.probabilities[TILTED] > 0.99
    assert check.sure_turn is None


def test_a_camera_turned_aside_shows_itself_over_a_way_only():
    aside = (0.0, 0.0, math.radians(6.0))
    standing = looked(5, turn=aside, frames=80)
    assert standing.probabilities[ASIDE] < 0.9
    walking = looked(5, turn=aside, frames=80, way=1.5)
    assert walking.probabilities[ASIDE] > 0.99
    assert math.degrees(walking.sure_turn[2]) == pytest.approx(6.0, abs=1.5)


@pytest.mark.parametrize("seed", range(6))
def test_a_robot_put_down_elsewhere_is_no_turned_camera_and_no_strained_map(seed):
    world, check, believed = floor(seed), MapStrain(SHARED), (0.0, 0.0, 0.0)
    eye, pose = Eye(world, EASY, seed, 0.3, false=0.1), np.zeros(3)
    for k in range(40):
        if k == 20:
            assert check.probabilities[DISPLACED] < 0.03
            pose = np.array([0.1, 0.12, math.radians(-8.0)])
        check.look(eye.look(pose)[0], world, believed, COV / 9.0, EASY, 0.1 * k)
    assert check.probabilities[DISPLACED] > 0.99
    assert check.sure_turn is None
    assert check._cases[DISPLACED].mean[strain.POSE :] == pytest.approx(pose, abs=0.03)
    assert "0.1" in check.reason
    assert "8 deg" in check.reason
    check.place()
    assert check.probabilities[DISPLACED] == 0.0


def test_evidence_for_a_displaced_robot_fades_where_frames_decide_no_more():
    check, model, world = looked(2), strain.StrainModel(), floor(2)
    eye, at = Eye(world, EASY, 9, 0.3, false=0.1), 0.1 * 19
    ratio = math.log(0.7 / 0.3)
    right, moved = check._cases[RIGHT], check._cases[DISPLACED]
    moved.mean[:], moved.cov[:] = right.mean, right.cov  # both expect the same, whatever is seen
    check._logs[DISPLACED] = check._logs[RIGHT] + ratio
    least = math.log(1.7 * model.displacement_rate)
    for k in range(1, 31):
        at += 1.7
        check.look(eye.look(np.zeros(3))[0], world, (0.0, 0.0, 0.0), COV, EASY, at)
        found = math.log(check.probabilities[DISPLACED] / check.probabilities[RIGHT])
        assert found == pytest.approx(least + (ratio - least) * math.exp(-1.7 * k / model.displaced_fade_s), abs=1e-6)
    assert check.probabilities[DISPLACED] < 0.03


def test_detections_are_turned_back_as_rays_onto_the_floor():
    rng = np.random.default_rng(1)
    ranges, bearings = rng.uniform(0.3, 1.2, 50), rng.uniform(-0.6, 0.6, 50)
    pitch, roll, aside = math.radians(4.0), math.radians(-3.0), math.radians(5.0)
    seen = turned_back(Detections(ranges, bearings, np.zeros((50, 8))), (pitch, roll, aside), HEIGHT)
    b = bearings - aside
    rays = Rotation.from_rotvec([-roll, pitch, 0.0]).apply(
        np.stack((ranges * np.cos(b), ranges * np.sin(b), np.full(50, -HEIGHT)), 1)
    )
    x, y = -HEIGHT * rays[:, 0] / rays[:, 2], -HEIGHT * rays[:, 1] / rays[:, 2]
    np.testing.assert_allclose(seen.ranges, np.hypot(x, y), rtol=1e-12)
    np.testing.assert_allclose(seen.bearings, np.arctan2(y, x), atol=1e-12)
    small = turned_back(Detections(ranges, bearings, np.zeros((50, 8))), (1e-6, 0.0, 0.0), HEIGHT)
    gain = (HEIGHT**2 + ranges**2) / HEIGHT * np.cos(bearings)
    np.testing.assert_allclose((ranges - small.ranges) / 1e-6, gain, rtol=1e-4)


def test_the_kernel_is_a_kalman_filter():
    rng = np.random.default_rng(2)
    n, m = strain.STATES, 7
    rows, off, variance = rng.standard_normal((m, n)), rng.standard_normal(m), rng.uniform(0.1, 1.0, m)
    root = rng.standard_normal((n, n))
    mean, cov = rng.standard_normal(n), root @ root.T
    s = rows @ cov @ rows.T + np.diag(variance)
    gain = cov @ rows.T @ np.linalg.inv(s)
    expected = mean + gain @ (off - rows @ mean), cov - gain @ s @ gain.T
    log = (
        -0.5 * (off - rows @ mean) @ np.linalg.solve(s, off - rows @ mean)
        - 0.5 * np.linalg.slogdet(2.0 * math.pi * s)[1]
    )
    assert strain.taken(mean, cov, FrameLines(rows, off, variance), 0.0, 1.0) == pytest.approx(log)
    np.testing.assert_allclose(mean, expected[0], rtol=1e-9)
    np.testing.assert_allclose(cov, expected[1], rtol=1e-7, atol=1e-9)


def test_a_wrong_match_moves_no_filter():
    mean, cov = np.zeros(strain.STATES), np.eye(strain.STATES) * 1e-4
    rows = np.zeros((1, strain.STATES))
    rows[0, strain.POSE] = 1.0
    log = strain.taken(mean, cov, FrameLines(rows, np.array([0.4]), np.array([1e-4])), 0.05, 0.6)
    assert log == pytest.approx(math.log(0.05 / 0.6 + 0.95 * norm.pdf(0.4, scale=math.sqrt(2e-4))))
    assert abs(mean).max() < 1e-9


def test_equations_are_those_of_a_turned_camera_over_a_strained_map():
    """Each row is the derivative of d - z by its state."""
    rng = np.random.default_rng(6)
    place, pose, size = np.array([0.7, 0.3]), np.array([0.1, -0.2, 0.4]), 1e-6
    c, s = math.cos(pose[2]), math.sin(pose[2])
    turn = np.array([[c, s], [-s, c]])
    d = turn @ (place - pose[:2])
    bearing, far = math.atan2(d[1], d[0]), math.hypot(*d)
    axes = np.array([d / far, [-d[1] / far, d[0] / far]])
    lines = FrameLines(np.zeros((2, strain.STATES)), np.zeros(2), np.zeros(2))
    strain.lines_of(place[None], np.array([[far, bearing]]), pose, SightNoise(0.0, 0.03, 0.02), HEIGHT, lines)
    np.testing.assert_allclose(lines.off, 0.0, atol=1e-12)
    e = rng.standard_normal(3)
    true = np.linalg.solve(np.eye(2) + size * np.array([[e[0], e[2]], [e[2], e[1]]]), place - pose[:2])
    np.testing.assert_allclose(lines.rows[:, :3] @ e, axes @ (d - turn @ true) / size, atol=1e-4)
    for i, angles in enumerate(np.eye(3)):
        found = turned_back(
            Detections(np.array([far]), np.array([bearing]), np.zeros((1, 8))), tuple(-size * angles), HEIGHT
        )
        z = found.ranges[0] * np.array([math.cos(found.bearings[0]), math.sin(found.bearings[0])])
        np.testing.assert_allclose(lines.rows[:, strain.TURN + i], axes @ (d - z) / size, atol=1e-4)
    for i, step in enumerate(np.eye(3)):
        x, y, theta = pose + size * step
        c, s = math.cos(theta), math.sin(theta)
        z = np.array([[c, s], [-s, c]]) @ (place - (x, y))
        np.testing.assert_allclose(lines.rows[:, strain.POSE + i], axes @ (d - z) / size, atol=1e-4)


def test_noise_of_zero_range_and_empty_frames_are_survived():
    check = MapStrain(SHARED)
    world = FloorLandmarks(np.array([[0.01, 0.0], [0.0, 0.02]]), np.eye(8)[:2])
    seen = Detections(np.array([0.03, 0.03]), np.zeros(2), np.eye(8)[:2])
    check.look(seen, world, (0.0, 0.0, 0.0), COV, SightNoise(), 0.0)
    check.look(Detections(np.zeros(0), np.zeros(0), np.zeros((0, 8))), world, (0.0, 0.0, 0.0), COV, SightNoise(), 0.1)
    assert sum(check.probabilities) == pytest.approx(1.0)
