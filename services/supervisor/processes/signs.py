"""Signs of life of a service: its start, its heartbeats, its ticks, its liveliness token. Pure: times are arguments.

Silence is counted in time in which the process could have spoken: what it waited for a processor is not silence.
"""

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Signs:
    """What is known of one process. Times are wall seconds of one monotonic clock.

    Attributes:
        since: when the process was started.
        progress: its last sign that it gets on: start, heartbeat of any state, tick.
        starved: seconds it had waited for a processor until `progress`.
        well: a heartbeat said that it is ready for work, or a tick did.
        hidden: when its liveliness token was lost, None while it is visible.
    """

    since: float
    progress: float
    starved: float = 0.0
    well: bool = False
    hidden: float | None = None

    def heard(self, now: float, starved: float, *, well: bool) -> "Signs":
        """Return the signs after a heartbeat or a tick."""
        return replace(self, progress=now, starved=starved, well=self.well or well)

    def seen(self, now: float, *, visible: bool) -> "Signs":
        """Return the signs after the liveliness token appeared or vanished."""
        return replace(self, hidden=None if visible else now)

    def silence(self, now: float, starved: float) -> float:
        """Return the seconds since the last sign of progress in which the process could have given another."""
        return max(0.0, now - self.progress - max(0.0, starved - self.starved))

    def words(self, now: float) -> str:
        """Return what is lost, heartbeat and liveliness apart."""
        lost = f"no heartbeat for {now - self.progress:.1f} s"
        return lost if self.hidden is None else f"{lost}, {self.token(now)}"

    def token(self, now: float) -> str:
        """Return the loss of liveliness in words, empty while the process is visible."""
        return "" if self.hidden is None else f"not visible on the bus for {now - self.hidden:.1f} s"


def starved_s(pid: int) -> float:
    """Return the seconds a process's main thread has waited for a processor; 0 where the kernel does not count."""
    try:
        with open(f"/proc/{pid}/schedstat", encoding="ascii") as stat:
            return int(stat.read().split()[1]) * 1e-9
    except (OSError, ValueError, IndexError):
        return 0.0
