"""Estimators of the service and referees through one function."""

from functools import cache

import numpy as np
import pytest

from surefoot.errors import FieldError
from surefoot.lab.estimation.scores import base_pose
from surefoot.lab.estimation.track import follow, names, track
from tests.lab.estimation.walks import noisy
from tests.surefoot.expect import expect_error


@cache
def found_by(name):
    """Track of an estimator over the walk."""
    return track(name, noisy())


@pytest.mark.parametrize("name", names())
def test_every_estimator_gives_a_finite_track(name):
    log, found = noisy(), found_by(name)
    n = len(log.stamp_ns)
    assert found.v.shape == found.g.shape == found.position.shape == (n, 3)
    assert found.p.shape == (n, 6, 6)
    for part in (found.v, found.g, found.p, found.position, found.yaw, found.v_odom):
        assert np.isfinite(part).all()
    assert found.flags["initialised"][300:].all()
    assert np.linalg.norm(found.g[300:], axis=1) == pytest.approx(9.81, abs=0.2)


def test_an_unknown_estimator_is_refused_with_the_known_ones():
    with expect_error(FieldError, "unknown_name", "estimator", text="inekf"):
        track("bets", noisy())


@pytest.mark.parametrize("name", ["kinematics_gyro", "imu", "paper"])
def test_the_odometry_of_an_estimator_is_its_own(name):
    log = noisy()
    found, best = found_by(name), found_by("best")
    assert not np.array_equal(found.position, best.position)
    way = np.cumsum(found.v_odom * np.gradient(log.seconds)[:, None], axis=0)
    np.testing.assert_allclose(found.position - found.position[0], way - way[0], atol=2e-3)
    ahead = np.hypot(*found.v_odom[:, :2].T)
    assert found.gyro_bias is not None
    base = found.v + np.cross(log.w - found.gyro_bias, -log.imu_position)
    np.testing.assert_allclose(ahead**2 + found.v_odom[:, 2] ** 2, np.sum(base**2, axis=1), atol=1e-9)


def test_pieces_of_own_odometry_are_the_whole():
    log = noisy()
    whole = found_by("kinematics_gyro")
    pieces = [piece for _, piece in follow("kinematics_gyro", log, 333)]
    for part in ("position", "yaw", "v_odom"):
        found = np.concatenate([getattr(piece, part) for piece in pieces])
        np.testing.assert_allclose(found, getattr(whole, part), atol=1e-12)


def test_the_heading_of_the_gyro_is_kept_over_a_walk_that_turns():
    log = noisy("turn")
    _, true = base_pose(log)
    yaw, rows = track("imu", log).yaw, np.flatnonzero(log.scored)[[0, -1]]
    assert np.ptp(true[rows]) > 1.0
    assert np.diff(yaw[rows])[0] == pytest.approx(np.diff(true[rows])[0], abs=0.03)


def test_the_same_log_gives_the_same_track():
    a, b = found_by("ekf"), track("ekf", noisy())
    np.testing.assert_array_equal(a.v, b.v)
    np.testing.assert_array_equal(a.p, b.p)
