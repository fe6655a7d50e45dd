"""Binding of each service to one process, so that messages of any other process under its name are refused."""

from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

from surefoot.bus.frame import Frame
from surefoot.bus.interface import Delivery, Life
from surefoot.bus.seal_times import SealTimes
from surefoot.errors import Refusal
from surefoot.lockstep.join import DRIVER
from surefoot.schemas.topics import HW_TICK

MOST_TRIED = 3
"""Largest number of processes that are asked in turn if several claim a service; each silent one costs about 0.2 s."""
MOST_EARLY = 64
"""Largest number of pairs of service and process whose early frames are counted; those of further pairs are not.

A frame is early if the process sent it before the service was bound to this process."""


def _ignore(service: str) -> None:
    """Do nothing; a function of the module, so that a table of bindings can be pickled."""


class _Seal(NamedTuple):
    """Seal of a process's name: the service for which it was made, and when, ms since the machine was started."""

    service: str = ""
    born_ms: int = 0


class Bindings:
    """Table of services and the one process that acts as each.

    A service is bound to the first process that has a liveliness token and also tests its links, such as by an empty
    message (prime), and stays bound while the token is there. A process whose token is lost for a while keeps its
    binding unless another process takes its place. A process whose name is sealed (the supervisor of the system started
    it) takes the place of any process without a seal and of any older one; from then on the service is bound to sealed
    processes only, so that a token which a stranger shows before a restart, or copies from an older process, counts
    for nothing.

    Args:
        born_ms: returns when a process of a service got its sealed name, 0 = its name is not sealed.
        counts: counter of refusals by reason, to which late frames are added; None = one of its own.
        look_for: called with the name of a service if a process of it that is not visible requests to join.
    """

    def __init__(
        self,
        born_ms: Callable[[str, str], int] = lambda service, instance: 0,
        counts: Counter[str] | None = None,
        look_for: Callable[[str], None] = _ignore,
    ) -> None:
        self._look_for = look_for
        self._born_ms = born_ms
        self._counts = Counter[str]() if counts is None else counts
        self._visible: dict[str, dict[str, None]] = {}
        self.bound: dict[str, str] = {}
        """Name of the process that each service is bound to, by service."""
        self._seals: dict[str, _Seal] = {}
        """Seal of the last sealed process that each service was bound to, by service."""
        self._sealed = set[tuple[str, str]]()
        """Pairs of service and process name whose frames must be sealed; only processes of the system are added."""
        self._windows: dict[tuple[str, str], SealTimes] = {}
        """Times of the seals of the newest frames by key and process."""
        self._early: Counter[tuple[str, str]] = Counter()
        self._turn: Counter[str] = Counter()
        """Index from which ``candidates`` begins at its next call, by service, if there are more than `MOST_TRIED`
        processes."""

    def on_life(self, life: Life) -> str:
        """Record that a process appeared or left; return the bound process if another appears beside it, else ""."""
        seen = self._visible.setdefault(life.service, {})
        if not life.alive:
            seen.pop(life.instance, None)
            if not seen:  # strangers may show any number of names
                del self._visible[life.service]
            return ""
        seen[life.instance] = None
        if self.bound.get(DRIVER) == life.instance:  # the token of its service may follow that of the driver
            self._note_seal(DRIVER, life.instance)
        bound = self.bound.get(life.service, "")
        return bound if bound in seen and bound != life.instance else ""

    def visible(self, service: str, instance: str) -> bool:
        """Return whether a process has a liveliness token of a service."""
        return instance in self._visible.get(service, ())

    def why_not(self, service: str, instance: str) -> str:
        """Return in words why a process cannot act as a service; empty if it may, once it has tested its links."""
        if not self.visible(service, instance):
            self._look_for(service)
            return f"no liveliness token of {service} {instance!r}"
        bound = self.bound.get(service)
        return "" if bound == instance or self._may_bind(service, instance) else f"{service} is {bound!r}, which runs"

    def candidates(self, service: str) -> tuple[str, ...]:
        """Return the processes that may answer as a service: the bound one, or those that may take its place.

        Of many it returns `MOST_TRIED`: the sealed ones that were started last, else the newest first and the next ones
        at the next call.
        """
        seen, bound = self._visible.get(service, {}), self.bound.get(service)
        newest = tuple(one for one in reversed(seen) if one != bound and self._may_bind(service, one))
        if bound is not None and (bound in seen or not newest):
            newest = (*newest, bound)
        if len(newest) <= 1:
            return newest
        sealed = sorted(
            (one for one in newest if self._seal(service, one).born_ms),
            key=lambda one: -self._seal(service, one).born_ms,
        )
        if sealed:
            return (*sealed[: MOST_TRIED - 1], *(one for one in newest if one == bound))
        if len(newest) <= MOST_TRIED:
            return newest
        first = self._turn[service] % len(newest)
        self._turn[service] = first + MOST_TRIED
        return (newest + newest)[first : first + MOST_TRIED]

    def bind(self, service: str, instance: str) -> bool:
        """Record that a process has tested its links; return whether the service is bound to this process now."""
        if self.bound.get(service) != instance:
            if not self.visible(service, instance) or not self._may_bind(service, instance):
                return False
            self.bound[service] = instance
            self._note_seal(service, instance)
        return True

    def _may_bind(self, service: str, instance: str) -> bool:
        """Return whether a visible process may take the place of the one that a service is bound to, if any."""
        bound, last = self.bound.get(service), self._seals.get(service)
        free, seal = bound is None or not self.visible(service, bound), self._seal(service, instance)
        if last is None or not seal.born_ms:
            return last is None and (free or seal.born_ms > 0)
        if seal.service != last.service:  # another service drives now
            return free
        return seal.born_ms > last.born_ms

    def _seal(self, service: str, instance: str) -> _Seal:
        """Return the seal of a visible process; the driver's name is sealed for the service that drives."""
        names = (service,)
        if service == DRIVER:
            names = tuple(name for name, seen in self._visible.items() if name != DRIVER and instance in seen)
        seals = (_Seal(name, self._born_ms(name, instance)) for name in names)
        return next((seal for seal in seals if seal.born_ms), _Seal())

    def _note_seal(self, service: str, instance: str) -> None:
        seal = self._seal(service, instance)
        if seal.born_ms:
            self._seals[service] = seal

    def opened(self, frame: Frame) -> list[Delivery]:
        """Return the messages of a frame; a late frame is counted, and its tests of links (primes) are left out.

        A late prime may belong to a run that is over, and primes are repeated anyway. Whether another late message is
        used is decided by the number of its tick.

        Raises:
            Refusal: the frame cannot be decoded, its sender is not bound, or its seal is absent or repeated.
        """
        deliveries = frame.deliveries(self.bound.get(frame.owner) == frame.instance)
        if self.check_seal(frame):
            return deliveries
        self._counts["late"] += 1
        return [one for one in deliveries if not is_prime(one)]

    def check_seal(self, frame: Frame) -> bool:
        """Return whether a frame is the newest of its key and process; False: it is late, overtaken on the way.

        Raises:
            Refusal: it has the sealed name of a visible process, but no seal (forged), or came before (replayed).
        """
        code = self.fault_of(frame)
        if code and code != "late":
            how = "one of an earlier time" if code == "replayed" else "without a seal"
            raise Refusal(code, f"frame of the {frame.owner} in the name of {frame.instance!r}, {how}")
        if (frame.owner, frame.instance) in self._sealed:
            place = frame.family, frame.instance
            window = self._windows.get(place)
            if window is None:
                window = self._windows[place] = SealTimes()
            window.add(frame.sealed_ns)
        return not code

    def fault_of(self, frame: Frame) -> str:
        """Return why a frame is not the newest that its process published, "" if nothing shows that.

        `forged`: it has no seal; `replayed`: it came before, or is too old for that to be known; `late`: a newer frame
        came first, and this one comes for the first time.
        """
        place = frame.owner, frame.instance
        if place not in self._sealed:
            if not self._seal(*place).born_ms:
                return ""
            self._sealed.add(place)
        if not frame.sealed:
            return "forged"
        window = self._windows.get((frame.family, frame.instance))
        return "" if window is None else window.fault(frame.sealed_ns)

    def note_early(self, service: str, instance: str) -> None:
        """Count a frame of a process that the service is not bound to, as it may be bound later (see ``forgive``)."""
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
