"""Links between processes that were lost while both ends kept their link to the router.

A peer of Zenoh learns of others when it joins, and never again: two processes that lose each other for longer than the
lease, as in a partition of half a second, stay apart as long as the router sees both, and it forwards nothing between
them. A session that joins anew is introduced to all by the router, and all of them to each other by that session; so
one is opened for a moment. It is a burden: all link to it, and a link too many that a busy machine makes then is not
always closed by Zenoh. Therefore the router is asked first whether who is missing lives.
"""
# pyright: reportUnknownMemberType=false

import threading
from collections.abc import Callable
from contextlib import suppress

import zenoh

from surefoot.bus.unread import LinkTrouble

INTRODUCE_S = 1.0
"""Time for which the session that introduces stays; processes of one machine or network link in some milliseconds."""
ROUTER_S = 1.0
"""Limit on the wait for the router, s; it answers in some milliseconds, and is asked again at the next look."""
LOOKS = 5
"""Answers of the router in a row that lack a process after which it has ended, however little they hold."""


class Mesh:
    """Looks at the links of a session again and again, and has those made anew that were lost.

    Args:
        linked: returns the names of the peers with a link to this one.
        visible: returns the names of the processes that show it a token of liveliness.
        alive: returns the names of those that show one to the router, this one among them; fewer where it is starved.
        introduce: has all processes linked to all. It takes a while, and ends early when the event is set that it gets.
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
        """Return the processes that live without a link to this one at two looks; their links are being made anew.

        What takes a while is done by a thread, and its result returned by a later look.
        """
        if self._busy is not None and self._busy.is_alive():
            return []
        named, self._named = self._named, []
        linked = self._linked()
        if linked != self._before or self._lost:
            self._before = linked
            self._busy = threading.Thread(target=self._check, args=(linked,), name="mesh", daemon=True)
            self._busy.start()
        return [LinkTrouble("unlinked", f"process {name!r} lives without a link to this one", name) for name in named]

    def settle(self) -> None:
        """Wait until the last check of the links has its result."""
        if self._busy is not None:
            self._busy.join(INTRODUCE_S + ROUTER_S)

    def close(self) -> None:
        """End what is under way: a thread that is in the network library when the interpreter ends aborts it."""
        self._over.set()
        self.settle()

    def _check(self, linked: set[str]) -> None:
        with suppress(zenoh.ZError):  # the session is closed, or the router gone: it introduces when it is back
            self._known |= self._visible() & linked
            before, self._lost = self._lost, self._known - linked
            if again := before & self._lost:
                alive = self._alive()
                self._looks = self._looks + 1 if again - alive else 0
                if self._looks >= LOOKS or (alive and self._known & self._linked() <= alive):
                    self._known -= again - alive  # else it saw too little to know who has ended
                    self._looks = 0
                if again & alive:
                    self._introduce(self._over)
                self._named = sorted(again & alive)


def linked_to(session: zenoh.Session) -> set[str]:
    """Return the names of the peers with a link to a session; a link to a router is made anew by Zenoh itself."""
    return {str(name) for name in session.info.peers_zid()}


def visible_to(session: zenoh.Session, tokens: str, timeout_s: float) -> set[str]:
    """Return the last words of the tokens of liveliness of all that a session sees."""
    found = session.liveliness().get(tokens, timeout=timeout_s)
    return {str(token.ok.key_expr).rpartition("/")[2] for token in found if token.ok is not None}
