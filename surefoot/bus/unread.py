"""Detection of peers that read nothing, from the TCP counters of the kernel.

Zenoh drops messages that such a peer does not take, and names neither peer nor key. The kernel counts for each
connection the bytes that wait and the bytes that the other end has taken so far.
"""
# pyright: reportUnknownMemberType=false

import fcntl
import os
import socket
import stat
import struct
import termios
from collections.abc import Iterator
from contextlib import suppress
from typing import NamedTuple

import zenoh

_TAKEN_AT = 120  # of tcpi_bytes_acked in the kernel's struct tcp_info, whose fields keep their places
_TCP_INFO_BYTES = 192


class Connection(NamedTuple):
    """Byte counters of a TCP connection of this process.

    Attributes:
        waiting: bytes that the other end has not taken.
        taken: bytes that it has taken so far.
    """

    waiting: int
    taken: int


class LinkTrouble(NamedTuple):
    """Something wrong with the link to a peer.

    Attributes:
        reason: `unread` the peer reads nothing, `unlinked` it is alive but has no link to this process.
        text: message for the log.
        peer: name of its session.
    """

    reason: str
    text: str
    peer: str


class Unread:
    """Periodic check (`look`) of the connections of a session for peers that read nothing; works on Linux only."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._before: dict[str, Connection] = {}

    def look(self) -> list[LinkTrouble]:
        """Return the peers with unread bytes that have read none since the last call."""
        names = {str(link.dst).partition("/")[2]: str(link.zid) for link in self._session.info.links()}
        now = {address: found for address, found in connections() if address in names}
        stuck = [
            _unread(names[address], address, found.waiting)
            for address, found in now.items()
            if found.waiting and found.taken == self._before.get(address, Connection(0, -1)).taken
        ]
        self._before = now
        return stuck


def _unread(name: str, address: str, waiting: int) -> LinkTrouble:
    text = f"peer {name!r} at {address} reads nothing: {waiting / 2**20:.1f} MiB wait for it, what is beyond is dropped"
    return LinkTrouble("unread", text, name)


def connections() -> Iterator[tuple[str, Connection]]:
    """Yield address of the other end and byte counters of each TCP connection of this process."""
    try:
        numbers = [int(name) for name in os.listdir("/proc/self/fd")]
    except OSError:
        return
    for number in numbers:
        with suppress(OSError, ValueError, struct.error):  # closed meanwhile, no TCP, not connected, another kernel
            if stat.S_ISSOCK(os.fstat(number).st_mode):
                with socket.socket(fileno=os.dup(number)) as one:
                    host, port = one.getpeername()[:2]
                    (waiting,) = struct.unpack("i", fcntl.ioctl(one, termios.TIOCOUTQ, bytes(4)))
                    info = one.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _TCP_INFO_BYTES)
                    (taken,) = struct.unpack_from("Q", info, _TAKEN_AT)
                    yield (f"[{host}]:{port}" if ":" in host else f"{host}:{port}"), Connection(waiting, taken)
