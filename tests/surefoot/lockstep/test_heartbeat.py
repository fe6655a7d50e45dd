"""A service that is never idle sends its heartbeats by the clock all the same."""

import time
from dataclasses import replace
from typing import Any

import pytest

from surefoot.bus.interface import Delivery, Raw
from surefoot.bus.memory import MemoryBus
from surefoot.lockstep import node as runtime
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.driver import DriverNode, DueSample
from surefoot.lockstep.node import Node
from surefoot.schemas.topics import CMD_ESTOP, HEALTH
from tests.surefoot.toys import ToyDriver, ToyEstimator

BUSY_S = 0.5  # s wall, the service works without a pause
PERIOD_S = 0.05  # s wall, of its heartbeat in these tests


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runtime, "HEALTH", replace(HEALTH, rate_hz=1.0 / PERIOD_S))
    monkeypatch.setattr(runtime, "LOOK_S", PERIOD_S / 2)


def heartbeats(bus: MemoryBus) -> list[Delivery]:
    found: list[Delivery] = []
    bus.subscribe(HEALTH, found.append)
    return found


def test_of_a_driver_that_runs_as_fast_as_it_goes() -> None:
    class Busy(ToyDriver):
        def release(self, tick: int) -> list[DueSample]:
            if time.monotonic() > end:
                self.node.stop()
            return super().release(tick)

    bus = MemoryBus()
    found, driver = heartbeats(bus), Busy()
    node = DriverNode(driver, bus)
    node.start()
    node.begin((), "paced", 0.0, 1, "degrade", 0)
    end = time.monotonic() + BUSY_S
    node.run()
    assert node.leader.tick > 100, "it is never idle"
    assert len(found) >= 0.4 * BUSY_S / PERIOD_S


def test_of_a_service_whose_inbox_is_never_empty() -> None:
    class Flooded(ToyEstimator):
        observes = (CMD_ESTOP,)

    bus = MemoryBus()
    found = heartbeats(bus)
    node = Node(Flooded(ServiceConfig()), bus)
    node.start()
    original = node.handle
    end = time.monotonic() + BUSY_S

    def handle(item: Any) -> None:
        original(item)
        node.inbox.put(Delivery(CMD_ESTOP, None, Raw(b"{", None, "")))
        if time.monotonic() > end:
            node.stop()

    node.handle = handle  # type: ignore[method-assign]
    node.inbox.put(Delivery(CMD_ESTOP, None, Raw(b"{", None, "")))
    node.run()
    assert node.refused["malformed"] > 100
    assert len(found) >= 0.4 * BUSY_S / PERIOD_S
