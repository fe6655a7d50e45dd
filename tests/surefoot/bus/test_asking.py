"""Clients beside a stranger who serves the keys of queries: the owner's answer counts, whoever is first."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import zenoh

from surefoot.bus import asking
from surefoot.bus.interface import Incoming
from surefoot.bus.memory import MemoryBus
from surefoot.errors import CallError, Refusal
from surefoot.schemas.stability import RegionReply, RegionRequest
from surefoot.schemas.system import Health, HealthReply, HealthRequest
from surefoot.schemas.topics import HEALTH_GET, STABILITY_REGION
from tests.surefoot.expect import expect_error
from tests.surefoot.net import Net, own, reached, serve, wait_until

REQUEST = RegionRequest(contacts=(), directions=16)
RIGHT = RegionReply(status="infeasible", inner=(), outer=(), support=())
WRONG = RegionReply(status="ok", inner=(), outer=(), support=())


def answering(reply: RegionReply) -> Any:
    return lambda incoming: incoming.reply(reply)


# -- in memory ---------------------------------------------------------------------------------------------------------


def memory_server(bus: MemoryBus, instance: str, reply: RegionReply, *, token: bool = True) -> None:
    bus.serve(STABILITY_REGION, answering(reply), instance=instance)
    if token:
        bus.announce("stability", instance)


@pytest.mark.parametrize("first", [True, False])
def test_a_server_without_the_owners_token_is_not_asked(first: bool) -> None:
    bus = MemoryBus()
    for instance in ("stranger", "real") if first else ("real", "stranger"):
        memory_server(bus, instance, WRONG if instance == "stranger" else RIGHT, token=instance == "real")
    assert bus.call(STABILITY_REGION, REQUEST) == RIGHT


def test_a_second_owner_is_not_asked_by_who_knows_the_first_and_named_to_who_does_not() -> None:
    bus = MemoryBus()
    memory_server(bus, "real", RIGHT)
    assert bus.call(STABILITY_REGION, REQUEST) == RIGHT
    memory_server(bus, "other", WRONG)
    assert bus.call(STABILITY_REGION, REQUEST) == RIGHT
    fresh = MemoryBus()
    for instance in ("real", "other"):
        memory_server(fresh, instance, WRONG)
    assert not fresh.probe(STABILITY_REGION)
    with expect_error(CallError, "second", text="'real' and 'other' both are stability"):
        fresh.call(STABILITY_REGION, REQUEST)


def test_a_stranger_alone_is_nobody() -> None:
    bus = MemoryBus()
    memory_server(bus, "stranger", WRONG, token=False)
    with expect_error(CallError, "absent"):
        bus.call(STABILITY_REGION, REQUEST)


# -- over the network --------------------------------------------------------------------------------------------------


@contextmanager
def stranger(net: Net, handler: Any, token: str = "") -> Iterator[zenoh.Session]:
    """A plain session whose queryable on the key of regions is declared before that of the owner."""
    with net.plain() as session:
        kept: list[Any] = [session.declare_queryable(f"{net.namespace}/{STABILITY_REGION.key}", handler, complete=True)]
        if token:
            kept.append(session.liveliness().declare_token(f"{net.namespace}/alive/stability/{session.zid()}"))
        yield session
        kept.clear()


def wrong(asked: zenoh.Query) -> None:
    with asked:
        asked.reply(asked.key_expr, WRONG.model_dump_json().encode())


def an_error(asked: zenoh.Query) -> None:
    with asked:
        asked.reply_err(b'{"code": "refused", "message": "no"}')


def without_an_answer(asked: zenoh.Query) -> None:
    with asked:
        return


def many(asked: zenoh.Query) -> None:
    with asked:
        for _ in range(100):
            asked.reply(asked.key_expr, b"{")


@pytest.mark.parametrize("handler", [wrong, an_error, without_an_answer, many])
def test_what_a_stranger_answers_is_refused_counted_and_named(net: Net, handler: Any) -> None:
    with stranger(net, handler) as session:
        serve(net.open(), lambda request: RIGHT)
        client = reached(net.open("client"), STABILITY_REGION)
        client.refused.clear()
        for _ in range(20):
            assert client.call(STABILITY_REGION, REQUEST) == RIGHT
        assert set(client.refused) <= {(STABILITY_REGION.key, str(session.zid()))}


def test_a_stranger_that_never_answers_holds_nobody(net: Net) -> None:
    kept: list[zenoh.Query] = []
    with stranger(net, kept.append):
        serve(net.open(), lambda request: RIGHT)
        client = reached(net.open("client"), STABILITY_REGION)
        assert all(client.call(STABILITY_REGION, REQUEST, 60.0) == RIGHT for _ in range(20))
        wait_until(lambda: len(kept) >= 20)  # each query reached it
        kept.clear()


def test_a_long_wait_for_an_answer_is_no_silence(net: Net, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(asking, "MEANWHILE_S", 0.01)
    begun, third = threading.Event(), threading.Event()

    def answer(request: Any) -> RegionReply:
        begun.set()
        assert third.wait(60.0)
        return RIGHT

    def meanwhile() -> None:
        looks.append(begun.is_set())
        if looks.count(True) == 3:
            third.set()

    looks: list[bool] = []
    serve(net.open(), answer)
    client = reached(net.open("client"), STABILITY_REGION)
    assert client.call(STABILITY_REGION, REQUEST, 60.0, meanwhile=meanwhile) == RIGHT
    assert looks.count(True) >= 3


def test_a_stranger_alone_answers_for_nobody_and_is_named(net: Net) -> None:
    with stranger(net, wrong) as session:
        client = net.open("client")
        wait_until(lambda: bool(client.refused) or client.probe(STABILITY_REGION))
        client.refused.clear()
        with expect_error(CallError, "timeout", text=f"'{session.zid()}' was refused, which is not stability"):
            client.call(STABILITY_REGION, REQUEST)
        assert client.refused == {(STABILITY_REGION.key, str(session.zid())): 1}


def test_two_owners_are_named_to_who_knows_neither_and_the_known_one_answers(net: Net) -> None:
    serve(real := net.open(), lambda request: RIGHT)
    before = reached(net.open("client"), STABILITY_REGION)
    with stranger(net, wrong, token="stability") as session:

        def named() -> bool:
            try:
                net.open("client").call(STABILITY_REGION, REQUEST)
            except CallError as error:
                return error.code == "second" and all(
                    repr(one) in error.message for one in (real.new_instance(), str(session.zid()))
                )
            return False

        wait_until(named)
        assert before.call(STABILITY_REGION, REQUEST) == RIGHT


def test_an_owner_that_is_started_again_is_known_again(net: Net) -> None:
    serve(first := net.open(), lambda request: WRONG)
    client = reached(net.open("client"), STABILITY_REGION)
    first.close()
    serve(net.open(), lambda request: RIGHT)
    reached(client, STABILITY_REGION)
    assert client.call(STABILITY_REGION, REQUEST) == RIGHT


def test_a_participant_is_answered_by_the_process_it_names_only(net: Net) -> None:
    """Also where a stranger serves the very key."""
    owner = net.open()

    def refuses(incoming: Incoming) -> None:
        incoming.fail(Refusal("refused", "right"))

    key = f"{net.namespace}/@{STABILITY_REGION.key}/{owner.new_instance()}"
    with net.plain() as session:
        kept = session.declare_queryable(key, wrong, complete=True)
        owner.serve(STABILITY_REGION, refuses, refuses, owner.new_instance())
        asker = net.open()

        def answered() -> bool:
            try:
                asker.call(STABILITY_REGION, REQUEST, instance=owner.new_instance())
            except CallError as error:
                return error.message == "right"
            return False

        wait_until(answered)
        del kept


def health_server(bus: Any, state: Any) -> HealthReply:
    reply = HealthReply(health=Health(service="walker", instance="x", state=state, pid=1))
    bus.serve(HEALTH_GET.of("walker"), lambda incoming: incoming.reply(reply), instance=bus.new_instance())
    return reply


def test_health_of_a_service_that_starts_is_answered_by_who_shows_that_it_starts(net: Net) -> None:
    query, server = HEALTH_GET.of("walker"), net.open()
    reply = health_server(server, "compiling")
    server.announce("walker", server.new_instance(), ready=False)
    health_server(stranger := net.open(), "running")
    client = reached(net.open("client"), query)
    client.refused.clear()
    for _ in range(20):
        assert client.call(query, HealthRequest()) == reply
    assert set(client.refused) <= {(query.key, stranger.new_instance())}
    own(server, query)
    assert client.call(query, HealthRequest()) == reply


def test_health_of_a_service_that_is_gone_is_answered_by_nobody(net: Net) -> None:
    query, stranger = HEALTH_GET.of("walker"), net.open()
    health_server(stranger, "running")
    client = net.open("client")
    wait_until(lambda: bool(client.refused) or client.probe(query))
    with expect_error(CallError, "timeout", text=f"'{stranger.new_instance()}' was refused, which is not walker"):
        client.call(query, HealthRequest(), 0.5)


def test_in_memory_health_is_answered_by_who_shows_that_it_starts() -> None:
    query, bus = HEALTH_GET.of("walker"), MemoryBus()
    for instance, state in (("stranger", "running"), ("real", "compiling")):
        found: Any = {"service": "walker", "instance": instance, "state": state, "pid": 1}
        reply = HealthReply(health=Health(**found))
        bus.serve(query, lambda incoming, reply=reply: incoming.reply(reply), instance=instance)
    with expect_error(CallError, "absent"):
        bus.call(query, HealthRequest())
    bus.announce("walker", "real", ready=False)
    assert bus.call(query, HealthRequest()).health.instance == "real"


def test_a_query_that_its_owner_leaves_is_a_time_out(net: Net) -> None:
    own(net.open(), STABILITY_REGION, lambda incoming: incoming.accept_probe() if incoming.probe else None)
    client = reached(net.open("client"), STABILITY_REGION)
    with expect_error(CallError, "timeout"):
        client.call(STABILITY_REGION, REQUEST, 0.2)
