"""Scores of tracks whose errors are known."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.lab.estimation.log import Log
from surefoot.lab.estimation.scores import base_pose, score, smoothed
from surefoot.lab.estimation.track import Track, track
from surefoot.lab.statistics import nees
from tests.lab.estimation.walks import clean, noisy


def exact(log: Log) -> Track:
    """The truth as a track."""
    n = len(log.stamp_ns)
    position, yaw = base_pose(log)
    p = np.repeat(np.eye(6)[None] * 1e-4, n, axis=0)
    return Track("exact", log.v, log.up, p, position, yaw, log.v_world, {}, np.full(n, np.nan), {})


def test_the_truth_has_no_error():
    log = clean()
    found = score(log, exact(log))
    assert max(found.rmse, found.smooth, abs(found.average), found.drift, found.nees) < 1e-15
    assert found.odometry == pytest.approx(0.0, abs=1e-12)
    assert found.height == pytest.approx(0.0, abs=1e-12)
    assert found.tilt_deg < 1e-6
    assert found.integral < 0.02  # the rule of trapezoids on 10 ms


def test_a_constant_error_ahead():
    log = clean()
    ahead = log.v_world[log.scored].mean(axis=0)
    v = np.einsum("nji,nj->ni", log.rot, log.v_world + 0.1 * ahead)
    found = score(log, replace(exact(log), v=v))
    size = 0.1 * np.linalg.norm(ahead)
    assert found.average == pytest.approx(0.1)
    assert found.rmse == pytest.approx(size)
    assert found.smooth == pytest.approx(size)
    assert found.nees == pytest.approx(size**2 / 1e-4)


def test_odometry_is_laid_over_the_start_of_the_scores_and_judged_by_the_net_way():
    log = clean()
    true = exact(log)
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    moved = replace(true, position=true.position @ turn.T + [1.0, 2.0, 3.0], yaw=true.yaw + 0.7)
    assert score(log, moved).odometry == pytest.approx(0.0, abs=1e-9)
    longer = replace(true, position=true.position * [1.05, 1.05, 1.0])
    assert score(log, longer).odometry == pytest.approx(0.05, abs=1e-6)


def test_noise_that_alternates_vanishes_over_half_a_second():
    log = clean()
    error = np.where(np.arange(400)[:, None] % 2 == 0, 1.0, -1.0) * np.ones(3)
    assert np.abs(smoothed(error, log)).max() < 1e-9


def test_nees_of_drawn_errors_is_their_number():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(3, 3))
    errors = rng.normal(size=(4000, 3)) @ root.T
    assert nees(errors, np.repeat((root @ root.T)[None], 4000, axis=0)).mean() == pytest.approx(3.0, abs=0.15)


def test_the_trajectory_is_measured_after_alignment():
    log = clean()
    true = exact(log)
    found = score(log, true)
    way = np.linalg.norm(np.diff(true.position[log.scored], axis=0), axis=1).sum()
    assert found.path == pytest.approx(way, rel=0.25)  # sways away
    assert max(found.rpe, found.rpe_1s, found.ate, found.heading_rms_deg, found.climb) < 1e-9
    assert found.rpe_m == 0.1  # 6 s at 4 cm/s
    rate = np.radians(3.0) / 60.0  # a gyro bias
    turned = score(log, replace(true, yaw=true.yaw + rate * log.seconds + 0.5))
    assert turned.heading_deg_min == pytest.approx(3.0)
    climbing = score(log, replace(true, position=true.position + [0, 0, 0.01] * log.seconds[:, None]))
    assert climbing.climb == pytest.approx(0.01 * np.ptp(log.seconds[log.scored]) / found.path, rel=0.2)


def test_rows_inside_the_region_are_those_of_a_stated_covariance():
    log, rng = clean(), np.random.default_rng(0)
    n = len(log.stamp_ns)
    found = score(log, replace(exact(log), v=log.v + 0.01 * rng.normal(size=(n, 3))))
    assert found.inside == pytest.approx(0.95, abs=0.03)
    unstarted = replace(exact(log), p=np.zeros((n, 6, 6)))
    assert np.isnan(score(log, unstarted).nees)


@pytest.mark.parametrize("kind", ["slip", "edges"])
def test_covariance_of_the_pose_holds_and_grows(kind):
    found = [(log, track("best", log)) for log in (noisy(kind, seed) for seed in range(4))]
    position = np.mean([score(log, one).position_nees for log, one in found]) / 3.0
    heading = np.mean([score(log, one).heading_nees for log, one in found])
    assert 0.2 < position < 2.0
    assert 0.1 < heading < 2.0
    for log, one in found:
        spread = np.trace(one.pose[:, :2, :2], axis1=1, axis2=2)
        assert spread[-1] > 1.5 * spread[len(log.stamp_ns) // 2] > 1.5 * spread[220]
    assert np.isnan(score(log, track("inekf", log)).position_nees)
