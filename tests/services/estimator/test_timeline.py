"""Samples by stamp, clocks, and contact points."""

import numpy as np
import pytest

from surefoot.robot.reader import load_robot
from surefoot.services.estimator.feet.contact import contact_points, point_feet, probabilities, sole_feet
from surefoot.services.estimator.filter.memory import IMU_END, add_imu, clear, new_memory
from surefoot.services.estimator.filter.state import new_state
from surefoot.services.estimator.inputs.results import AHEAD, LATE, OK, RESTART
from surefoot.services.estimator.inputs.timeline import (
    AHEAD_NS,
    CAPACITY,
    CLOCK,
    RESYNC_AFTER,
    WINDOW_NS,
    after,
    judge_clock,
)


def store(stamps):
    """Put samples into a memory in this order; True for each that was taken."""
    memory, state = new_memory(1, 1), new_state(1)
    clear(memory, state)
    return memory, [add_imu(memory, int(s), np.full(3, float(s)), np.full(3, -float(s))) for s in stamps]


def test_samples_are_in_order_whatever_comes_first():
    memory, taken = store([*np.random.default_rng(0).permutation(200), 7])
    assert taken == [True] * 200 + [False]
    assert memory.marks[IMU_END] == 200
    assert memory.imu_stamps[:200].tolist() == list(range(200))
    np.testing.assert_array_equal(memory.imu[:200, 0], np.arange(200.0))
    np.testing.assert_array_equal(memory.imu[:200, 5], -np.arange(200.0))
    assert after(memory.imu_stamps[:200], 99) == 100


def test_a_full_store_keeps_the_newest():
    memory, taken = store([*range(3 * CAPACITY), 3 * CAPACITY - 5])
    assert all(taken[:-1])
    assert not taken[-1]
    count = memory.marks[IMU_END]
    assert count >= CAPACITY // 2
    assert memory.imu_stamps[:count].tolist() == list(range(3 * CAPACITY - count, 3 * CAPACITY))


def clock(newest):
    made = np.zeros(CLOCK, dtype=np.int64)
    assert judge_clock(made, newest, newest) == OK
    return made


@pytest.mark.parametrize(("stamp", "result"), [
    (10**9 - WINDOW_NS, OK), (10**9 - WINDOW_NS - 1, LATE), (10**9 + 1, OK), (10**9 + AHEAD_NS + 1, AHEAD),
    (10**12, AHEAD),
])  # fmt: skip
def test_stamps(stamp, result):
    assert judge_clock(clock(10**9), stamp, 10**9) == result


def test_one_stamp_far_ahead_does_not_close_the_ears():
    made = clock(10**9)
    assert judge_clock(made, 10**18, 10**9) == AHEAD
    assert judge_clock(made, 10**9 + 10**7, 10**9) == OK


def test_a_clock_that_began_anew_is_followed():
    made = clock(10**12)
    results = [judge_clock(made, k * 10**7, 10**12) for k in range(1, RESYNC_AFTER + 1)]
    assert set(results[:-1]) == {LATE}
    assert results[-1] == RESTART


def test_a_sole_has_three_points_in_its_plane():
    normal = np.array([[0.0, 1.0, 0.0], [0.6, 0.0, 0.8]])
    points = sole_feet(normal, 0.1)
    assert points.foot.tolist() == [0, 0, 0, 1, 1, 1]
    np.testing.assert_allclose(np.linalg.norm(points.place, axis=1), 0.1)
    for f in range(2):
        np.testing.assert_allclose(points.place[3 * f : 3 * f + 3] @ normal[f], 0.0, atol=1e-15)
        np.testing.assert_allclose(points.place[3 * f : 3 * f + 3].sum(axis=0), 0.0, atol=1e-15)


@pytest.mark.parametrize(
    ("robot", "points", "round_feet"), [("nao", 6, False), ("bioloid", 6, False), ("ragno", 6, True)]
)
def test_points_of_the_robots(robot, points, round_feet):
    found = contact_points(load_robot(robot))
    assert len(found.foot) == points
    assert (found.radius > 0.0).all() == round_feet
    if not round_feet:
        assert 0.05 < np.linalg.norm(found.place[0]) < 0.2
    assert found.switches.shape == ((6, 1, 3) if round_feet else (2, 4, 3))
    np.testing.assert_allclose(found.switches[:, :, 2], 0.0, atol=1e-9)  # in the sole, in which the foot's centre is


def test_probabilities_of_feet_are_those_of_their_points():
    points = sole_feet(np.array([[0.0, 0.0, 1.0]] * 2), 0.1)
    np.testing.assert_allclose(probabilities(points.foot, np.array([1.0, 0.0])), [0.98] * 3 + [0.0] * 3)
    assert np.isnan(probabilities(point_feet(np.zeros(1)).foot, np.array([np.nan]))).all()
