"""Checks of inputs at their very limits: a first stamp, feet that show no turn of the robot, and covariances."""

from itertools import product

import numpy as np
import pytest

from surefoot.services.estimator.inputs.check import (
    EQUAL_FEET,
    PATH,
    SHARED,
    SMALLEST,
    TURN,
    TURN_NS,
    CheckLimits,
    CheckState,
    check_feet,
    check_imu,
    check_units,
    new_check,
)
from surefoot.services.estimator.inputs.clock import LARGEST_NS
from surefoot.services.estimator.inputs.external import ExternalSample
from surefoot.services.estimator.inputs.results import AHEAD, OK, InputResult

TICK = 10_000_000
LIMITS = CheckLimits(10.0, 50.0, 5e7, 1e7, 25)
FEET = np.array([[0.1, 0.0, -0.1], [-0.1, 0.1, -0.1], [-0.1, -0.1, -0.1]])
ALL, NONE = np.ones(3), np.zeros(3)


@pytest.mark.parametrize(("stamp_ns", "code"), [(LARGEST_NS, OK), (LARGEST_NS + 1, AHEAD), (-LARGEST_NS - 1, AHEAD)])
def test_a_first_stamp_is_bounded(stamp_ns: int, code: int) -> None:
    assert check_feet(new_check(3, 3), stamp_ns, FEET) == code
    if stamp_ns > 0:
        assert check_imu(new_check(3, 3), LIMITS, stamp_ns, np.zeros(3), np.array([0.0, 0.0, 9.81])) == code


def compared(feet: np.ndarray, before: np.ndarray, now: np.ndarray, *, equal: int = 0) -> CheckState:
    """Return a check after two samples of feet that turn by 0.1 rad against a gyro that shows as much."""
    check, foot, place = new_check(3, 3), np.arange(3), np.zeros((3, 3))
    rot = np.tile(np.eye(3), (3, 1, 1))
    check.marks[TURN_NS] = TICK
    check_units(check, TICK, feet, rot, before, foot, place)
    check.marks[TURN_NS], check.marks[EQUAL_FEET], check.numbers[TURN + 2] = 2 * TICK, equal, 0.1
    c, s = np.cos(-0.1), np.sin(-0.1)
    turned = feet @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    check_units(check, 2 * TICK, turned, rot, now, foot, place)
    return check


def test_feet_that_stand_show_the_turn_of_the_gyro() -> None:
    numbers = compared(FEET, ALL, ALL).numbers
    assert numbers[PATH] == pytest.approx(0.1, rel=1e-9)
    assert numbers[SHARED] == pytest.approx(0.01, rel=0.01)


@pytest.mark.parametrize(
    ("before", "now", "equal"),
    [
        (NONE, ALL, 0), (ALL, NONE, 0), (np.array([1.0, 0.0, 0.0]), ALL, 0), (ALL, np.array([0.0, 1.0, 0.0]), 0),
        (np.array([1.0, 1.0, 0.0]), np.array([0.0, 1.0, 1.0]), 0), (ALL, ALL, 1),
    ],
)  # fmt: skip
def test_fewer_than_two_points_that_stand_and_repeated_feet_show_nothing(before, now, equal) -> None:
    assert np.all(compared(FEET, before, now, equal=equal).numbers[SHARED:] == 0.0)


@pytest.mark.parametrize(("size", "seen"), [(0.99, False), (1.01, True)])
def test_points_that_are_too_close_show_nothing(size: float, seen: bool) -> None:
    centred = FEET - FEET.mean(axis=0)
    feet = size * np.sqrt(SMALLEST) * centred / np.linalg.norm(centred)
    assert bool(compared(feet, ALL, ALL).numbers[PATH] > 0.0) == seen


@pytest.mark.parametrize("signs", list(product((-1.0, 1.0), repeat=3)))
@pytest.mark.parametrize("turned", [False, True])
def test_a_covariance_is_taken_with_positive_eigenvalues_only(signs, turned) -> None:
    random = np.random.default_rng(1)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0] if turned else np.eye(3)
    matrix = turn @ np.diag(1e-4 * random.uniform(1.0, 2.0, 3) * np.array(signs)) @ turn.T
    _, code = ExternalSample(velocity=[0.1, 0.0, 0.0], velocity_covariance=0.5 * (matrix + matrix.T)).row()
    assert code == (InputResult.OK if min(signs) > 0.0 else InputResult.COVARIANCE)


@pytest.mark.parametrize("place", [(0, 1), (0, 2), (1, 2)])
def test_a_covariance_is_taken_if_symmetric_only(place) -> None:
    matrix = 1e-4 * np.eye(3)
    matrix[place] = 2e-5
    _, code = ExternalSample(velocity=[0.1, 0.0, 0.0], velocity_covariance=matrix).row()
    assert code == InputResult.COVARIANCE
