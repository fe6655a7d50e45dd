"""A router and sessions on a loopback port, inside this process; for tests over Zenoh."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from typing import Any

import pytest
import zenoh

from surefoot.bus.interface import Incoming
from surefoot.bus.zenoh import ZenohBus, ZenohOptions
from surefoot.errors import Refusal
from surefoot.lockstep.node import Node
from surefoot.schemas.topics import STABILITY_REGION
from tests.ports import free_address

WAIT_S = 40.0  # s wall, bound of every wait; all come in milliseconds


class Net:
    """A router, unless another process runs it, and sessions that join it."""

    def __init__(self, namespace: str = "test/net", address: str = "", *, router: bool = True) -> None:
        self.address, self.namespace = address or free_address(), namespace
        self.buses: list[ZenohBus] = []
        if router:
            self.router = self.open("router", identity="supervisor")

    def open(self, mode: str = "peer", namespace: str | None = None, identity: str = "", secret: str = "") -> ZenohBus:
        listen = (self.address,) if mode == "router" else ()
        bus = ZenohBus(ZenohOptions(mode, (self.address,), listen, namespace or self.namespace, identity, secret))
        self.buses.append(bus)
        return bus

    def plain(self) -> zenoh.Session:
        """A session of a program that knows nothing of this project."""
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", f'["{self.address}"]')
        config.insert_json5("scouting/multicast/enabled", "false")
        return zenoh.open(config)

    def close(self) -> None:
        for bus in reversed(self.buses):
            bus.close()


class Inbox:
    """Return what came, in order, with bounded waits."""

    def __init__(self) -> None:
        self.queue: SimpleQueue[Any] = SimpleQueue()
        self.put = self.queue.put

    def get(self) -> Any:
        try:
            return self.queue.get(timeout=WAIT_S)
        except Empty:
            pytest.fail(f"nothing came within {WAIT_S} s")


def serve(bus: ZenohBus, answer: Any) -> None:
    """Answer region queries on Zenoh's own thread."""

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

    own(bus, STABILITY_REGION, on_query)


def own(bus: ZenohBus, query: Any, sink: Callable[[Incoming], Any] | None = None) -> None:
    """Show the token of the service that owns a query, and serve it."""
    if sink is not None:
        bus.serve(query, sink)
    bus.announce(query.owner, bus.new_instance())


def reached(bus: ZenohBus, query: Any) -> ZenohBus:
    """Wait until a query is known to a session; return the session."""
    wait_until(lambda: bus.probe(query))
    return bus


def matched(bus: ZenohBus, topic: Any) -> Any:
    """A publisher with a subscriber."""
    publisher: Any = bus.publisher(topic)
    wait_until(lambda: publisher._publisher.matching_status.matching)
    return publisher


def wait_until(condition: Callable[[], bool]) -> None:
    """Wait for what another thread does in milliseconds, `WAIT_S` at most."""
    deadline = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < deadline
        threading.Event().wait(0.005)


@contextmanager
def spinning(*nodes: Node) -> Iterator[None]:
    """Run each node in a thread of its own; stop them on leaving."""
    threads = [threading.Thread(target=node.run, daemon=True) for node in nodes]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        for node in nodes:
            node.stop()
        for thread in threads:
            thread.join(WAIT_S)
            assert not thread.is_alive()
