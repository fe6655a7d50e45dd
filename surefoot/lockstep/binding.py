"""Binding of each service to one process, so that messages of any other process under its name are refused."""

from collections import Counter

from surefoot.bus.interface import Delivery, Life
from surefoot.errors import Refusal
from surefoot.schemas.topics import HW_TICK

MOST_TRIED = 3
"""Processes that are asked in turn if they act as a service: one that does not answer takes a fifth of a second."""
MOST_EARLY = 64
"""Processes whose early frames are counted apart; a flood under many names is not."""


class Bindings:
    """Table of services and the one process that acts as each.

    A service is bound to the first process that has a liveliness token and also tests its links, such as by an empty
    message (prime), and stays bound while the token is there. A process whose token is lost for a while keeps its
    binding unless another process takes its place.
    """

    def __init__(self) -> None:
        self._visible: dict[str, dict[str, None]] = {}
        self.bound: dict[str, str] = {}
        """Process of each service that has proved its links."""
        self._early: Counter[tuple[str, str]] = Counter()
        self._turn: Counter[str] = Counter()
        """Number of the first candidate of each service that is returned next."""

    def on_life(self, life: Life) -> str:
        """Record that a process appeared or left; return the bound process if another appears beside it, else ""."""
        seen = self._visible.setdefault(life.service, {})
        if not life.alive:
            seen.pop(life.instance, None)
            return ""
        seen[life.instance] = None
        bound = self.bound.get(life.service, "")
        return bound if bound in seen and bound != life.instance else ""

    def visible(self, service: str, instance: str) -> bool:
        """Return whether a process has a liveliness token of a service."""
        return instance in self._visible.get(service, ())

    def candidates(self, service: str) -> tuple[str, ...]:
        """Return the processes that may answer as a service: the bound one, or those that may take its place.

        Of many it returns `MOST_TRIED`, the newest first, and the next ones at the next call.
        """
        seen, bound = self._visible.get(service, {}), self.bound.get(service)
        if bound is not None and (bound in seen or not seen):
            return (bound,)
        newest = tuple(reversed(seen))
        if len(newest) <= MOST_TRIED:
            return newest
        first = self._turn[service] % len(newest)
        self._turn[service] = first + MOST_TRIED
        return (newest + newest)[first : first + MOST_TRIED]

    def bind(self, service: str, instance: str) -> bool:
        """Record that a process has tested its links; return whether the service is bound to this process now."""
        bound = self.bound.get(service)
        if bound != instance:
            if not self.visible(service, instance) or (bound is not None and self.visible(service, bound)):
                return False
            self.bound[service] = instance
        return True

    def note_early(self, service: str, instance: str) -> None:
        """Count a frame of a process that the service is not bound to, or not yet."""
        if (service, instance) in self._early or len(self._early) < MOST_EARLY:
            self._early[service, instance] += 1

    def forgive(self, service: str, instance: str) -> int:
        """Return how many frames a process sent before the service was bound to it, and reset the count."""
        return self._early.pop((service, instance), 0)


def is_prime(last: Delivery) -> bool:
    """Return whether a frame whose last message is `last` is a test of links (prime): empty, or a tick before 0."""
    try:
        return last.prime or (last.key == HW_TICK.key and last.header().tick < 0)
    except Refusal:
        return False
