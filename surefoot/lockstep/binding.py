"""Bindings of services to processes: frames of any other process are refused."""

from collections import Counter

from surefoot.bus.interface import Delivery, Life
from surefoot.errors import Refusal
from surefoot.schemas.topics import HW_TICK

MOST_EARLY = 64
"""Processes whose early frames are counted apart; a flood under many names is not."""


class Bindings:
    """Owners of frames and the processes they are bound to.

    A service is bound to the first visible process that proves its links (its prime), and stays bound to it while that
    process is visible; a process that is out of sight for a while is the same one when it returns. A liveliness token
    alone binds nothing, and a frame alone neither.
    """

    def __init__(self) -> None:
        self._visible: dict[str, dict[str, None]] = {}
        self.bound: dict[str, str] = {}
        """Process of each service that has proved its links."""
        self._early: Counter[tuple[str, str]] = Counter()

    def on_life(self, life: Life) -> str:
        """Note that a process appeared or went out of sight; return the bound one where another appears beside it."""
        seen = self._visible.setdefault(life.service, {})
        if not life.alive:
            seen.pop(life.instance, None)
            return ""
        seen[life.instance] = None
        bound = self.bound.get(life.service, "")
        return bound if bound in seen and bound != life.instance else ""

    def visible(self, service: str, instance: str) -> bool:
        """Return whether a process shows a liveliness token of a service."""
        return instance in self._visible.get(service, ())

    def candidates(self, service: str) -> tuple[str, ...]:
        """Return the processes that may answer for a service: the bound one, or those that may take its place."""
        seen, bound = self._visible.get(service, {}), self.bound.get(service)
        return (bound,) if bound is not None and (bound in seen or not seen) else tuple(seen)

    def bind(self, service: str, instance: str) -> bool:
        """Note that a process proves its links; return whether the service is bound to it now."""
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
        """Return how many frames a process sent before the service was bound to it; they count no more."""
        return self._early.pop((service, instance), 0)


def is_prime(last: Delivery) -> bool:
    """Return whether a frame that ends with a message proves its publisher's links."""
    try:
        return last.prime or (last.key == HW_TICK.key and last.header().tick < 0)
    except Refusal:
        return False
