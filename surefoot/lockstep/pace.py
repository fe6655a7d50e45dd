"""Pace of simulated time: when the next tick is due on the wall clock, and how delays are handled."""

import time
from collections.abc import Callable

from surefoot.schemas.topics import TICK_S

SLACK_S = 0.1  # s wall, a delay up to this is caught up; a longer one is given up, so that time never races


class Pace:
    """Due times of ticks at a real-time factor.

    After a start at tick k0 and wall time t0, tick k is due at ``t0 + (k - k0) * TICK_S / factor``. If it is more than
    ``SLACK_S`` overdue, t0 moves by the delay, so that such a delay is not caught up.

    Args:
        clock: returns monotonic wall time, s.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self.factor = 0.0
        """Requested ratio of simulated to wall time; 0 = as fast as possible."""
        self.given_up_s = 0.0
        """Total delay since ``begin`` that is not caught up, s of wall time, by which the due times were moved."""
        self._origin = (clock(), 0)
        self._reported_s = 0.0

    def begin(self, factor: float, tick: int = 0) -> None:
        """Start at a real-time factor (0 = as fast as possible): ``tick`` is due now."""
        self.factor = factor
        self.given_up_s = self._reported_s = 0.0
        self._origin = (self._clock(), tick)

    def resume(self, tick: int) -> None:
        """Continue after a pause: ``tick`` is due now, and the pause does not count as a delay."""
        self._origin = (self._clock(), tick)

    def until_due(self, tick: int) -> float:
        """Return the wall time until a tick is due, s; 0 or less: it is due."""
        if self.factor <= 0.0:
            return 0.0
        began, first = self._origin
        wait = began + (tick - first) * TICK_S / self.factor - self._clock()
        if wait < -SLACK_S:
            self.given_up_s -= wait
            self._origin = (began - wait, first)
            return 0.0
        return wait

    def late(self) -> bool:
        """Return True if a tick has been more than `SLACK_S` = 0.1 s of wall time overdue since the last call."""
        before, self._reported_s = self._reported_s, self.given_up_s
        return self.given_up_s > before
