"""A peer that was killed leaves in those that live on no memory, no descriptors; and a reader that raises."""

import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import zenoh

from surefoot.bus.pour import pour
from surefoot.bus.zenoh import ZenohBus
from tests.processes import running
from tests.surefoot.net import Inbox, Net, wait_until

RESTARTS = 4
LEAST_KB = 20_000  # kB, what one restart once left behind

PEER = """
import sys, threading
from surefoot.bus.zenoh import ZenohBus, ZenohOptions
bus = ZenohBus(ZenohOptions("peer", (sys.argv[1],), (), sys.argv[2]))
heard = threading.Event()
subscriber = bus.session.declare_subscriber("down", lambda sample: heard.set())
while True:
    bus.session.put("up", bytes(20000))
    if heard.wait(0.01):
        print("linked", flush=True)
"""


def descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def resident_kb() -> int:
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1])


def test_a_killed_peer_leaves_nothing_behind(net: Net) -> None:
    survivor: ZenohBus = net.open()
    came = Inbox()
    subscriber = survivor.session.declare_subscriber("up", lambda sample: came.put(len(sample.payload.to_bytes())))
    publisher = survivor.session.declare_publisher("down")
    before: list[tuple[int, int]] = []
    for _ in range(1 + RESTARTS):
        command = [sys.executable, "-c", PEER, net.address, net.namespace]
        with running(command, stdout=subprocess.PIPE, text=True) as peer:
            assert came.get() == 20000
            wait_until(lambda: publisher.matching_status.matching)  # type: ignore[attr-defined]
            for _ in range(20):
                publisher.put(bytes(20000))
            assert peer.stdout is not None
            assert peer.stdout.readline() == "linked\n"
            peer.send_signal(signal.SIGKILL)
            peer.wait()
        wait_until(lambda: not publisher.matching_status.matching)  # type: ignore[attr-defined]
        while not came.queue.empty():
            came.get()
        before.append((descriptors(), resident_kb()))
    assert before[-1][0] - before[0][0] <= 1
    assert before[-1][1] - before[0][1] < RESTARTS * LEAST_KB / 4
    del subscriber


def test_a_reader_that_raises_gets_the_next_message_all_the_same() -> None:
    class Handler:
        def __init__(self) -> None:
            self.items = [1, 2, 3]

        def recv(self) -> int:
            if not self.items:
                raise zenoh.ZError("closed")
            return self.items.pop(0)

    seen: Any = Inbox()

    def sink(item: int) -> None:
        seen.put(item)
        if item == 1:
            raise ValueError(item)

    pour(Handler(), lambda item: item, sink)
    assert [seen.get() for _ in range(3)] == [1, 2, 3]
