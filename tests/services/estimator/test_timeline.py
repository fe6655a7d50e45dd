"""Samples by stamp, clocks, and contact points."""

import numpy as np
import pytest

from surefoot.robot.reader import load_robot
from surefoot.services.estimator.contact import contact_points, point_feet, probabilities, sole_feet
from surefoot.services.estimator.results import InputResult
from surefoot.services.estimator.timeline import AHEAD_NS, CAPACITY, RESYNC_AFTER, WINDOW_NS, ClockJudge, Samples


def test_samples_are_in_order_whatever_comes_first():
    stamps = np.random.default_rng(0).permutation(200)
    samples = Samples((2,))
    for s in stamps:
        assert samples.add(int(s), np.array([s, -s], dtype=float))
    assert samples.stamps.tolist() == list(range(200))
    np.testing.assert_array_equal(samples.values[0][:, 0], np.arange(200.0))
    assert not samples.add(7, np.zeros(2))
    assert samples.newest == 199
    assert samples.after(99) == 100


def test_a_full_store_keeps_the_newest():
    samples = Samples(())
    for s in range(3 * CAPACITY):
        samples.add(s, np.float64(s))
    assert samples.newest == 3 * CAPACITY - 1
    assert len(samples) >= CAPACITY // 2
    assert samples.add(3 * CAPACITY - 5, np.float64(0)) is False


@pytest.mark.parametrize(("stamp", "result"), [
    (10**9 - WINDOW_NS, InputResult.OK), (10**9 - WINDOW_NS - 1, InputResult.LATE), (10**9 + 1, InputResult.OK),
    (10**9 + AHEAD_NS + 1, InputResult.AHEAD), (10**12, InputResult.AHEAD),
])  # fmt: skip
def test_stamps(stamp, result):
    judge = ClockJudge()
    assert judge.judge(10**9, 10**9) is InputResult.OK
    assert judge.judge(stamp, 10**9) is result


def test_one_stamp_far_ahead_does_not_close_the_ears():
    judge = ClockJudge()
    judge.judge(10**9, 10**9)
    assert judge.judge(10**18, 10**9) is InputResult.AHEAD
    assert judge.judge(10**9 + 10**7, 10**9) is InputResult.OK


def test_a_clock_that_began_anew_is_followed():
    judge = ClockJudge(newest=10**12)
    results = [judge.judge(k * 10**7, 10**12) for k in range(1, RESYNC_AFTER + 1)]
    assert set(results[:-1]) == {InputResult.LATE}
    assert results[-1] is InputResult.RESTART


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


def test_probabilities_of_feet_are_those_of_their_points():
    points = sole_feet(np.array([[0.0, 0.0, 1.0]] * 2), 0.1)
    np.testing.assert_allclose(probabilities(points, np.array([1.0, 0.0])), [0.98] * 3 + [0.0] * 3)
    assert np.isnan(probabilities(point_feet(np.zeros(1)), np.array([np.nan]))).all()
