"""Processes that are visible on the bus by their liveliness tokens, and which of them drives."""

from surefoot.bus.interface import Life
from surefoot.lockstep.join import DRIVER


class Visible:
    """Table of the visible processes of each service; a notice costs the same however many there are.

    One thread of the bus adds notices, others read. A stranger may show thousands of tokens.
    """

    def __init__(self) -> None:
        self._alive: dict[str, dict[str, None]] = {}
        """Visible processes of each service, the first to appear first."""
        self._names: dict[str, dict[str, None]] = {}
        """Services as which each process is visible, the first to appear first."""
        self._drivers: dict[str, None] = {}
        """Processes that are visible as the driver and as a service, the first to appear as both first."""

    def note(self, life: Life) -> bool:
        """Record that a process appeared or left; return whether any process is visible as its service now."""
        service, instance = life.service, life.instance
        if life.alive:
            self._alive.setdefault(service, {})[instance] = None
            self._names.setdefault(instance, {})[service] = None
        else:
            for table, key, entry in ((self._alive, service, instance), (self._names, instance, service)):
                entries = table.get(key, {})
                entries.pop(entry, None)
                if not entries:
                    table.pop(key, None)
        names = self._names.get(instance, {})
        if DRIVER in names and len(names) > 1:  # the token of the driver alone makes no driver
            self._drivers[instance] = None
        else:
            self._drivers.pop(instance, None)
        return service in self._alive

    @property
    def services(self) -> tuple[str, ...]:
        """Names of the services that are visible, in alphabetical order, without that of the driver's second token."""
        return tuple(sorted(name for name in tuple(self._alive) if name != DRIVER))

    @property
    def driver(self) -> str:
        """Name of the service that drives the ticks, which is visible as `driver` too; empty while there is none."""
        names = tuple(self._names.get(self.instance_of(DRIVER), ()))
        return next((name for name in names if name != DRIVER), "")

    def instance_of(self, service: str) -> str:
        """Return a visible process of a service, empty if there is none: the one that drives, else the first."""
        seen = self._alive.get(service, {})
        driving = next((one for one in tuple(self._drivers) if one in seen), "")
        return driving or ("" if service == DRIVER else next(iter(tuple(seen)), ""))
