"""Liveliness tokens that a session watches: those of the services that it needs, not those of every name.

Zenoh passes each token to each process that watches its name, and the time for one grows with the number of tokens.
2500 of one client, under names of no service, took 7 s of processor time in a router and six peers that watched all
names, and 0.5 s where only the router does.
"""
# pyright: reportUnknownMemberType=false

import os
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

import zenoh
from zenoh.handlers import Callback

from surefoot.bus.hidden import Merged, sealed_for_any
from surefoot.bus.interface import Life
from surefoot.bus.pour import keep_thread_state
from surefoot.bus.seals import DRIVER
from surefoot.bus.unread import MOST_NAMED, LinkTrouble

LIVE, STARTS = "alive", "starts"
"""`LIVE`: first word of the liveliness-token key of a process that is ready; `STARTS`: first word of the key that a
process shows from its start on."""
SERVICES = "SUREFOOT_SERVICES"
"""Environment variable by which the supervisor passes the names of its system's services, with commas between them."""
MOST_ADDED, MOST_FOREIGN = 16, 64
"""`MOST_ADDED`: largest number of names that are watched besides those of the system, as of services that are started
by hand; `MOST_FOREIGN`: largest number of visible tokens under such names that the router's session reads."""
MAX_SHOWN = 64
"""Characters to which a name of no service is cut in reports; beyond `MOST_NAMED` they count under the empty name."""
_NAME = set("abcdefghijklmnopqrstuvwxyz0123456789_")


def given_services() -> tuple[str, ...]:
    """Return the names of the services of this system from the environment; empty = they are not known."""
    return tuple(filter(_is_name, os.environ.get(SERVICES, "").split(",")))


def _owners() -> set[str]:
    """Return the services that own a topic or a query."""
    from surefoot.schemas.topics import QUERIES, TOPICS  # here: `surefoot stop` watches nothing, and does without

    return {row.owner for row in (*TOPICS, *QUERIES)}


def _is_name(service: str) -> bool:
    return bool(service) and set(service) <= _NAME


class Foreign:
    """Filter of liveliness tokens under names of no service: the first few are passed on, all others only counted.

    Args:
        known: names of the services of the system, and others whose tokens are all passed on.
        counts: counter of the tokens under other names that came, by name.
        ours: names of services that somebody may start by hand; one visible process of each is not counted.
    """

    def __init__(self, known: Iterable[str], counts: Counter[str], ours: Iterable[str] = ()) -> None:
        self._known, self._counts, self._ours = frozenset(known), counts, frozenset(ours)
        self._passed = set[tuple[str, str]]()
        self._by_hand: dict[str, str] = {}
        """Process of each service started by hand that is visible, by service."""

    def passes(self, life: Life) -> bool:
        """Return whether a notice is passed on: of a known name, or of one of the first `MOST_FOREIGN` other tokens."""
        if life.service in self._known:
            return True
        place = life.service, life.instance
        if not life.alive:
            passed = place in self._passed
            self._passed.discard(place)
            if self._by_hand.get(life.service) == life.instance:
                del self._by_hand[life.service]
            return passed
        few = len(self._passed) < MOST_FOREIGN and life.service in self._ours
        if few and self._by_hand.setdefault(life.service, life.instance) == life.instance:
            self._passed.add(place)
            return True
        name = life.service[:MAX_SHOWN]
        self._counts[name if name in self._counts or len(self._counts) < MOST_NAMED else ""] += 1
        if len(self._passed) >= MOST_FOREIGN:
            return False
        self._passed.add(place)
        return True


class Tokens:
    """Subscriptions of one session to liveliness tokens, by service.

    Args:
        session: session of Zenoh.
        services: names of the services of the system; empty = they are not known, all names are watched.
        everything: watch all names, as the router does, which counts the tokens under names of no service.
        hidden: first word of the hidden keys of the system (see `hidden`); empty = there are none.
        secret: secret of the system; empty = none.
        on_change: called when a token appears or vanishes under the public or the hidden key of any name, if all names
            are watched.
    """

    def __init__(
        self,
        session: zenoh.Session,
        services: tuple[str, ...],
        *,
        everything: bool,
        hidden: str = "",
        secret: str = "",
        on_change: Callable[[], None] = lambda: None,
    ) -> None:
        self._on_change = on_change
        self._session, self._services = session, services
        self._hidden, self._sealed = hidden, sealed_for_any(secret, services)
        self._merged: dict[str, list[Merged]] = {}
        """Readers of the services whose tokens are watched under hidden keys and under public ones, by service."""
        self._everything = everything or not services
        self._keep: dict[str, list[zenoh.Subscriber[None]]] = {}
        self._public: dict[str, list[zenoh.Subscriber[None]]] = {}
        """Subscriptions to the public keys of services that are watched under hidden keys, too, by service."""
        self._added: dict[str, int] = {}
        """Number of visible tokens of each name that was added to those of the system."""
        self._sinks: list[Callable[[Life], Any]] = []
        self._foreign: Counter[str] = Counter()

    def watch(self, sink: Callable[[Life], Any], services: Iterable[str] | None) -> None:
        """Deliver a notice whenever a process of one of the services, or of those added later, appears or leaves.

        Without ``services`` those of the system count. Any of them that owns no topic or query may drive the ticks, and
        is watched always: the name of the driver is sealed for it.
        """
        owners = set[str]() if services is None else _owners()
        names = self._services if services is None else (*services, *(s for s in self._services if s not in owners))
        if not self._everything:
            self._sinks.append(sink)
            for service in sorted({*names, DRIVER}):
                self._subscribe(service, sink, indirect=False)
            return
        first = not self._keep  # counted once, however many watch
        known = (*self._services, *names, DRIVER)
        foreign = Foreign(known, self._foreign if first else Counter(), _owners()) if self._services else None

        def on_life(life: Life) -> None:
            if first:
                self._on_change()
            if foreign is None or foreign.passes(life):
                sink(life)

        self._subscribe("*", on_life, indirect=True)
        if first and self._hidden:
            hidden = self._declare(self._hidden, "*", lambda life: self._on_change(), indirect=True)
            self._keep[self._hidden] = [hidden]

    @property
    def expressions(self) -> tuple[str, ...]:
        """Key expressions that find the tokens of all processes that may be participants."""
        names = (*self._services, DRIVER)
        if not self._services:
            return (f"{LIVE}/*/*",)
        merged = tuple(self._merged.items())  # of another thread: `add` may change them meanwhile
        closed = {name for name, readers in merged if all(one.closed for one in readers)}
        hidden = (f"{self._hidden}/{name}/*" for name in names) if self._hidden else ()
        return (*hidden, *(f"{LIVE}/{name}/*" for name in names if name not in closed))

    def troubles(self) -> list[LinkTrouble]:
        """Return the tokens under names of no service that came since the last call, as reports for health and log.

        Public keys that do not count any more are watched no longer from this call on.
        """
        for service, readers in tuple(self._merged.items()):
            if service in self._public and all(one.closed for one in readers):
                for subscriber in self._public.pop(service):
                    subscriber.undeclare()
        found = list(self._foreign.items())
        self._foreign.clear()
        text = "token of {!r}, which is no service of this system"
        return [LinkTrouble("foreign_token", f"{n}x a " + text.format(name or "others"), name, n) for name, n in found]

    def add(self, service: str) -> None:
        """Watch the tokens of one more service, if that can be its name.

        At most `MOST_ADDED` names are added. Then the oldest without a token is dropped; if all have one, nothing is
        added.
        """
        if self._everything or service in self._keep or not _is_name(service):
            return
        if len(self._added) >= MOST_ADDED:
            bare = next((name for name, tokens in self._added.items() if tokens <= 0), None)
            if bare is None:
                return
            del self._added[bare]
            for subscriber in (*self._keep.pop(bare), *self._public.pop(bare, ())):
                subscriber.undeclare()
            self._merged.pop(bare, None)
        self._added[service] = 0
        for sink in self._sinks:
            self._subscribe(service, sink, indirect=False)

    def _subscribe(self, service: str, sink: Callable[[Life], Any], *, indirect: bool) -> None:
        """Subscribe to the tokens of a service; ``indirect``: `sink` is called by a thread of its own."""

        def counted(life: Life) -> None:
            if life.service in self._added:
                self._added[life.service] += 1 if life.alive else -1
            sink(life)

        if not self._hidden or self._everything:
            self._keep.setdefault(service, []).append(self._declare(LIVE, service, counted, indirect))
            return
        merged = Merged(counted, self._sealed)
        self._merged.setdefault(service, []).append(merged)
        self._keep.setdefault(service, []).append(self._declare(self._hidden, service, merged.hidden, indirect))
        self._public.setdefault(service, []).append(self._declare(LIVE, service, merged.public, indirect))

    def _declare(
        self, word: str, service: str, sink: Callable[[Life], Any], indirect: bool
    ) -> "zenoh.Subscriber[None]":
        def on_sample(sample: zenoh.Sample) -> None:
            keep_thread_state()
            _, name, instance = str(sample.key_expr).rsplit("/", 2)
            sink(Life(name, instance, sample.kind == zenoh.SampleKind.PUT))

        handler = Callback(on_sample, indirect=indirect)
        return self._session.liveliness().declare_subscriber(f"{word}/{service}/*", handler, history=True)
