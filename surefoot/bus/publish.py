"""Publishers over Zenoh: single messages for observers, frames with all messages of a service for participants."""
# pyright: reportUnknownMemberType=false

from typing import Any, Generic

import zenoh

from surefoot.bus.codec import encode, encoding_of
from surefoot.bus.frame import FramePart, pack
from surefoot.bus.interface import Stamp
from surefoot.bus.seals import with_seal
from surefoot.schemas.rows import M
from surefoot.schemas.topics import Kind, Query, Topic

_JSON = "application/json"
_DROP = zenoh.CongestionControl.DROP
_QOS = {  # congestion control, priority, express (no batching: a tick waits for its messages)
    Kind.SAMPLE: (_DROP, zenoh.Priority.DATA_HIGH, False),
    Kind.STATE: (_DROP, zenoh.Priority.DATA_HIGH, False),
    Kind.COMMAND: (_DROP, zenoh.Priority.DATA_HIGH, False),
    Kind.LATCHED: (_DROP, zenoh.Priority.DATA, False),
    Kind.LOCKSTEP: (_DROP, zenoh.Priority.REAL_TIME, True),
    Kind.STATUS: (_DROP, zenoh.Priority.DATA_LOW, False),
    Kind.ALARM: (_DROP, zenoh.Priority.REAL_TIME, True),
}
"""Congestion control, priority and express flag (True = sent at once, not in a batch) of a topic's messages, by its
kind. All may be dropped, frames too: whoever subscribes to a key and does not read fills the links on the way to
itself, and a publisher, or a router, that waited for room would be held. In lockstep the driver repeats what is
lost."""
_FRAMES = (_DROP, zenoh.Priority.REAL_TIME, True)
_TO_PARTICIPANTS = {
    Kind.LOCKSTEP: _FRAMES,
    Kind.LATCHED: (_DROP, zenoh.Priority.DATA, False),
    Kind.STATUS: (_DROP, zenoh.Priority.INTERACTIVE_LOW, False),
}
"""Congestion control, priority and express flag of kinds whose messages go to participants under keys of their own, so
that a flood on the common key does not displace them; status has a priority, and so a queue, of its own."""

FRAME, BATCH = "@frame/{}", "@batch/{}"
"""`FRAME`: key of the message with all that a service (``{}``) publishes in one tick; `BATCH`: key of the message with
what a service publishes in several ticks."""


def participants_key(row: Topic[Any] | Query[Any, Any], instance: str) -> str:
    """Return the key under which participants exchange a query, or a topic that does not travel in frames.

    The key of a query or a latched topic ends with the process that serves or publishes it (``*``: any), so that
    readers can distinguish several processes of one service.
    """
    named = isinstance(row, Query) or row.kind is Kind.LATCHED
    return f"@{row.key}/{instance}" if named else f"@{row.key}"


def apart(topic: Topic[Any]) -> bool:
    """Return whether participants receive a topic outside of frames, as single messages under `participants_key`."""
    return topic.kind in _TO_PARTICIPANTS


class ZenohPublisher(Generic[M]):
    """Publisher of one key over Zenoh that sends each message by itself, not in frames."""

    watched = True

    def __init__(self, session: zenoh.Session, topic: Topic[M], instance: str = "", secret: str = "") -> None:
        self.topic = topic
        encoding = encoding_of(topic.model)
        self._publisher = _declare(session, topic.key, encoding, *_QOS[topic.kind])
        self._participants: zenoh.Publisher | None = None
        self._secret, self._key = secret, participants_key(topic, instance)
        if apart(topic) and (instance or topic.kind is not Kind.LATCHED):
            self._participants = _declare(session, self._key, encoding, *_TO_PARTICIPANTS[topic.kind])

    def put(self, message: M) -> tuple[bytes, bytes | None]:
        token = encode(message)
        self.resend(token)
        return token

    def resend(self, token: tuple[bytes, bytes | None]) -> None:
        payload, attachment = token
        self._publisher.put(payload, attachment=attachment)
        if self._participants is not None:
            if self._secret:
                attachment = with_seal(self._secret, self._key, payload, attachment)
            self._participants.put(payload, attachment=attachment)

    def prime(self) -> None:
        self.resend((b"", None))


class Framer:
    """Collector of the messages of one service, which publishes them in frames of one tick and of several ticks."""

    def __init__(self, session: zenoh.Session, owner: str, instance: str, secret: str = "") -> None:
        self.corked = False
        self._owner, self._instance, self._secret = owner, instance, secret
        self.frame: list[FramePart] = []
        self.batch: list[FramePart] = []
        self._frames = _declare(session, FRAME.format(owner), _JSON, *_FRAMES)
        self._batches = _declare(session, BATCH.format(owner), _JSON, *_FRAMES)

    def flush(self, batch: bool) -> None:
        """Publish the collected messages as one frame; ``batch``: also those of all ticks since the last batch."""
        self.corked = False
        if self.frame:
            payload, index = pack(self.frame, self._instance, self._secret, FRAME.format(self._owner))
            self._frames.put(payload, attachment=index)
            self.batch += self.frame
            self.frame = []
        if batch and self.batch:
            payload, index = pack(self.batch, self._instance, self._secret, BATCH.format(self._owner))
            self._batches.put(payload, attachment=index)
            self.batch = []


class FramedPublisher(Generic[M]):
    """Publisher of one key whose messages travel in frames, and singly while an observer subscribes to the key."""

    def __init__(self, session: zenoh.Session, framer: Framer, topic: Topic[M]) -> None:
        self.topic = topic
        self._framer = framer
        self._publisher = _declare(session, topic.key, encoding_of(topic.model), *_QOS[topic.kind])
        self.watched = False
        self._listener = self._publisher.declare_matching_listener(self._on_match)
        status: Any = self._publisher.matching_status  # typed bool in the stubs
        self._on_match(status)

    def _on_match(self, status: Any) -> None:
        self.watched = bool(status.matching)

    def put(self, message: M) -> FramePart:
        stamp = Stamp(message.tick, message.epoch, message.stamp_ns, message.seq)
        part = FramePart(self.topic.key, encode(message)[0], stamp)
        self.resend(part)
        return part

    def resend(self, token: FramePart) -> None:
        self._frame(token)
        if self.watched or not self._framer.corked:
            self._publisher.put(token.payload)

    def prime(self) -> None:
        self._frame(FramePart(self.topic.key, b"", Stamp(-1, 0, 0, 0)))

    def _frame(self, part: FramePart) -> None:
        (self._framer.batch if self.topic.observers_only else self._framer.frame).append(part)
        if not self._framer.corked:
            self._framer.flush(batch=True)


def _declare(
    session: zenoh.Session, key: str, encoding: str, congestion: Any, priority: Any, express: bool
) -> zenoh.Publisher:
    return session.declare_publisher(
        key,
        encoding=encoding,
        congestion_control=congestion,
        priority=priority,
        express=express,
        reliability=zenoh.Reliability.RELIABLE,
    )
