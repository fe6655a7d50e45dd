"""Links between processes that were lost while both ends kept their link to the router.

Zenoh tells a peer of others where it joins, and never again: two processes that lose each other for longer than the
lease, as in a partition of half a second, stay apart as long as the router sees both. A session that joins anew is
introduced to all by the router, and all of them to each other by that session; so one is opened for a moment.
"""
# pyright: reportUnknownMemberType=false

import threading
from collections.abc import Callable, Iterable
from contextlib import suppress

import zenoh

INTRODUCE_S = 1.0
"""Time for which the session that introduces stays; processes of one machine or network link in some milliseconds."""


class Mesh:
    """Looks at the links of a session again and again, and has those made anew that are missing.

    Args:
        linked: returns the names of the processes with a link to this one.
        visible: returns the names of the processes that show a token of liveliness.
        introduce: has all processes linked to all; it may take a while.
    """

    def __init__(
        self, linked: Callable[[], set[str]], visible: Callable[[], set[str]], introduce: Callable[[], None]
    ) -> None:
        self._linked, self._visible, self._introduce = linked, visible, introduce
        self._before: set[str] | None = None
        self._suspects: set[str] = set()
        self._missing: set[str] = set()
        self._busy: threading.Thread | None = None

    def look(self) -> list[str]:
        """Return the visible processes without a link at this look and the last one, whose links are made anew.

        What takes a while is done by a thread, and its result returned by a later look.
        """
        if self._busy is not None and self._busy.is_alive():
            return []
        missing, self._missing = self._missing, set()
        linked = self._linked()
        if linked != self._before or self._suspects:
            self._before = linked
            self._busy = threading.Thread(target=self._check, args=(linked,), name="mesh", daemon=True)
            self._busy.start()
        return sorted(missing)

    def close(self) -> None:
        """Wait for the thread: one that is in the network library when the interpreter ends aborts it."""
        if self._busy is not None:
            self._busy.join(2 * INTRODUCE_S)

    def _check(self, linked: set[str]) -> None:
        with suppress(zenoh.ZError):  # the session is closed, or the router gone: it introduces when it is back
            unlinked = self._visible() - linked
            self._missing, self._suspects = unlinked & self._suspects, unlinked
            if self._missing:
                self._introduce()


def linked_to(session: zenoh.Session) -> set[str]:
    """Return the names of a session and of those with a link to it."""
    info = session.info
    names: Iterable[zenoh.ZenohId] = (info.zid(), *info.peers_zid(), *info.routers_zid())
    return {str(name) for name in names}
