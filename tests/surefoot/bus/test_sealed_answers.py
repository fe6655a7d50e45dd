"""Answers in a system with a secret: a copied name is not enough, the seal of this very question is needed."""

import stat
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from surefoot.bus.interface import Incoming
from surefoot.bus.options import client_options
from surefoot.bus.seals import Asked, new_digits, without_seal
from surefoot.bus.zenoh import ZenohBus
from surefoot.errors import CallError, Refusal
from surefoot.schemas.stability import RegionReply, RegionRequest
from surefoot.schemas.topics import STABILITY_REGION
from surefoot.services.supervisor.processes.rundir import Endpoint, RunFolder
from surefoot.state import secret_of
from tests.ports import free_address
from tests.surefoot.expect import expect_error
from tests.surefoot.net import Net, own, reached, serve, wait_until

SECRET, OTHER = "0123456789abcdef" * 2, "fedcba9876543210" * 2
REQUEST = RegionRequest(contacts=(), directions=16)
RIGHT = RegionReply(status="infeasible", inner=(), outer=(), support=())
WRONG = RegionReply(status="ok", inner=(), outer=(), support=())


def wrong(asked: zenoh.Query) -> None:
    with asked:
        asked.reply(asked.key_expr, WRONG.model_dump_json().encode())


def wrong_error(asked: zenoh.Query) -> None:
    with asked:
        asked.reply_err(b'{"code": "refused", "message": "no"}')


def with_a_seal(asked: zenoh.Query) -> None:
    """Answer with the digits of the query and a seal of the right form."""
    digits = str(asked.parameters.get("seal", "1"))
    with asked:
        asked.reply(asked.key_expr, WRONG.model_dump_json().encode(), attachment=f"\n{digits}:{'0' * 16}".encode())


def answer_as_error(asked: zenoh.Query) -> None:
    """Pass on the owner's right and sealed answer as an error, which a caller would take for a refusal of its order."""
    request = asked.payload
    digits = str(asked.parameters.get("seal", "")).encode()
    query = Asked(STABILITY_REGION.key, digits, b"" if request is None else request.to_bytes(), None)
    payload = RIGHT.model_dump_json().encode()
    with asked:
        seal = query.seal(SECRET, payload, None).decode()
        asked.reply_err(payload, encoding=f"application/json;surefoot/ErrorReply/1.0;{seal}")


@contextmanager
def relayed(net: Net, name: str, key: str, handler: Any) -> Iterator[None]:
    """A stranger's router beside that of the system, and behind it a session that serves under a copied name."""
    place = free_address()
    with opened("router", net.address, place), opened("client", place, name=name) as session:
        kept = session.declare_queryable(f"{net.namespace}/{key}", handler, complete=True)
        yield
        kept.undeclare()


def opened(mode: str, connect: str, listen: str = "", name: str = "") -> zenoh.Session:
    config = zenoh.Config()
    config.insert_json5("mode", f'"{mode}"')
    config.insert_json5("connect/endpoints", f'["{connect}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    if listen:
        config.insert_json5("listen/endpoints", f'["{listen}"]')
    if name:
        config.insert_json5("id", f'"{name}"')
    return zenoh.open(config)


@pytest.mark.parametrize("handler", [wrong, wrong_error, with_a_seal, answer_as_error])
def test_what_a_copied_name_answers_is_not_taken(net: Net, handler: Any) -> None:
    owner = net.open(identity="stability", secret=SECRET)
    with relayed(net, owner.new_instance(), STABILITY_REGION.key, handler):
        serve(owner, lambda request: RIGHT)
        client = net.open("client", secret=SECRET)
        wait_until(lambda: client.probe(STABILITY_REGION) and bool(client.refused))  # both are reached
        client.refused.clear()
        for _ in range(20):
            assert client.call(STABILITY_REGION, REQUEST) == RIGHT


def test_a_copied_name_alone_answers_for_nobody(net: Net) -> None:
    owner = net.open(identity="stability", secret=SECRET)
    owner.announce("stability", owner.new_instance())
    with relayed(net, owner.new_instance(), STABILITY_REGION.key, wrong):
        client = net.open("client", secret=SECRET)
        wait_until(lambda: bool(client.refused) or client.probe(STABILITY_REGION))
        with expect_error(CallError, "timeout", text="was refused"):
            client.call(STABILITY_REGION, REQUEST)


def test_an_error_of_the_owner_is_sealed_as_well(net: Net) -> None:
    owner = net.open(identity="stability", secret=SECRET)

    def refuses(request: Any) -> RegionReply:
        raise Refusal("refused", "right")

    with relayed(net, owner.new_instance(), STABILITY_REGION.key, wrong):
        serve(owner, refuses)
        client = reached(net.open("client", secret=SECRET), STABILITY_REGION)
        for _ in range(10):
            with expect_error(CallError, "refused", text="right"):
                client.call(STABILITY_REGION, REQUEST)


def test_a_participant_takes_no_unsealed_answer_of_a_sealed_process(net: Net) -> None:
    owner, asker = net.open(identity="stability", secret=SECRET), net.open(identity="walker", secret=SECRET)
    name = owner.new_instance()
    owner.announce("stability", name)

    def answers(incoming: Incoming) -> None:
        incoming.accept_probe() if incoming.probe else incoming.reply(RIGHT)

    with relayed(net, name, f"@{STABILITY_REGION.key}/{name}", wrong):
        owner.serve(STABILITY_REGION, answers, answers, name)
        wait_until(lambda: asker.probe(STABILITY_REGION, instance=name) and bool(asker.refused))
        for _ in range(20):
            assert asker.call(STABILITY_REGION, REQUEST, instance=name) == RIGHT
        troubles = [trouble for trouble in asker.look_at_links() if trouble.reason == "forged"]
        assert [trouble.peer for trouble in troubles] == [STABILITY_REGION.key]
        assert f"of {name!r}, which does not own it" in troubles[0].text
        assert not [trouble for trouble in asker.look_at_links() if trouble.reason == "forged"]


@pytest.mark.parametrize(("owners", "clients"), [("", SECRET), (SECRET, ""), (SECRET, OTHER), ("", "")])
def test_who_does_not_share_the_secret_is_answered_as_without_one(net: Net, owners: str, clients: str) -> None:
    serve(net.open(identity="stability", secret=owners), lambda request: RIGHT)
    client = reached(net.open("client", secret=clients), STABILITY_REGION)
    assert client.call(STABILITY_REGION, REQUEST) == RIGHT


ASKED = Asked("stability/region", b"123", b"{}", None)


@given(st.binary(max_size=40), st.none() | st.binary(min_size=1, max_size=40))
def test_a_seal_holds_for_one_answer_to_one_question(answer: bytes, attachment: bytes | None) -> None:
    digits, _, seal = (found := ASKED.seal(SECRET, answer, attachment)).partition(b":")
    assert digits == ASKED.digits
    assert without_seal((attachment or b"") + b"\n" + found) == (attachment, digits, seal)
    for other in (
        ASKED._replace(key="stability/check"),
        ASKED._replace(digits=b"124"),
        ASKED._replace(payload=b"{ }"),
        ASKED._replace(payload=b"}", attachment=b"{"),
    ):
        assert other.seal(SECRET, answer, attachment).partition(b":")[2] != seal
    assert ASKED.seal(SECRET, answer + b" ", attachment) != found
    assert ASKED.seal(OTHER, answer, attachment) != found
    assert ASKED.seal(SECRET, answer, attachment, failed=True) != found


@pytest.mark.parametrize("given", ["", "x", "1" * 21, "1" * 19 + "\u00e9", "\u0661", "1\n2", "-1"])
def test_a_query_with_something_else_for_digits_is_answered_without_a_seal(net: Net, given: str) -> None:
    def refuses(incoming: Incoming) -> None:
        incoming.accept_probe() if incoming.probe else incoming.fail(Refusal("refused", "right"))

    owner = net.open(identity="stability", secret=SECRET)
    own(owner, STABILITY_REGION, refuses)
    reached(net.open("client"), STABILITY_REGION)
    with net.plain() as session:
        for reply in session.get(f"{net.namespace}/{STABILITY_REGION.key}?seal={given}"):
            assert reply.err is not None
            assert b"right" in reply.err.payload.to_bytes()
            assert str(reply.err.encoding).count(";") == 1
            break
        else:
            pytest.fail("no answer")


def test_without_digits_or_secret_there_is_no_seal() -> None:
    assert ASKED.seal("", b"{}", None) == ASKED._replace(digits=b"").seal(SECRET, b"{}", None) == b""
    assert new_digits().isdigit()
    assert new_digits() != new_digits()


def test_clients_of_this_user_find_the_secret_and_nobody_else_reads_it(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.delenv("SUREFOOT_SECRET", raising=False)
    place = Endpoint("tcp/127.0.0.1:7447", "surefoot/ragno")
    folder = RunFolder("ragno")
    folder.acquire()
    assert secret_of(place.connect, place.namespace) == ""
    folder.write_endpoint(place, SECRET)
    assert client_options(place.connect, place.namespace).secret == SECRET
    assert secret_of(place.connect, "surefoot/messor") == ""
    assert stat.S_IMODE((folder.path / "secret.json").stat().st_mode) == 0o600
    monkeypatch.setenv("SUREFOOT_SECRET", OTHER)
    assert client_options(place.connect, place.namespace).secret == OTHER
    folder.release()
    assert secret_of(place.connect, place.namespace) == ""


@pytest.mark.parametrize("content", ["", "[", "[" * 99999, "{}", "null", "[1]"])
def test_a_damaged_file_of_a_secret_is_none(tmp_path: Any, monkeypatch: pytest.MonkeyPatch, content: str) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    place = Endpoint("tcp/127.0.0.1:7447", "surefoot/ragno")
    folder = RunFolder("ragno")
    folder.acquire()
    folder.write_endpoint(place, SECRET)
    (folder.path / "secret.json").write_text(content)
    assert secret_of(place.connect, place.namespace) == ""
    (folder.path / "endpoint.json").write_text(content)
    assert secret_of(place.connect, place.namespace) == ""
    folder.release()


def test_a_client_has_no_sealed_name(net: Net) -> None:
    client: ZenohBus = net.open("client", secret=SECRET)
    assert client.born_ms("", client.new_instance()) == 0
