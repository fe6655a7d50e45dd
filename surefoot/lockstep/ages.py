"""Ages of the inputs of a service, and limits on them, so that silent sensors and services are reported by key.

Age is simulated time, from the stamp of the newest sample of an input to the stamp of the tick.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from surefoot.lockstep.join import DRIVER, Delayed, Input, TickInputs
from surefoot.schemas.topics import Topic

LEAST_NS = 100_000_000  # ns, no input is late before this age
LOGGED = 3  # silences of one input in an epoch that are logged; all are in the health
_NONE: tuple[list[str], list[str]] = ([], [])
PERIODS = 3  # an input is late when so many of its periods have passed without a sample


def limit_ns(topic: Topic[Any]) -> int:
    """Return the age beyond which an input is late by default, ns; 0 = never, as the topic has no period."""
    return max(PERIODS * topic.period_ns, LEAST_NS) if topic.period_ns else 0


class Ages:
    """Record of the ages of the inputs of one service.

    Args:
        inputs: declared inputs of the service.
    """

    def __init__(self, inputs: Iterable[Input]) -> None:
        self._rows = [item.topic if isinstance(item, Delayed) else item for item in inputs]
        self.late: dict[str, float] = {}
        """Age of each input that is late now, s of simulated time, by key of its topic."""
        self.longest: dict[str, float] = {}
        """Greatest age of each input that was late in this run (epoch), s of simulated time, by key of its topic."""
        self.begin()

    def begin(self, limits: Mapping[str, int] | None = None) -> None:
        """Reset the ages for a new run (epoch): no input is late.

        Args:
            limits: age beyond which an input is late, ns, by key, 0 = never; for other keys: ``limit_ns``.
        """
        given = limits or {}
        self._limits = {row.key: limit for row in self._rows if (limit := given.get(row.key, limit_ns(row))) > 0}
        self._owners = {row.key: row.owner for row in self._rows if row.key in self._limits}
        self._stamps: dict[str, int] = {}
        self._newest: dict[str, Any] = {}
        """Last message of each key since the ages were last computed."""
        self._due_ns = -1
        """Stamp of a tick, ns, up to which no input can become late unless ``_known`` changes; ages are computed again
        after it."""
        self._known: tuple[Any, Any] = (None, None)
        self._times: Counter[str] = Counter()
        self.late = {}
        self.longest = {}

    def judge(self, inputs: TickInputs, absent: Iterable[str], log: Callable[[str, str], None]) -> None:
        """Update the ages from a tick's inputs; log the first ``LOGGED`` times that an input becomes late or returns.

        Args:
            inputs: inputs of the tick; its ``late`` is filled in: age of each late input, s, by key.
            absent: keys that the driver does not provide.
            log: called with level and text.
        """
        late, again = self.note(inputs, absent)
        for key in late:
            self._times[key] += 1
            if self._times[key] <= LOGGED:
                log("warning", f"{key} is silent: no new sample for {self.late[key]:.2f} s")
        for key in again:
            if self._times[key] <= LOGGED:
                log("info", f"{key} comes again")

    def note(self, inputs: TickInputs, absent: Iterable[str] = ()) -> tuple[list[str], list[str]]:
        """Update the ages from the inputs of a tick; return the keys that became late, and those that returned.

        Args:
            inputs: inputs of the tick; its ``late`` is filled in.
            absent: keys that the driver does not provide.
        """
        tick, newest = inputs.tick, self._newest
        if not self._limits:
            return _NONE
        newest.update(inputs.messages)
        if tick.stamp_ns <= self._due_ns and self._known == (tick.roster, absent):
            return _NONE
        now, before = tick.stamp_ns, self.late
        self._known = (tick.roster, absent)
        self._age(newest, now)
        newest.clear()
        late = {key: (now - stamp) * 1e-9 for key, stamp in self._stamps.items() if now - stamp > self._limits[key]}
        if not late:
            self._due_ns = min((now + LEAST_NS, *(stamp + self._limits[key] for key, stamp in self._stamps.items())))
            if not before:
                return _NONE
        else:
            self._due_ns = -1  # its return may come in any tick
        for key, age in late.items():
            self.longest[key] = max(age, self.longest.get(key, 0.0))
        self.late = late
        inputs.late.update(late)
        return [key for key in late if key not in before], [key for key in before if key not in late]

    def _age(self, newest: Mapping[str, Any], now: int) -> None:
        """Set the stamp, ns, of each input to that of its newest message, or to `now` if its source has just joined."""
        roster, absent = self._known
        for key, owner in self._owners.items():
            message, stamp = newest.get(key), self._stamps.get(key)
            if message is not None and (stamp is None or message.stamp_ns > stamp):
                self._stamps[key] = message.stamp_ns
            elif stamp is None and (owner == DRIVER or owner in roster) and key not in absent:
                self._stamps[key] = now
