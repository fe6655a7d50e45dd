"""Names of processes, and frames, that only the processes of one system can make, by a secret of its supervisor.

The name of a process is that of its Zenoh session, 32 hexadecimal digits, and public: it stands in liveliness tokens,
frames and answers. A sealed name is ``f``, 3 random digits, 12 digits of the time since the machine was started, in ms,
and a keyed hash (BLAKE2b) of the service and these digits, cut to 16 digits. Whoever does not know the secret can copy
such a name, but can make none that is newer; services take the newest. What it cannot copy is the seal of a frame: a
keyed hash of the frame.
"""

import secrets
import time
from functools import lru_cache
from hashlib import blake2b

VARIABLE = "SUREFOOT_SECRET"
"""Variable of the environment by which the supervisor passes the secret on to the processes that it starts."""
DRAWN, BORN, SEAL = 4, 12, 16
"""Digits of the three parts of a name: drawn by lot, time, hash."""
MOST_KNOWN = 1024
"""Names whose check is remembered: strangers may show any number."""


def new_secret() -> str:
    """Return a new secret, 32 hexadecimal digits drawn by lot."""
    return secrets.token_hex(16)


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
    if not secret or len(name) != DRAWN + BORN + SEAL or not secrets.compare_digest(seal, _hash(secret, service, head)):
        return 0
    return int(head[DRAWN:], 16)


def seal_of(secret: str, name: bytes, index: bytes, payload: bytes) -> bytes:
    """Return the seal of a frame, 16 hexadecimal digits: a keyed hash of the name of its process and what it contains.

    A frame that is sent again has the seal of the first: it is the same.
    """
    made = blake2b(name + b";" + index, key=secret.encode()[:64], digest_size=SEAL // 2)
    made.update(payload)
    return made.hexdigest().encode()


def _hash(secret: str, service: str, head: str) -> str:
    return blake2b(f"{service}/{head}".encode(), key=secret.encode()[:64], digest_size=SEAL // 2).hexdigest()
