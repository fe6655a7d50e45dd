"""Tokens under hidden keys: what strangers show costs the processes of a system with a secret nothing."""

from collections.abc import Iterator
from itertools import count, islice
from typing import Any, cast

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from surefoot.bus.hidden import Merged, hidden_word, sealed_for_any
from surefoot.bus.interface import Life
from surefoot.bus.seals import new_secret, sealed_name
from surefoot.bus.tokens import LIVE, Tokens
from surefoot.bus.zenoh import ZenohBus, ZenohOptions
from surefoot.lockstep.join import DRIVER
from tests.surefoot.net import Net, wait_until

SECRET = new_secret()
SYSTEM = ("motors", "walker")


def opened(net: Net, mode: str, identity: str, secret: str = SECRET) -> ZenohBus:
    """Open a session of a service of the system."""
    listen = (net.address,) if mode == "router" else ()
    bus = ZenohBus(ZenohOptions(mode, (net.address,), listen, net.namespace, identity, secret, SYSTEM))
    net.buses.append(bus)
    return bus


@pytest.fixture
def system() -> Iterator[Net]:
    net = Net(router=False)
    net.router = opened(net, "router", "supervisor")
    yield net
    net.close()


def watched(bus: ZenohBus) -> list[Life]:
    """Return the notices that a reader of the bus gets; later ones are added."""
    found = list[Life]()
    bus.watch(found.append, SYSTEM)
    return found


def shown(bus: ZenohBus, service: str) -> str:
    name = bus.new_instance()
    bus.announce(service, name)
    return name


def test_tokens_of_strangers_reach_no_peer_once_it_has_seen_the_process_of_the_system(system: Net) -> None:
    reader, motors, walker = (
        opened(system, "peer", "reader"),
        opened(system, "peer", "motors"),
        opened(system, "peer", "walker"),
    )
    stranger, found, all_of_it = system.open("client"), watched(reader), list[Life]()
    system.router.watch(all_of_it.append)
    early = Life("walker", "early", True)
    stranger.announce("walker", "early")
    wait_until(lambda: early in found)
    expected = {(DRIVER, shown(motors, DRIVER)), ("motors", motors.new_instance()), ("walker", shown(walker, "walker"))}
    motors.announce("motors", motors.new_instance())
    wait_until(lambda: expected <= {(one.service, one.instance) for one in found if one.alive})
    wait_until(lambda: Life("walker", "early", False) in found)
    reader.look_at_links()
    for name in (DRIVER, "walker", "motors"):
        for number in range(50):
            stranger.announce(name, f"{number}")
    wait_until(lambda: {Life(name, "49", True) for name in (DRIVER, "walker", "motors")} <= set(all_of_it))
    motors.close()
    wait_until(lambda: Life("motors", motors.new_instance(), False) in found)
    assert {(one.service, one.instance) for one in found} == expected | {("walker", "early")}
    assert len(found) == 2 * (len(expected) + 1) - 1, "each once, and the motors and the stranger left"


def test_without_a_sealed_process_a_service_that_somebody_starts_by_hand_is_seen(system: Net) -> None:
    found = watched(opened(system, "peer", "walker"))
    hand = opened(system, "peer", "motors", secret="")
    here = {(name, shown(hand, name)) for name in ("motors", DRIVER)}
    wait_until(lambda: {(one.service, one.instance) for one in found} == here)


def test_links_are_checked_by_tokens_that_strangers_cannot_show(system: Net) -> None:
    reader, walker = opened(system, "peer", "reader"), opened(system, "peer", "walker")
    found = watched(reader)
    name = shown(walker, "walker")
    wait_until(lambda: bool(found))
    system.open("client").announce("walker", "stranger")
    system.open("client").announce("motors", "by_hand")
    wait_until(lambda: reader._visible(reader.session) == {name, "by_hand"})  # pyright: ignore[reportPrivateUsage]
    assert reader._alive() == {name, "by_hand"}  # pyright: ignore[reportPrivateUsage]


def test_a_client_that_flaps_under_the_hidden_key_is_ended_as_well(system: Net) -> None:
    watched(system.router)
    flapper, numbers, reasons = system.plain(), count(), set[str]()

    def flaps() -> bool:
        for number in islice(numbers, 1000):
            key = f"{system.namespace}/{hidden_word(SECRET)}/walker/{number}"
            flapper.liveliness().declare_token(key).undeclare()
        reasons.update(one.reason for one in system.router.look_at_links())
        return f"flooder {flapper.zid()}" in reasons

    wait_until(flaps)
    flapper.close()


def test_a_service_that_is_added_while_links_are_checked_ends_no_check() -> None:
    tokens = Tokens(cast("zenoh.Session", None), SYSTEM, everything=False, hidden="@alive0", secret=SECRET)
    readers: dict[str, list[Any]] = tokens._merged  # pyright: ignore[reportPrivateUsage]

    class Adding:
        @property
        def closed(self) -> bool:
            readers[f"added{len(readers)}"] = []
            return False

    readers["walker"], readers["motors"] = [Adding()], [Adding()]
    assert len(tokens.expressions) == 2 * len((*SYSTEM, DRIVER))


def test_no_wildcard_finds_a_hidden_key_and_each_secret_has_its_own() -> None:
    key = zenoh.KeyExpr(f"fleet/robot/{hidden_word(SECRET)}/walker/x")
    for wide in ("**", "*/*/*/*/*", "fleet/robot/**", "**/walker/x", "fleet/robot/*/walker/x", "fleet/robot/@alive/**"):
        assert not zenoh.KeyExpr(wide).intersects(key)
    assert SECRET not in hidden_word(SECRET)
    assert hidden_word(SECRET) != hidden_word(new_secret())
    assert hidden_word("") == ""
    assert not hidden_word(SECRET).startswith(LIVE)


@given(st.lists(st.tuples(st.booleans(), st.booleans(), st.integers(0, 3)), max_size=60))
def test_a_process_is_visible_under_either_key_until_a_sealed_one_came_and_then_under_the_hidden_one(
    events: list[tuple[bool, bool, int]],
) -> None:
    names = ["plain", "other", sealed_name(SECRET, "walker"), sealed_name(SECRET, "motors")]
    seen, hidden, public, closed = dict[str, bool](), set[str](), set[str](), False

    def on_life(life: Life) -> None:
        seen[life.instance] = life.alive

    merged = Merged(on_life, sealed_for_any(SECRET, SYSTEM))
    for secretly, alive, number in events:
        life, here = Life("walker", names[number], alive), hidden if secretly else public
        (merged.hidden if secretly else merged.public)(life)
        (here.add if alive else here.discard)(life.instance)
        closed = closed or (secretly and alive and number >= 2)
        assert {name for name, there in seen.items() if there} == (hidden if closed else hidden | public)
        assert merged.closed == closed
