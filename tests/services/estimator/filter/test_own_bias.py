"""Heading before a rest has shown the bias of the gyro."""

import math

import pytest

from surefoot.services.estimator.filter.heading import keep_heading
from surefoot.services.estimator.filter.layout import M, X
from surefoot.services.estimator.filter.state import new_state


@pytest.mark.parametrize(("rate", "bias", "own", "turned"), [
    (0.02, 0.03, 0.0, 0.0), (0.02, -0.03, 0.0, 0.0), (0.02, 0.005, 0.0, 0.0025), (0.02, 0.03, 0.025, 0.0025),
    (1.0, 0.005, 0.0, 0.005), (1.0, 0.03, 0.025, 0.005), (0.045, 0.03, 0.0, 0.0289), (0.045, -0.03, 0.0, -0.0289),
])  # fmt: skip
def test_a_bias_that_no_rest_has_shown_turns_the_heading_only_where_it_may_be_nothing(rate, bias, own, turned):
    """Feet that part at 0.02/s have half of the heading, and count as much for the bias; at 0.045/s next to nothing."""
    state = new_state(4)
    state.memory[M.parting] = rate**2
    state.x[X.gyro_bias + 2], state.memory[M.own_bias + 2] = bias, own
    for _ in range(100):
        keep_heading(state, 0.01)
    assert math.atan2(state.x[X.rot + 3], state.x[X.rot]) == pytest.approx(turned, abs=1e-9 + 0.02 * abs(turned))
