"""Heading by gyro or feet: feet that part are not believed about the heading."""

import math

import numpy as np
import pytest

from surefoot.services.estimator.feet.mount import FootMount
from surefoot.services.estimator.filter.heading import gyro_share, keep_heading, learn_parting, take_back, turn_heading
from surefoot.services.estimator.filter.layout import M, P, X
from surefoot.services.estimator.filter.noise import FIXED
from surefoot.services.estimator.filter.state import BestState, new_state, rotation, turn_matrix
from surefoot.services.estimator.params import EstimatorParams
from surefoot.services.estimator.stream import Estimator

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


def test_a_shaking_trunk_leaves_its_heading_to_the_gyro_where_pairs_of_feet_turn():
    sd, stances = 0.01, 30
    errors = [shaken_trot(seed, sd, stances) for seed in range(8)]
    rms = math.sqrt(sum(error**2 for error in errors) / len(errors))
    assert rms < 0.45 * sd * math.sqrt(stances), "0.65 of what the feet turn if the trunk's jerk counts as in its tilt"


def shaken_trot(seed: int, sd: float, stances: int) -> float:
    """Error of the heading, rad, of a trot on the spot: the trunk shakes by 2 deg, pairs of feet turn by `sd` rad."""
    filter_ = Estimator(FootMount(None, np.eye(3), np.zeros(3), np.zeros(4)), EstimatorParams(), names=("best",))
    rng, d, stance, t = np.random.default_rng(seed), 0.01, 0.2, 0.0
    turns = sd * rng.normal(size=stances + 1)
    for k in range(100 + 20 * stances):
        before, t = attitude(t), max(0.0, d * k - 1.0)
        here, step, side = attitude(t), int(t / stance), 1.0 if int(t / stance) % 2 else 0.0
        turn = before.T @ here
        gyro = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / (2.0 * d)
        acc = here.T @ np.array([0.0, 0.0, 9.81])
        filter_.imu(10_000_000 * k, gyro + 0.0054 * rng.normal(size=3), acc + 0.035 * rng.normal(size=3))
        if k % 3 == 0:
            stands = np.array([side, side, 1.0 - side, 1.0 - side]) if t > 0.0 else np.ones(4)
            slid = turn_matrix(np.array([0.0, 0.0, turns[step] * (t / stance - step)]))
            filter_.feet(10_000_000 * k, FEET @ slid.T @ here, np.repeat(here.T[None], 4, axis=0), stands)
    assert filter_.estimate("best").filter_ok
    return filter_.pose().yaw - math.atan2(here[1, 0], here[0, 0])


def attitude(t: float) -> np.ndarray:
    """Rotation of a shaking trunk so long after it has set off."""
    return turn_matrix(0.035 * np.sin(np.array([30.0, 26.0, 22.0]) * t))
