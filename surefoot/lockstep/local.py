"""A whole system in one process on the in-memory bus: the same services, the same lockstep, the same run hash.

For tests, for studies over many seeds (one process per seed, no ports) and for replay.
"""

import time
from collections.abc import Callable, Iterable
from typing import Any

from surefoot.bus.memory import MemoryBus
from surefoot.errors import BusError
from surefoot.lockstep.driver import Driver, DriverNode
from surefoot.lockstep.node import Node
from surefoot.lockstep.service import Service


def node_of(service: Service[Any], bus: Any, clock: Callable[[], float] = time.monotonic) -> Node:
    """Return a new runtime for a service: a DriverNode for a driver, else a Node."""
    return DriverNode(service, bus, clock) if isinstance(service, Driver) else Node(service, bus, clock)


class LocalSystem:
    """Services of a system that share an in-memory bus; they run only during ``run_until``."""

    def __init__(self, services: Iterable[Service[Any]]) -> None:
        self.bus = MemoryBus()
        self.nodes = [node_of(service, self.bus) for service in services]
        for node in self.nodes:
            node.start()
            for query in node.service.serves:
                self.bus.pump_with(query, node.pump_once)

    def run_until(self, finished: Callable[[], bool], max_idle_rounds: int = 200_000) -> None:
        """Run the services in turn until ``finished()`` is true.

        Raises:
            BusError: no service did anything in ``max_idle_rounds`` turns.
        """
        idle = 0
        while not finished():
            progressed = False
            for node in self.nodes:
                progressed = node.pump_once() or progressed
            idle = 0 if progressed else idle + 1
            if idle > max_idle_rounds:
                waiting = {node.name: node.health().waiting_for for node in self.nodes}
                raise BusError("stalled", f"nothing moves any more; waiting: {waiting}")

    def close(self) -> None:
        """End all services of the system and release the bus."""
        for node in self.nodes:
            node.service.on_stop()
        self.bus.close()
