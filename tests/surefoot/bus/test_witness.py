"""A stop is confirmed by a status of the driver, and by nothing that another process publishes."""

import json
from typing import Any

import pytest

from surefoot.bus.seals import DRIVER, new_secret, sealed_name, with_seal
from surefoot.bus.witness import MOST_BYTES, MOST_TOKENS, Stop, Witness
from surefoot.schemas.topics import SIM_STATUS

SECRET, KEY = "c0ffee" * 5 + "00", f"@{SIM_STATUS.key}"
STATUS = json.dumps({"source": "simulator", "tick": 7, "stopped": "surefoot stop"}).encode()
DONE = Stop("simulator", "surefoot stop", 7)


def witness(*shown: tuple[str, str], secret: str = SECRET) -> Witness:
    made = Witness(secret, 1)
    for service, process in shown:
        made.on_token(f"test/net/alive/{service}/{process}", True)
    return made


def driver(secret: str = SECRET) -> tuple[tuple[str, str], tuple[str, str]]:
    """The two tokens of a driver whose name is sealed."""
    name = sealed_name(secret, "simulator")
    return (DRIVER, name), ("simulator", name)


def test_a_sealed_status_confirms_a_stop() -> None:
    sealed = with_seal(SECRET, KEY, STATUS, None)
    assert witness(*driver()).status(KEY, STATUS, sealed) == DONE
    assert witness().status(KEY, STATUS, sealed) == DONE


@pytest.mark.parametrize("key", [SIM_STATUS.key, KEY])
def test_a_status_without_the_seal_of_a_visible_sealed_driver_confirms_nothing(key: str) -> None:
    shown = (*driver(), (DRIVER, "a5"), ("simulator", "a5"))
    for attachment in (None, b"", b"\n1:" + b"0" * 16, with_seal(new_secret(), key, STATUS, None)):
        assert witness(*shown).status(key, STATUS, attachment) is None


def test_a_sealed_status_of_before_the_stop_confirms_nothing() -> None:
    sealed = with_seal(SECRET, KEY, STATUS, None)
    number = int(sealed.strip().partition(b":")[0])
    assert Witness(SECRET, number).status(KEY, STATUS, sealed) is None
    assert Witness(SECRET, number - 1).status(KEY, STATUS, sealed) == DONE


def test_the_seal_of_another_status_confirms_nothing() -> None:
    other = STATUS.replace(b"surefoot stop", b"")
    assert witness(*driver()).status(KEY, STATUS, with_seal(SECRET, KEY, other, None)) is None
    assert witness(*driver()).status(KEY, STATUS, with_seal(SECRET, "@sim/other", STATUS, None)) is None


def test_an_unsealed_status_counts_while_a_driver_that_is_not_sealed_is_visible() -> None:
    alone = witness((DRIVER, "a5"), ("robot", "a5"))
    assert alone.status(SIM_STATUS.key, STATUS, None) == DONE
    alone.on_token(f"alive/{DRIVER}/a5", False)
    assert alone.status(SIM_STATUS.key, STATUS, None) is None
    assert witness(secret="").status(SIM_STATUS.key, STATUS, None) == DONE


def test_tokens_without_end_hide_no_sealed_driver() -> None:
    crowd = [(DRIVER, f"a{number}") for number in range(MOST_TOKENS)]
    assert witness(*crowd, *driver()).status(SIM_STATUS.key, STATUS, None) is None


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"{",
        b"[]",
        b"1",
        b'"stopped"',
        b"[" * 60_000,
        b'{"stopped": "x"}',
        b'{"stopped": "x", "tick": "a", "source": "s"}',
        b'{"stopped": "x", "tick": 1e999, "source": "s"}',
        b'{"stopped": "x", "tick": true, "source": "s"}',
        b'{"stopped": ["x"], "tick": 1, "source": "s"}',
        b'{"stopped": "x", "tick": 1, "source": null}',
        b'{"stopped": "", "tick": 1, "source": "s"}',
        b'{"stopped": "x", "tick": 1, "source": "s"}' + b" " * MOST_BYTES,
    ],
)
def test_what_is_no_status_of_a_stop_confirms_nothing(payload: Any) -> None:
    assert witness(secret="").status(SIM_STATUS.key, payload, None) is None


def test_a_driver_that_names_no_service_confirms_as_driver() -> None:
    payload = json.dumps({"source": "", "stopped": "x", "tick": 1}).encode()
    assert witness(secret="").status(SIM_STATUS.key, payload, None) == Stop(DRIVER, "x", 1)
