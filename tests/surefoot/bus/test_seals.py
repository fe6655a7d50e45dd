"""Sealed names of processes: who knows the secret makes them, all others are found out."""

from hypothesis import given
from hypothesis import strategies as st

from surefoot.bus.options import ZenohOptions
from surefoot.bus.seals import born_ms, new_secret, sealed_name
from surefoot.bus.zenoh import ZenohBus
from tests.ports import free_address

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
