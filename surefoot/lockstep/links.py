"""Test of the links a service needs: each input has had an empty message (prime), each query an answer."""

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from surefoot.bus.interface import Bus
from surefoot.errors import CallError
from surefoot.lockstep.binding import Bindings
from surefoot.lockstep.join import DRIVER
from surefoot.lockstep.patience import TRY_S, Patience
from surefoot.schemas.hw import Tick
from surefoot.schemas.rows import Rep, Req
from surefoot.schemas.system import JoinRequest
from surefoot.schemas.topics import SIM_JOIN, Query, Topic

Row = Topic[Any] | Query[Any, Any]

JOIN_S = 0.3  # s, limit on the wait for one driver's answer


class Links:
    """Record of the links of a service that were tested, and sender of its queries.

    Args:
        bus: bus on which queries are sent.
        bindings: processes that services are bound to.
        patience: rule of the wait for answers within ticks.
    """

    def __init__(self, bus: Bus, bindings: Bindings, patience: Patience) -> None:
        self._bus, self._bindings, self._patience = bus, bindings, patience
        self._rows: tuple[Row, ...] = ()
        self._proved: set[str] = set()
        self._servers: dict[str, str] = {}
        self.unproved: tuple[str, ...] = ()
        """Keys of topics and queries whose links the last prime did not prove; empty = all links work."""

    def need(self, rows: Iterable[Row]) -> None:
        """Set the topics and queries whose links a service needs."""
        self._rows = tuple(rows)

    def note(self, key: str) -> None:
        """Record that an empty message (prime) came on a key, so that the link from its publisher works."""
        self._proved.add(key)

    def lacking(self, prime: Tick) -> set[str]:
        """Return the needed keys that the driver does not provide; its manifest lists its own (``due``, none = all)."""
        had = set(prime.due)
        return {row.key for row in self._rows if had and row.owner == DRIVER and row.key not in had}

    def prove(self, prime: Tick) -> bool:
        """Test the links to the services on the roster of a manifest; return whether all of them work."""
        present, lacking = {DRIVER, *prime.roster}, self.lacking(prime)
        rows = [r for r in self._rows if r.owner in present and r.key not in lacking]
        self.unproved = tuple(sorted(row.key for row in rows if not self._is_proved(row)))
        return not self.unproved

    def _is_proved(self, row: Row) -> bool:
        return bool(self.server(row)) if isinstance(row, Query) else row.key in self._proved

    def call(self, query: Query[Req, Rep], request: Req, timeout_s: float | None, within: Tick | None = None) -> Rep:
        """Send a request to the process that a query's owner is bound to, and return its reply (raises CallError).

        ``within``: manifest of the tick in which the service asks; None = outside ticks. In lockstep simulated time
        waits for the answer, so the request is repeated (see `patience`), if other processes run meanwhile.
        """
        if within is None:
            return self._ask(query, request, timeout_s)
        if query.owner not in (DRIVER, *within.roster):
            raise CallError("absent", f"{query.owner} is not on the roster")
        if within.mode != "lockstep" or not self._bus.apart:
            return self._ask(query, request, timeout_s)
        look = partial(self._patience.look, query.owner, within)
        return self._patience.ask(lambda: self._ask(query, request, TRY_S, look), look)

    def _ask(
        self, query: Query[Req, Rep], request: Req, timeout_s: float | None, meanwhile: Callable[[], Any] | None = None
    ) -> Rep:
        server = self.server(query)
        if not server:
            raise CallError("absent", f"no process that is {query.owner} answers {query.key!r}")
        return self._bus.call(query, request, timeout_s, instance=server, meanwhile=meanwhile)

    def join(self, request: JoinRequest) -> list[str]:
        """Request a place on the roster from each process that may be the driver; return the codes of failed calls."""
        failed: list[str] = []
        for driver in self._bindings.candidates(DRIVER):
            try:
                if self._bus.call(SIM_JOIN, request, JOIN_S, instance=driver).accepted:
                    break
            except CallError as error:
                failed.append(error.code)
        return failed

    def server(self, query: Query[Any, Any]) -> str:
        """Return the process that answers a query, "" = none: the one that the query's owner is bound to.

        Before the first request an empty query tests the process; its answer binds the owner to the process.
        """
        for instance in self._bindings.candidates(query.owner):
            known = self._servers.get(query.key) == instance
            if known or (self._bus.probe(query, instance=instance) and self._bindings.bind(query.owner, instance)):
                self._servers[query.key] = instance
                return instance
        return ""
