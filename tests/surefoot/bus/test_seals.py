"""Sealed names of processes: who knows the secret makes them, all others are found out."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surefoot.bus.options import ZenohOptions
from surefoot.bus.seals import Guard, born_ms, new_secret, seal_of, sealed_name, with_seal, without_seal
from surefoot.bus.zenoh import ZenohBus
from surefoot.schemas.system import Done
from surefoot.schemas.topics import TICK_DONE
from tests.ports import free_address
from tests.surefoot.net import Inbox, Net, wait_until

SECRET = "c0ffee" * 5 + "00"


def test_a_name_is_known_by_its_secret_and_its_service_only() -> None:
    name = sealed_name(SECRET, "walker")
    assert born_ms(SECRET, "walker", name) > 0
    assert born_ms(SECRET, "estimator", name) == 0
    assert born_ms(new_secret(), "walker", name) == 0
    assert born_ms("", "walker", name) == 0


def test_a_later_name_is_not_older() -> None:
    born = [born_ms(SECRET, "walker", sealed_name(SECRET, "walker")) for _ in range(50)]
    assert born == sorted(born)


@given(place=st.integers(0, 31), digit=st.sampled_from("0123456789abcdef"))
def test_a_name_with_another_digit_has_no_seal(place: int, digit: str) -> None:
    name = sealed_name(SECRET, "walker")
    other = name[:place] + digit + name[place + 1 :]
    assert (born_ms(SECRET, "walker", other) > 0) == (other == name)


@given(st.text(max_size=40))
def test_any_other_name_has_no_seal(name: str) -> None:
    assert born_ms(SECRET, "walker", name) == 0


def test_a_session_has_the_sealed_name_of_its_service() -> None:
    options = ZenohOptions("router", (), (free_address(),), "surefoot/seals", "supervisor", SECRET)
    bus = ZenohBus(options)
    try:
        name = bus.new_instance()
        assert bus.born_ms("supervisor", name) == born_ms(SECRET, "supervisor", name) > 0
    finally:
        bus.close()
    assert SECRET not in repr(options)


def test_what_is_published_to_participants_carries_a_seal_that_comes_off_again() -> None:
    for payload, attachment in ((b"{}", None), (b"raw", b'{"a": 1}'), (b"", None)):
        sealed = with_seal(SECRET, "@tick/walker", payload, attachment)
        assert without_seal(sealed) == (attachment, seal_of(SECRET, b"@tick/walker", attachment or b"", payload))
    assert without_seal(b'{"a": 1}') == (b'{"a": 1}', b"")
    assert without_seal(None) == (None, b"")


def test_messages_of_a_service_need_its_seal_once_a_sealed_process_was_seen() -> None:
    guard, key = Guard(SECRET), "@tick/walker"
    seal = seal_of(SECRET, key.encode(), b"", b"{}")
    assert guard.passes("walker", key, b"{}", None, b"")
    guard.on_token("walker", "stranger")
    guard.on_token("walker", sealed_name(SECRET, "estimator"))
    assert guard.passes("walker", key, b"{}", None, b"")
    guard.on_token("walker", sealed_name(SECRET, "walker"))
    assert guard.passes("walker", key, b"{}", None, seal)
    assert not guard.passes("walker", key, b"{}", None, b"")
    assert not guard.passes("walker", key, b"{ }", None, seal)
    assert not guard.passes("walker", "@tick/estimator", b"{}", None, seal)
    assert guard.passes("another", "@tick/another", b"{}", None, b"")
    assert dict(guard.forged()) == {key: 2, "@tick/estimator": 1}
    assert guard.forged() == []


@pytest.mark.parametrize("first", ["driver", "simulator"])
def test_the_driver_needs_the_seal_of_the_service_that_drives(first: str) -> None:
    guard, name = Guard(SECRET), sealed_name(SECRET, "simulator")
    for service in (first, *{"driver", "simulator"} - {first}):
        guard.on_token(service, name)
    assert not guard.passes("driver", "@terrain/map/x", b"{}", None, b"")


def test_a_forged_report_of_a_tick_reaches_nobody_over_the_network(net: Net) -> None:
    inbox, reader, walker = Inbox(), net.open(secret=SECRET), net.open(identity="walker", secret=SECRET)
    reader.watch(lambda life: None)
    reader.take((TICK_DONE,), inbox.put)
    name = walker.new_instance()
    publisher = walker.publisher(TICK_DONE.of("walker"), name)
    walker.announce("walker", name)
    stranger = net.open().publisher(TICK_DONE.of("walker"), name)
    done = Done(tick=1, epoch=1, seq=0, stamp_ns=0, source="walker", instance=name)
    late = done.model_copy(update={"tick": 9})

    def forged() -> list[str]:
        stranger.put(late)
        return [one.text for one in reader.look_at_links() if one.reason == "forged"]

    wait_until(lambda: bool(forged()))  # the token of the walker was seen
    while not inbox.queue.empty():
        inbox.get()
    for _ in range(5):
        stranger.put(late)
    publisher.put(done)
    assert inbox.get().message() == done
    assert "without a seal" in forged()[0]
