"""Sealed names of processes: who knows the secret makes them, all others are found out."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surefoot.bus import seals
from surefoot.bus.guard import Guard, Sealed
from surefoot.bus.options import ZenohOptions
from surefoot.bus.seals import (
    MOST_KNOWN,
    SEAL,
    VARIABLE,
    born_ms,
    given_secret,
    new_secret,
    sealed_name,
    with_seal,
    without_seal,
)
from surefoot.bus.zenoh import ZenohBus
from surefoot.errors import ConfigError
from surefoot.schemas.system import Done
from surefoot.schemas.topics import TICK_DONE
from tests.ports import free_address
from tests.surefoot.expect import expect_error
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


@pytest.mark.parametrize("seal", ["\ufffd" * 16, "e\u0301" * 8, "\x00" * 16])
def test_a_name_that_is_not_ascii_has_no_seal(seal: str) -> None:
    assert born_ms(SECRET, "walker", sealed_name(SECRET, "walker")[:16] + seal) == 0


@pytest.mark.parametrize(("secret", "more"), [("", ""), (SECRET, "0"), (SECRET, "0" * 16)])
def test_a_hash_that_fits_makes_no_seal_without_a_secret_or_at_another_length(secret: str, more: str) -> None:
    head = sealed_name(SECRET, "walker")[:-SEAL] + more
    assert born_ms(secret, "walker", head + seals._hash(secret, "walker", head)) == 0


@pytest.mark.parametrize("secret", ["x", "a" * 31, "A" * 32, "a" * 32 + "\n"])
def test_a_secret_of_another_form_is_refused_and_not_shown(secret: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, secret)
    with expect_error(ConfigError, "invalid", text=f"got {len(secret)} characters") as caught:
        given_secret()
    assert len(secret) < 2 or secret not in str(caught.value)


def test_whoever_shifts_bytes_between_attachment_and_payload_breaks_the_seal() -> None:
    guard = Guard(SECRET)
    guard.on_token("walker", sealed_name(SECRET, "walker"))
    right = made("@terrain/map/x", b"payload", attachment=b"attachment")
    shifted = right._replace(payload=b"tpayload", attachment=b"attachmen")
    assert not guard.passes("walker", shifted)
    assert guard.passes("walker", right)


def test_keys_of_strangers_fill_no_report() -> None:
    guard = Guard("")
    for number in range(1000):
        assert not guard.owns(f"@health/{number:0500}", str(number), b'{"source": "zz"}')
        assert not guard.owns(f"@health{number}/x", "x", b'{"source": "zz"}')
    found = dict(guard.forged())
    assert len(found) <= 17
    assert sum(found.values()) == 2000
    assert max(map(len, found)) <= 80


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


def made(key: str, payload: bytes = b"{}", secret: str = SECRET, attachment: bytes | None = None) -> Sealed:
    return Sealed(key, payload, *without_seal(with_seal(secret, key, payload, attachment)))


def bare(key: str) -> Sealed:
    return Sealed(key, b"{}", None, b"", b"")


@pytest.mark.parametrize(
    ("payload", "attachment"), [(b"{}", None), (b"raw", b'{"a": 1}'), (b"", None), (b"x", b"a\nb")]
)
def test_what_is_published_to_participants_carries_a_seal_that_comes_off_again(
    payload: bytes, attachment: bytes | None
) -> None:
    assert made("@tick/walker", payload, attachment=attachment).attachment == attachment
    assert without_seal(attachment) == (attachment, b"", b"")


def test_messages_of_a_service_need_its_seal_once_a_sealed_process_was_seen() -> None:
    guard, key = Guard(SECRET), "@tick/walker"
    assert guard.passes("walker", bare(key))
    guard.on_token("walker", "stranger")
    guard.on_token("walker", sealed_name(SECRET, "estimator"))
    assert guard.passes("walker", bare(key))
    guard.on_token("walker", sealed_name(SECRET, "walker"))
    right = made(key)
    assert guard.passes("walker", right)
    for wrong in (bare(key), right, right._replace(payload=b"{ }"), made(key, secret=new_secret())):
        assert not guard.passes("walker", wrong)
    assert guard.passes("walker", made(key))
    assert not guard.passes("walker", made(key)._replace(key="@tick/estimator"))
    assert guard.passes("another", bare("@tick/another"))
    assert dict(guard.forged()) == {key: 4, "@tick/estimator": 1}
    assert guard.forged() == []


@pytest.mark.parametrize(
    ("owner", "payload", "right"),
    [
        ("walker", b'{"source": "walker"}', True),
        ("walker", b"", True),
        ("walker", b"{", True),
        ("walker", b"[]", True),
        ("walker", b"[" * 9999, True),
        ("zz", b'{"source": "walker"}', False),
        ("*", b'{"source": "walker"}', False),
        ("zz", b'{"source": "zz", "service": "walker"}', False),
        ("zz", b'{"source": "zz", "so\\u0075rce": "walker"}', False),
        ("zz", b'{"source": ["walker"]}', False),
    ],
)
def test_a_message_on_the_key_of_a_service_names_that_service(owner: str, payload: bytes, right: bool) -> None:
    assert Guard("").owns(f"@tick/{owner}", owner, payload) is right


@pytest.mark.parametrize("first", ["driver", "simulator"])
def test_the_driver_needs_the_seal_of_the_service_that_drives(first: str) -> None:
    guard, name = Guard(SECRET), sealed_name(SECRET, "simulator")
    for service in (first, *{"driver", "simulator"} - {first}):
        guard.on_token(service, name)
    assert not guard.passes("driver", bare("@terrain/map/x"))


def test_the_driver_is_not_hidden_by_many_that_pretend_to_be_one() -> None:
    name = sealed_name(SECRET, "simulator")
    fakes = [("driver", f"f{k:0{len(name) - 1}x}") for k in range(MOST_KNOWN)]
    real = [("driver", name), ("simulator", name)]
    for tokens in ([real[0], *fakes, real[1]], [*fakes, *real], [*real, *fakes], [real[1], *fakes, real[0]]):
        guard = Guard(SECRET)
        for service, instance in tokens:
            guard.on_token(service, instance)
        assert not guard.passes("driver", bare("@terrain/map/x"))


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
    texts: list[str] = []
    wait_until(lambda: texts.extend(forged()) or bool(texts))  # another session's: not in the order of the walker's
    publisher.put(done)
    assert inbox.get().message() == done
    assert "@tick/walker without the seal of its service" in texts[0]
