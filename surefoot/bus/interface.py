"""Interface of the two buses: Zenoh between processes, or function calls inside one process.

Participants, which are the services that run in lockstep, exchange *frames*: all messages of a service in a tick
travel as one message, as each message costs its sender and every reader a wake-up, however small it is. Observers
subscribe to single topics, whose messages are published separately while they have a subscriber.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, Protocol, TypeVar, cast

from surefoot.bus.codec import decode, encode, encoding_of, read_header
from surefoot.errors import CallError, Refusal, SurefootError
from surefoot.schemas.base import Message, Request, Wire
from surefoot.schemas.rows import M, Rep, Req
from surefoot.schemas.topics import Query, Topic

if TYPE_CHECKING:
    from surefoot.bus.unread import LinkTrouble

M_contra = TypeVar("M_contra", bound=Message, contravariant=True)


_new: Callable[..., Any] = cast(Any, tuple).__new__  # of any tuple, without the checks of its class


class Raw(NamedTuple):
    """An encoded message, as a recorder stores it: payload, attachment and Zenoh encoding."""

    payload: bytes
    attachment: bytes | None
    encoding: str


class Stamp(NamedTuple):
    """Header of a message, read from the index of a frame without decoding the message."""

    tick: int
    epoch: int
    stamp_ns: int
    seq: int


class Delivery:
    """A received message: an object (in-memory bus), or bytes (Zenoh) that are decoded at the first `message()`."""

    __slots__ = ("_message", "_raw", "_stamp", "sender", "topic")

    def __init__(
        self,
        topic: Topic[Any],
        message: Message | None,
        raw: Raw | None,
        stamp: tuple[str, ...] | None = None,
        sender: str = "",
    ) -> None:
        self.topic = topic
        self.sender = sender
        """Name of the process that published the message; empty = unknown to the bus."""
        self._message = message
        self._raw = raw
        self._stamp = stamp

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Delivery) and self.key == other.key and self.raw()[:2] == other.raw()[:2]

    __hash__ = None  # pyright: ignore[reportAssignmentType] - its content is made when it is asked for

    @property
    def key(self) -> str:
        """Key of the topic of the message."""
        return self.topic.key

    @property
    def size(self) -> int:
        """Size of the encoded message, bytes; 0 if it came as an object."""
        raw = self._raw
        return 0 if raw is None else len(raw.payload) + len(raw.attachment or b"")

    @property
    def prime(self) -> bool:
        """True for a message without payload, by which a publisher tests its links before tick 0."""
        return self._message is None and (self._raw is None or not self._raw.payload)

    def message(self) -> Message:
        """Return the decoded message.

        Raises:
            Refusal: the payload is not what the topic carries.
        """
        if self._message is None:
            assert self._raw is not None
            self._message = decode(self.topic.model, *self._raw)
        return self._message

    def under(self, topic: Topic[Any]) -> "Delivery":
        """Return the same message with another row of the topic table, such as a ``/*`` row instead of one key."""
        return self if topic is self.topic else Delivery(topic, self._message, self._raw, self._stamp, self.sender)

    def header(self) -> Any:
        """Return an object with the header fields of the message, without decoding the rest.

        Raises:
            Refusal: the payload is not what the topic carries.
        """
        if self._message is not None:
            return self._message
        if self._stamp is not None:
            try:
                return _new(Stamp, map(int, self._stamp))  # Stamp itself takes longer
            except ValueError as error:
                raise Refusal("malformed", f"index of a frame, {self.topic.key}: {error}") from None
        assert self._raw is not None
        return read_header(self._raw.payload, self._raw.attachment)

    def raw(self) -> Raw:
        """Return the encoded message; a message that came as an object is encoded now."""
        if self._raw is None:
            assert self._message is not None
            self._raw = Raw(*encode(self._message), encoding_of(self.topic.model))
        return self._raw


class Incoming(Protocol):
    """A received query that waits for its answer; exactly one of `reply`, `fail` and `accept_probe` ends it."""

    query: Query[Any, Any]
    participant: bool
    """True if the query came on the key for participants; False: on the key for all clients."""

    @property
    def probe(self) -> bool:
        """True for an empty query, by which a participant tests the link."""
        ...

    def request(self) -> Request:
        """Return the decoded request (raises Refusal if it cannot be decoded, for `fail`)."""
        ...

    def reply(self, reply: Wire) -> None:
        """Send the reply of the query to the client that sent it."""
        ...

    def fail(self, error: SurefootError) -> None:
        """Answer the query with an error."""
        ...

    def accept_probe(self) -> None:
        """Answer an empty query (`probe`) with an empty reply."""
        ...


@dataclass(frozen=True)
class Life:
    """Notice that a process of a service appeared on the bus or left it."""

    service: str
    instance: str
    alive: bool


class Publisher(Protocol, Generic[M_contra]):
    """Publisher of the messages of one key."""

    @property
    def watched(self) -> bool:
        """True if an observer, not only participants, listens to this key."""
        ...

    def put(self, message: M_contra) -> Any:
        """Publish a message; return its encoded form for ``resend``."""
        ...

    def resend(self, token: Any) -> None:
        """Publish the message of an earlier ``put`` again, unchanged; ``token`` is what ``put`` returned."""
        ...

    def prime(self) -> None:
        """Publish an empty message, by which each reader can test its link before the first tick."""
        ...


class Bus(Protocol):
    """Interface of a bus: topics and queries of one robot.

    Functions that receive messages (sinks) may be called from any thread, and must only queue what they get.
    """

    apart: bool
    """True if other processes run while a caller waits for a reply; False: all services share one process."""

    def publisher(self, topic: Topic[M], instance: str = "") -> Publisher[M]:
        """Return the only publisher of a key; ``instance`` names the process in its frames."""
        ...

    def subscribe(self, topic: Topic[Any], sink: Callable[[Delivery], Any], *, bounded: bool = False) -> None:
        """Deliver the messages of a key, or of all keys that a ``/*`` key covers, to an observer.

        ``bounded``: for services, which must not be flooded. Few messages are kept and more than some thousands per s
        are dropped; status and latched messages are taken from services only.
        """
        ...

    def take(self, topics: Iterable[Topic[Any]], sink: Callable[[Any], Any], *, batched: bool = False) -> None:
        """Deliver topics to a participant: those that travel in frames as Frame, the others as Delivery.

        Args:
            topics: rows of the topic table, each with one owner.
            sink: called from any thread.
            batched: get the messages of several ticks in one frame, for topics that no tick waits for.
        """
        ...

    def cork(self) -> None:
        """Collect the messages of topics that travel in frames, and publish none of them before ``flush``."""
        ...

    def flush(self, *, batch: bool = True) -> None:
        """Publish the messages since ``cork`` as one frame per owner; ``batch``: also the frames of several ticks."""
        ...

    def serve(
        self,
        query: Query[Any, Any],
        sink: Callable[[Incoming], Any],
        participants: Callable[[Incoming], Any] | None = None,
        instance: str = "",
    ) -> None:
        """Deliver the queries of a key to functions that answer them; a function returns False if it has no room.

        Args:
            query: row of the query table.
            sink: gets the queries of any client, of which a flood is dropped in part.
            participants: gets the queries that participants send to ``instance``, on a key of their own; None = no
                such key.
            instance: name of the process that serves.
        """
        ...

    def call(
        self,
        query: Query[Req, Rep],
        request: Req,
        timeout_s: float | None = None,
        *,
        instance: str = "",
        meanwhile: Callable[[], Any] | None = None,
    ) -> Rep:
        """Send a request and return its reply.

        Args:
            query: row of the query table.
            request: the message to send.
            timeout_s: limit on the wait, s; None = that of the row.
            instance: process that shall answer, asked on the key for participants, which other clients cannot flood;
                empty = the process with the liveliness token of the query's owner.
            meanwhile: called on the thread of the caller every half second of a longer wait.

        Raises:
            CallError: absent, timeout, ``second`` if two processes answer as the owner and neither was it before, or
                the refusal of the server with its code.
        """
        ...

    def probe(self, query: Query[Any, Any], *, instance: str = "") -> bool:
        """Send an empty query; return whether the process ``instance``, or the owner of the query, answers it."""
        ...

    def new_instance(self) -> str:
        """Return a name for a process on this bus, which its answers and its liveliness token carry."""
        ...

    def born_ms(self, service: str, instance: str) -> int:
        """Return when a process got its name, ms since the machine was started; 0 = the name has no seal of the system.

        Processes that the supervisor started seal their names with its secret (see `seals`). `service`: name that the
        process acts under; `instance`: name of the process.
        """
        ...

    def announce(self, service: str, instance: str, *, ready: bool = True) -> None:
        """Make the process visible to ``watch``; call it after everything is declared.

        Args:
            service: name of the service.
            instance: name of the process.
            ready: False = it is starting: ``watch`` does not report it, and it may answer only the query of its health.
        """
        ...

    def watch(self, sink: Callable[[Life], Any], services: Iterable[str] | None = None) -> None:
        """Deliver a notice whenever a process of a service appears or leaves; first one for each that is there.

        A bus that knows the services of its system may leave out processes of services that are not in ``services``
        (None: the services of the system).
        """
        ...

    def add_watched(self, service: str) -> None:
        """Deliver notices of processes of one more service that appear or leave to all sinks of `watch`."""
        ...

    def look_at_links(self) -> "list[LinkTrouble]":
        """Return troubles found since the last call: peers that read nothing, and lost links, which are restored."""
        ...

    def close(self) -> None:
        """Close the bus and release its resources; a second call does nothing."""
        ...


def two_owners(query: Query[Any, Any], processes: Iterable[str]) -> CallError:
    """Return the CallError ``second`` of a query that two processes serve as its owner."""
    both = " and ".join(map(repr, processes))
    return CallError("second", f"{query.key!r}: processes {both} both are {query.owner}; end one of them")
