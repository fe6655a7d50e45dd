"""Detection of peers that read nothing, from the TCP counters of the kernel.

Zenoh drops messages that such a peer does not take, and names neither peer nor key. The kernel counts for each
connection the bytes that wait and the bytes that the other end has taken so far.
"""
# pyright: reportUnknownMemberType=false

import fcntl
import math
import os
import socket
import stat
import struct
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import NamedTuple

import zenoh

_TAKEN_AT = 120  # of tcpi_bytes_acked in the kernel's struct tcp_info, whose fields keep their places
_RECEIVED_AT = 128  # of tcpi_bytes_received
_TCP_INFO_BYTES = 192
FRESH_S = 0.2
"""Largest age of the byte counters of all connections at which they are reused instead of read again, s."""


class Connection(NamedTuple):
    """Byte counters of a TCP connection of this process.

    Attributes:
        waiting: bytes that the other end has not taken.
        taken: bytes that it has taken so far.
        received: bytes that came from it so far.
    """

    waiting: int
    taken: int
    received: int = 0


MOST_NAMED = 16
"""Largest number of keys, clients or names that a report of trouble lists one by one; it sums up further ones."""


class LinkTrouble(NamedTuple):
    """Fault of the link to a peer, with reason, text for the log and name of the peer.

    Attributes:
        reason: `unread` the peer reads nothing, `unlinked` it is alive but has no link to this process, `late`
            messages of a process come after later ones, `forged` messages in the name of a process lack its seal,
            `foreign_token` liveliness tokens are shown under a name of no service, `too_large` messages are larger than
            any legal one of their key, `heavy` a client sends more at a stretch than the largest message, `token_flood`
            tokens come and go without end, `flooder <session>` the link to the client that shows them was ended.
        text: message for the log.
        peer: name of its session; of late and forged messages their key, of tokens their name.
        number: number by which it counts.
    """

    reason: str
    text: str
    peer: str
    number: int = 1


class _Counters:
    """Byte counters of the connections of this process, by address of the other end, read once for all its sessions.

    Ten robots in one process have 1600 connections; if each of their 40 sessions read all of them twice a second, they
    did nothing else.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._found: dict[str, Connection] = {}
        self._read_at = -math.inf

    def read(self) -> dict[str, Connection]:
        """Return the byte counters of all connections, by address of the other end, at most ``FRESH_S`` old."""
        with self._lock:
            if time.monotonic() - self._read_at > FRESH_S:
                self._found = dict(connections())
                self._read_at = time.monotonic()
            return self._found


COUNTERS = _Counters()


class Unread:
    """Periodic check (`look`) of the connections of a session for peers that read nothing; works on Linux only.

    Args:
        session: session whose peers are checked.
        counters: returns the byte counters by address of the other end.
    """

    def __init__(self, session: zenoh.Session, counters: Callable[[], dict[str, Connection]] = COUNTERS.read) -> None:
        self._session, self._counters = session, counters
        self._before: dict[str, Connection] = {}

    def look(self) -> list[LinkTrouble]:
        """Return the peers with unread bytes that have read none since the last call."""
        names = {str(link.dst).partition("/")[2]: str(link.zid) for link in self._session.info.links()}
        found = self._counters()
        now = {address: found[address] for address in names if address in found}
        stuck = [
            _unread(names[address], address, one.waiting)
            for address, one in now.items()
            if one.waiting and one.taken == self._before.get(address, Connection(0, -1)).taken
        ]
        self._before = now
        return stuck


def _unread(name: str, address: str, waiting: int) -> LinkTrouble:
    text = f"peer {name!r} at {address} reads nothing: {waiting / 2**20:.1f} MiB wait for it, what is beyond is dropped"
    return LinkTrouble("unread", text, name)


def connections() -> Iterator[tuple[str, Connection]]:
    """Yield address of the other end and byte counters of each TCP connection of this process."""
    for address, one in sockets():
        with suppress(OSError, struct.error):  # closed meanwhile, no TCP, another kernel
            info = one.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _TCP_INFO_BYTES)
            (waiting,) = struct.unpack("i", fcntl.ioctl(one.fileno(), termios.TIOCOUTQ, bytes(4)))
            (taken,) = struct.unpack_from("Q", info, _TAKEN_AT)
            (received,) = struct.unpack_from("Q", info, _RECEIVED_AT)
            yield address, Connection(waiting, taken, received)


def sockets() -> Iterator[tuple[str, socket.socket]]:
    """Yield address of the other end and each connected socket of this process, which stays the network library's."""
    try:
        numbers = [int(name) for name in os.listdir("/proc/self/fd")]
    except OSError:
        return
    for number in numbers:
        try:
            if not stat.S_ISSOCK(os.fstat(number).st_mode):
                continue
            one = socket.socket(socket.AF_INET, socket.SOCK_STREAM, 0, fileno=number)  # names spare system calls
        except OSError:
            continue  # closed meanwhile
        try:
            with suppress(OSError, ValueError):  # closed meanwhile, not connected, of another family
                yield address_of(one), one
        finally:
            one.detach()


def address_of(one: socket.socket) -> str:
    """Return the address of the other end of a connected socket, as Zenoh writes it (raises OSError: not connected)."""
    host, port = one.getpeername()[:2]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
