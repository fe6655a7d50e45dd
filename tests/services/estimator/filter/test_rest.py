"""What a rest shows of the bias of the gyro."""

import numpy as np
import pytest

from surefoot.services.estimator.filter.layout import E, M, X
from surefoot.services.estimator.filter.noise import best_limits, best_noise
from surefoot.services.estimator.filter.rest import learn_gyro_bias
from surefoot.services.estimator.filter.state import new_state
from surefoot.services.estimator.params import EstimatorParams, StartPose

LATER = 1e-3
"""Rate that the gyro reads about the vertical in the last three seconds of a rest of 23 s, rad/s."""


@pytest.mark.parametrize(("moved", "least", "most"), [(0.0, 0.0, 0.2), (1.0, 0.8, 1.0)])
def test_the_end_of_a_rest_after_a_walk_shows_the_bias_about_the_vertical(
    moved: float, least: float, most: float
) -> None:
    params = EstimatorParams()
    noise, limits = best_noise(params), best_limits(params, StartPose(), stated=False)
    state = new_state(4)
    state.cov[E.gyro_bias : E.gyro_bias + 3, E.gyro_bias : E.gyro_bias + 3] = limits.creep**2 * np.eye(3)
    state.memory[M.moved] = moved
    for k in range(2300):
        learn_gyro_bias(state, np.array([0.0, 0.0, LATER if k >= 2000 else 0.0]), 1, noise, limits)
    assert least * LATER < state.x[X.gyro_bias + 2] < most * LATER
    assert abs(state.x[X.gyro_bias]) < 1e-9
