"""Names of processes, and frames, that only the processes of one system can make, by a secret of its supervisor.

The name of a process is that of its Zenoh session, 32 hexadecimal digits, and public: it stands in liveliness tokens,
frames and answers. A sealed name is ``f``, 3 random digits, 12 digits of the time since the machine was started, in ms,
and a keyed hash (SHA-256, with the secret before and behind) of the service and these digits, cut to 16 digits. Whoever
does not know the secret can copy such a name, but can make none that is newer; services take the newest. What it cannot
copy is the seal of a message: with the secret K and K0, K filled up to 64 bytes by zeros,

    seal = first 16 hexadecimal digits of SHA-256(K0 | "<len name>;<len index>;" | name | index | payload | K)

where the name of a frame is ``<key> <process>:<time>``, that of another message ``<key> <time>``, time in ns. An answer
to a query is sealed for the digits that the sender of the query drew: its name is ``?<key> <digits>`` and the request.
"""

import hashlib
import os
import secrets
import time
from functools import lru_cache
from typing import Any, NamedTuple

from surefoot.errors import ConfigError

DRIVER = "driver"
"""Service name in the second liveliness token of the process that drives the ticks, beside the token of its own
service."""
VARIABLE = "SUREFOOT_SECRET"
"""Environment variable by which the supervisor passes its secret to the processes that it starts."""
DRAWN, BORN, SEAL = 4, 12, 16
"""`DRAWN`: length of ``f`` and the random digits in a sealed process name, characters; `BORN`: length of the digits of
its time; `SEAL`: length of its hash."""
MOST_DIGITS = 20
"""Largest number of decimal digits of the time in a seal, and of the digits in a query; a longer number is ignored."""
BLOCK = 64
"""Length of a block of SHA-256, bytes."""
ASKED = "seal"
"""Name of the query parameter that holds the decimal digits for which the sender expects the answer to be sealed."""
MOST_KNOWN = 1024
"""Largest number of process names whose checked seals are cached, and of names shown as the driver that are kept."""


def new_secret() -> str:
    """Return a new secret of 32 random hexadecimal digits."""
    return secrets.token_hex(16)


def given_secret() -> str:
    """Return the secret of the environment, empty if it has none.

    Raises:
        ConfigError: it is not 32 hexadecimal digits; the sentence does not repeat it.
    """
    found = os.environ.get(VARIABLE, "")
    if found and not (len(found) == DRAWN + BORN + SEAL and set(found) <= set("0123456789abcdef")):
        raise ConfigError("invalid", f"{VARIABLE}: got {len(found)} characters, allowed: 32 of 0-9a-f", VARIABLE)
    return found


def sealed_name(secret: str, service: str) -> str:
    """Return a new name for a process of a service, which only those who know the secret can make."""
    drawn = f"f{secrets.randbelow(16 ** (DRAWN - 1)):0{DRAWN - 1}x}"  # Zenoh takes no name that begins with 0
    name = f"{drawn}{time.monotonic_ns() // 1_000_000 + 1:0{BORN}x}"
    return name + _hash(secret, service, name)


@lru_cache(MOST_KNOWN)
def born_ms(secret: str, service: str, name: str) -> int:
    """Return the time at which a process got its sealed name, ms since the machine was started, at least 1.

    It is 0 for a name that was not made with this secret for this service, and without a secret (empty).
    """
    head, seal = name[:-SEAL], name[-SEAL:]
    if not secret or len(name) != DRAWN + BORN + SEAL or not name.isascii():
        return 0
    if not secrets.compare_digest(seal, _hash(secret, service, head)):
        return 0
    return int(head[DRAWN:], 16)


def seal_of(secret: str, name: bytes, index: bytes, payload: bytes) -> bytes:
    """Return the seal of a message, 16 hexadecimal digits: a keyed hash of its sender or key and what it contains.

    Args:
        secret: secret of the system.
        name: name of the process of a frame, or key of another message.
        index: index of a frame, or attachment of another message.
        payload: content.
    """
    key = secret.encode()
    made = _begun(key).copy()
    made.update(b"%d;%d;" % (len(name), len(index)) + name + index)
    made.update(payload)
    made.update(key)
    return made.hexdigest()[:SEAL].encode()


@lru_cache(4)
def _begun(key: bytes) -> Any:
    """Return a SHA-256 hash that has taken in the key, padded to one block; callers continue on a copy."""
    return hashlib.sha256(key.ljust(BLOCK, b"\0"))


def with_seal(secret: str, key: str, payload: bytes, attachment: bytes | None) -> bytes:
    """Return the attachment of a message to participants with a line break and ``<time, ns>:<seal>`` at its end.

    `secret`: secret of the system; `key`: key of the message.
    """
    number = b"%d" % time.monotonic_ns()
    head = attachment or b""
    return head + b"\n" + number + b":" + seal_of(secret, key.encode() + b" " + number, head, payload)


def without_seal(attachment: bytes | None) -> tuple[bytes | None, bytes, bytes]:
    """Return attachment, time and seal of a message to participants; the last two are empty if it has no seal."""
    head, line, last = (attachment or b"").rpartition(b"\n")
    number, _, seal = last.partition(b":")
    if not line or not number.isdigit() or len(number) > MOST_DIGITS or len(seal) != SEAL:
        return attachment, b"", b""
    return head or None, number, seal


def new_digits() -> bytes:
    """Return new random digits for a query, by which the answer to another query is recognised and refused."""
    return b"%d" % secrets.randbelow(10 ** (MOST_DIGITS - 1))


def as_digits(given: str) -> bytes:
    """Return the digits that a query carries; empty if it carries none, or something else, as strangers may send."""
    return given.encode() if given.isascii() and given.isdigit() and len(given) <= MOST_DIGITS else b""


class Asked(NamedTuple):
    """Query on whose content the seal of its answer depends, as its sender sent it or as its server received it."""

    key: str
    digits: bytes
    """Random decimal digits that the sender of the query chose; empty = it expects no seal."""
    payload: bytes
    attachment: bytes | None

    def seal(self, secret: str, answer: bytes, attachment: bytes | None, *, failed: bool = False) -> bytes:
        """Return ``<digits>:<seal>`` of an answer to this query; empty without digits or without a secret.

        ``failed``: the answer is an error; its seal is another one, so that neither can be taken for the other.
        """
        if not (secret and self.digits):
            return b""
        more = self.attachment or b""
        kind = b"!" if failed else b"?"
        name = b"%s%s %s %d;" % (kind, self.key.encode(), self.digits, len(more)) + more + self.payload
        return self.digits + b":" + seal_of(secret, name, attachment or b"", answer)


def _hash(secret: str, service: str, head: str) -> str:
    return seal_of(secret, service.encode(), head.encode(), b"").decode()
