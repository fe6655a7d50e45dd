"""Frames: everything a service publishes in one tick, or in a few, as one message.

Payload: the JSON array of the messages, so that any tool can read it. Attachment: the publishing process (the last word
of its liveliness token), in a system with a secret the time of the machine and the seal of the frame (see `seals`),
colons between them; then the index, one ``<key>,<length>,<tick>,<epoch>,<stamp_ns>,<seq>`` per message, semicolons
between them, in the order of the array, so that a reader can decode only the messages it needs. Length 0 marks a prime,
an empty message that tests the link before tick 0: it has no place in the array.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from hmac import compare_digest
from typing import Any, NamedTuple, cast

from surefoot.bus.codec import MAX_JSON_BYTES
from surefoot.bus.interface import Delivery, Raw, Stamp
from surefoot.bus.seals import MOST_DIGITS, seal_of
from surefoot.errors import Refusal
from surefoot.schemas.topics import Topic

MAX_FRAME_BYTES = 8 * MAX_JSON_BYTES
"""Largest frame or batch, bytes; a larger one is refused."""
MAX_INDEX_BYTES = 1 << 18
"""Largest index of a frame, bytes; a frame with a larger one is refused."""
PRIME_BYTES = 1 << 14
"""Largest frame of a process that its service is not bound to, which may only test links (prime), bytes."""
MAX_INSTANCE = 64
"""Largest length of a process name in a frame, characters; a longer name is cut."""

_new: Callable[..., Any] = cast(Any, tuple).__new__  # of any tuple, without the checks of its class


class FramePart(NamedTuple):
    """One message of a frame: key, JSON payload and header."""

    key: str
    payload: bytes
    stamp: Stamp


def pack(parts: Sequence[FramePart], instance: str = "", secret: str = "", family: str = "") -> tuple[bytes, bytes]:
    """Return payload and attachment of a frame that the process ``instance`` publishes, sealed if there is a secret.

    The seal holds for the key ``family`` (that of frames or of batches of a service) and the time of the machine, ns.
    """
    entries = [
        f"{key},{len(payload)},{tick},{epoch},{stamp_ns},{seq}" for key, payload, (tick, epoch, stamp_ns, seq) in parts
    ]
    payload, index = (
        b"[" + b",".join([payload for _, payload, _ in parts if payload]) + b"]",
        ";".join(entries).encode(),
    )
    name = instance.encode()
    if secret:
        name += b":%d" % time.monotonic_ns()
        name += b":" + seal_of(secret, family.encode() + b" " + name, index, payload)
    return payload, name + b";" + index if entries else name


class Frame:
    """Frame of messages as it was received, decoded on the reader's own thread."""

    __slots__ = (
        "_index", "_payload", "_seal", "_secret", "_topics", "family", "instance", "owner", "sealed_ns",
        "size",
    )  # fmt: skip

    def __init__(
        self,
        owner: str,
        topics: Mapping[str, Topic[Any]],
        payload: bytes,
        index: bytes,
        secret: str = "",
        family: str = "",
    ) -> None:
        self.owner = owner
        self._topics = topics
        self._payload = payload
        self._secret, self.family = secret, family
        name, _, self._index = index.partition(b";")
        instance, _, seal = name.partition(b":")
        number, _, self._seal = seal.partition(b":")
        self.instance = instance[:MAX_INSTANCE].decode("ascii", "replace")
        """Name of the process that published the frame, as written in the frame."""
        self.sealed_ns = int(number) if number.isdigit() and len(number) <= MOST_DIGITS else 0
        """Monotonic time at which the frame was sealed, ns since the machine was started; 0 = it has no seal."""
        self.size = len(payload) + len(index)

    @property
    def sealed(self) -> bool:
        """True if a process that knows the secret published exactly this frame, under this name and key."""
        if not self._secret:
            return False
        name = f"{self.family} {self.instance}:{self.sealed_ns}".encode()
        return compare_digest(seal_of(self._secret, name, self._index, self._payload), self._seal)

    def deliveries(self, bound: bool = True) -> list[Delivery]:
        """Return the messages of the frame on the reader's topics, in the order they were published.

        Args:
            bound: the service is bound to the process that published it; of any other a frame may test links alone,
                and one that is larger than that is refused before it costs the time of decoding.

        Raises:
            Refusal: malformed, the index has another form or does not fit the payload; too_large, the frame, its index
                or a message is; unbound.
        """
        if not bound and self.size > PRIME_BYTES:
            text = f"frame of {self.size} bytes by {self.instance!r}, to which the {self.owner} is not bound"
            raise Refusal("unbound", text)
        found: list[Delivery] = []
        payload, topics = self._payload, self._topics
        if self.size > MAX_FRAME_BYTES:
            raise Refusal("too_large", f"frame of {self.size} bytes; at most {MAX_FRAME_BYTES} are accepted")
        if len(self._index) > MAX_INDEX_BYTES:
            text = f"index of {len(self._index)} bytes of a frame; at most {MAX_INDEX_BYTES} are accepted"
            raise Refusal("too_large", text)
        try:
            begin = 1
            for entry in self._index.decode("ascii").split(";"):
                key, size, tick, epoch, stamp_ns, seq = entry.split(",")
                length = int(size)
                topic = topics.get(key)
                if length > MAX_JSON_BYTES:
                    raise Refusal("too_large", f"{key} of {length} bytes; at most {MAX_JSON_BYTES} are accepted")
                if topic is not None:
                    raw = _new(Raw, (payload[begin : begin + length], None, ""))  # Raw itself takes twice as long
                    found.append(Delivery(topic, None, raw, (tick, epoch, stamp_ns, seq)))
                if length:
                    begin += length + 1
        except ValueError as error:
            raise Refusal("malformed", f"index of a frame: {error} (got {self._index[:80]!r})") from None
        if max(begin, 2) != len(payload):
            raise Refusal("malformed", f"frame of {len(payload)} bytes; its index states {max(begin, 2)}")
        return found
