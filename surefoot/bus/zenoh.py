"""The bus between processes: the topics and queries of one robot over one Zenoh session."""
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)

import threading
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import zenoh
from zenoh.handlers import Callback, RingChannel

from surefoot.bus.asking import TOKENS_S, Asking, plain_attachment
from surefoot.bus.codec import check_size, decode, encode, encoding_of, validate_json
from surefoot.bus.endpoint import is_secure, without_source
from surefoot.bus.flapping import Flapping
from surefoot.bus.guard import Guard
from surefoot.bus.heavy import Heavy
from surefoot.bus.hidden import hidden_word, sealed_for_any
from surefoot.bus.interface import Delivery, Incoming, Life
from surefoot.bus.mesh import INTRODUCE_S, ROUTER_S, Mesh, linked_to, tokens_of_any
from surefoot.bus.options import DEFAULT_FLEET as DEFAULT_FLEET
from surefoot.bus.options import ZenohOptions as ZenohOptions
from surefoot.bus.options import client_options as client_options
from surefoot.bus.options import reading_threads, why_not_open, zenoh_config
from surefoot.bus.pour import MOST_HZ, keep_thread_state, pour, unless_none
from surefoot.bus.publish import BATCH, FRAME, FramedPublisher, Framer, ZenohPublisher, apart, participants_key
from surefoot.bus.receive import Receiving
from surefoot.bus.replies import WAITING, Replies
from surefoot.bus.seals import ASKED, Asked, as_digits, born_ms, sealed_name
from surefoot.bus.tokens import LIVE, STARTS, Tokens
from surefoot.bus.unread import LinkTrouble, Unread
from surefoot.errors import BusError, CallError, Refusal, SurefootError
from surefoot.heap import hand_back_growth
from surefoot.schemas.base import BulkRequest, ErrorReply, Request, Wire
from surefoot.schemas.rows import M, Rep, Req
from surefoot.schemas.topics import Query, Topic

KEEP = 10_000
"""Largest number of messages of a key that wait for an observer, e.g. a recorder; the oldest are dropped."""
BOUNDED_KEEP = 64
"""Largest number of messages of a topic, or of queries of a key, that wait for a service; the oldest are dropped."""
PROBE = b"probe"
CLOSE_S = 1.0  # s, how long a reader that works may delay the end
PROBE_S = 0.2


class ZenohIncoming:
    """A query received over the network; ``reply``, ``fail`` or ``accept_probe`` answers it.

    Args:
        query: row of the query table.
        key: key on which the query came.
        asked: Zenoh's object of the query.
        secret: secret of the system, by which answers are sealed; empty = none.
        replies: threads that send replies; None for a participant, which is answered at once.
    """

    def __init__(
        self, query: Query[Any, Any], key: str, asked: zenoh.Query, secret: str, replies: Replies | None = None
    ) -> None:
        self.query = query
        self._key, self._asked, self._replies, self.participant = key, asked, replies, replies is None
        self._secret = secret
        attachment = asked.attachment
        self._attachment = None if attachment is None else attachment.to_bytes()
        self.probe = self._attachment == PROBE
        self.size = (0 if asked.payload is None else len(asked.payload)) + len(self._attachment or b"")

    def request(self) -> Request:
        payload, encoding = self._asked.payload, self._asked.encoding
        bulk = issubclass(self.query.request, BulkRequest) and self._attachment is not None
        check_size(0 if payload is None else len(payload), bulk=bulk)  # before the payload is copied
        data = b"" if payload is None else payload.to_bytes()
        if not data and self._attachment is None:
            if self.query.acts:
                raise Refusal("malformed", f"{self.query.key}: an empty request does nothing; send a JSON object")
            data = b"{}"
        return decode(self.query.request, data, self._attachment, "" if encoding is None else str(encoding))

    def reply(self, reply: Wire) -> None:
        payload, attachment = encode(reply)
        if not self._later(partial(self._answer, payload, attachment, encoding_of(type(reply))), len(payload)):
            self.fail(
                Refusal("busy", f"{self.query.key}: {WAITING} large replies are queued already; request it again later")
            )

    def fail(self, error: SurefootError) -> None:
        payload = encode(error.reply())[0]
        seal = self._seal(payload, None, failed=True).decode()  # in the encoding: an error has no attachment
        encoding = f"{encoding_of(ErrorReply)};{seal}" if seal else encoding_of(ErrorReply)
        self._later(partial(self._send, lambda q: q.reply_err(payload, encoding=encoding)))

    def accept_probe(self) -> None:
        self._later(partial(self._answer, b"", PROBE, None))

    def _later(self, send: Callable[[], None], size: int = 0) -> bool:
        """Send to a participant at once, to a client by a thread; return False if too many large ones are queued."""
        if self._replies is None:
            send()
            return True
        return self._replies.put(send, partial(self._send, lambda _: None), size)

    def _answer(self, payload: bytes, attachment: bytes | None, encoding: str | None) -> None:
        seal = self._seal(payload, attachment)
        sealed = (attachment or b"") + b"\n" + seal if seal else attachment
        self._send(lambda q: q.reply(self._key, payload, encoding=encoding, attachment=sealed))

    def _seal(self, payload: bytes, attachment: bytes | None, *, failed: bool = False) -> bytes:
        request, digits = self._asked.payload, as_digits(str(self._asked.parameters.get(ASKED, "")))
        asked = Asked(self._key, digits, b"" if request is None else request.to_bytes(), self._attachment)
        return asked.seal(self._secret, payload, attachment, failed=failed)

    def _send(self, send: Callable[[zenoh.Query], None]) -> None:
        with self._asked as asked:
            try:
                send(asked)
            except zenoh.ZError:
                return  # the asker is gone


class ZenohBus:
    """Topics and queries of one robot over a Zenoh session."""

    apart = True

    def __init__(self, endpoint: ZenohOptions) -> None:
        self.endpoint = endpoint
        name = sealed_name(endpoint.secret, endpoint.identity) if endpoint.secret and endpoint.mode != "client" else ""
        try:
            with reading_threads(endpoint):
                self.session = zenoh.open(zenoh_config(endpoint, name))
        except zenoh.ZError as error:
            raise BusError("no_bus", why_not_open(endpoint, without_source(str(error)))) from None
        self._replies = Replies()
        self._keep: list[Any] = []
        self._pours: list[threading.Thread] = []
        self._asking = Asking(self.session, endpoint.namespace, endpoint.secret)
        self._unread = Unread(self.session)
        self._guard = Guard(endpoint.secret)
        self._receiving = Receiving(self._guard, endpoint.secret)
        self._heavy = Heavy(self.session) if endpoint.mode == "router" else None
        self._reported: Counter[tuple[str, str]] = Counter()
        """Refused answers at the last look at the links, by key and process."""
        self._framers: dict[str, Framer] = {}
        self._hidden = "" if endpoint.mode == "client" or _secure(endpoint) else hidden_word(endpoint.secret)
        """First word of the keys of tokens that only processes of this system know; empty = there are none."""
        router = endpoint.mode == "router"
        self._flapping = Flapping(self.session, sealed_for_any(endpoint.secret, endpoint.services)) if router else None
        self._tokens = Tokens(
            self.session,
            endpoint.services,
            everything=router,
            hidden=self._hidden,
            secret=endpoint.secret,
            on_change=self._flapping.note if self._flapping else lambda: None,
        )
        visible = partial(self._visible, self.session)
        self._mesh = Mesh(partial(linked_to, self.session), visible, self._alive, self._introduce)

    def publisher(
        self, topic: Topic[M], instance: str = "", *, framed: bool = True
    ) -> ZenohPublisher[M] | FramedPublisher[M]:
        """Return the only publisher of a key; ``instance`` names the process in its frames.

        ``framed`` = False: its messages reach observers only, as when a recording is played.
        """
        if not (framed and topic.framed):
            return ZenohPublisher(self.session, topic, instance if framed else "", self.endpoint.secret)
        framer = self._framers.get(topic.owner)
        if framer is None:
            framer = self._framers[topic.owner] = Framer(self.session, topic.owner, instance, self.endpoint.secret)
        return FramedPublisher(self.session, framer, topic)

    def cork(self) -> None:
        for framer in self._framers.values():
            framer.corked = True

    def flush(self, *, batch: bool = True) -> None:
        for framer in self._framers.values():
            framer.flush(batch)

    def subscribe(self, topic: Topic[Any], sink: Callable[[Delivery], Any], *, bounded: bool = False) -> None:
        self.listen(topic, sink, bounded=bounded)

    def listen(
        self, topic: Topic[Any], sink: Callable[[Delivery], Any], *, bounded: bool = False
    ) -> Callable[[], None]:
        """Deliver the messages of a key to an observer; return a function that ends the subscription.

        ``bounded``: for services; few messages are kept and more than some thousands per s are dropped.
        """
        keep, most_hz = (BOUNDED_KEEP, MOST_HZ) if bounded else (KEEP, 0.0)
        key = participants_key(topic, "*") if bounded and apart(topic) else topic.key
        subscriber = self.session.declare_subscriber(key, RingChannel(keep))
        of_services = self._receiving.guarded if apart(topic) else self._receiving.seen
        make = of_services if bounded else self._receiving.observed
        thread = pour(subscriber.handler, partial(make, topic), unless_none(sink), most_hz=most_hz)
        self._keep.append(subscriber)
        self._pours.append(thread)

        def end() -> None:
            if subscriber in self._keep:
                self._keep.remove(subscriber)
                with suppress(zenoh.ZError):  # the session is closed
                    subscriber.undeclare()
                self._pours[:] = [one for one in self._pours if one.is_alive()]  # `close` waits for the others

        return end

    def newest(self, topic: Topic[Any]) -> Callable[[], Delivery | None]:
        """Return a function that returns the newest message of a key since its last call, None when none came.

        Older messages are dropped without a thread or a call in Python: for a reader that asks now and then. The
        subscription ends when the returned function is deleted.
        """
        subscriber = self.session.declare_subscriber(topic.key, RingChannel(1))

        def look() -> Delivery | None:
            sample = subscriber.handler.try_recv()
            return None if sample is None else self._receiving.observed(topic, sample)

        return look

    def take(self, topics: Iterable[Topic[Any]], sink: Callable[[Any], Any], *, batched: bool = False) -> None:
        family = BATCH if batched else FRAME
        owners: dict[str, dict[str, Topic[Any]]] = {}
        for topic in topics:
            encoding_of(topic.model)
            if topic.framed:
                owners.setdefault(topic.owner, {})[topic.key] = topic
            else:
                handler = Callback(self._receiving.to_messages(topic, sink), indirect=True)
                self._keep.append(self.session.declare_subscriber(participants_key(topic, "*"), handler))
        for owner, wanted in owners.items():
            key = family.format(owner)
            handler = Callback(self._receiving.to_frames(owner, key, wanted, sink), indirect=False)
            self._keep.append(self.session.declare_subscriber(key, handler))

    def serve(
        self,
        query: Query[Any, Any],
        sink: Callable[[Incoming], Any],
        participants: Callable[[Incoming], Any] | None = None,
        instance: str = "",
    ) -> None:
        queryable = self.session.declare_queryable(query.key, RingChannel(BOUNDED_KEEP), complete=True)
        self._keep.append(queryable)
        for model in (query.request, query.reply):
            encoding_of(model)
        self._pours.append(
            pour(
                queryable.handler,
                partial(_from_stranger, self._replies, query, self.endpoint.secret),
                sink,
                most_hz=MOST_HZ,
            )
        )
        if participants is not None:
            key = participants_key(query, instance)
            handler = Callback(_query_sink(query, key, participants, self.endpoint.secret), indirect=False)
            self._keep.append(self.session.declare_queryable(key, handler, complete=True))

    def call(
        self,
        query: Query[Req, Rep],
        request: Req,
        timeout_s: float | None = None,
        *,
        instance: str = "",
        meanwhile: Callable[[], Any] | None = None,
    ) -> Rep:
        timeout = query.timeout_s if timeout_s is None else timeout_s
        reply = self._asking.ask(query, timeout, *encode(request), instance=instance, meanwhile=meanwhile)
        if reply.ok is None:
            assert reply.err is not None
            raise _call_error(reply.err.payload.to_bytes())
        try:
            return decode(query.reply, reply.ok.payload.to_bytes(), plain_attachment(reply.ok), str(reply.ok.encoding))
        except Refusal as refusal:
            raise CallError(refusal.code, refusal.message, refusal.field) from None

    def probe(self, query: Query[Any, Any], *, instance: str = "") -> bool:
        try:
            return self._asking.ask(query, PROBE_S, b"", PROBE, instance=instance).ok is not None
        except CallError:
            return False

    @property
    def refused(self) -> Counter[tuple[str, str]]:
        """Number of answers refused because their process does not own the query, by key and process."""
        return self._asking.refused

    def new_instance(self) -> str:
        return str(self.session.zid())

    def born_ms(self, service: str, instance: str) -> int:
        return born_ms(self.endpoint.secret, service, instance)

    def look_at_links(self) -> list[LinkTrouble]:
        lost = self._mesh.look() if self.endpoint.mode == "peer" else []
        strange = (*self._guard.troubles(), *self._tokens.troubles(), *self._receiving.troubles())
        heavy = [] if self._heavy is None else self._heavy.look()
        flapping = [] if self._flapping is None else self._flapping.look()
        hand_back_growth()
        return [*self._unread.look(), *heavy, *flapping, *lost, *strange, *self._refused_answers()]

    def _refused_answers(self) -> list[LinkTrouble]:
        """Return the answers to queries of this process that were refused since the last call, by key and process."""
        new, self._reported = Counter(self.refused) - self._reported, Counter(self.refused)
        code = "forged" if self.endpoint.secret else "unbound"
        return [
            LinkTrouble(code, f"{n}x an answer to {key} of {by or 'others'!r}, which does not own it", key)
            for (key, by), n in new.items()
        ]

    def _visible(self, session: zenoh.Session) -> set[str]:
        found = tokens_of_any(session, self._tokens.expressions, TOKENS_S)
        return {key.rpartition("/")[2] for key in found}

    def _alive(self) -> set[str]:
        config = zenoh_config(replace(self.endpoint, mode="client", listen=()))
        config.insert_json5("connect/timeout_ms", str(round(1000 * ROUTER_S)))
        with zenoh.open(config) as session:
            return self._visible(session)

    def _introduce(self, over: threading.Event) -> None:
        listen = tuple(f"{place.rpartition(':')[0]}:0" for place in self.endpoint.listen)
        with zenoh.open(zenoh_config(replace(self.endpoint, listen=listen))):
            over.wait(INTRODUCE_S)

    def announce(self, service: str, instance: str, *, ready: bool = True) -> None:
        for word in (self._hidden, LIVE) if ready and self._hidden else (LIVE if ready else STARTS,):
            self._keep.append(self.session.liveliness().declare_token(f"{word}/{service}/{instance}"))

    def watch(self, sink: Callable[[Life], Any], services: Iterable[str] | None = None) -> None:
        def on_life(life: Life) -> None:
            if life.alive:
                self._guard.on_token(life.service, life.instance)
            sink(life)

        self._tokens.watch(on_life, services)

    def add_watched(self, service: str) -> None:
        self._tokens.add(service)

    def close(self) -> None:
        self._mesh.close()
        if self._flapping is not None:
            self._flapping.close()
        self._replies.finish(CLOSE_S)
        if not self.session.is_closed():
            with suppress(zenoh.ZError):  # a reader that does not read leaves the last messages unsent
                self.session.close()
        for thread in self._pours:  # one that is still in the network library when the interpreter ends aborts it
            if thread is not threading.current_thread():
                thread.join(CLOSE_S)


def _secure(endpoint: ZenohOptions) -> bool:
    """Return whether a session shows certificates, by which the router passes tokens of their owner only."""
    return is_secure((*endpoint.connect, *endpoint.listen))


def _from_stranger(replies: Replies, query: Query[Any, Any], secret: str, asked: zenoh.Query) -> ZenohIncoming:
    return ZenohIncoming(query, query.key, asked, secret, replies)


def _query_sink(
    query: Query[Any, Any], key: str, sink: Callable[[Incoming], Any], secret: str
) -> Callable[[zenoh.Query], None]:
    def on_query(asked: zenoh.Query) -> None:
        keep_thread_state()
        sink(ZenohIncoming(query, key, asked, secret))

    return on_query


def _call_error(payload: bytes) -> CallError:
    try:
        error = validate_json(ErrorReply, payload)
    except Refusal:
        return CallError("error", payload[:200].decode("utf-8", "replace"))
    return CallError(error.code, error.message, error.field)
