"""Stated noise of inertial sensors, far too large or small, counts as what a rest shows; excess has a bound."""

import numpy as np
import pytest

from surefoot.lab.estimation.track import track
from surefoot.services.estimator.filter.layout import E, M
from surefoot.services.estimator.filter.setting import best_noise
from surefoot.services.estimator.filter.start import shown_noise
from surefoot.services.estimator.filter.state import Felt, new_state, predict
from surefoot.services.estimator.params import EstimatorParams
from tests.lab.estimation.walks import noisy


@pytest.mark.parametrize("factor", [0.02, 0.2, 0.5, 1.0, 3.0, 5.0, 15.0])
def test_a_stated_noise_counts_as_what_a_rest_shows(factor):
    rng, true = np.random.default_rng(3), 0.01
    for _ in range(20):
        rows = true * rng.normal(size=(50, 3))
        used = shown_noise(rows, rows.mean(axis=0), factor * true) * factor
        assert max(min(factor, 1.0), 0.7) * 0.75 < used < 2.0
    loud = rows * np.array([1.0, 1.0, 0.1])  # an axis that does not shake is no sign that the others are right
    assert shown_noise(loud, loud.mean(axis=0), 0.2 * true) * 0.2 > 0.7


def test_a_rest_without_noise_changes_nothing():
    rows = np.full((50, 3), 0.02)
    rows[25, 0] += 1e-6
    assert shown_noise(rows, rows.mean(axis=0), 0.01) == 1.0
    assert shown_noise(rows, rows.mean(axis=0), 0.0) == 1.0


@pytest.mark.parametrize("key", ["sigma_w", "sigma_q"])
@pytest.mark.parametrize("factor", [0.2, 5.0])
def test_a_walk_is_hardly_worse_where_noise_is_stated_wrongly(key, factor):
    log = noisy("twist", 31)
    assert log.truth is not None
    rows, errors = log.seconds > 2.0, []
    for change in (1.0, factor):
        found = track("best", log, **{key: change * getattr(EstimatorParams(), key)})
        errors.append(np.sqrt(np.mean(np.sum((found.v - log.truth.v)[rows] ** 2, axis=1))))
    assert errors[1] < 1.2 * errors[0]


@pytest.mark.parametrize("sigma_q", [0.01, 0.035, 0.5, 2.0])
def test_the_excess_raises_no_accelerometer_beyond_what_a_trunk_hides(sigma_q):
    noise = best_noise(EstimatorParams(sigma_q=sigma_q))
    grown = []
    for excess in (1.0, noise.most_excess):
        state = new_state(1)
        state.cov[:], state.memory[M.excess] = 0.0, excess
        for _ in range(100):
            predict(state, np.zeros(3), np.array([0.0, 0.0, 9.81]), 0.01, noise._replace(gyro=0.0), Felt(0.0, 0.0, 0.0))
        grown.append(np.sqrt(state.cov[E.vel, E.vel]))  # after 1 s
    assert grown[0] >= noise.acc
    assert max(noise.acc, min(noise.most_excess * noise.acc, noise.most_shaken)) * 0.99 <= grown[1]
    assert grown[1] <= 1.1 * max(grown[0], min(noise.most_excess * noise.acc, noise.most_shaken))
