"""The public client: wrong names are reported, topics are read and queries called in a few lines."""

import threading

import pytest

from surefoot.client import Client, connect, make_request, query_named, topic_named
from surefoot.errors import BusError, CallError, ConfigError, SurefootError
from surefoot.schemas.stability import RegionReply
from surefoot.schemas.state import VelocityEstimate
from surefoot.schemas.topics import HEALTH, STABILITY_REGION, STATE_VELOCITY
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
