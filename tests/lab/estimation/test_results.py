"""Whole logs of any length to files."""

import csv
import json
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from surefoot.lab.estimation import results
from surefoot.lab.estimation.log import Log, TrueMotion
from surefoot.lab.estimation.plots import draw
from surefoot.lab.estimation.track import track
from tests.lab.estimation.walks import noisy


def test_pieces_are_the_whole(tmp_path, monkeypatch):
    log = noisy()
    monkeypatch.setattr(results, "ROWS_EACH", 333)
    found = results.estimate(log, "ekf", tmp_path / "parts")
    whole = track("ekf", log)
    for name in ("v", "g", "p", "position", "yaw", "nis"):
        np.testing.assert_array_equal(getattr(found.track, name), getattr(whole, name))
    assert found.track.refused == whole.refused


def test_files_hold_what_was_estimated(tmp_path):
    log = noisy()
    found = results.estimate(log, "ekf", tmp_path / "parts")
    v = np.array(found.track.v)
    table = results.write_csv(found, tmp_path / "estimates.csv")
    picture = draw(found, tmp_path / "estimates.svg")
    packed = results.pack(tmp_path / "parts", tmp_path / "estimates.npz")
    with np.load(packed) as file:
        assert {"velocity_imu", "covariance", "nis", "slipping", "filter_ok", "stamp_ns"} <= set(file.files)
        np.testing.assert_array_equal(file["velocity_imu"], v)
        np.testing.assert_array_equal(file["stamp_ns"], log.stamp_ns)
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(v)
    assert float(rows[-1]["velocity_imu_x"]) == pytest.approx(v[-1, 0], rel=1e-8)
    assert picture.read_text().startswith("<?xml")
    assert not list((tmp_path / "parts").glob("*"))


def test_the_summary_says_what_matters(tmp_path):
    report = results.estimate(noisy(), "ekf", tmp_path).summary
    assert report["started_after_s"] == pytest.approx(0.49, abs=0.02)
    assert report["imu_hz"] == pytest.approx(100.0)
    assert 0.0 < report["nis_mean"] < 20.0
    assert report["errors"]["rmse"] < 0.03
    assert "drift" in report["unobservable"]


def test_a_log_that_never_rests_is_said_not_to_start(tmp_path):
    log = noisy().with_imu(np.arange(400, 2000))
    report = results.estimate(log, "ekf", tmp_path).summary
    if report["started_after_s"] is None:  # an estimator may start in motion
        assert "standstill" in report["warning"]


def long_log(n: int) -> Log:
    """Standing still for n rows."""
    rng = np.random.default_rng(0)
    m = n // 3
    position = np.array([[0.0, 0.04, -0.25], [0.0, -0.04, -0.25]])
    return Log(
        "long", 10_000_000 * (1 + np.arange(n)), 0.005 * rng.normal(size=(n, 3)),
        [0.0, 0.0, 9.81] + 0.03 * rng.normal(size=(n, 3)), 30_000_000 * (1 + np.arange(m)),
        np.broadcast_to(position, (m, 2, 3)), np.broadcast_to(np.eye(3), (m, 2, 3, 3)), np.ones((m, 2), dtype=bool),
    )  # fmt: skip


def test_memory_does_not_grow_with_the_estimates(tmp_path, monkeypatch):
    """10^7 rows of estimates are 8 GB: they go to disk piece by piece, and only the order of arrival stays."""
    monkeypatch.setattr(results, "ROWS_EACH", 500)
    peaks = []
    results.estimate(long_log(600), "ekf", tmp_path / "warm")
    for n in (900, 2700):
        log = replace(long_log(n))
        tracemalloc.start()
        results.estimate(log, "ekf", tmp_path / str(n))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert (peaks[1] - peaks[0]) / 1800 < 250  # bytes a row; a row of estimates has 800


def standing_with_truth() -> Log:
    log = long_log(600)
    rot = np.tile(np.eye(3), (600, 1, 1))
    return replace(log, truth=TrueMotion(np.zeros((600, 3)), rot, np.zeros((600, 3))))


STRANGE = {
    "stands still": standing_with_truth,
    "without truth": lambda: long_log(600),
    "three rows": lambda: replace(noisy().with_imu(np.arange(3)), begin_s=0.0, end_s=0.0),
    "never rests": lambda: noisy().with_imu(np.arange(400, 460)).with_feet(np.arange(0)),
}


@pytest.mark.parametrize("name", ["best", "kinematics_gyro", "inekf"])
@pytest.mark.parametrize("kind", STRANGE)
def test_summaries_hold_no_number_that_json_does_not_know(tmp_path, kind, name):
    report = results.estimate(STRANGE[kind](), name, tmp_path).summary
    text = json.dumps(report, allow_nan=False)
    assert report["rows"] > 0
    assert ("errors" in report) <= ("rpe" in text)
    if kind == "stands still":
        assert report["errors"]["odometry"] is None
        assert report["errors"]["rpe_m"] is None
        assert report["us_per_row"] > 0.0
