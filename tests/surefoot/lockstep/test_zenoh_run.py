"""The whole runtime over Zenoh, a thread and a session for each node."""

import json
import sys
import threading
import time
from contextlib import ExitStack
from subprocess import PIPE
from typing import Any, Self

import pytest
import zenoh

from surefoot.bus.publish import FRAME
from surefoot.lockstep.driver import DriverNode
from surefoot.lockstep.join import DRIVER
from surefoot.lockstep.local import node_of
from surefoot.schemas.system import HealthRequest
from surefoot.schemas.topics import HEALTH_GET, HW_IMU, HW_TICK
from tests.processes import running
from tests.processors import ROOT
from tests.surefoot.net import WAIT_S, Net, spinning, wait_until
from tests.surefoot.toys import toys


class Threads:
    """The toys of the in-memory tests as threads with a Zenoh session each, in a given order."""

    def __init__(self, net: Net, order: tuple[int, ...], ticks: int, namespace: str | None = None) -> None:
        self.driver, services = toys()
        self.observer: Any = services[3]
        self.stack = ExitStack()
        for place in order:
            node = node_of(services[place], net.open(namespace=namespace, identity=services[place].name))
            node.start()
            if isinstance(node, DriverNode):
                node.begin(("estimator", "walker", "recorder"), "lockstep", 0.0, 1, "hold", 0)
                node.leader.end_tick = ticks
                self.leader = node.leader
            self.stack.enter_context(spinning(node))

    def wait(self) -> list[float]:
        deadline = time.monotonic() + 4.0 * WAIT_S
        while not (self.leader.state == "ended" and self.leader.all_done()):
            assert time.monotonic() < deadline, self.leader
            threading.Event().wait(0.01)
        return self.driver.history

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stack.close()


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 2, 1, 0), (2, 0, 3, 1)], ids=str)
def test_run_over_zenoh_is_the_in_memory_run_in_any_order_and_misses_no_first_message(
    net: Net, order: tuple[int, ...]
) -> None:
    from tests.surefoot.lockstep.test_lockstep import run

    with Threads(net, order, ticks=60) as system:
        assert system.wait() == run(ticks=60)[0]
        assert [tick for tick, _ in system.observer.seen] == list(range(61))
        assert set(system.observer.seen[0][1]) == {"hw/imu", "state/velocity", "state/gait"}


def test_run_over_shared_memory_is_the_in_memory_run(monkeypatch: pytest.MonkeyPatch) -> None:
    from tests.surefoot.lockstep.test_lockstep import run

    monkeypatch.setenv("SUREFOOT_SHARED_MEMORY", "1")
    net = Net()
    try:
        with Threads(net, (0, 1, 2, 3), ticks=60) as system:
            assert system.wait() == run(ticks=60)[0]
    finally:
        net.close()


def test_ten_robots_on_one_network_walk_as_if_each_were_alone(net: Net) -> None:
    from tests.surefoot.lockstep.test_lockstep import run

    words = [sys.executable, "-m", "tests.surefoot.lockstep.alone", net.address]
    with ExitStack() as stack:
        robots = [
            stack.enter_context(running([*words, f"test/{number}"], stdout=PIPE, cwd=ROOT, text=True))
            for number in range(10)
        ]
        found = [json.loads(robot.communicate(timeout=6.0 * WAIT_S)[0]) for robot in robots]
    assert found == [[run(ticks=40)[0], list(range(41))]] * 10


def test_live_node_answers_its_health_and_refuses_what_strangers_send(net: Net) -> None:
    with Threads(net, (0, 1, 2, 3), ticks=20) as system:
        system.wait()
        tool = net.open("client")
        with net.plain() as stranger:
            for key in (HW_IMU.key, HW_TICK.key, FRAME.format(DRIVER), FRAME.format(DRIVER)):
                stranger.put(f"{net.namespace}/{key}", b"\xff{", congestion_control=zenoh.CongestionControl.BLOCK)

            def counted() -> bool:
                nonlocal health
                health = tool.call(HEALTH_GET.of("estimator"), HealthRequest()).health
                return health.refused.get("malformed") == 2

            health: Any = None
            wait_until(counted)
        assert health.state == "running"
        assert health.tick == 20
