"""Invariant and linear filter are fair referees: right where they can be, consistent, indifferent to the axes."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.lab.estimation.log import TrueMotion
from surefoot.lab.estimation.peers.inekf import InekfNoise, exp3, inekf
from surefoot.lab.estimation.peers.linear import LinearNoise, linear
from surefoot.lab.estimation.scores import score
from surefoot.lab.estimation.track import track
from surefoot.lab.statistics import nees
from tests.lab.estimation.walks import clean, noisy


@pytest.mark.parametrize(("name", "rmse", "tilt_deg"), [("inekf", 2e-3, 0.05), ("linear", 5e-3, np.inf)])
def test_perfect_sensors_give_the_truth(name, rmse, tilt_deg):
    log = clean()
    found = score(log, track(name, log))
    assert found.rmse < rmse
    assert found.tilt_deg < tilt_deg
    assert found.odometry < 0.01


def test_exp_is_a_rotation_and_its_jacobian_the_derivative():
    x = np.array([0.3, -0.8, 0.5])
    rot, left = exp3(x)
    np.testing.assert_allclose(rot @ rot.T, np.eye(3), atol=1e-14)
    for i in range(3):
        step = np.zeros(3)
        step[i] = 1e-6
        turned = (exp3(x + step)[0] - exp3(x - step)[0]) @ rot.T / 2e-6
        np.testing.assert_allclose([turned[2, 1], turned[0, 2], turned[1, 0]], left[:, i], atol=1e-8)


def test_the_gyro_bias_is_found_without_a_standstill():
    log = noisy("twist", 1)
    found = [score(one, track("inekf", one)).rmse for one in (log, replace(log, rest=(0, 0)))]
    assert found[1] < 1.3 * found[0] + 1e-3


@pytest.mark.parametrize("points", [False, True])
def test_covariance_is_symmetric_and_positive(points):
    _, _, p, _, _ = inekf(noisy(), InekfNoise(points=points))
    np.testing.assert_allclose(p, np.swapaxes(p, 1, 2), atol=1e-12)
    assert np.linalg.eigvalsh(p[250:, 3:, 3:]).min() > 0.0
    assert np.linalg.eigvalsh(p[250:]).min() > -1e-15  # the length of g is known: that variance is 0


def test_consistent_on_walks_that_fit_its_model():
    """Feet that stand still, noise as stated: the mean NEES of one sample of each walk is near 3."""
    values = []
    for seed in range(4):
        log = noisy("plain", seed)
        v, _, p, _, _ = inekf(log, InekfNoise())
        rows = np.arange(600, 1900, 400)
        values.append(nees(v[rows] - log.v[rows], p[rows][:, 3:, 3:]).mean())
    assert 0.5 < np.mean(values) < 4.5


def test_the_heading_of_the_world_changes_nothing():
    log = noisy()
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    other = replace(log, truth=TrueMotion(log.position @ turn.T, turn @ log.rot, log.v_world @ turn.T))
    a, b = (score(one, track("inekf", one)) for one in (log, other))
    assert a.rmse == pytest.approx(b.rmse)
    assert a.odometry == pytest.approx(b.odometry)


def test_the_linear_filter_filters_what_the_legs_alone_show():
    log = noisy()
    ours = score(log, track("linear", log)).rmse
    assert ours < 0.5 * score(log, track("kinematics_gyro", log)).rmse


def test_covariance_of_the_velocity_of_the_linear_filter_is_positive():
    p = linear(noisy(), LinearNoise())[2][250:, 3:, 3:]
    assert np.linalg.eigvalsh(p).min() > 0.0
