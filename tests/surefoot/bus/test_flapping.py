"""A client that shows and takes away tokens without end loses its link; no other client does."""

import socket
import threading
from contextlib import suppress
from itertools import count
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from surefoot.bus.flapping import AGAIN_S, AT_ONCE, LOOKS, MOST_NAMED, Flapping
from surefoot.bus.interface import Life
from surefoot.bus.unread import Connection, LinkTrouble
from surefoot.bus.waiting import Waiting, end_connection
from tests.surefoot.net import Net, wait_until

FLOOD = 2000
TOKEN = 50
"""Bytes of a message that shows a token."""
FLAPS = Waiting(1200, 24)
IMAGES = Waiting(60000, 0, 15)


class Router:
    """Router with a number of links, whose traffic a test sets, and a clock that it moves."""

    def __init__(self, *links: str) -> None:
        self.now, self.ended = 0.0, list[str]()
        self.sent = dict.fromkeys(links, 0)
        self.waits = dict[str, Waiting]()
        """Bytes that wait on each link; nothing is seen of others."""
        self.flapping = Flapping(
            self._session(),
            lambda name: name.startswith("sealed"),
            self._counters,
            self._end,
            self.time,
            lambda addresses, looks: {one: self.waits[one[:-2]] for one in addresses if one[:-2] in self.waits},
        )

    def _session(self) -> Any:
        links = lambda: [SimpleNamespace(dst=f"tcp/{one}:1", zid=one) for one in self.sent]  # noqa: E731
        return SimpleNamespace(info=SimpleNamespace(links=links))

    def _counters(self) -> dict[str, Connection]:
        return {f"{one}:1": Connection(0, 0, sent) for one, sent in self.sent.items()}

    def _end(self, address: str) -> bool:
        self.ended.append(address[:-2])
        return True

    def time(self) -> float:
        return self.now

    def second(self, changes: int = 0, **sent: int) -> list[LinkTrouble]:
        """Return the reports of a look after a second of so many changes of tokens, and bytes of each link."""
        for name, size in sent.items():
            self.sent[name] = self.sent.get(name, 0) + size
        for _ in range(changes):
            self.flapping.note()
        self.now += 1.0
        return self.flapping.look()


def test_the_client_that_floods_is_counted_named_and_loses_its_link() -> None:
    router = Router("sealed1", "viewer")
    for _ in range(2):
        assert router.second(60, sealed1=60 * TOKEN, viewer=10**6) == []
    first = router.second(FLOOD, sealed1=10**7, viewer=10**6, flapper=FLOOD * TOKEN)
    assert [(one.reason, one.number) for one in first] == [("token_flood", FLOOD)]
    assert router.ended == []
    flood, ended = router.second(FLOOD, sealed1=10**7, viewer=10**6, flapper=FLOOD * TOKEN)
    assert (flood.reason, flood.number) == ("token_flood", FLOOD)
    assert (ended.reason, ended.number) == ("flooder flapper", 1)
    assert "flapper:1" in ended.text
    assert router.ended == ["flapper"]
    router.flapping.close()


def test_a_burst_is_counted_and_ends_nothing() -> None:
    router = Router("viewer")
    assert len(router.second(10 * FLOOD, burst=10 * FLOOD * TOKEN)) == 1
    assert router.second(0) == []
    assert len(router.second(10 * FLOOD, burst=10 * FLOOD * TOKEN)) == 1
    assert router.ended == []


def test_two_clients_that_flood_at_once_are_named_and_both_lose_their_links() -> None:
    router = Router("viewer")
    router.waits = {"a": FLAPS, "b": FLAPS, "viewer": IMAGES}
    for _ in range(2):
        router.second(0, viewer=0)
    router.second(FLOOD, a=FLOOD * TOKEN // 2, b=FLOOD * TOKEN // 2, viewer=10**7)
    assert router.ended == []
    reports = router.second(FLOOD, a=FLOOD * TOKEN // 2, b=FLOOD * TOKEN // 2, viewer=10**7)
    assert [one.reason for one in reports] == ["token_flood", "flooder a", "flooder b"]
    assert router.ended == ["a", "b"]
    router.flapping.close()


def test_a_client_that_begins_to_send_keeps_its_link_beside_one_that_floods_and_sent_as_much_before() -> None:
    router = Router("flapper", "starter")
    router.waits = {"flapper": IMAGES}
    for _ in range(2):
        router.second(0, flapper=FLOOD * TOKEN, starter=0)
    router.waits = {"flapper": FLAPS, "starter": IMAGES}
    for _ in range(LOOKS):
        router.second(FLOOD, flapper=FLOOD * TOKEN, starter=10 * FLOOD * TOKEN)
    assert router.ended == ["flapper"]
    router.flapping.close()


def test_a_client_that_begins_to_send_is_not_taken_for_one_whose_tokens_are_not_seen() -> None:
    router = Router("flapper", "starter")
    router.waits = {"starter": IMAGES}
    for _ in range(2):
        router.second(0, flapper=FLOOD * TOKEN, starter=0)
    for _ in range(3 * LOOKS):
        router.second(FLOOD, flapper=FLOOD * TOKEN, starter=10 * FLOOD * TOKEN)
    assert router.ended == []


def test_a_client_that_floods_under_another_first_word_is_named_and_loses_its_link() -> None:
    router = Router("sealed1")
    router.waits = {"flapper": FLAPS, "sealed1": FLAPS}
    reasons = [one.reason for _ in range(LOOKS) for one in router.second(flapper=FLOOD * TOKEN, sealed1=10**6)]
    assert reasons == ["token_flood", "token_flood", "flooder flapper"]
    assert router.ended == ["flapper"]
    router.flapping.close()


def test_where_two_clients_may_be_the_one_and_nothing_is_seen_of_either_neither_is_ended() -> None:
    router = Router("a", "b")
    for _ in range(3 * LOOKS):
        router.second(FLOOD, a=FLOOD * TOKEN, b=FLOOD * TOKEN)
    assert router.ended == []


def test_clients_that_send_as_before_sessions_of_the_system_and_quiet_ones_keep_their_links() -> None:
    router = Router("stream", "sealed1", "quiet")
    for _ in range(2):
        router.second(0, stream=FLOOD * TOKEN, sealed1=0, quiet=9)
    for _ in range(3 * LOOKS):
        router.second(FLOOD, stream=FLOOD * TOKEN, sealed1=FLOOD * TOKEN, quiet=FLOOD)
    assert router.ended == []


def test_the_same_client_by_a_new_link_loses_it_at_once_for_a_while() -> None:
    router = Router()
    for _ in range(LOOKS):
        router.second(FLOOD, again=FLOOD * TOKEN)
    ended = threading.Event()
    router.flapping._end_link = lambda address: not ended.set()  # pyright: ignore[reportPrivateUsage]
    router.now += 0.1
    router.sent["again"] += AT_ONCE * TOKEN
    for _ in range(AT_ONCE):
        router.flapping.note()
    assert ended.wait(20.0)
    router.flapping.close()
    router.now += AGAIN_S
    router.second()
    assert [one.reason for one in router.second(FLOOD, again=FLOOD * TOKEN)][-1] == "token_flood"


def test_between_two_looks_the_links_are_checked_once_for_each_hundred_tokens() -> None:
    router = Router()
    for _ in range(LOOKS):
        router.second(FLOOD, again=FLOOD * TOKEN)
    flapping = router.flapping
    flapping.close()
    flapping._over = False  # pyright: ignore[reportPrivateUsage]

    def end(address: str) -> bool:
        router.ended.append(address[:-2])
        flapping._over = True  # pyright: ignore[reportPrivateUsage]
        return True

    flapping._end_link = end  # pyright: ignore[reportPrivateUsage]
    moments = count(1)
    flapping._clock = lambda: router.now + 0.1 * next(moments)  # pyright: ignore[reportPrivateUsage]
    router.sent["again"] += AT_ONCE * TOKEN
    for _ in range(AT_ONCE):
        flapping.note()
    flapping._due.set()  # pyright: ignore[reportPrivateUsage]
    flapping._stay()  # pyright: ignore[reportPrivateUsage]
    assert router.ended == ["again", "again"]
    flapping._over = False  # pyright: ignore[reportPrivateUsage]
    router.now += 3 * AGAIN_S
    flapping._stay()  # pyright: ignore[reportPrivateUsage]
    assert router.ended == ["again", "again"]


def test_few_clients_are_named() -> None:
    router, reasons = Router(), set[str]()
    for number in range(2 * MOST_NAMED):
        for _ in range(LOOKS):
            reasons |= {one.reason for one in router.second(FLOOD, **{f"x{number}": FLOOD * TOKEN})}
        router.sent.clear()
    assert len(reasons) == 1 + MOST_NAMED + 1
    assert "flooder others" in reasons
    router.flapping.close()


def test_the_connection_to_an_address_is_ended_and_no_other() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        ends = [socket.create_connection(server.getsockname()) for _ in range(3)]
        here = [server.accept()[0] for _ in ends]
        host, port = ends[1].getsockname()
        assert end_connection(f"{host}:{port}")
        assert ends[1].recv(1) == b""
        ends[0].sendall(b"x")
        assert here[0].recv(1) == b"x"
        for one in (*ends, *here):
            one.close()
    assert not end_connection("127.0.0.1:1")


@pytest.mark.parametrize(
    ("word", "flappers"), [("alive", 1), ("alive", 2), ("elsewhere", 1)], ids=["one", "two", "another-word"]
)
def test_over_the_network_clients_that_flap_are_ended_and_another_one_goes_on(word: str, flappers: int) -> None:
    net, over = Net(), threading.Event()
    try:
        seen, reasons = list[Life](), set[str]()
        net.router.watch(seen.append)
        viewer, some = net.open("client"), [net.plain() for _ in range(flappers)]
        viewer.announce("viewer", "1")
        wait_until(lambda: Life("viewer", "1", True) in seen)

        def flaps(session: zenoh.Session) -> None:
            with suppress(zenoh.ZError):  # its link was ended
                for number in count():
                    if over.is_set():
                        return
                    session.liveliness().declare_token(f"{net.namespace}/{word}/walker/{number}").undeclare()

        threads = [threading.Thread(target=flaps, args=(one,)) for one in some]
        names = {f"flooder {one.zid()}" for one in some}
        for one in threads:
            one.start()

        def named() -> bool:
            reasons.update(one.reason for one in net.router.look_at_links())
            return names <= reasons

        wait_until(named)
        assert "token_flood" in reasons
        assert not [one for one in reasons - names if one.startswith("flooder")]
        over.set()
        for one in threads:
            one.join()
        assert Life("viewer", "1", False) not in seen
        viewer.announce("viewer", "2")
        wait_until(lambda: Life("viewer", "2", True) in seen)
        for one in some:
            one.close()
    finally:
        over.set()
        net.close()
