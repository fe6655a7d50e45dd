"""The border for joint commands."""

import math

import numpy as np
import pytest

from surefoot.services.simulator.physics.command import CommandGuard

LOWER, UPPER = np.array([-1.0, -1.0]), np.array([1.0, 1.0])


@pytest.mark.parametrize(
    ("q", "reason"),
    [
        ([0.1], "wrong_length"),
        ([math.nan, 0.0], "not_finite"),
        ([math.inf, 0.0], "not_finite"),
        ([0.0, 1.1], "out_of_range"),
        ([-1.1, 0.0], "out_of_range"),
        (UPPER.tolist(), None),
        (LOWER.tolist(), None),
    ],
)
def test_refusals_are_named(q: list[float], reason: str | None) -> None:
    assert CommandGuard(LOWER, UPPER).refusal(q) == reason
