"""Checks of joint commands before they reach the servos."""

import math
from collections.abc import Sequence
from operator import le

from surefoot.arrays import Array

COMMAND_SLACK = 1e-6  # rad, rounding of a command at the limit


class CommandGuard:
    """Refuses commands that the servos must not follow, with the reason."""

    def __init__(self, lower: Array, upper: Array) -> None:
        self._lower: list[float] = (lower - COMMAND_SLACK).tolist()  # plain floats: quicker than numpy for a few joints
        self._upper: list[float] = (upper + COMMAND_SLACK).tolist()

    def refusal(self, q: Sequence[float]) -> str | None:
        """Return the reason against joint positions in the robot's order, rad; None: there is none.

        It does not depend on commands before: the runtime orders them by their tick, and one that was lost on the way
        comes after later ones.

        Returns:
            `wrong_length`, `not_finite` or `out_of_range`.
        """
        if len(q) != len(self._lower):
            return "wrong_length"
        if not (all(map(le, self._lower, q)) and all(map(le, q, self._upper))):
            return "out_of_range" if all(map(math.isfinite, q)) else "not_finite"
        return None
