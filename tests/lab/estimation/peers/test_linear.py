"""The linear filter is a fair referee."""

import numpy as np

from surefoot.lab.estimation.peers.linear import LinearNoise, linear
from surefoot.lab.estimation.scores import score
from surefoot.lab.estimation.track import track
from tests.lab.estimation.walks import clean, noisy


def test_perfect_sensors_give_the_truth():
    log = clean()
    found = score(log, track("linear", log))
    assert found.rmse < 5e-3
    assert found.odometry < 0.01


def test_it_filters_what_the_legs_alone_show():
    log = noisy()
    ours = score(log, track("linear", log)).rmse
    assert ours < 0.5 * score(log, track("kinematics_gyro", log)).rmse


def test_covariance_of_the_velocity_is_positive():
    p = linear(noisy(), LinearNoise())[2][250:, 3:, 3:]
    assert np.linalg.eigvalsh(p).min() > 0.0
