"""Readers that never read, floods on observed keys and queries: a run goes on as if they were not there."""

import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from types import SimpleNamespace
from typing import Any

import pytest

from surefoot.bus.inbox import OBSERVED_ITEMS, QUERY_ITEMS, Inbox, Lane
from surefoot.bus.interface import Delivery, Raw
from surefoot.bus.memory import MemoryBus
from surefoot.bus.unread import LinkTrouble, Unread, connections
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.driver import DriverNode
from surefoot.lockstep.node import Node
from surefoot.lockstep.sample import DueSample
from surefoot.schemas.hw import Landmark, LandmarkDetections
from surefoot.schemas.navigation import CancelRequest, NavigatorReply
from surefoot.schemas.system import HealthRequest, LogRecord
from surefoot.schemas.topics import CMD_ESTOP, HEALTH, HEALTH_GET, HW_LANDMARKS, NAVIGATOR_CANCEL, SIM_STATUS, TICK_NS
from tests.processes import running
from tests.surefoot.lockstep.node_bench import Bench
from tests.surefoot.lockstep.test_zenoh_run import Threads
from tests.surefoot.net import Net, spinning, wait_until
from tests.surefoot.toys import ToyDriver, ToyEstimator

READER = """
import json, sys, time, zenoh
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [sys.argv[1]]}}))
session = zenoh.open(config)
subscriber = session.declare_subscriber(sys.argv[2], zenoh.handlers.FifoChannel(1))
print(session.zid(), flush=True)
time.sleep(600)
"""
ASKER = """
import json, sys, zenoh
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [sys.argv[1]]}}))
session = zenoh.open(config)
while True:
    session.get(sys.argv[2], lambda reply: None, payload=b'{"goal_id": "a"}', timeout=1.0)
"""
FLOOD = 20_000  # messages
LANDMARKS = tuple(Landmark(range=1.0, bearing=0.5, descriptor=(0.125,) * 16) for _ in range(256))
GAP_S = 3.0  # s wall, an unread `**` stopped every run for at least 5 s before Zenoh closed it


def test_a_lane_is_bounded_by_count_and_by_bytes_and_counts_what_it_refuses() -> None:
    lane = Lane(3, 100_000)
    a, b, c, d = (SimpleNamespace(key=key) for key in "abcd")
    assert [lane.put(a, 10_000) for _ in range(5)] == [True, True, True, False, False]
    assert [lane.get() for _ in range(3)] == [a, a, a]
    assert lane.put(b, 1_000_000)  # the first always finds room
    assert not lane.put(c, 5_000)
    assert lane.get() is b
    assert [lane.put(d, 60_000) for _ in range(2)] == [True, False]
    assert lane.dropped == {"a": 2, "c": 1, "d": 1}


def test_what_a_tick_needs_comes_before_queries_and_these_before_what_is_observed() -> None:
    inbox, observed = Inbox(), Delivery(CMD_ESTOP, None, Raw(b"{}", None, ""))

    class Query:
        query = CMD_ESTOP
        size = 1

    query = Query()
    for put, item in ((inbox.put_observed, observed), (inbox.put_query, query), (inbox.put, "tick")):
        assert put(item)
    assert [inbox.get_nowait() for _ in range(3)] == ["tick", query, observed]
    assert inbox.put(query)  # of a participant
    assert inbox.tick
    for _ in range(10 * OBSERVED_ITEMS):
        inbox.put_observed(observed)
    for _ in range(10 * QUERY_ITEMS):
        inbox.put_query(query)
    assert inbox.put("tick")
    assert [inbox.get_nowait() for _ in range(2)] == [query, "tick"]
    assert inbox.dropped() == {CMD_ESTOP.key: 9 * (OBSERVED_ITEMS + QUERY_ITEMS)}


def test_heartbeats_are_not_displaced_by_other_status() -> None:
    inbox = Inbox()
    status, heartbeat = (Delivery(topic, None, Raw(b"{}", None, "")) for topic in (SIM_STATUS, HEALTH))
    for _ in range(10 * OBSERVED_ITEMS):
        inbox.put_observed(status)
    assert inbox.put_observed(heartbeat)
    assert inbox.get_nowait() is heartbeat


class Watcher(ToyEstimator):
    """An estimator that observes emergency stops."""

    observes = (CMD_ESTOP,)


@contextmanager
def unread(net: Net, key: str, count: int) -> Iterator[set[str]]:
    """Client processes that subscribe to a key and never read, by name; each blocks its whole session."""
    names = set[str]()
    with ExitStack() as stack:
        command = [sys.executable, "-c", READER, net.address, key]
        for _ in range(count):
            reader = stack.enter_context(running(command, stdout=subprocess.PIPE, text=True))
            assert reader.stdout is not None
            names.add(reader.stdout.readline().strip())
        yield names


@pytest.mark.parametrize(
    ("key", "mode"),
    [
        ("**", "lockstep"),
        ("*/*/@frame/*", "paced"),
        pytest.param("**", "paced", marks=pytest.mark.slow),
        pytest.param("*/*/@frame/*", "lockstep", marks=pytest.mark.slow),
    ],
)
def test_readers_of_everything_that_never_read_stop_nothing(net: Net, key: str, mode: str) -> None:
    gaps: list[float] = []

    class Timed(ToyDriver):
        """Its frames are so large that no buffer on the way holds all that is not read."""

        outputs = (*ToyDriver.outputs, HW_LANDMARKS)
        at = 0.0

        def release(self, tick: int) -> Any:
            now = time.monotonic()
            gaps.append(now - self.at)
            self.at = now
            seen = LandmarkDetections(landmarks=LANDMARKS)
            return [*super().release(tick), DueSample(HW_LANDMARKS, seen, tick * TICK_NS, tick)]

    with unread(net, key, 2) as readers:
        driver, estimator = DriverNode(Timed(), net.open()), Node(ToyEstimator(ServiceConfig()), net.open())
        for node in (driver, estimator):
            node.start()
        driver.begin(("estimator",), mode, 4.0, 1, "hold", 0)
        driver.leader.end_tick = 20_000
        with spinning(driver, estimator):
            wait_until(lambda: driver.leader.tick > 50)
            end = time.monotonic() + 2.0 * GAP_S
            wait_until(lambda: driver.leader.state == "ended" or time.monotonic() > end)
            assert driver.leader.tick > 500
            assert max(gaps[51:]) < GAP_S
            net.router.look_at_links()
            wait_until(lambda: {one.peer for one in net.router.look_at_links()} == readers)


def test_a_peer_that_reads_nothing_is_counted_in_health_and_logged_once_by_name_and_address() -> None:
    bench = Bench()
    trouble = LinkTrouble("unread", "peer 'a1b2' at 127.0.0.1:5 reads nothing", "a1b2")
    bench.bus.look_at_links = lambda: [trouble]  # type: ignore[method-assign]
    for _ in range(3):
        bench.node._next_health = 0.0
        bench.node.timers()
    assert bench.node.health().refused == {"unread": 3}
    (text,) = (record.text for record in bench.sent(LogRecord))
    assert "'a1b2' at 127.0.0.1:5 reads nothing" in text


def test_a_connection_whose_other_end_reads_now_and_then_is_not_stuck() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server, socket.create_connection(server.getsockname()) as reader:
        one, address = server.accept()
        with one:
            links = [SimpleNamespace(dst=f"tcp/127.0.0.1:{address[1]}", zid="a1b2")]
            session: Any = SimpleNamespace(info=SimpleNamespace(links=lambda: links))
            looks = Unread(session, lambda: dict(connections()))
            one.setblocking(False)
            with suppress(BlockingIOError):
                while True:
                    one.send(bytes(1 << 16))

            def stuck() -> list[str]:
                return [trouble.peer for trouble in looks.look() if "reads nothing: " in trouble.text]

            assert stuck() == []  # the first look has nothing to compare with
            wait_until(lambda: stuck() == ["a1b2"])
            assert "MiB wait for it" in looks.look()[0].text
            reader.settimeout(10.0)
            while looks.look():
                reader.recv(1 << 20)
            wait_until(lambda: stuck() == ["a1b2"])


def test_sessions_of_one_process_read_its_connections_once(monkeypatch: pytest.MonkeyPatch) -> None:
    reads: list[int] = []
    monkeypatch.setattr("surefoot.bus.unread.connections", lambda: reads.append(1) or iter(()))
    session: Any = SimpleNamespace(info=SimpleNamespace(links=list))
    for looks in [Unread(session) for _ in range(40)]:
        assert looks.look() == []
    assert len(reads) <= 2  # the others of the process may have read them just now


def test_a_flood_of_nonsense_and_of_queries_is_bounded_counted_and_over_when_it_ends(net: Net) -> None:
    with Threads(net, (0, 2, 3), ticks=2000) as system:
        node = Node(Watcher(ServiceConfig()), net.open())
        node.start()
        most: list[int] = []
        original, misplaced = node.handle, 0

        def handle(item: Any) -> None:
            nonlocal misplaced
            most.append(len(node.inbox.observed) + len(node.inbox.queries))
            waiting = node.inbox.tick.items.copy()
            misplaced += sum(isinstance(one, Delivery) and one.topic.key == CMD_ESTOP.key for one in waiting)
            original(item)

        node.handle = handle  # type: ignore[method-assign]
        with spinning(node):
            with net.plain() as stranger:
                for _ in range(FLOOD):
                    stranger.put(f"{net.namespace}/{CMD_ESTOP.key}", b"{")
                    stranger.put(f"{net.namespace}/of/nobody", b"{")
                for _ in range(FLOOD // 10):
                    stranger.get(f"{net.namespace}/health/estimator", lambda reply: None, payload=b"{", timeout=1.0)
                tool = net.open("client")
                health = tool.call(HEALTH_GET.of("estimator"), HealthRequest()).health  # within the limit of the query
            system.wait()
            assert system.driver.history == system.driver.history[:2000]
            assert health.refused["malformed"] > 0
            assert max(most) <= OBSERVED_ITEMS + QUERY_ITEMS
            assert misplaced == 0  # what is observed never waits before what a tick needs
            assert not node.refused["too_far_ahead"]


def test_a_participant_is_answered_while_strangers_flood_its_query(net: Net) -> None:
    """The flooded service needs 5 ms for each query; a participant waits for the one in hand at most."""
    handled: list[str] = []
    at_arrival: list[int] = []

    class Server(ToyEstimator):
        serves = (NAVIGATOR_CANCEL,)

        def on_start(self) -> None:
            self.handle(NAVIGATOR_CANCEL, self._slow)

        def _slow(self, request: CancelRequest) -> NavigatorReply:
            handled.append(request.goal_id)
            threading.Event().wait(0.005)
            return NavigatorReply(accepted=False)

    node = Node(Server(ServiceConfig()), net.open())
    put = node.inbox.put

    def counted(item: Any) -> bool:
        if getattr(item, "query", None) is NAVIGATOR_CANCEL and not item.probe:
            at_arrival.append(len(handled))
        return put(item)

    node.inbox.put = counted  # type: ignore[method-assign]
    node.start()
    asker, asked = net.open(), CancelRequest(goal_id="participant")
    with spinning(node):
        wait_until(lambda: asker.probe(NAVIGATOR_CANCEL, instance=node.instance))
        with running([sys.executable, "-c", ASKER, net.address, f"{net.namespace}/{NAVIGATOR_CANCEL.key}"]):
            wait_until(lambda: len(node.inbox.queries) > QUERY_ITEMS // 2)
            for _ in range(20):
                asker.call(NAVIGATOR_CANCEL, asked, 30.0, instance=node.instance)
            assert len(node.inbox.queries) > QUERY_ITEMS // 2
    answered = [place for place, goal in enumerate(handled) if goal == "participant"]
    assert len(at_arrival) == len(answered) == 20
    assert max(place - first for place, first in zip(answered, at_arrival, strict=True)) <= 1


@pytest.mark.parametrize("payload", [b"{", b"7" * 100_000])
def test_dropped_messages_are_named_in_health(payload: bytes) -> None:
    bus = MemoryBus()
    node = Node(Watcher(ServiceConfig()), bus)
    node.start()
    for _ in range(1000):
        node.inbox.put_observed(Delivery(CMD_ESTOP, None, Raw(payload, None, "")))
    dropped = node.health().dropped[CMD_ESTOP.key]
    node.pump()
    assert dropped + node.refused["malformed"] + node.refused["invalid"] == 1000
    assert len(payload) * (1000 - dropped) <= max(4 << 20, OBSERVED_ITEMS * len(payload))
