"""How old each input of a service is, and which are too old: silent sensors and services are named, not averaged over.

Ages are simulated time, from the stamp of the newest sample to the stamp of the tick; a paused run ages nothing.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from surefoot.lockstep.join import DRIVER, Delayed, Input, TickInputs
from surefoot.schemas.topics import TICK_NS, Kind, Topic

LEAST_NS = 100_000_000  # ns, no input is late before this age
LOGGED = 3  # silences of one input in an epoch that are logged; all are in the health
PERIODS = 3  # an input is late when so many of its periods have passed without a sample


def limit_ns(topic: Topic[Any]) -> int:
    """Return the age beyond which an input is late, ns; 0 = it has no period, and is never late."""
    if topic.kind is Kind.LATCHED:
        return 0
    period = topic.period_ns or topic.period_ticks * TICK_NS
    return max(PERIODS * period, LEAST_NS) if period else 0


class Ages:
    """Ages of the inputs of one service.

    Args:
        inputs: as the service declares them.
        limits: ages beyond which an input is late, ns, by key; others: ``limit_ns``.
    """

    def __init__(self, inputs: Iterable[Input], limits: Mapping[str, int] | None = None) -> None:
        rows = [item.topic if isinstance(item, Delayed) else item for item in inputs]
        given = limits or {}
        self._limits = {row.key: limit for row in rows if (limit := given.get(row.key, limit_ns(row))) > 0}
        self._owners = {row.key: row.owner for row in rows}
        self.late: dict[str, float] = {}
        """Inputs that are late, and their age, s."""
        self.longest: dict[str, float] = {}
        """Greatest age of each input that was late in this epoch, s."""
        self.begin()

    def begin(self) -> None:
        """Begin an epoch: no input is late."""
        self._stamps: dict[str, int] = {}
        self._seen: set[str] = {DRIVER}
        self._times: Counter[str] = Counter()
        self.late = {}
        self.longest = {}

    def judge(self, inputs: TickInputs, absent: Iterable[str], log: Callable[[str, str], None]) -> None:
        """Take the inputs of a tick, as ``note``; log an input that becomes late, and its return, a few times."""
        late, again = self.note(inputs, absent)
        for key in late:
            self._times[key] += 1
            if self._times[key] <= LOGGED:
                log("warning", f"{key} is silent: no new sample for {self.late[key]:.2f} s")
        for key in again:
            if self._times[key] <= LOGGED:
                log("info", f"{key} comes again")

    def note(self, inputs: TickInputs, absent: Iterable[str] = ()) -> tuple[list[str], list[str]]:
        """Take the inputs of a tick; return the keys that are late since now, and those that have come again.

        Args:
            inputs: of the tick; its ``late`` is filled in.
            absent: keys that the driver does not have.
        """
        now, before, stamps, messages = inputs.tick.stamp_ns, self.late, self._stamps, inputs.messages
        self._seen.update(inputs.tick.roster)
        late: dict[str, float] = {}
        for key, limit in self._limits.items():
            stamp, message = stamps.get(key), messages.get(key)
            if message is not None and (stamp is None or message.stamp_ns > stamp):
                stamp = stamps[key] = message.stamp_ns
            if stamp is None:
                if self._owners[key] in self._seen and key not in absent:
                    stamps[key] = now  # it may take as long to come as it may later be silent
            elif now - stamp > limit:
                late[key] = (now - stamp) * 1e-9
                self.longest[key] = max(late[key], self.longest.get(key, 0.0))
        if not late and not before:
            return [], []
        self.late = late
        inputs.late.update(late)
        return [key for key in late if key not in before], [key for key in before if key not in late]
