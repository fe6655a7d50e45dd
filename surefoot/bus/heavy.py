"""Detection of clients that send more at a stretch than the largest message, from the TCP counters of the kernel.

Zenoh drops a message beyond its limit on arrival, and counts and names neither message nor sender.
"""
# pyright: reportUnknownMemberType=false

from collections.abc import Callable

import zenoh

from surefoot.bus.options import MAX_MESSAGE_BYTES
from surefoot.bus.unread import COUNTERS, Connection, LinkTrouble

CALM_BYTES = 8 << 20
"""Largest number of bytes that a client sends between two looks without being busy with a large message."""


class Heavy:
    """Periodic check (`look`) of the connections of a router for clients that send much; works on Linux only.

    Args:
        session: session whose clients are checked.
        counters: returns the byte counters by address of the other end.
    """

    def __init__(self, session: zenoh.Session, counters: Callable[[], dict[str, Connection]] = COUNTERS.read) -> None:
        self._session, self._counters = session, counters
        self._before: dict[str, int] = {}
        self._stretch: dict[str, int] = {}

    def look(self) -> list[LinkTrouble]:
        """Return the clients that sent more bytes without a pause than the largest message has; restart their count."""
        info = self._session.info
        others = {str(name) for name in (*info.peers_zid(), *info.routers_zid())}
        found = self._counters()
        clients = {
            address: str(link.zid)
            for link in info.links()
            if str(link.zid) not in others and (address := str(link.dst).partition("/")[2]) in found
        }
        now, stretch = {address: found[address].received for address in clients}, dict[str, int]()
        troubles = list[LinkTrouble]()
        for address, received in now.items():
            grown = received - self._before.get(address, 0)
            if grown <= CALM_BYTES:
                continue
            sent = self._stretch.get(address, 0) + grown
            if sent > MAX_MESSAGE_BYTES:
                troubles.append(_heavy(clients[address], address, sent))
                sent = 0
            stretch[address] = sent
        self._before, self._stretch = now, stretch
        return troubles


def _heavy(name: str, address: str, sent: int) -> LinkTrouble:
    text = f"client {name!r} at {address} sent {sent >> 20} MiB at a stretch; what is larger than "
    return LinkTrouble("heavy", f"{text}{MAX_MESSAGE_BYTES >> 20} MiB is dropped on arrival", name)
