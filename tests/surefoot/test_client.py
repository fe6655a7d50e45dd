"""The public client: wrong names are reported, topics are read and queries called in a few lines."""

import asyncio
import socket
import threading
import time
from typing import Any

import pytest

from surefoot.bus.knock import nothing_listens
from surefoot.client import Client, connect, make_request, query_named, topic_named
from surefoot.client_async import AsyncClient
from surefoot.errors import BusError, CallError, ConfigError, FieldError, SurefootError
from surefoot.schemas.stability import RegionReply
from surefoot.schemas.state import VelocityEstimate
from surefoot.schemas.topics import HEALTH, STABILITY_REGION, STATE_VELOCITY
from tests.ports import free_address
from tests.surefoot.expect import expect_error
from tests.surefoot.net import WAIT_S, Net, matched, reached, serve
from tests.surefoot.toys import estimate

EMPTY = RegionReply(status="infeasible", inner=(), outer=(), support=())


def test_rows_are_found_by_key_also_members_of_families() -> None:
    assert topic_named("state/velocity") == STATE_VELOCITY
    assert topic_named("health/walker") == HEALTH.of("walker")
    assert query_named("stability/region") == STABILITY_REGION
    assert query_named("health/walker").owner == "walker"


@pytest.mark.parametrize(
    ("named", "code", "near"),
    [(topic_named, "unknown_topic", "state/velocity"), (query_named, "unknown_query", "stability/region")],
)
def test_unknown_keys_are_told_with_the_nearest_or_all(named: object, code: str, near: str) -> None:
    assert callable(named)
    for key, told in ((f"{near}y", f"did you mean {near!r}?"), ("xyz", near)):
        with expect_error(SurefootError, code, text=told):
            named(key)


@pytest.mark.parametrize(
    ("fields", "field"), [({"contact": []}, "contacts"), ({"contacts": 3}, "contacts"), ({"contacts": [], "x": 1}, "x")]
)
def test_wrong_requests_name_the_field_before_anything_is_sent(fields: dict[str, object], field: str) -> None:
    with expect_error(SurefootError, field=field):
        make_request(STABILITY_REGION, fields)


def test_watch_and_ask(net: Net) -> None:
    server = net.open()
    serve(server, lambda request: EMPTY)
    fleet, _, robot = net.namespace.partition("/")
    with connect(robot, net.address, fleet) as tool:
        reached(tool.bus, STABILITY_REGION)
        assert tool.call("stability/region", contacts=[]) == EMPTY
        heard: list[VelocityEstimate] = []

        def listen() -> None:
            heard.append(tool.latest(STATE_VELOCITY, WAIT_S))

        listener = threading.Thread(target=listen, daemon=True)
        listener.start()
        publisher = matched(server, STATE_VELOCITY)
        publisher.prime()
        publisher.put(estimate(0.25))
        listener.join(WAIT_S)
        assert heard == [estimate(0.25)]
    tool.close()


@pytest.mark.parametrize(("variable", "port"), [("SUREFOOT_CONNECT", 7), ("SUREFOOT_LISTEN", 9)])
def test_without_an_endpoint_the_environment_names_the_router(
    monkeypatch: pytest.MonkeyPatch, variable: str, port: int
) -> None:
    monkeypatch.delenv("SUREFOOT_CONNECT", raising=False)
    monkeypatch.setenv("SUREFOOT_LISTEN", "tcp/127.0.0.1:9")
    monkeypatch.setenv(variable, f"tcp/127.0.0.1:{port}")
    monkeypatch.setattr("surefoot.bus.options.CONNECT_TIMEOUT_MS", 100)
    told = f"no router answers at tcp/127.0.0.1:{port} (start one with `surefoot up`"
    with expect_error(BusError, text=told, without=".rs"):
        connect()
    monkeypatch.setenv(variable, "garbage")
    with pytest.raises(ConfigError, match=f"{variable}: got 'garbage', expected tcp/"):
        connect()


def test_where_nothing_listens_a_client_does_not_wait_long() -> None:
    address, begin = free_address(), time.monotonic()
    with expect_error(BusError, "no_bus", text=f"no router answers at {address}"):
        connect(endpoint=address)
    assert 1.0 < time.monotonic() - begin < 3.0


def test_a_router_that_begins_to_listen_and_one_that_is_silent_are_waited_for() -> None:
    host, port = "127.0.0.1", int(free_address().rpartition(":")[2])
    late = threading.Timer(0.4, lambda: opened.append(socket.create_server((host, port))))
    opened: list[socket.socket] = []
    late.start()
    assert not nothing_listens(f"tcp/{host}:{port}")
    late.join()
    opened[0].close()
    assert nothing_listens(f"tcp/{host}:{port}", 0.2)
    assert not nothing_listens("ws/127.0.0.1:1")


def test_silence_ends_after_the_time_given(net: Net) -> None:
    tool = Client(net.open("client"))
    assert list(tool.messages(STATE_VELOCITY, timeout_s=0.05)) == []
    with expect_error(CallError, "timeout"):
        tool.latest(STATE_VELOCITY, timeout_s=0.05)
    with expect_error(CallError, "absent"):
        tool.call("stability/region", contacts=[])


def test_reading_again_and_again_leaves_nothing_behind(net: Net) -> None:
    tool = Client(net.open("client"))
    threads = {thread for thread in threading.enumerate() if thread.name == "pour"}
    for _ in range(5):
        assert list(tool.messages(STATE_VELOCITY, timeout_s=0.01)) == []
    for thread in {thread for thread in threading.enumerate() if thread.name == "pour"} - threads:
        thread.join(WAIT_S)
        assert not thread.is_alive()
    assert tool.bus._keep == []
    assert len(tool.bus._pours) <= 5, "those that had not ended at the last end"
    end = tool.subscribe(STATE_VELOCITY, print)
    tool.close()
    end()
    end()


@pytest.mark.parametrize(
    ("given", "kind", "field", "text"),
    [
        ({"robot": None}, FieldError, "robot", "got None, expected the name of a robot, such as 'ragno'"),
        ({"robot": ""}, FieldError, "robot", "got '', expected the name"),
        ({"robot": "tcp/127.0.0.1:9"}, FieldError, "robot", "an endpoint is passed as endpoint='tcp/127.0.0.1:9'"),
        ({"robot": "ra*no"}, FieldError, "robot", "without *, $, # and ?"),
        ({"fleet": 3}, FieldError, "fleet", "got 3, expected the name of a fleet"),
        ({"endpoint": 7}, ConfigError, "endpoint", "got 7, expected tcp/<host>:<port 1-65535>"),
    ],
)
def test_what_names_no_robot_or_router_is_refused_before_the_network(
    given: dict[str, Any], kind: type[SurefootError], field: str, text: str
) -> None:
    with expect_error(kind, field=field, text=text):
        connect(**{"endpoint": "tcp/127.0.0.1:9", **given})


def test_wrong_arguments_are_refused_at_the_call(net: Net) -> None:
    tool = Client(net.open("client"))
    for wait in (-1, float("nan"), float("inf"), "a"):
        for use in (tool.latest, tool.messages, AsyncClient(tool).messages):
            with expect_error(FieldError, field="timeout_s", text="allowed is 0 to 1e+09 s, or None for no end"):
                use(STATE_VELOCITY, timeout_s=wait)  # type: ignore[arg-type]
        with expect_error(FieldError, field="timeout_s", text="or None for that of the query"):
            tool.call("stability/region", timeout_s=wait, contacts=[])  # type: ignore[arg-type]
    for wrong in (None, 3):
        for use in (tool.latest, tool.messages):
            with expect_error(FieldError, field="topic", text=f"got {wrong}, expected a key such as"):
                use(wrong)  # type: ignore[arg-type]
        with expect_error(FieldError, field="query", text=f"got {wrong}, expected a key such as"):
            tool.call(wrong)  # type: ignore[arg-type]
    with expect_error(FieldError, field="sink", text="got 3, expected a function that takes a message"):
        tool.subscribe(STATE_VELOCITY, 3)  # type: ignore[arg-type]


def test_a_closed_client_says_so(net: Net) -> None:
    tool = Client(net.open("client"))
    tool.close()
    uses = (
        lambda: tool.call("stability/region", contacts=[]),
        lambda: tool.latest(STATE_VELOCITY),
        lambda: tool.messages(STATE_VELOCITY),
        lambda: tool.subscribe(STATE_VELOCITY, print),
        lambda: asyncio.run(AsyncClient(tool).latest(STATE_VELOCITY)),
    )
    for use in uses:
        with expect_error(BusError, "closed", text="surefoot.connect() opens another"):
            use()


def test_an_unknown_robot_is_reported_with_those_that_run(net: Net) -> None:
    fleet, _, robot = net.namespace.partition("/")
    with connect("nix", net.address, fleet) as tool:
        with expect_error(CallError, "absent", text="no system runs at this router"):
            tool.call("stability/region", contacts=[])
        serve(net.open(), lambda request: EMPTY)
        with connect(robot, net.address, fleet) as other:
            reached(other.bus, STABILITY_REGION)
        with expect_error(CallError, "absent", text=f"; running here: {net.namespace} (<fleet>/<robot>)"):
            tool.call("stability/region", contacts=[])
        with expect_error(CallError, "timeout", text=f"; running here: {net.namespace} "):
            tool.latest(STATE_VELOCITY, 0.01)


@pytest.mark.parametrize("wait", ["messages", "latest"])
def test_closing_a_client_ends_what_waits_without_a_limit(net: Net, wait: str) -> None:
    net.open()
    fleet, _, robot = net.namespace.partition("/")
    tool, ended, errors = connect(robot, net.address, fleet), threading.Event(), list[SurefootError]()

    def read() -> None:
        try:
            found = tool.latest(STATE_VELOCITY, None) if wait == "latest" else list(tool.messages(STATE_VELOCITY, None))
            assert found == []
        except SurefootError as error:
            errors.append(error)
        ended.set()

    threading.Thread(target=read, daemon=True).start()
    while not tool.waiting:
        assert not ended.is_set()
    tool.close()
    assert ended.wait(WAIT_S)
    assert [error.code for error in errors] == (["closed"] if wait == "latest" else [])
    assert not tool.waiting


def test_a_program_that_gave_up_a_wait_without_a_limit_ends(net: Net) -> None:
    net.open()
    fleet, _, robot = net.namespace.partition("/")

    async def program() -> list[VelocityEstimate]:
        async with AsyncClient(connect(robot, net.address, fleet)) as tool:
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(tool.latest(STATE_VELOCITY, None), 0.05)
            reader = asyncio.ensure_future(_all(tool))
            while len(tool.client.waiting) < 2:
                await asyncio.sleep(0)
        return await reader

    assert asyncio.run(asyncio.wait_for(program(), WAIT_S)) == []


async def _all(tool: AsyncClient) -> list[VelocityEstimate]:
    return [message async for message in tool.messages(STATE_VELOCITY, None)]
