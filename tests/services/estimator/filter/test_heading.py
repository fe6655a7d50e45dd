"""Heading by gyro or feet: feet that part are not believed about the heading."""

import math

import numpy as np
import pytest

from surefoot.services.estimator.filter.heading import gyro_share, keep_heading, learn_parting, take_back, turn_heading
from surefoot.services.estimator.filter.layout import M, P, X
from surefoot.services.estimator.filter.noise import FIXED
from surefoot.services.estimator.filter.state import BestState, new_state, rotation, turn_matrix

FEET = np.array([[0.2, 0.15, -0.3], [-0.2, -0.15, -0.3], [0.2, -0.15, -0.3], [-0.2, 0.15, -0.3]])
FOOT = np.arange(4)


def standing(parting: float = 0.0) -> BestState:
    state = new_state(4)
    for k, place in enumerate(FEET):
        state.x[X.points + 3 * k : X.points + 3 * k + 3] = place
        state.points[k, P.down] = 1.0
    state.x[X.vel : X.vel + 3] = 0.3, -0.1, 0.02
    state.memory[M.parting] = parting
    return state


def trot(state: BestState, rate: float, turn: float, steps: int = 20) -> None:
    """Stand on both diagonals in turn for .4 s each; their feet part at `rate` 1/s and turn at `turn` rad/s."""
    for step in range(steps):
        contact = np.array([1.0, 1.0, 0.0, 0.0]) if step % 2 else np.array([0.0, 0.0, 1.0, 1.0])
        for i in range(21):
            t = 0.02 * i
            seen = math.exp(rate * t) * FEET @ turn_matrix(np.array([0.0, 0.0, turn * t])).T
            learn_parting(state, np.add(seen, [0.3 * t, 0.0, 0.0]), contact, FOOT)
            state.memory[M.age] += 0.02 if i < 20 else 0.0


def test_feet_that_turn_without_parting_are_believed():
    state = standing()
    trot(state, 0.0, 0.5)
    assert state.memory[M.parting] == pytest.approx(0.0, abs=1e-12)
    assert gyro_share(state.memory) == 0.0


@pytest.mark.parametrize("rate", [0.05, -0.05])
def test_feet_that_part_or_close_up_are_not(rate):
    state = standing()
    trot(state, rate, 0.0)
    assert math.sqrt(state.memory[M.parting]) == pytest.approx(0.05, rel=0.02)
    assert gyro_share(state.memory) > 0.95
    trot(state, 0.0, 0.0, 40)
    assert gyro_share(state.memory) == 0.0, "feet that stand firmly again are believed again"


def test_one_foot_alone_shows_nothing():
    state = standing(1e-3)
    for i in range(40):
        learn_parting(state, FEET * (1.0 + 0.01 * i), np.array([1.0, 0.0, 0.0, 0.0]), FOOT)
        state.memory[M.age] += 0.02
    learn_parting(state, FEET, np.ones(4), FOOT)
    assert state.memory[M.parting] == 1e-3


def test_the_heading_turns_by_the_bias_that_the_feet_claim():
    state = standing(parting=1.0)  # of the rate, 1/s^2: no trust in the feet
    state.x[X.gyro_bias : X.gyro_bias + 3] = 0.01, -0.02, 0.05
    state.memory[M.own_bias : M.own_bias + 3] = 0.0, 0.0, 0.02
    for _ in range(100):
        keep_heading(state, 0.01)
    assert math.atan2(state.x[X.rot + 3], state.x[X.rot]) == pytest.approx(0.03, rel=1e-6)


def test_what_the_feet_correct_is_taken_back():
    state = standing(parting=1.0)
    before = rotation(state.x)
    turn_heading(state, 0.02)
    take_back(state, before)
    assert math.atan2(state.x[X.rot + 3], state.x[X.rot]) == pytest.approx(0.0, abs=1e-5)


def test_a_turned_heading_leaves_what_the_robot_feels():
    state = standing()
    before = state.x.copy()
    turn_heading(state, 0.7)
    for at in (X.vel, *range(X.points, X.points + 12, 3)):
        felt = rotation(state.x).T @ state.x[at : at + 3]
        np.testing.assert_allclose(felt, rotation(before).T @ before[at : at + 3], atol=1e-12)
    assert state.x[X.pos] == before[X.pos]


def test_feet_that_part_little_change_nothing():
    state = standing(parting=(0.25 * FIXED.parting) ** 2)
    state.x[X.gyro_bias + 2] = 0.05
    before = state.x.copy()
    keep_heading(state, 0.01)
    np.testing.assert_array_equal(state.x, before)
