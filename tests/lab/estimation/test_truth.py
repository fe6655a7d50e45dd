"""Truth by captured positions: its velocity against scipy's filter of the same kind, and what it does not know."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import savgol_filter
from scipy.spatial.transform import Rotation

from surefoot.lab.estimation.log import TrueMotion
from surefoot.lab.estimation.scores import score
from surefoot.lab.estimation.track import track
from surefoot.lab.estimation.truth import held_rows, over_window, slopes, truth_of
from surefoot.papers.wawrzynski.synthetic import KINDS, synthesize


@pytest.mark.parametrize(("rows", "window"), [(5, 5), (31, 31), (40, 7), (500, 31)])
def test_slopes_are_those_of_scipy(rows, window):
    values = np.cumsum(np.random.default_rng(rows).normal(size=(rows, 3)), axis=0)
    expected = savgol_filter(values, window, 3, deriv=1, delta=0.01, axis=0)
    np.testing.assert_allclose(slopes(values, window, 0.01), expected, atol=1e-9)


def test_a_cubic_is_met_exactly():
    t = np.arange(20) * 0.1
    found = slopes(np.stack([t**3 - t, 2.0 * t**2], axis=1), 9, 0.1)
    np.testing.assert_allclose(found, np.stack([3.0 * t**2 - 1.0, 4.0 * t], axis=1), atol=1e-9)


def test_velocities_over_the_window_of_the_truth_are_its_own():
    t = np.arange(400) * 0.01
    way = np.stack([np.sin(9.0 * t), np.cos(4.0 * t), 0.1 * t], axis=1)
    v = np.stack([9.0 * np.cos(9.0 * t), -4.0 * np.sin(4.0 * t), np.full(400, 0.1)], axis=1)
    captured = slopes(way, 51, 0.01)
    assert np.abs(captured - v).max() > 1.0  # the window takes the motion away
    np.testing.assert_allclose(over_window(v, t, 0.5), captured, atol=0.02)
    np.testing.assert_array_equal(over_window(v, t, 0.0), v)
    np.testing.assert_array_equal(over_window(v, t, 0.02), v)


@pytest.mark.parametrize("kind", ["plain", "slip"])
def test_nees_by_captured_positions_is_near_that_by_the_exact_velocity(kind):
    log = synthesize(KINDS[kind], 61)
    found, truth = track("best", log), log.known()
    exact = score(log, found).nees
    rows = 51
    captured = slopes(truth.position, rows, float(np.median(np.diff(log.seconds))))
    blurred = score(replace(log, truth=replace(truth, v_world=captured)), found).nees
    alike = score(replace(log, truth=replace(truth, v_world=captured, window_s=0.5)), found).nees
    assert blurred > 3.0 * exact  # a window on one side only: the estimate looks confident and wrong
    assert 0.5 * exact < alike < 1.5 * exact  # what is faster than the window is not seen


def walk(n: int = 1000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A walk at 0.15 m/s that turns, captured at 50 Hz and written at 100."""
    at = np.arange(n) // 2 * 0.02
    position = np.stack([0.15 * at, 0.02 * np.sin(3.0 * at), np.full(n, 0.5)], axis=1)
    return position, Rotation.from_rotvec(0.1 * at[:, None] * [0.0, 0.0, 1.0]).as_matrix(), np.arange(n) * 0.01


@pytest.mark.parametrize("shown", ["first", "last"])
def test_poses_that_a_capture_repeats_while_the_robot_moves_are_found(shown):
    position, rot, seconds = walk()
    assert not held_rows(position, rot, seconds, 0.0).any()
    at = 300 if shown == "first" else 339  # the pose before the loss, or that behind it
    position[300:340], rot[300:340] = position[at], rot[at]
    held = held_rows(position, rot, seconds, 0.0)
    assert held[302:338].all()
    assert held.sum() <= 42
    wide = held_rows(position, rot, seconds, 0.4)
    assert wide[282:358].all()
    assert wide.sum() <= 83


def test_a_robot_that_stands_is_not_lost():
    position, rot, seconds = walk()
    position[300:600], rot[300:600] = position[300], rot[300]
    position[600:] += position[300] - position[600]
    rot[600:] = rot[600:] @ rot[600].T @ rot[300]
    assert not held_rows(position, rot, seconds, 0.4).any()
    assert not held_rows(np.ones((50, 3)), np.repeat(np.eye(3)[None], 50, axis=0), seconds[:50], 0.0).any()


def test_rows_that_are_not_known_are_not_scored():
    position, rot, seconds = walk()
    position[300:340], rot[300:340] = position[339], rot[339]
    stamps = 1 + np.round(1e9 * seconds).astype(np.int64)
    columns = {
        "stamp_ns": stamps, "acc": np.tile([0.0, 0.0, 9.81], (1000, 1)), "true_position": position, "true_rotation": rot
    }  # fmt: skip
    notes: list[str] = []
    truth = truth_of(columns, notes)
    assert truth.held.any()
    assert any("repeats poses while the robot moves" in note for note in notes)
    log = synthesize(KINDS["plain"], 61)
    held = np.zeros(len(log.stamp_ns), dtype=bool)
    held[1000:1100] = True
    spoilt = log.v_world.copy()
    spoilt[1000:1100] += 1.0
    found = track("best", log)
    judged = score(replace(log, truth=TrueMotion(log.position, log.rot, spoilt, 0.0, held)), found)
    assert judged.rmse < 1.05 * score(log, found).rmse


def test_a_gap_in_the_stamps_is_no_error_of_an_exact_velocity():
    t = np.arange(400) * 0.01
    t[200:] += 0.2
    v = np.tile([0.5, 0.0, 0.0], (400, 1))
    captured = slopes(v * t[:, None], 41, 0.01)
    assert np.abs(captured - v).max() > 0.5  # the fit takes equal steps
    np.testing.assert_allclose(over_window(v, t, 0.4), captured, atol=1e-9)
