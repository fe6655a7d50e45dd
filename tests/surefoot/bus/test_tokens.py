"""Tokens of strangers: under names of no service they reach no peer, are counted, and hold no service up."""

from collections import Counter
from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from surefoot.bus.interface import Life
from surefoot.bus.memory import MemoryBus
from surefoot.bus.seals import new_secret
from surefoot.bus.tokens import LIVE, MOST_ADDED, MOST_FOREIGN, MOST_NAMED, SERVICES, Foreign, Tokens, given_services
from surefoot.bus.unread import LinkTrouble
from surefoot.bus.zenoh import ZenohBus, ZenohOptions
from surefoot.lockstep.binding import Bindings
from surefoot.lockstep.join import DRIVER
from tests.surefoot.lockstep.node_bench import Bench
from tests.surefoot.net import Net, wait_until

SYSTEM = ("motors", "walker", "estimator")
WALKER_READS = ("estimator",)


def opened(net: Net, mode: str) -> ZenohBus:
    """Open a session that knows the services of its system."""
    listen = (net.address,) if mode == "router" else ()
    bus = ZenohBus(ZenohOptions(mode, (net.address,), listen, net.namespace, services=SYSTEM))
    net.buses.append(bus)
    return bus


def watched(bus: ZenohBus, services: Iterable[str] | None = None) -> set[tuple[str, str]]:
    """Return the processes that are visible to a reader of the bus, kept up to date."""
    seen = set[tuple[str, str]]()

    def on_life(life: Life) -> None:
        (seen.add if life.alive else seen.discard)((life.service, life.instance))

    bus.watch(on_life, services)
    return seen


def strange(bus: ZenohBus) -> list[tuple[str, int]]:
    """Return name and number of the strange tokens that a session reports."""
    return [(one.peer, one.number) for one in bus.look_at_links() if one.reason == "foreign_token"]


@pytest.fixture
def system() -> Iterable[Net]:
    net = Net(router=False)
    net.router = opened(net, "router")
    yield net
    net.close()


def test_tokens_under_names_of_no_service_reach_no_peer_and_are_counted(system: Net) -> None:
    router, peer = watched(system.router), watched(opened(system, "peer"), WALKER_READS)
    stranger = system.open("client")
    for number in range(300):
        stranger.announce("zz", f"{number}")
    for name in ("estimator", "walker", "motors", DRIVER):
        stranger.announce(name, "late")
    expected = {("estimator", "late"), ("motors", "late"), (DRIVER, "late")}
    wait_until(lambda: expected <= peer and (DRIVER, "late") in router)
    assert peer == expected, "what it reads, and whoever may drive"
    assert len([place for place in router if place[0] == "zz"]) == MOST_FOREIGN
    assert strange(system.router) == [("zz", 300)]
    assert not strange(system.router)


def test_a_service_started_by_hand_is_visible_once_it_is_looked_for(system: Net) -> None:
    bus = opened(system, "peer")
    seen = watched(bus)
    own = system.open("peer")
    own.announce("own", "first")
    bindings = Bindings(look_for=bus.add_watched)
    assert "no liveliness token" in bindings.why_not("own", "first")
    wait_until(lambda: seen == {("own", "first")})
    own.close()
    wait_until(lambda: not seen)


def test_names_that_are_looked_for_displace_those_without_a_process_only(system: Net) -> None:
    bus = opened(system, "peer")
    seen = watched(bus)
    hand = system.open("peer")
    for name in ("own", *(f"none{number}" for number in range(3 * MOST_ADDED)), "", "*", "a/b", "last"):
        bus.add_watched(name)
    for name in ("none0", "own", "last"):
        hand.announce(name, "by_hand")
    wait_until(lambda: ("last", "by_hand") in seen)
    assert ("own", "by_hand") not in seen, "it had no process when others were looked for"
    bus.add_watched("own")
    wait_until(lambda: seen == {("last", "by_hand"), ("own", "by_hand")})
    for number in range(3 * MOST_ADDED):
        bus.add_watched(f"none{number}")
    hand.announce("own", "second")
    wait_until(lambda: ("own", "second") in seen)


def test_a_session_that_knows_no_services_sees_all(system: Net) -> None:
    seen = watched(system.open("peer"), WALKER_READS)
    system.open("client").announce("zz", "1")
    wait_until(lambda: seen == {("zz", "1")})


def test_one_process_of_a_service_that_somebody_starts_by_hand_is_not_foreign(system: Net) -> None:
    router = watched(system.router)
    hand, again, stranger = (system.open("peer") for _ in range(3))
    hand.announce("mapper", "1")
    wait_until(lambda: ("mapper", "1") in router)
    assert not strange(system.router)
    hand.close()
    wait_until(lambda: not router)
    again.announce("mapper", "2")
    wait_until(lambda: ("mapper", "2") in router)
    assert not strange(system.router)
    for name in ("mapper", "zz"):
        stranger.announce(name, "3")
        wait_until(lambda name=name: (name, "3") in router)
        assert strange(system.router) == [(name, 1)]


@given(st.lists(st.tuples(st.integers(0, 3 * MOST_FOREIGN), st.booleans()), max_size=600))
def test_few_strange_tokens_are_passed_on_and_each_that_was_is_passed_on_when_it_goes(
    events: list[tuple[int, bool]],
) -> None:
    counts, passed, came = Counter[str](), set[str](), 0
    foreign = Foreign(("walker",), counts)
    for number, alive in events:
        assert foreign.passes(Life("walker", f"{number}", alive))
        came += alive
        if foreign.passes(Life(f"zz{number}", "x", alive)):
            (passed.add if alive else passed.remove)(f"zz{number}")
        assert len(passed) <= MOST_FOREIGN
    assert counts.total() == came
    assert len(counts) <= MOST_NAMED + 1


def test_the_first_process_of_a_service_started_by_hand_is_not_counted_and_the_second_is() -> None:
    counts = Counter[str]()
    foreign = Foreign(("walker",), counts, ("mapper",))
    assert foreign.passes(Life("mapper", "a", True))
    assert foreign.passes(Life("mapper", "a", True))
    assert counts == {}
    assert foreign.passes(Life("mapper", "b", True))
    assert counts == {"mapper": 1}


def test_tokens_beyond_the_most_are_not_passed_on_when_they_come_and_when_they_go() -> None:
    foreign = Foreign(("walker",), Counter())
    names = [f"zz{number}" for number in range(2 * MOST_FOREIGN)]
    assert [foreign.passes(Life(name, "x", True)) for name in names] == [k < MOST_FOREIGN for k in range(len(names))]
    assert not foreign.passes(Life(names[-1], "x", False))
    assert foreign.passes(Life(names[0], "x", False))


class Session:
    """Session of Zenoh that notes what is subscribed to."""

    def __init__(self) -> None:
        self.subscribed = list[str]()
        self.handlers = dict[str, Any]()

    def liveliness(self) -> Any:
        return self

    def declare_subscriber(self, key: str, handler: Any, **_: Any) -> Any:
        self.subscribed.append(key)
        self.handlers[key] = handler
        return SimpleNamespace(undeclare=lambda: self.subscribed.remove(key))


def test_a_name_is_subscribed_to_once_and_by_those_who_do_not_watch_all() -> None:
    session: Any = Session()
    tokens = Tokens(session, SYSTEM, everything=False)
    tokens.watch(lambda life: None, None)
    for _ in range(2):
        for name in ("mapper", "walker", "no/name"):
            tokens.add(name)
    assert session.subscribed.count(f"{LIVE}/mapper/*") == session.subscribed.count(f"{LIVE}/walker/*") == 1
    assert not any("no/name" in key for key in session.subscribed)
    router: Any = Session()
    tokens = Tokens(router, SYSTEM, everything=True, hidden="@h", secret=new_secret())
    tokens.watch(lambda life: None, None)
    for number in range(2 * MOST_ADDED):
        tokens.add(f"zz{number}")
    assert router.subscribed == [f"{LIVE}/*/*", "@h/*/*"]


def test_where_all_added_names_have_a_process_no_further_one_is_added() -> None:
    session: Any = Session()
    tokens = Tokens(session, SYSTEM, everything=False)
    tokens.watch(lambda life: None, None)
    names = [f"zz{number}" for number in range(MOST_ADDED)]
    for name in names:
        tokens.add(name)
        session.handlers[f"{LIVE}/{name}/*"].callback(token(name, zenoh.SampleKind.PUT))
    tokens.add("mapper")
    assert f"{LIVE}/mapper/*" not in session.subscribed
    session.handlers[f"{LIVE}/zz3/*"].callback(token("zz3", zenoh.SampleKind.DELETE))
    tokens.add("mapper")
    assert f"{LIVE}/mapper/*" in session.subscribed
    assert f"{LIVE}/zz3/*" not in session.subscribed


def token(name: str, kind: zenoh.SampleKind) -> Any:
    return SimpleNamespace(key_expr=f"{LIVE}/{name}/1", kind=kind)


def test_health_counts_each_strange_token(monkeypatch: pytest.MonkeyPatch, system: Net) -> None:
    watched(system.router)
    stranger = system.open("client")
    for number in range(3):
        stranger.announce("zz", f"{number}")
    found = list[LinkTrouble]()
    wait_until(lambda: bool(found.extend(system.router.look_at_links()) or any(one.peer == "zz" for one in found)))
    monkeypatch.setattr(MemoryBus, "look_at_links", lambda bus: found)
    bench = Bench()
    bench.node.timers()
    assert bench.node.health().refused["foreign_token"] >= 1


def test_names_of_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(SERVICES, raising=False)
    assert given_services() == ()
    monkeypatch.setenv(SERVICES, "walker,estimator,,a/b,*,ros2")
    assert given_services() == ("walker", "estimator", "ros2")
