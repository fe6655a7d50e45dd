"""Detection of a driver that sends heartbeats and does no tick, although simulated time runs."""

from surefoot.schemas.status import SimStatus
from surefoot.schemas.system import Health
from surefoot.schemas.topics import TICK_NS

STILL_S = 10.0
"""Wall time without a tick, in which heartbeats came, after which a driver counts as busy without ticking, s."""
MOST_TICKS = 3.0
"""Number of ticks by which this limit is longer where simulated time is asked to run slower than real time."""


class Still:
    """Record of the heartbeats of the driver, from which the time without a tick is known.

    Time is measured between heartbeats, so a long tick or reset, in which no heartbeat comes, does not count. Neither
    does a pause, a run that has ended, or one that waits for services and reports which.
    """

    def __init__(self) -> None:
        self._at: tuple[str, int, int] | None = None  # process, run and tick of the last heartbeat, None: no time runs
        self._since = self._last = 0.0

    def beat(self, health: Health, now: float) -> None:
        """Record a heartbeat of the driver at time `now` of the monotonic clock, s."""
        at = (health.instance, health.epoch, health.tick) if health.state == "running" else None
        if at is None or at != self._at:
            self._at, self._since = at, now
        self._last = now

    def words(self, status: SimStatus | None) -> str:
        """Return in words for how long the driver has done no tick; empty while it is within the limit.

        Args:
            status: last state of simulated time, which reports services that it waits for; None = unknown.
        """
        if self._at is None or (status is not None and status.state in ("joining", "holding", "paused")):
            return ""
        slow_s = MOST_TICKS * 1e-9 * TICK_NS / status.pace if status is not None and status.pace > 0.0 else 0.0
        still_s = self._last - self._since
        return f"busy, but no tick for {still_s:.0f} s" if still_s > max(STILL_S, slow_s) else ""
