"""The public client of a running system: it reads topics and sends queries.

import surefoot

with surefoot.connect() as robot:
    print(robot.latest("state/velocity").velocity)
    corners = ((0.1, 0.1), (0.1, -0.1), (-0.1, 0.0))
    feet = [{"position": [x, y, 0.0], "normal": [0.0, 0.0, 1.0], "mu": 0.5} for x, y in corners]
    print(robot.call("stability/region", contacts=feet).inner)
"""

from collections import Counter
from collections.abc import Callable, Iterator
from queue import Empty, SimpleQueue
from typing import Any, Self, cast

from surefoot.bus.codec import refusal_of
from surefoot.bus.elsewhere import others_running
from surefoot.bus.endpoint import checked, to_connect
from surefoot.bus.interface import Delivery
from surefoot.bus.knock import nothing_listens
from surefoot.bus.options import why_not_open
from surefoot.bus.zenoh import ZenohBus, client_options
from surefoot.client_arguments import key_part, wait_s
from surefoot.errors import BusError, CallError, FieldError, Refusal, SurefootError, shown
from surefoot.nearest import did_you_mean
from surefoot.schemas.base import Wire
from surefoot.schemas.rows import M
from surefoot.schemas.topics import QUERIES, SIM_STATUS_GET, TOPICS, Query, Topic
from surefoot.simtime import standing_still


def topic_named(key: str) -> Topic[Any]:
    """Return the row of the topic table for a key (raises SurefootError that names similar keys)."""
    for topic in TOPICS:
        if topic.key == key or (topic.key.endswith("/*") and key.startswith(topic.key[:-1]) and key != topic.key):
            return topic if topic.key == key else topic.of(key[len(topic.key) - 1 :])
    known = _known(key, [t.key for t in TOPICS], [q.key for q in QUERIES], "a query: `surefoot call")
    raise SurefootError("unknown_topic", f"no topic {key!r}{known}")


def query_named(key: str) -> Query[Any, Any]:
    """Return the row of the query table for a key (raises SurefootError that names similar keys)."""
    for query in QUERIES:
        if query.key == key or (query.key.endswith("/*") and key.startswith(query.key[:-1]) and key != query.key):
            return query if query.key == key else query.of(key[len(query.key) - 1 :])
    known = _known(key, [q.key for q in QUERIES], [t.key for t in TOPICS], "a topic: `surefoot topic echo")
    raise SurefootError("unknown_query", f"no query {key!r}{known}")


def _topic(topic: Topic[M] | str) -> Topic[M]:
    """Return the row of a topic given as row or key (raises SurefootError)."""
    if isinstance(topic, str):
        return topic_named(topic)
    if not isinstance(topic, Topic):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise FieldError("type", "topic", f"got {shown(topic)}, expected a key such as 'state/velocity', or its row")
    return topic


def _query(query: Query[Any, Any] | str) -> Query[Any, Any]:
    """Return the row of a query given as row or key (raises SurefootError)."""
    if isinstance(query, str):
        return query_named(query)
    if not isinstance(query, Query):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise FieldError("type", "query", f"got {shown(query)}, expected a key such as 'stability/check', or its row")
    return query


def _known(key: str, keys: list[str], others: list[str], other: str) -> str:
    """Return a hint on an unknown key: the kind of row it belongs to, else the nearest keys, or all if none is near."""
    if key in others:
        return f"; it is {other} {key}`"
    return did_you_mean(key, keys) or f"; known are {', '.join(keys)}"


class Client:
    """Connection of a tool to one robot: it reads any topic and sends any query; no service ever waits for it."""

    def __init__(self, bus: ZenohBus) -> None:
        self.bus = bus
        self._closed = False
        self.waiting: set[Callable[[], None]] = set()
        """Functions, called by `close`, that end the waits for messages."""
        self.refused: Counter[str] = Counter()
        """Number of messages left out because they were not valid for their topic, by key."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection to the system; running subscriptions end, and so do waits for messages."""
        self._closed = True
        for end in tuple(self.waiting):
            end()
        self.bus.close()

    def call(self, query: Query[Any, Any] | str, timeout_s: float | None = None, **fields: Any) -> Any:
        """Send a request and return its reply.

        Args:
            query: key, such as `stability/check`, or its row of the table.
            timeout_s: longest wait, s of wall time; None = that of the query.
            fields: fields of the request.

        Raises:
            SurefootError: no such query, a field the request does not have, or an invalid wait.
            CallError: `absent` (no service answers), `timeout`, or the service's refusal.
            BusError: the client is closed.
        """
        row, limit = _query(query), wait_s(timeout_s, "that of the query")
        request = make_request(row, fields)
        self._open()
        try:
            return self.bus.call(row, request, limit)
        except CallError as error:
            if error.code != "absent":
                raise
            raise CallError("absent", f"{error.message}{self._others()}", error.field) from None

    def _others(self) -> str:
        """Return a text on which systems run at the router if no service of this client's system does; else empty."""
        return others_running(self.bus.session, self.bus.endpoint)

    def _open(self) -> None:
        """Refuse the use of a closed client (raises BusError)."""
        if self._closed:
            raise BusError(
                "closed", "client: got a closed one, allowed is an open one; surefoot.connect() opens another"
            )

    def subscribe(self, topic: Topic[M] | str, sink: Callable[[M], None]) -> Callable[[], None]:
        """Call `sink` with each message of a topic, on another thread; return a function that ends this.

        Raises:
            SurefootError: no such topic, or a sink that cannot be called.
            BusError: the client is closed.
        """
        row = _topic(topic)
        if not callable(sink):
            raise FieldError("type", "sink", f"got {shown(sink)}, expected a function that takes a message")
        self._open()

        def take(delivery: Delivery) -> None:
            if delivery.prime:
                return
            try:
                message = delivery.message()
            except Refusal:
                self.refused[row.key] += 1
                return
            sink(cast("M", message))

        return self.bus.listen(row, take)

    def messages(self, topic: Topic[M] | str, timeout_s: float | None = 5.0) -> Iterator[M]:
        """Return an iterator over the messages of a topic (row or key) as they come.

        Args:
            topic: key, such as `state/velocity`, or its row of the table.
            timeout_s: the iterator ends when no message comes for so long, s of wall time; None = never.

        Raises:
            SurefootError: no such topic, or an invalid wait.
            BusError: the client is closed.
        """
        row, limit = _topic(topic), wait_s(timeout_s, "no end")
        self._open()
        return self._messages(row, limit)

    def _messages(self, topic: Topic[M], timeout_s: float | None) -> Iterator[M]:
        queue: SimpleQueue[M | None] = SimpleQueue()

        def close() -> None:
            queue.put(None)

        end = self.subscribe(topic, queue.put)
        self.waiting.add(close)
        try:
            while not self._closed and (message := queue.get(timeout=timeout_s)) is not None:
                yield message
        except Empty:
            return
        finally:
            self.waiting.discard(close)
            end()

    def latest(self, topic: Topic[M] | str, timeout_s: float | None = 5.0) -> M:
        """Return the next message of a topic.

        Args:
            topic: key, such as `state/velocity`, or its row of the table.
            timeout_s: longest wait, s of wall time; None = no end.

        Raises:
            SurefootError: no such topic, or an invalid wait.
            CallError: no message comes in time; the text names the reason if time is paused.
            BusError: the client is closed, before or while it waits.
        """
        topic = _topic(topic)
        for message in self.messages(topic, timeout_s):
            return message
        self._open()
        why = self.standing_still()
        reason = f": {why}" if why else self._others()
        raise CallError("timeout", f"no message on {topic.key!r} within {timeout_s:g} s{reason}")

    def standing_still(self) -> str:
        """Return a text on why simulated time stands still; empty while it runs, or when no simulator answers."""
        try:
            return standing_still(self.bus.call(SIM_STATUS_GET, SIM_STATUS_GET.request(), 1.0))
        except CallError:
            return ""


def make_request(query: Query[Any, Any], fields: dict[str, Any]) -> Wire:
    """Return the validated request of a query (raises SurefootError naming the field)."""
    from pydantic import ValidationError

    try:
        return query.request.model_validate(fields)
    except ValidationError as error:
        raise refusal_of(error, query.key) from None


def connect(robot: str = "ragno", endpoint: str | None = None, fleet: str = "surefoot") -> Client:
    """Join the network as a client.

    Args:
        robot: second part of the keys' prefix.
        endpoint: that of the router; None = SUREFOOT_CONNECT, else SUREFOOT_LISTEN, else ``tcp/127.0.0.1:7447``.
        fleet: first part of the keys' prefix.

    Raises:
        FieldError: `robot` or `fleet` is no name that keys can hold; the name of a robot that does not run is one.
        BusError: no router answers: after 1.5 s where all connections are refused, after 8 s where nothing answers.
        ConfigError: the value given is no endpoint, or SUREFOOT_SECRET is no secret.
    """
    prefix = f"{key_part(fleet, 'fleet', 'surefoot')}/{key_part(robot, 'robot', 'ragno')}"
    where = to_connect() if endpoint is None or endpoint == "" else checked("endpoint", endpoint)
    options = client_options(where, prefix)
    if nothing_listens(where):
        raise BusError("no_bus", why_not_open(options))
    return Client(ZenohBus(options))
