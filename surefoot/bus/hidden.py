"""Liveliness tokens under a key that is made from the secret of a system.

Zenoh passes each token to each process that watches its key, and lets every client show tokens under any key: one that
shows and takes away tokens of a service keeps all processes that watch that service from their work. Therefore a
process of a system with a secret shows its token twice, under the public key for clients and under a hidden key, and
its peers stop watching the public key of a service as soon as they have seen a process of it with a sealed name. From
then on no other process may act as that service anyway.

The first word of the hidden key begins with ``@``, so that no wildcard of a subscription or query finds it. A stranger
whose session is a peer can read it from the subscriptions of others; tokens that it shows there are counted like those
under the public key (docs/security.md).
"""

import threading
from collections.abc import Callable, Iterable
from typing import Any

from surefoot.bus.interface import Life
from surefoot.bus.seals import born_ms, seal_of


def hidden_word(secret: str) -> str:
    """Return the first word of the hidden keys of a system: ``@alive`` and the seal of ``alive``; empty without secret.

    Args:
        secret: secret of the system.
    """
    return f"@alive{seal_of(secret, b'alive', b'', b'').decode()}" if secret else ""


def sealed_for_any(secret: str, names: Iterable[str]) -> Callable[[str], bool]:
    """Return a function that returns whether the name of a process is sealed for any service of a system.

    The name of a driver is sealed for another service than `driver`, so that any of them counts.

    Args:
        secret: secret of the system.
        names: names of the services of the system.
    """
    known = tuple(names)
    return lambda instance: any(born_ms(secret, name, instance) for name in known)


class Merged:
    """Notices of one service under its hidden key and under its public one, passed on as one sequence to a reader.

    A process is visible while its token is there under one of the keys. From the first sealed process on the public
    key does not count any more: processes that are visible under it only leave.

    Args:
        sink: reader of the notices.
        sealed: returns whether the name of a process is sealed.
    """

    def __init__(self, sink: Callable[[Life], Any], sealed: Callable[[str], bool]) -> None:
        self._sink, self._sealed, self._lock = sink, sealed, threading.Lock()
        self._hidden, self._public = set[str](), set[str]()
        self.closed = False
        """True once the public key does not count any more."""

    def hidden(self, life: Life) -> None:
        """Add a notice under the hidden key."""
        with self._lock:
            self._note(life, self._hidden, self._public)
            if life.alive and not self.closed and self._sealed(life.instance):
                self.closed = True
                left = self._public - self._hidden
                self._public.clear()
                for instance in sorted(left):
                    self._sink(Life(life.service, instance, False))

    def public(self, life: Life) -> None:
        """Add a notice under the public key; it is ignored once that does not count any more."""
        with self._lock:
            if not self.closed:
                self._note(life, self._public, self._hidden)

    def _note(self, life: Life, here: set[str], there: set[str]) -> None:
        (here.add if life.alive else here.discard)(life.instance)
        if life.instance not in there:
            self._sink(life)
