"""Conversion of samples of Zenoh to deliveries; one larger than any legal message of its key is dropped uncopied."""
# pyright: reportUnknownMemberType=false

from collections.abc import Callable
from functools import cache
from typing import Any

import zenoh

from surefoot.bus.codec import encoding_of
from surefoot.bus.frame import MAX_FRAME_BYTES, MAX_INDEX_BYTES, Frame
from surefoot.bus.guard import MOST_NAMED, OTHERS, Guard, Sealed
from surefoot.bus.interface import Delivery, Raw
from surefoot.bus.pour import keep_thread_state
from surefoot.bus.seals import without_seal
from surefoot.bus.sizes import MAX_BULK_BYTES, MAX_JSON_BYTES
from surefoot.bus.unread import LinkTrouble
from surefoot.schemas.base import Bulk, Wire
from surefoot.schemas.topics import Kind, Topic

SEAL_BYTES = 128
"""Largest time and seal behind the attachment of a message, bytes."""


@cache
def largest(model: type[Wire]) -> int:
    """Return the size of the largest legal message of a model with its attachment, bytes."""
    return (MAX_BULK_BYTES if issubclass(model, Bulk) else 0) + MAX_JSON_BYTES + SEAL_BYTES


class Oversized:
    """Count of the messages that were dropped on arrival because they were larger than any legal one of their key."""

    def __init__(self) -> None:
        self._found: dict[str, tuple[int, int, int, str]] = {}

    def drops(self, key: str, sample: zenoh.Sample, most: int) -> bool:
        """Return whether a sample has more than ``most`` bytes; it is counted then, under the key of its row."""
        attachment = sample.attachment
        return self.exceeds(key, sample, len(sample.payload) + (0 if attachment is None else len(attachment)), most)

    def exceeds(self, key: str, sample: zenoh.Sample, size: int, most: int) -> bool:
        """Return as `drops` whether a sample, of known size in bytes, has more than ``most``."""
        if size <= most:
            return False
        key = key if key in self._found or len(self._found) < MOST_NAMED else OTHERS
        number, largest_one, _, _ = self._found.get(key, (0, 0, 0, ""))
        source = sample.source_info
        by = "" if source is None else f" by {str(source.source_id.zid)!r}"
        self._found[key] = number + 1, max(size, largest_one), most, by
        return True

    def troubles(self) -> list[LinkTrouble]:
        """Return what was dropped since the last call, as reports for health and log."""
        found, self._found = self._found, {}
        return [
            LinkTrouble("too_large", f"{n}x {key}{by} of up to {size} bytes; at most {most} are accepted", key, n)
            for key, (n, size, most, by) in found.items()
        ]


class Receiving:
    """Conversion of the samples that one session receives.

    Args:
        guard: check of the seals of messages to participants.
        secret: secret of the system, by which frames are sealed; empty = none.
    """

    def __init__(self, guard: Guard, secret: str) -> None:
        self._guard, self._secret = guard, secret
        self._oversized = Oversized()
        self.troubles = self._oversized.troubles

    def seen(self, topic: Topic[Any], sample: zenoh.Sample) -> Delivery | None:
        """Return a message of the key for a service that observes it; None if it is too large."""
        if self._oversized.drops(topic.key, sample, largest(topic.model)):
            return None
        return self.observed(topic, sample)

    def observed(self, topic: Topic[Any], sample: zenoh.Sample) -> Delivery:
        """Return a message of the key for other observers, which get the refusal of one that is too large."""
        attachment = sample.attachment
        return Delivery(topic, None, _raw(topic, sample, None if attachment is None else attachment.to_bytes()))

    def guarded(self, topic: Topic[Any], sample: zenoh.Sample) -> Delivery | None:
        """Return a message of the key for participants; None if it is too large or lacks the seal of its service."""
        if self._oversized.drops(topic.key, sample, largest(topic.model)):
            return None
        guard, sealed, key = self._guard, sample.attachment, str(sample.key_expr)
        attachment, number, seal = without_seal(None if sealed is None else sealed.to_bytes())
        raw, last = _raw(topic, sample, attachment), key.rpartition("/")[2]
        owner = last if topic.owner == "*" else topic.owner
        if topic.owner == "*" and not guard.owns(key, last, raw.payload):
            return None
        if not guard.passes(owner, Sealed(key, raw.payload, attachment, number, seal)):
            return None
        return Delivery(topic, None, raw, None, last if topic.kind is Kind.LATCHED else "")

    def to_messages(self, topic: Topic[Any], sink: Callable[[Any], Any]) -> Callable[[zenoh.Sample], None]:
        """Return a callback that passes the messages of a key for participants on."""

        def on_sample(sample: zenoh.Sample) -> None:
            delivery = self.guarded(topic, sample)
            if delivery is not None:
                sink(delivery)

        return on_sample

    def to_frames(
        self, owner: str, key: str, wanted: dict[str, Topic[Any]], sink: Callable[[Any], Any]
    ) -> Callable[[zenoh.Sample], None]:
        """Return a callback for the samples of a key, which passes them on as frames.

        Args:
            owner: service that publishes the frames.
            key: key of the frames.
            wanted: topics that the reader decodes, by key.
            sink: gets each `Frame`.
        """
        secret, exceeds, most = self._secret, self._oversized.exceeds, MAX_FRAME_BYTES + MAX_INDEX_BYTES

        def on_sample(sample: zenoh.Sample) -> None:
            keep_thread_state()
            payload, index = sample.payload, sample.attachment
            if exceeds(key, sample, len(payload) + (0 if index is None else len(index)), most):
                return
            sink(Frame(owner, wanted, payload.to_bytes(), b"" if index is None else index.to_bytes(), secret, key))

        return on_sample


def _raw(topic: Topic[Any], sample: zenoh.Sample, attachment: bytes | None) -> Raw:
    encoding = sample.encoding
    named = "" if encoding == encoding_of(topic.model) else str(encoding)
    return Raw(sample.payload.to_bytes(), attachment, named)
