"""Share that is done and time left of work that takes long."""

import time
from collections.abc import Callable

from .output import notify

FIRST_S, EACH_S = 1.0, 10.0
"""Wall time before the first line, and between further lines."""


class Progress:
    """Reports on work that states its share.

    Args:
        what: is done, for the line.
        report: gets the lines.
        clock: s.
    """

    def __init__(
        self, what: str, report: Callable[[str], None] = notify, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._what, self._report, self._clock = what, report, clock
        self._began = clock()
        self._next = self._began + FIRST_S

    def at(self, share: float) -> None:
        """Note the share that is done, 0 to 1; a line is written when it is time for one."""
        now = self._clock()
        if now < self._next or not 0.0 < share < 1.0:
            return
        self._next = now + EACH_S
        left = (now - self._began) * (1.0 / share - 1.0)
        self._report(f"{self._what}: {100.0 * share:.0f} %, about {left:.0f} s left")
