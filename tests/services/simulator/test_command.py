"""The border for joint commands."""

import math

import numpy as np
import pytest

from services.simulator.command import STALE_NS, CommandGuard

LOWER, UPPER = np.array([-1.0, -1.0]), np.array([1.0, 1.0])


@pytest.mark.parametrize(
    ("q", "stamp", "reason"),
    [
        ([0.1], 20, "wrong_length"),
        ([math.nan, 0.0], 20, "not_finite"),
        ([math.inf, 0.0], 20, "not_finite"),
        ([0.0, 1.1], 20, "out_of_range"),
        ([0.0, 0.0], 9, "stamp_back"),
    ],
)
def test_refusals_are_named_counted_and_change_nothing(q: list[float], stamp: int, reason: str) -> None:
    guard = CommandGuard(LOWER, UPPER)
    assert guard.offer([0.5, -0.5], 10) is None
    assert guard.offer(q, stamp) == reason
    assert guard.refused == {reason: 1}
    np.testing.assert_array_equal(guard.q, [0.5, -0.5])


def test_stale_after_100_ms_and_never_before_the_first() -> None:
    guard = CommandGuard(LOWER, UPPER)
    assert not guard.stale(10 * STALE_NS)
    guard.offer([0.0, 0.0], 5)
    assert not guard.stale(5 + STALE_NS)
    assert guard.stale(6 + STALE_NS)


def test_limits_themselves_are_allowed_and_state_continues() -> None:
    guard = CommandGuard(LOWER, UPPER)
    assert guard.offer(UPPER, 1) is None
    guard.offer([9.0, 0.0], 2)
    again = CommandGuard(LOWER, UPPER)
    again.restore(guard.state())
    assert again.offer([0.0, 0.0], 0) == "stamp_back"
    assert again.refused == {"out_of_range": 1, "stamp_back": 1}
