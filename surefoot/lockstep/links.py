"""The links a service needs: inputs that their publishers have primed, queries that their owners answer."""

from collections.abc import Iterable
from typing import Any

from surefoot.bus.interface import Bus
from surefoot.lockstep.binding import Bindings
from surefoot.lockstep.join import DRIVER
from surefoot.schemas.hw import Tick
from surefoot.schemas.topics import Query, Topic

Row = Topic[Any] | Query[Any, Any]


class Links:
    """Links that a service has proved."""

    def __init__(self, bus: Bus, bindings: Bindings) -> None:
        self._bus, self._bindings = bus, bindings
        self._rows: tuple[Row, ...] = ()
        self._proved: set[str] = set()
        self._servers: dict[str, str] = {}
        self.unproved: tuple[str, ...] = ()
        """Keys that the last prime left unproved."""

    def need(self, rows: Iterable[Row]) -> None:
        """Set the topics and queries that a service needs."""
        self._rows = tuple(rows)

    def note(self, key: str) -> None:
        """Note that a key was primed."""
        self._proved.add(key)

    def lacking(self, prime: Tick) -> set[str]:
        """Return the keys that the driver does not have (its ``due`` names those it has; none named: all)."""
        had = set(prime.due)
        return {row.key for row in self._rows if had and row.owner == DRIVER and row.key not in had}

    def prove(self, prime: Tick) -> bool:
        """Probe what is not proved yet of the services of a roster; return whether every link is proved."""
        present, lacking = {DRIVER, *prime.roster}, self.lacking(prime)
        rows = [r for r in self._rows if r.owner in present and r.key not in lacking]
        self.unproved = tuple(sorted(row.key for row in rows if not self._is_proved(row)))
        return not self.unproved

    def _is_proved(self, row: Row) -> bool:
        return bool(self.server(row)) if isinstance(row, Query) else row.key in self._proved

    def server(self, query: Query[Any, Any]) -> str:
        """Return the process that answers a query: the one its service is bound to, which binds it; "" = there is none.

        A process that is asked for the first time is probed first.
        """
        for instance in self._bindings.candidates(query.owner):
            known = self._servers.get(query.key) == instance
            if known or (self._bus.probe(query, instance=instance) and self._bindings.bind(query.owner, instance)):
                self._servers[query.key] = instance
                return instance
        return ""
