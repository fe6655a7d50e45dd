"""The links a service needs: inputs that their publishers have primed, queries that their owners answer."""

from collections.abc import Iterable
from typing import Any

from surefoot.bus.interface import Bus
from surefoot.lockstep.join import DRIVER
from surefoot.schemas.hw import Tick
from surefoot.schemas.topics import Query, Topic

Row = Topic[Any] | Query[Any, Any]


class Links:
    """Links that a service has proved."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._rows: tuple[Row, ...] = ()
        self._proved: set[str] = set()
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
        rows = [r for r in self._rows if r.owner in present and r.key not in lacking and r.key not in self._proved]
        self._proved |= {row.key for row in rows if isinstance(row, Query) and self._bus.probe(row, participant=True)}
        self.unproved = tuple(sorted(row.key for row in rows if row.key not in self._proved))
        return not self.unproved
