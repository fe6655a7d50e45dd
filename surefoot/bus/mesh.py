"""Detection and repair of lost links between two processes that both still have their link to the router.

A peer of Zenoh discovers other peers only when it joins. Two processes that lose their link for longer than the lease,
as in a partition of half a second, therefore stay unlinked while the router has a link to both, and the router forwards
nothing between them. A session that joins anew makes Zenoh link all peers to it and to each other; so one is opened for
a moment. This costs links: all peers link to it, and Zenoh does not always close a surplus link that a busy machine
makes then. Therefore the router is asked first whether the missing process is alive.
"""
# pyright: reportUnknownMemberType=false

import threading
from collections.abc import Callable, Collection
from contextlib import suppress

import zenoh
from zenoh.handlers import Callback

from surefoot.bus.unread import LinkTrouble

INTRODUCE_S = 1.0
"""Time for which the session that makes Zenoh link all processes to each other stays open, s."""
ROUTER_S = 1.0
"""Limit on the wait for an answer of the router, s; after it the router is asked again at the next check."""
LOOKS = 5
"""Number of answers of the router in a row in which a process is absent, after which the process counts as ended."""


class Mesh:
    """Check of the links of a session, called periodically (`look`), that restores lost links.

    Args:
        linked: returns the names of the peers with a link to this process.
        visible: returns the names of the processes whose liveliness tokens reach this process.
        alive: returns the names of the processes whose tokens reach the router, this one included; on a busy machine
            some may be missing.
        introduce: links all processes to each other. It takes a while, and ends early once the given event is set.
    """

    def __init__(
        self,
        linked: Callable[[], set[str]],
        visible: Callable[[], set[str]],
        alive: Callable[[], set[str]],
        introduce: Callable[[threading.Event], None],
    ) -> None:
        self._linked, self._visible, self._alive, self._introduce = linked, visible, alive, introduce
        self._before, self._known, self._lost = set[str](), set[str](), set[str]()
        self._named: list[str] = []
        self._looks = 0
        self._busy: threading.Thread | None = None
        self._over = threading.Event()

    def look(self) -> list[LinkTrouble]:
        """Return the live processes without a link to this one at two checks in a row; their links are restored.

        A thread does the checks, so a call may return the result of an earlier one.
        """
        if self._busy is not None and self._busy.is_alive():
            return []
        named, self._named = self._named, []
        linked = self._linked()
        if linked != self._before or self._lost:
            thread = threading.Thread(target=self._check, args=(linked,), name="mesh", daemon=True)
            with suppress(RuntimeError):  # no memory for a thread now: the next call tries it again
                thread.start()
                self._before, self._busy = linked, thread
        return [LinkTrouble("unlinked", f"process {name!r} lives without a link to this one", name) for name in named]

    def settle(self) -> None:
        """Wait until the last check of the links has ended, for 2 s at most."""
        if self._busy is not None:
            self._busy.join(INTRODUCE_S + ROUTER_S)

    def close(self) -> None:
        """End a running check, as a thread that is still in the network library would abort the process at its exit."""
        self._over.set()
        self.settle()

    def _check(self, linked: set[str]) -> None:
        with suppress(zenoh.ZError):  # the session is closed, or the router gone: it introduces when it is back
            self._known |= self._visible() & linked
            before, self._lost = self._lost, self._known - linked
            again = before & self._lost
            if again and not self._over.is_set():
                alive = self._alive()
                self._looks = self._looks + 1 if again - alive else 0
                if self._looks >= LOOKS or (alive and self._known & self._linked() <= alive):
                    self._known -= again - alive  # else it saw too little to know who has ended
                    self._looks = 0
                if again & alive and not self._over.is_set():
                    self._introduce(self._over)
                self._named = sorted(again & alive)


def linked_to(session: zenoh.Session) -> set[str]:
    """Return the names of the peers with a link to a session, without routers, to which Zenoh reconnects by itself."""
    return {str(name) for name in session.info.peers_zid()}


def visible_to(session: zenoh.Session, tokens: str, timeout_s: float) -> set[str]:
    """Return the last word, the process name, of each liveliness token that matches the key expression ``tokens``."""
    return {key.rpartition("/")[2] for key in tokens_of(session, tokens, timeout_s)}


def tokens_of(session: zenoh.Session, tokens: str, timeout_s: float) -> list[str]:
    """Return the keys of the liveliness tokens that match the key expression ``tokens``, in ``timeout_s`` s at most."""
    return tokens_of_any(session, (tokens,), timeout_s)


def tokens_of_any(session: zenoh.Session, tokens: Collection[str], timeout_s: float) -> list[str]:
    """Return the keys of the liveliness tokens that match any of some key expressions, in ``timeout_s`` s at most.

    A peer knows most tokens itself, and Zenoh passes these on within the call, in the calling thread. A channel of
    limited size, as Zenoh's default of 256, would block the whole session for good if a stranger shows more tokens.
    """
    found, over, open_ = list[str](), threading.Event(), list(tokens)

    def on_reply(reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            found.append(str(reply.ok.key_expr))

    def on_end() -> None:
        open_.pop()
        if not open_:
            over.set()

    for one in tokens:
        session.liveliness().get(one, handler=Callback(on_reply, on_end, indirect=False), timeout=timeout_s)
    over.wait(timeout_s + ROUTER_S)
    return found[:]
