"""Checks of joint commands before they reach the servos."""

import math
from collections.abc import Sequence
from operator import le

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

COMMAND_SLACK = 1e-6  # rad, rounding of a command at the limit


class CommandGuard:
    """Refuses commands that the servos must not follow, with the reason."""

    def __init__(self, lower: Array, upper: Array) -> None:
        self._lower: list[float] = (lower - COMMAND_SLACK).tolist()  # plain floats: quicker than numpy for a few joints
        self._upper: list[float] = (upper + COMMAND_SLACK).tolist()
        self.clear()

    def clear(self) -> None:
        """Begin an epoch: stamps begin anew."""
        self._stamp_ns = -1

    def offer(self, q: Sequence[float], stamp_ns: int) -> str | None:
        """Take a command, or return the reason against it.

        Args:
            q: joint positions in the robot's order, rad.
            stamp_ns: simulated time the command is for.

        Returns:
            None when taken; else `wrong_length`, `not_finite`, `out_of_range` or `stamp_back`.
        """
        if len(q) != len(self._lower):
            return "wrong_length"
        if not (all(map(le, self._lower, q)) and all(map(le, q, self._upper))):
            return "out_of_range" if all(map(math.isfinite, q)) else "not_finite"
        if stamp_ns < self._stamp_ns:
            return "stamp_back"
        self._stamp_ns = stamp_ns
        return None
