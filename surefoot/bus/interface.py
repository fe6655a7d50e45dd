"""Interface of every bus: Zenoh between processes, or plain calls inside one.

Participants of lockstep exchange *frames*: all messages of a service in a tick travel to its peers as one message,
for each message costs its sender and every reader a wake-up, however small it is. Observers subscribe to the topics
themselves, which are published as well as soon as somebody listens.
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
    """A message that is passed on without being read: what a recorder keeps."""

    payload: bytes
    attachment: bytes | None
    encoding: str


class Stamp(NamedTuple):
    """The header of a message as the index of its frame holds it."""

    tick: int
    epoch: int
    stamp_ns: int
    seq: int


class Delivery:
    """A message as it came: already an object (in-memory bus) or still bytes (Zenoh); read on the node's own thread."""

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
        """Process that published the message; empty = the bus does not know."""
        self._message = message
        self._raw = raw
        self._stamp = stamp

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Delivery) and self.key == other.key and self.raw()[:2] == other.raw()[:2]

    __hash__ = None  # pyright: ignore[reportAssignmentType] - its content is made when it is asked for

    @property
    def key(self) -> str:
        """Key of the topic that the message came on."""
        return self.topic.key

    @property
    def size(self) -> int:
        """Bytes on the wire, 0 of a message that came as an object."""
        raw = self._raw
        return 0 if raw is None else len(raw.payload) + len(raw.attachment or b"")

    @property
    def prime(self) -> bool:
        """An empty payload: the publisher proves the link before tick 0."""
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
        """Return the same message under another topic row of its family, such as the one that was subscribed to."""
        return self if topic is self.topic else Delivery(topic, self._message, self._raw, self._stamp, self.sender)

    def header(self) -> Any:
        """Return the header of the message alone, without decoding the rest.

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
        """Return the bytes on the wire, encoded here when the message came as an object."""
        if self._raw is None:
            assert self._message is not None
            self._raw = Raw(*encode(self._message), encoding_of(self.topic.model))
        return self._raw


class Incoming(Protocol):
    """A query that waits for its answer; exactly one of `reply`, `fail` and `accept_probe` ends it."""

    query: Query[Any, Any]
    participant: bool
    """It came on the way of participants."""

    @property
    def probe(self) -> bool:
        """True for the empty query that only proves the link."""
        ...

    def request(self) -> Request:
        """Return the decoded request (raises Refusal)."""
        ...

    def reply(self, reply: Wire) -> None:
        """Send the reply to the client that asked."""
        ...

    def fail(self, error: SurefootError) -> None:
        """Answer the query with an error."""
        ...

    def accept_probe(self) -> None:
        """Answer a probe, by which a participant tests its link, with an empty reply."""
        ...


@dataclass(frozen=True)
class Life:
    """Notice that a process appeared on the bus or left it."""

    service: str
    instance: str
    alive: bool


class Publisher(Protocol, Generic[M_contra]):
    """Writer of the messages of one key."""

    @property
    def watched(self) -> bool:
        """True if an observer, not only participants, listens to this key."""
        ...

    def put(self, message: M_contra) -> Any:
        """Publish a message; return a token for ``resend``."""
        ...

    def resend(self, token: Any) -> None:
        """Publish the bytes of an earlier ``put`` again."""
        ...

    def prime(self) -> None:
        """Publish an empty payload, which proves the link to each reader before the first tick."""
        ...


class Bus(Protocol):
    """A namespace of topics and queries. Sinks may be called from any thread and must only queue."""

    apart: bool
    """Other processes act while one waits in a call."""

    def publisher(self, topic: Topic[M], instance: str = "") -> Publisher[M]:
        """Declare the one writer of a key; ``instance`` names the process in its frames."""
        ...

    def subscribe(self, topic: Topic[Any], sink: Callable[[Delivery], Any], *, bounded: bool = False) -> None:
        """Deliver the messages of a key, or of all keys of a ``/*`` family, to an observer, whoever publishes them.

        ``bounded``: for services, which have more to do. Few are kept and more than some thousands per s are dropped;
        what services publish outside ticks (status, latched) is taken from services only.
        """
        ...

    def take(self, topics: Iterable[Topic[Any]], sink: Callable[[Any], Any], *, batched: bool = False) -> None:
        """Deliver topics to a participant, without loss: framed ones as a Frame of their owner's, others as
        Deliveries. What an observer that does not read could hold up does not come this way.

        Args:
            topics: rows with one owner each.
            sink: called from any thread.
            batched: some ticks in one frame, for owners that no participant waits for.
        """
        ...

    def cork(self) -> None:
        """Hold back what is published on framed topics until ``flush``."""
        ...

    def flush(self, *, batch: bool = True) -> None:
        """Publish what was held back as one frame; ``batch``: to readers that take several ticks in one frame, too."""
        ...

    def serve(
        self,
        query: Query[Any, Any],
        sink: Callable[[Incoming], Any],
        participants: Callable[[Incoming], Any] | None = None,
        instance: str = "",
    ) -> None:
        """Deliver the queries of a key; a sink that returns False has no room, and some queries are dropped.

        Args:
            query: row of the table.
            sink: gets the queries of any client.
            participants: gets those of participants (see ``call``), without loss; None = they are not served apart.
            instance: process that serves; participants ask it by that name.
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
            query: row of the table.
            request: what is asked.
            timeout_s: limit on the wait, s; None = that of the row.
            instance: process that shall answer, on the way of participants, which no flood of other clients' queries
                fills; empty = the one that shows the token of the query's owner.
            meanwhile: called on the thread of the caller every half second of a longer wait.

        Raises:
            CallError: absent, timeout, ``second`` where two processes answer as the owner and neither is known, or
                the server's refusal under the server's code.
        """
        ...

    def probe(self, query: Query[Any, Any], *, instance: str = "") -> bool:
        """Return whether a query is answered, by the process ``instance`` or by the one that owns the query."""
        ...

    def new_instance(self) -> str:
        """Return the name of a process on this bus, by which its answers and its token are known."""
        ...

    def announce(self, service: str, instance: str, *, ready: bool = True) -> None:
        """Make the process visible to ``watch``; call it after everything is declared.

        Args:
            service: name of the service.
            instance: name of the process.
            ready: false: it starts, is not visible to ``watch``, and owns nothing but its health.
        """
        ...

    def watch(self, sink: Callable[[Life], Any]) -> None:
        """Deliver the appearance and disappearance of services, those already there first."""
        ...

    def look_at_links(self) -> "list[LinkTrouble]":
        """Return what is wrong since the last call: peers that read nothing, and links that are being made anew."""
        ...

    def close(self) -> None:
        """End the bus; harmless when repeated."""
        ...


def two_owners(query: Query[Any, Any], processes: Iterable[str]) -> CallError:
    """Return the error of a query that two processes serve as its owner."""
    both = " and ".join(map(repr, processes))
    return CallError("second", f"{query.key!r}: processes {both} both are {query.owner}; end one of them")
