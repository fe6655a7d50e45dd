"""The border for joint commands."""

import math

import numpy as np
import pytest

from surefoot.services.simulator.physics.command import CommandGuard

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
def test_refusals_are_named_and_change_nothing(q: list[float], stamp: int, reason: str) -> None:
    guard = CommandGuard(LOWER, UPPER)
    assert guard.offer([0.5, -0.5], 10) is None
    assert guard.offer(q, stamp) == reason
    assert guard.offer([0.5, -0.5], 10) is None


def test_limits_themselves_are_allowed_and_a_new_epoch_counts_anew() -> None:
    guard = CommandGuard(LOWER, UPPER)
    assert guard.offer(UPPER.tolist(), 5) is None
    assert guard.offer([0.0, 0.0], 0) == "stamp_back"
    guard.clear()
    assert guard.offer([0.0, 0.0], 0) is None
