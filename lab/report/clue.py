"""Clues that finders of evidence return: their kinds, and which of these are causes."""

from dataclasses import dataclass

ROOTS = (
    "service", "stop", "command", "late", "imu", "joints", "contacts", "encoder", "servo", "switch", "push", "stale",
    "camera", "ranger", "cone", "friction", "support",
)  # fmt: skip
"""Values of `Clue.code` that are causes of a failure, in order of precedence; all other codes are consequences."""
OF_GOALS = ("camera", "ranger")
"""Causes that only a missed goal can have: of all services, only those that localise and plan read these sensors."""


@dataclass(frozen=True)
class Clue:
    """Evidence of a fault or of its consequences in a recording.

    Attributes:
        code: kind, one of `ROOTS` or a consequence.
        begin, end: when, s of simulated time.
        text: what was seen, with numbers.
    """

    code: str
    begin: float
    end: float
    text: str
