"""Truth that is late, turned, elsewhere and scaled is found, and taken out before scores."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import correlate
from scipy.spatial.transform import Rotation

from surefoot.lab.estimation.align import Alignment, align, aligned, correlations
from surefoot.lab.estimation.export import save_npz
from surefoot.lab.estimation.files import open_log
from surefoot.lab.estimation.log import Log, TrueMotion
from surefoot.lab.estimation.scores import score
from surefoot.lab.estimation.track import track
from tests.lab.estimation.walks import noisy

LATE_S, LEVER, SCALE = 0.04, np.array([0.05, -0.03, 0.08]), 1.02
TURN_DEG = 10.0 * np.array([0.6, 0.0, 0.8])


def displaced(log: Log, rows: int = 4) -> Log:
    """The log with a truth of another point of the body, in other axes, scaled and late."""
    truth = log.known()
    turn = Rotation.from_rotvec(TURN_DEG, degrees=True).as_matrix()
    position = SCALE * (truth.position + truth.rot @ LEVER)
    v = np.gradient(position, log.seconds, axis=0)
    at = np.maximum(np.arange(len(position)) - rows, 0)
    return replace(log, truth=TrueMotion(position[at], truth.rot[at] @ turn, v[at]))


def off(found: Alignment) -> dict[str, np.ndarray]:
    """Errors over half intervals."""
    true = {"offset_s": LATE_S, "rotation_deg": TURN_DEG, "lever_m": LEVER, "scale": SCALE}
    return {name: np.abs(getattr(found, name).value - true[name]) / getattr(found, name).within for name in true}


@pytest.mark.parametrize(("kind", "seed"), [("plain", 0), ("slip", 1)])
def test_a_displaced_truth_is_found_within_its_intervals(kind, seed):
    found = align(displaced(noisy(kind, seed)))
    assert max(part.max() for part in off(found).values()) < 1.5  # of 8 values of 95 % each
    assert np.mean(np.concatenate(list(off(found).values())) < 1.0) > 0.7
    assert found.offset_s.within[0] < 0.003
    assert found.rotation_deg.within.max() < 0.3
    assert found.lever_m.within.max() < 0.01
    assert found.scale.within[0] < 0.02


def test_scores_after_alignment_are_those_of_the_true_truth():
    log = noisy("turn")
    bad = displaced(log)
    found = track("kinematics_gyro", log)
    true, displaced_, mended = (score(one, found) for one in (log, bad, aligned(bad, align(bad))))
    assert displaced_.rmse > 1.3 * true.rmse
    assert mended.rmse == pytest.approx(true.rmse, rel=0.1)
    assert mended.tilt_deg == pytest.approx(true.tilt_deg, abs=0.2)
    assert mended.rpe == pytest.approx(true.rpe, abs=0.01)


def test_an_aligned_truth_has_no_note_and_a_displaced_one_has():
    log = noisy("turn")
    assert align(log).notes(0.01) == ()
    (note,) = align(displaced(log)).notes(0.01)
    assert all(word in note for word in ("+40 ms", "10.0 deg", "--align"))


def test_a_truth_of_another_recording_is_said_to_be():
    log, other = noisy("turn", 0), noisy("turn", 1).known()
    rng = np.random.default_rng(0)
    drawn = Rotation.from_rotvec(np.cumsum(0.01 * rng.normal(size=(len(other.v), 3)), axis=0)).as_matrix()
    (note,) = align(replace(log, truth=replace(other, rot=drawn))).notes(0.01)
    assert "another clock" in note


def test_a_log_that_stands_shows_nothing():
    log = noisy()
    still = log.with_imu(np.arange(150)).with_feet(np.flatnonzero(log.foot_ns < log.stamp_ns[150]))
    found = align(still)
    assert found.notes(0.01) == ()
    assert found.report()["applied"] == []
    assert aligned(still, found).truth.position == pytest.approx(still.truth.position)


def test_the_reader_notes_and_mends(answer, tmp_path):
    path = save_npz(displaced(noisy("turn")), tmp_path / "late.npz")
    assert any("--align" in note for note in open_log(path).notes)
    report = json.loads(answer("estimate", path, "--align", "--json"))
    assert report["alignment"]["applied"] == ["offset_s", "rotation_deg", "lever_m", "scale"]
    assert report["alignment"]["offset_s"] == pytest.approx(0.04, abs=0.002)
    assert report["errors"]["rmse"] < 0.02
    assert not any("--align" in note for note in report["notes"])
    assert "point from the IMU" in answer("estimate", path, "--align")


@pytest.mark.parametrize(("rows", "most"), [(50, 10), (257, 100), (1024, 511), (9, 0)])
def test_correlations_are_those_of_scipy(rows, most):
    a, b = np.random.default_rng(rows).normal(size=(2, rows, 3))
    whole = np.array([[correlate(b[:, j], a[:, i]) for j in range(3)] for i in range(3)])
    expected = np.moveaxis(whole, 2, 0)[rows - 1 - most : rows + most]
    np.testing.assert_allclose(correlations(a, b, most), expected, atol=1e-12)
