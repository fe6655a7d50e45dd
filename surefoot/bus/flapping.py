"""Detection of clients that show and take away liveliness tokens without end, and the end of their links.

Each token that appears or vanishes costs a router about a tenth of a millisecond, whoever watches it, so that one
client takes all the time of a processor. Zenoh does not name who shows a token, so the clients are found by what waits
on their connections: the messages that show and take away tokens. Where none is seen, a client is found by its
traffic: the only connection that carries as many bytes as the tokens need, and carried less than half of it before.
"""
# pyright: reportUnknownMemberType=false

import math
import threading
import time
from collections.abc import Callable
from contextlib import suppress

import zenoh

from surefoot.bus.unread import MOST_NAMED, Connection, LinkTrouble, connections
from surefoot.bus.waiting import Waiting, end_connection, waiting_of

MOST_PER_S = 300.0
"""Largest number of tokens that appear or vanish per s in good order. Twenty services that start at once show 60
under each of their keys."""
LOOKS = 2
"""Number of looks in a row with more of them after which the link is ended; a burst of 2500 tokens is over before."""
AGAIN_S = 60.0
"""Time after the end of a link in which a client that floods, as the same one by a new link, loses its link at once, s;
that is `AT_ONCE` tokens after it began."""
AT_ONCE = 100
TOKEN_BYTES = 16
"""Lower bound on the bytes of a message that shows or takes away a token: its key alone is longer."""
EACH_PER_S = MOST_PER_S / 4
"""Smallest number of tokens per s of a client that loses its link while all clients together show more than
`MOST_PER_S`."""
LOOKS_IN_FLOOD = 20
"""Number of looks at what waits, a millisecond apart, while tokens come without end: a router that keeps up leaves
little of it."""
ENOUGH_BYTES = 256
"""Bytes of a connection without a token from which on its client is not the one that shows them."""


class Flapping:
    """Periodic check (`look`) of a router for a client that floods it with tokens, whose link is ended; on Linux only.

    Args:
        session: session whose links are checked.
        ours: returns whether a session is one of this system, whose link is never ended.
        counters: returns the byte counters by address of the other end.
        end_link: ends the connection to an address; returns whether there was one.
        clock: returns the time, s.
        waiting: returns what waits on the connections to addresses, looked at so many times.
    """

    def __init__(
        self,
        session: zenoh.Session,
        ours: Callable[[str], bool],
        counters: Callable[[], dict[str, Connection]] = lambda: dict(connections()),
        end_link: Callable[[str], bool] | None = None,
        clock: Callable[[], float] = time.monotonic,
        waiting: Callable[[set[str], int], dict[str, Waiting]] = waiting_of,
    ) -> None:
        self._session, self._ours, self._counters, self._clock = session, ours, counters, clock
        self._end_link = end_connection if end_link is None else end_link
        self._waiting = waiting
        self._changes, self._floods, self._at, self._ended_at = 0, 0, clock(), -AGAIN_S
        self._received: dict[str, int] = {}
        self._calm: tuple[dict[str, float], dict[str, float]] = {}, {}
        """Bytes per s of each connection, by address of the other end, at the last two checks without a flood. The
        older one counts, as bytes of the flood come before its tokens are counted."""
        self._named = set[str]()
        self._found: list[LinkTrouble] = []
        self._lock, self._due, self._over = threading.Lock(), threading.Event(), False
        self._thread: threading.Thread | None = None

    def note(self) -> None:
        """Record that a token appeared or vanished."""
        self._changes += 1
        if self._changes % AT_ONCE == 0 and self._thread is not None:
            self._due.set()

    def look(self) -> list[LinkTrouble]:
        """Return the floods of tokens since the last look, and the clients whose links were ended."""
        self._check()
        with self._lock:
            found, self._found = self._found, []
        return found

    def close(self) -> None:
        """End the thread that checks between two looks."""
        self._over = True
        self._due.set()
        if self._thread is not None:
            self._thread.join(1.0)

    def _check(self) -> None:
        with self._lock, suppress(zenoh.ZError):  # the session is closed
            now = self._clock()
            changes, span_s = self._changes, now - self._at
            if span_s <= 0.0:
                return
            self._changes, self._at = 0, now
            links = {str(link.dst).partition("/")[2]: str(link.zid) for link in self._session.info.links()}
            rates = self._rates(links, span_s)
            foreign = {address: rate for address, rate in rates.items() if not self._ours(links[address])}
            flood = changes > MOST_PER_S * span_s
            seen = self._seen(foreign, LOOKS_IN_FLOOD if flood else 1)
            shown = {address: rate * seen[address].share for address, rate in foreign.items() if address in seen}
            # tokens under words that nothing watches are seen on their connections only
            changes = max(changes, round(span_s * math.fsum(shown.values())))
            if changes <= MOST_PER_S * span_s:
                self._calm, self._floods = (self._calm[1], rates), 0
                return
            self._floods += 1
            text = f"{changes} liveliness tokens came or went in {span_s:.2f} s"
            self._found.append(LinkTrouble("token_flood", text, "", changes))
            if self._floods < LOOKS and now - self._ended_at > AGAIN_S:
                return
            guilty = [address for address, per_s in shown.items() if per_s >= EACH_PER_S]
            self._end(guilty or self._by_traffic(foreign, seen, changes / span_s), links, text)

    def _seen(self, rates: dict[str, float], looks: int) -> dict[str, Waiting]:
        """Return what waits on the connections that carry enough for a client that floods, by address."""
        fast = {address for address, rate in rates.items() if rate >= TOKEN_BYTES * EACH_PER_S}
        return self._waiting(fast, looks) if fast else {}

    def _by_traffic(self, rates: dict[str, float], seen: dict[str, Waiting], per_s: float) -> list[str]:
        """Return the address of the only connection that may carry so many tokens per s, none where there are two."""
        may = [
            address
            for address, rate in rates.items()
            if rate >= TOKEN_BYTES * per_s and rate > 2.0 * self._calm[0].get(address, 0.0)
        ]
        other = [address for address in may if address in seen and seen[address].other_than_tokens(ENOUGH_BYTES)]
        return may if len(may) == 1 and not other else []

    def _end(self, addresses: list[str], links: dict[str, str], text: str) -> None:
        for address in addresses:
            if self._end_link(address):
                self._ended_at = self._at
                self._found.append(self._ended(links[address], address, text))
        if self._thread is None and self._ended_at == self._at:
            thread = threading.Thread(target=self._stay, name="flapping", daemon=True)
            with suppress(RuntimeError):  # no memory for a thread now
                thread.start()
                self._thread = thread

    def _rates(self, links: dict[str, str], span_s: float) -> dict[str, float]:
        """Return the bytes per s that came over each link since the last check, by address of the other end."""
        found = self._counters()
        received = {address: found[address].received for address in links if address in found}
        before, self._received = self._received, received
        return {address: (count - before.get(address, 0)) / span_s for address, count in received.items()}

    def _ended(self, process: str, address: str, text: str) -> LinkTrouble:
        name = process if process in self._named or len(self._named) < MOST_NAMED else "others"
        self._named.add(name)
        return LinkTrouble(f"flooder {name}", f"the link to {process!r} at {address} was ended: {text}", name)

    def _stay(self) -> None:
        """Check after each `AT_ONCE` tokens, for `AGAIN_S` after the last end of a link."""
        try:
            while not self._over and self._clock() - self._ended_at <= AGAIN_S:
                if self._due.wait(AGAIN_S) and not self._over:
                    self._due.clear()
                    self._check()
        finally:
            self._thread = None
