"""Cost of encrypted connections with certificates: round trip of a joint state, speed of the demo."""

import multiprocessing
import os
import statistics
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from benchmarks.bench import Bench, goal
from benchmarks.bus import NAMESPACE, PER_BLOCK, publish, state
from benchmarks.lockstep import zenoh_run
from surefoot.bus.endpoint import secured
from surefoot.bus.zenoh import ZenohBus, ZenohOptions
from surefoot.lab.security.made import Membership, classes, make
from surefoot.schemas.hw import JointState
from surefoot.schemas.topics import CMD_JOINTS, HW_JOINTS, Kind, Topic
from surefoot.services.supervisor.processes.compose import load_compose
from tests.ports import free_address

BENCH = Bench("secure")

PING = Topic(HW_JOINTS.key, JointState, Kind.SAMPLE, "driver")
PONG = Topic(CMD_JOINTS.key, JointState, Kind.COMMAND, "walker")
"""Topic of the replies: joint commands' key with a joint state, in frames of the walker, which the driver may read."""


@contextmanager
def certificates(namespace: str) -> Iterator[None]:
    """Create certificates of the system `ragno`, for this process and those that it starts, inside the context."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["SUREFOOT_SECURITY"] = folder
        try:
            make(classes(load_compose("ragno")), namespace, Membership(("operator",), (), (), 2))
            yield
        finally:
            del os.environ["SUREFOOT_SECURITY"]


def echo(router: str, ready: Any, stop: Any) -> None:
    """Send every received joint state back in a frame of the walker, in a process of its own, until `stop` is set.

    Args:
        router: endpoint of the router to connect to.
        ready: event of multiprocessing, set here once joint states are received.
        stop: event of multiprocessing that ends the loop.
    """
    bus = ZenohBus(ZenohOptions("peer", (router,), (), NAMESPACE, "walker"))
    work: SimpleQueue[Any] = SimpleQueue()
    pong = bus.publisher(PONG)
    bus.take((PING,), work.put)
    ready.set()
    while not stop.is_set():
        with suppress(Empty):
            for delivery in work.get(timeout=0.2).deliveries():
                publish(bus, pong, delivery.message())
    bus.close()


class Pair:
    """Two processes on one router, and the trips between them."""

    def __init__(self, router: str) -> None:
        self._hub = ZenohBus(ZenohOptions("router", (), (router,), NAMESPACE, "supervisor"))
        context = multiprocessing.get_context("spawn")
        ready, self._stop = context.Event(), context.Event()
        self._other = context.Process(target=echo, args=(router, ready, self._stop))
        self._other.start()
        self._bus = ZenohBus(ZenohOptions("peer", (router,), (), NAMESPACE, "simulator"))
        self._got: SimpleQueue[Any] = SimpleQueue()
        self._bus.take((PONG,), self._got.put)
        self._ping = self._bus.publisher(PING)
        self._count = 0
        ready.wait(60.0)
        deadline = time.monotonic() + 60.0
        while True:  # the links are up when the first trip comes back
            try:
                self.trip(0.1)
                break
            except Empty:
                if time.monotonic() > deadline:
                    raise
        for _ in range(2 * PER_BLOCK):
            self.trip()

    def trip(self, timeout: float = 5.0) -> None:
        """Send a joint state to the other process and wait until it comes back, at most `timeout` s."""
        self._count += 1
        publish(self._bus, self._ping, state(self._count))
        for delivery in self._got.get(timeout=timeout).deliveries():
            delivery.message()

    def block(self) -> float:
        """Return the mean time of a trip to the other process and back over a block of trips, s."""
        began = time.perf_counter()
        for _ in range(PER_BLOCK):
            self.trip()
        return (time.perf_counter() - began) / PER_BLOCK

    def close(self) -> None:
        """End both processes."""
        self._stop.set()
        self._other.join(10.0)
        self._bus.close()
        self._hub.close()


@BENCH.part("--blocks 1")
def round_trips(*, blocks: int = 30) -> None:
    """Round trips of an 18-joint state in frames, peer to peer on loopback, with certificates and without, interleaved.

    Args:
        blocks: number of blocks of 100 round trips each way.
    """
    with certificates(NAMESPACE):
        pairs = {"plain": Pair(free_address()), "secure": Pair(secured(free_address()))}
        times: dict[str, list[float]] = {name: [] for name in pairs}
        for _ in range(blocks):
            for name, pair in pairs.items():
                times[name].append(pair.block())
        for pair in pairs.values():
            pair.close()
    for name, values in times.items():
        goal(name, statistics.median(values) * 1e6, unit="us")
    goal("secure / plain", statistics.median(b / a for a, b in zip(*times.values(), strict=True)), "<=", 1.5)


@BENCH.part("--rounds 1")
def demo(*, rounds: int = 5) -> None:
    """Real-time factor of the demo with certificates and without, in turns; the run hashes must be equal.

    Args:
        rounds: pairs of runs.
    """
    ratios, hashes = list[float](), set[str]()
    with certificates("surefoot/ragno"), tempfile.TemporaryDirectory() as name:
        for number in range(rounds):
            ways = {"plain": free_address(), "secure": secured(free_address())}
            found = {way: zenoh_run(Path(name), "--no-record", listen=place) for way, place in ways.items()}
            factor = {way: result["values"]["real_time_factor"] for way, result in found.items()}
            hashes |= {result["message_hash"] for result in found.values()}
            ratios.append(factor["secure"] / factor["plain"])
            print(f"round {number}: plain {factor['plain']:.2f}, secure {factor['secure']:.2f}", flush=True)
    print(f"hashes: {', '.join(sorted(hashes))}")
    goal("secure / plain", statistics.median(ratios), ">=", 0.8)
