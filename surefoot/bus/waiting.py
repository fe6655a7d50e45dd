"""Bytes on the TCP connections of this process that the network library has not read yet; on Linux only."""

import re
import socket
import time
from contextlib import suppress
from typing import NamedTuple

from surefoot.bus.unread import sockets

_TOKEN = re.compile(rb"\x9e\x21.[\x06\x07\x26\x27\x46\x47\x66\x67\x86\x87\xa6\xa7\xc6\xc7\xe6\xe7]", re.DOTALL)
"""A message of Zenoh's protocol 9 that declares with a quality of service (0x9e, 0x21) a token (6) or its end (7), with
any flags in the upper three bits. Other bytes have it once in a million."""
_MAYBE = re.compile(rb"\x1e[\x06\x07\x26\x27\x46\x47\x66\x67\x86\x87\xa6\xa7\xc6\xc7\xe6\xe7]")
"""The same without a quality of service. Other bytes have it once in 4096."""
_BYTES = 2**16
BETWEEN_S = 1e-3
"""Time between two looks, s."""


class Waiting(NamedTuple):
    """Bytes that were seen to wait on a connection.

    Attributes:
        size: number of bytes.
        tokens: number of messages among them that show or take away a token.
        maybe: number of places at which there may be such a message without a quality of service.
    """

    size: int = 0
    tokens: int = 0
    maybe: int = 0

    @property
    def share(self) -> float:
        """Return the number of messages that show or take away a token for each byte."""
        return self.tokens / self.size if self.size else 0.0

    def other_than_tokens(self, least: int) -> bool:
        """Return whether at least so many bytes were seen, and hardly a message of a token among them."""
        return self.size >= least and (self.tokens + self.maybe) * least < self.size

    def plus(self, data: bytes) -> "Waiting":
        tokens, maybe = (len(one.findall(data)) for one in (_TOKEN, _MAYBE))
        return Waiting(self.size + len(data), self.tokens + tokens, self.maybe + maybe)


def waiting_of(addresses: set[str], looks: int) -> dict[str, Waiting]:
    """Return what waits on the connections to addresses, looked at so many times or until something was seen of each.

    Nothing is taken away: the network library reads all of it afterwards.
    """
    found = dict.fromkeys(addresses, Waiting())
    for look in range(looks):
        if look:
            time.sleep(BETWEEN_S)
        for address, one in sockets():
            if address in found and not found[address].size:
                with suppress(OSError):  # nothing waits
                    found[address] = found[address].plus(one.recv(_BYTES, socket.MSG_PEEK | socket.MSG_DONTWAIT))
        if all(one.size for one in found.values()):
            break
    return found


def end_connection(address: str) -> bool:
    """End the TCP connection of this process to an address; return False if there is none."""
    for there, one in sockets():
        if there == address:
            with suppress(OSError):  # closed meanwhile
                one.shutdown(socket.SHUT_RDWR)
                return True
    return False
