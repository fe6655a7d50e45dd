"""The bus inside one process: same interface, no encoding, deterministic. For tests, replay and studies over seeds."""

import uuid
from collections.abc import Callable, Iterable
from typing import Any, Generic

from surefoot.bus.interface import Delivery, Incoming, Life, two_owners
from surefoot.errors import CallError, SurefootError
from surefoot.schemas.base import Request, Wire
from surefoot.schemas.rows import M, Rep, Req
from surefoot.schemas.topics import HEALTH_GET, Query, Topic


class MemoryPublisher(Generic[M]):
    """Publisher of one key on the in-memory bus: hands each message to the sinks of its key."""

    watched = False

    def __init__(
        self, topic: Topic[M], sinks: Callable[[str], list[Callable[[Delivery], Any]]], sender: str = ""
    ) -> None:
        self.topic = topic
        self._sinks = sinks
        self._sender = sender

    def put(self, message: M) -> M:
        sinks = self._sinks(self.topic.key)
        if sinks:
            delivery = Delivery(self.topic, message, None, None, self._sender)
            for sink in sinks:
                sink(delivery)
        return message

    def resend(self, token: M) -> None:
        self.put(token)

    def prime(self) -> None:
        for sink in self._sinks(self.topic.key):
            sink(Delivery(self.topic, None, None, None, self._sender))


class MemoryIncoming:
    """Received query on the in-memory bus, whose client waits in the same thread."""

    def __init__(self, query: Query[Any, Any], request: Request | None, *, participant: bool = False) -> None:
        self.query, self.participant = query, participant
        self.probe = request is None
        self._request = request
        self.answer: Wire | None = None
        self.error: SurefootError | None = None

    def request(self) -> Request:
        assert self._request is not None
        return self._request

    def reply(self, reply: Wire) -> None:
        self.answer = reply

    def fail(self, error: SurefootError) -> None:
        self.error = error

    def accept_probe(self) -> None:
        return


class MemoryBus:
    """Topics and queries of one robot inside one process.

    For each query a function (``pump_with``) lets its server handle its inbox; ``call`` calls this function until the
    answer is there. Because the call graph is acyclic, no server is run while it is in a call itself.
    """

    apart = False

    def __init__(self) -> None:
        self._sinks: dict[str, list[Callable[[Delivery], Any]]] = {}
        self._families: list[tuple[str, Callable[[Delivery], Any]]] = []
        self._servers: dict[str, dict[str, tuple[Callable[[Incoming], Any], Callable[[Incoming], Any]]]] = {}
        """Functions that receive queries, by key and process: first the one for those of any client, then for those of
        participants."""
        self._owners: dict[str, str] = {}
        self._pumps: dict[str, Callable[[], bool]] = {}
        self._routes: dict[str, list[Callable[[Delivery], Any]]] = {}
        self._watchers: list[Callable[[Life], Any]] = []
        self._alive: list[Life] = []
        self._starting: list[tuple[str, str]] = []

    def publisher(self, topic: Topic[M], instance: str = "") -> MemoryPublisher[M]:
        return MemoryPublisher(topic, self._route, instance)

    def _route(self, key: str) -> list[Callable[[Delivery], Any]]:
        route = self._routes.get(key)
        if route is None:
            route = self._sinks.get(key, []) + [sink for prefix, sink in self._families if key.startswith(prefix)]
            self._routes[key] = route
        return route

    def subscribe(self, topic: Topic[Any], sink: Callable[[Delivery], Any], *, bounded: bool = False) -> None:
        self._routes.clear()
        if topic.key.endswith("/*"):
            self._families.append((topic.key[:-1], sink))
        else:
            self._sinks.setdefault(topic.key, []).append(sink)

    def take(self, topics: Iterable[Topic[Any]], sink: Callable[[Delivery], Any], *, batched: bool = False) -> None:
        for topic in topics:
            self.subscribe(topic, sink)

    def cork(self) -> None:
        return  # a call costs the same for one message as for a frame of them

    def flush(self, *, batch: bool = True) -> None:
        return

    def serve(
        self,
        query: Query[Any, Any],
        sink: Callable[[Incoming], Any],
        participants: Callable[[Incoming], Any] | None = None,
        instance: str = "",
    ) -> None:
        self._servers.setdefault(query.key, {})[instance] = (sink, participants or sink)

    def pump_with(self, query: Query[Any, Any], pump: Callable[[], bool]) -> None:
        """Set the function that lets the server of ``query`` handle its inbox; it returns whether it did anything."""
        self._pumps[query.key] = pump

    def call(
        self,
        query: Query[Req, Rep],
        request: Req,
        timeout_s: float | None = None,
        *,
        instance: str = "",
        meanwhile: Callable[[], Any] | None = None,
    ) -> Rep:
        server = self._servers.get(query.key, {}).get(instance or self._owner(query))
        if server is None:
            raise CallError("absent", f"no service answers {query.key!r}")
        incoming = MemoryIncoming(query, request, participant=bool(instance))
        server[1 if instance else 0](incoming)
        pump = self._pumps.get(query.key)
        while incoming.answer is None and incoming.error is None:
            if pump is None or not pump():
                raise CallError("timeout", f"{query.key!r} did not answer")
        if incoming.error is not None:
            error = incoming.error
            raise CallError(error.code, error.message, error.field)
        answer = incoming.answer
        assert isinstance(answer, query.reply)
        return answer

    def probe(self, query: Query[Any, Any], *, instance: str = "") -> bool:
        try:
            return (instance or self._owner(query)) in self._servers.get(query.key, {})
        except CallError:
            return False

    def _owner(self, query: Query[Any, Any]) -> str:
        """Return the process that shows the token of a query's owner and serves the query; empty = there is none."""
        servers = self._servers.get(query.key, {})
        shown = [life.instance for life in self._alive if life.service == query.owner and life.instance in servers]
        if self._owners.get(query.owner) in shown:
            return self._owners[query.owner]
        if len(shown) > 1:
            raise two_owners(query, shown)
        if shown:
            self._owners[query.owner] = shown[0]
        elif query.key.startswith(HEALTH_GET.key[:-1]):  # all that a service answers while it starts
            shown = [by for service, by in self._starting if service == query.owner and by in servers]
        return next(iter(shown), "")

    def new_instance(self) -> str:
        return uuid.uuid4().hex[:12]

    def born_ms(self, service: str, instance: str) -> int:
        return 0

    def look_at_links(self) -> list[Any]:
        return []

    def announce(self, service: str, instance: str, *, ready: bool = True) -> None:
        if not ready:
            self._starting.append((service, instance))
            return
        life = Life(service, instance, True)
        self._alive.append(life)
        for watcher in self._watchers:
            watcher(life)

    def depart(self, service: str) -> None:
        """Report that the process of a service has left, as if it had ended; for tests of faults."""
        for life in [life for life in self._alive if life.service == service]:
            self._alive.remove(life)
            for watcher in self._watchers:
                watcher(Life(life.service, life.instance, False))

    def watch(self, sink: Callable[[Life], Any], services: Iterable[str] | None = None) -> None:
        self._watchers.append(sink)
        for life in self._alive:
            sink(life)

    def add_watched(self, service: str) -> None:
        return  # all are watched

    def close(self) -> None:
        self._sinks.clear()
        self._servers.clear()
        self._routes.clear()
