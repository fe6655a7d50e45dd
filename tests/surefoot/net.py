"""A router and sessions on a loopback port, inside this process; for tests over Zenoh."""

import threading
import time
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any

import pytest
import zenoh

from surefoot.bus.interface import Incoming
from surefoot.bus.zenoh import ZenohBus, ZenohOptions
from surefoot.errors import Refusal
from surefoot.schemas.topics import STABILITY_REGION
from tests.ports import free_address

WAIT_S = 40.0  # s wall, bound of every wait; all come in milliseconds


class Net:
    """A router and sessions that join it."""

    def __init__(self, namespace: str = "test/net") -> None:
        self.address, self.namespace = free_address(), namespace
        self.buses: list[ZenohBus] = []
        self.router = self.open("router")

    def open(self, mode: str = "peer", namespace: str | None = None) -> ZenohBus:
        listen = (self.address,) if mode == "router" else ()
        bus = ZenohBus(ZenohOptions(mode, (self.address,), listen, namespace or self.namespace))
        self.buses.append(bus)
        return bus

    def plain(self) -> zenoh.Session:
        """A session of somebody who knows nothing of us."""
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", f'["{self.address}"]')
        config.insert_json5("scouting/multicast/enabled", "false")
        return zenoh.open(config)

    def close(self) -> None:
        for bus in reversed(self.buses):
            bus.close()


class Inbox:
    """What came, in order, with bounded waits."""

    def __init__(self) -> None:
        self.queue: SimpleQueue[Any] = SimpleQueue()
        self.put = self.queue.put

    def get(self) -> Any:
        try:
            return self.queue.get(timeout=WAIT_S)
        except Empty:
            pytest.fail(f"nothing came within {WAIT_S} s")


def serve(bus: ZenohBus, answer: Any) -> None:
    """Answers region queries on Zenoh's own thread."""

    def on_query(incoming: Incoming) -> None:
        if incoming.probe:
            incoming.accept_probe()
            return
        try:
            reply = answer(incoming.request())
        except Refusal as refusal:
            incoming.fail(refusal)
            return
        incoming.reply(reply)

    bus.serve(STABILITY_REGION, on_query)


def reached(bus: ZenohBus, query: Any) -> None:
    """Waits until a query is known here."""
    deadline = time.monotonic() + WAIT_S
    while not bus.probe(query):
        assert time.monotonic() < deadline


def matched(bus: ZenohBus, topic: Any) -> Any:
    """A publisher that somebody listens to."""
    publisher: Any = bus.publisher(topic)
    wait_until(lambda: publisher._publisher.matching_status.matching)
    return publisher


def wait_until(condition: Callable[[], bool]) -> None:
    """Bounded; what is awaited here comes from another thread in milliseconds."""
    deadline = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < deadline
        threading.Event().wait(0.005)
