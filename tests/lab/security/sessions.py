"""Zenoh sessions that show a certificate and keep no rules of their own, as a hostile process would."""

import json
import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import Any

import zenoh

from surefoot.lab.security.grants import Grant, Verb
from tests.surefoot.net import WAIT_S, wait_until

WORD = "w"
"""Word that stands for ``*`` where a key is used."""
ASK_S = 2.0  # s, a query that is not answered ends then
TOKENS = ("alive/", "starts/")
MARK = "alive/of/all"

Tried = set[tuple[Verb, str]]


def open_session(mode: str, settings: dict[str, Any], *, connect: str = "", listen: str = "") -> zenoh.Session:
    """Open a session with these settings."""
    config = zenoh.Config()
    place = {
        "mode": mode, "connect/endpoints": [connect] if connect else [], "listen/endpoints": [listen] if listen else [],
        "scouting/multicast/enabled": False, "scouting/delay": 0, "connect/timeout_ms": 3000,
        "connect/exit_on_failure": True,
    }  # fmt: skip
    for key, value in (settings | place).items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def settings_in(folder: Path, identity: str, *, rules: bool) -> dict[str, Any]:
    """Return the settings of an identity, with or without the rules for others."""
    found = json.loads((folder / f"{identity}.json").read_text())
    return found if rules else {"transport": found["transport"]}


def allowed(granted: Iterable[Grant], identity: str, keys: Iterable[str]) -> Tried:
    """Return what an identity may do with the keys, by its grants alone."""
    own = [grant for grant in granted if grant.identity == identity]
    return {(grant.verb, key) for grant in own for key in keys if zenoh.KeyExpr(grant.key).includes(_used(key))}


class Trial:
    """One identity tries every verb on every key at the other end of its link, whose own user may do anything.

    Args:
        one: session of the identity.
        other: session that keeps the rules.
        namespace: prefix of the keys.
        keys: expressions of topics, queries and tokens, all that are granted to anybody.
    """

    def __init__(self, one: zenoh.Session, other: zenoh.Session, namespace: str, keys: Iterable[str]) -> None:
        self._one, self._other, self._prefix = one, other, f"{namespace}/"
        places = {f"{namespace}/{_used(key)}": key for key in keys}
        self._data = {place: key for place, key in places.items() if not key.startswith(TOKENS)}
        self._tokens = {place: key for place, key in places.items() if key.startswith(TOKENS)}
        self.found: Tried = set()

    def run(self, may: Tried) -> Tried:
        """Return what happened; all that may happen is waited for."""
        self._towards(self._one, self._other, Verb.PUBLISH, Verb.ASK, may)
        self._towards(self._other, self._one, Verb.READ, Verb.SERVE, may)
        self._show(may)
        return self.found

    def _towards(self, sender: zenoh.Session, taker: zenoh.Session, put: Verb, ask: Verb, may: Tried) -> None:
        kept: list[Any] = []
        for place, key in self._data.items():
            kept.append(taker.declare_subscriber(place, lambda sample, key=key: self.found.add((put, key))))
            kept.append(taker.declare_queryable(place, lambda query, key=key, place=place: _answer(query, place)))

        def tried() -> bool:
            for place in self._data:
                sender.put(place, b"1")
            left = threading.Semaphore(0)
            for place, key in self._data.items():
                handler = zenoh.handlers.Callback(_noter(self.found, ask, key), left.release)
                sender.get(place, handler, timeout=ASK_S)
            for _ in self._data:
                assert left.acquire(timeout=WAIT_S)
            return {one for one in may if one[0] in (put, ask)} <= self.found

        _repeat(tried)
        for item in kept:
            item.undeclare()

    def _show(self, may: Tried) -> None:
        kept = [self._one.liveliness().declare_token(place) for place in self._tokens]
        kept.append(self._other.liveliness().declare_token(self._prefix + MARK))
        _repeat(lambda: self._seen(may))
        for item in kept:
            item.undeclare()

    def _seen(self, may: Tried) -> bool:
        shown = [self._other.liveliness().get(f"{self._prefix}{word}*/*", timeout=ASK_S) for word in TOKENS]
        for reply in chain(*shown):
            if reply.ok is not None and str(reply.ok.key_expr) in self._tokens:
                self.found.add((Verb.SHOW, self._tokens[str(reply.ok.key_expr)]))
        seen = [str(reply.ok.key_expr) for reply in self._one.liveliness().get(f"{self._prefix}alive/*/*") if reply.ok]
        if self._prefix + MARK in seen:
            self.found |= {(Verb.WATCH, key) for key in self._tokens.values()}
        return {one for one in may if one[0] in (Verb.SHOW, Verb.WATCH)} <= self.found


def _repeat(tried: Callable[[], bool]) -> None:
    """Try again what may be done, while the other end has yet to learn of it, and once more what may not."""
    with suppress(AssertionError):  # the comparison that follows names what is lacking
        wait_until(tried)
    tried()


def _noter(found: Tried, verb: Verb, key: str) -> Callable[[zenoh.Reply], None]:
    def note(reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            found.add((verb, key))

    return note


def _answer(query: zenoh.Query, place: str) -> None:
    with query:
        query.reply(place, b"1")


def _used(key: str) -> str:
    return key.replace("*", WORD)
