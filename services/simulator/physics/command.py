"""Checks of joint commands before they reach the servos."""

import math
from collections.abc import Sequence
from operator import le

from surefoot.arrays import Array

COMMAND_SLACK = 1e-6  # rad, rounding of a command at the limit


class CommandGuard:
    """Check of joint commands against the joint limits `lower` and `upper`, (nj,) rad, widened by a small slack."""

    def __init__(self, lower: Array, upper: Array) -> None:
        self._lower: list[float] = (lower - COMMAND_SLACK).tolist()  # plain floats: quicker than numpy for a few joints
        self._upper: list[float] = (upper + COMMAND_SLACK).tolist()

    def refusal(self, q: Sequence[float]) -> str | None:
        """Return the reason against joint positions `q`, rad, in the robot's order; None: they are allowed.

        The reasons are `wrong_length`, `not_finite` and `out_of_range`. The result does not depend on earlier commands:
        the runtime orders commands by their ticks.
        """
        if len(q) != len(self._lower):
            return "wrong_length"
        if not (all(map(le, self._lower, q)) and all(map(le, q, self._upper))):
            return "out_of_range" if all(map(math.isfinite, q)) else "not_finite"
        return None
