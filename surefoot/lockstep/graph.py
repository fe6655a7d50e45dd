"""Graph of the declared dataflow between services, and their order within a tick if the graph has no cycle."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from surefoot.lockstep.driver import Driver
from surefoot.lockstep.join import DRIVER, Delayed
from surefoot.lockstep.service import Service
from surefoot.schemas.topics import CMD_JOINTS, Kind


@dataclass(frozen=True)
class Edge:
    """Dependence of service ``target`` on ``source``; ``delayed`` edges do not constrain the order within a tick."""

    source: str
    target: str
    key: str
    kind: str
    """Kind of the connection between two services: `topic` or `query`."""
    delayed: bool = False


def edges(services: Iterable[type[Service[Any]]]) -> list[Edge]:
    """Return the edges of the dataflow that the services declare by their inputs, outputs and calls.

    The edge of joint commands to the driver closes the control loop through the actuation delay, so it is delayed.
    """
    services, found = list(services), list[Edge]()
    driver = next((service.name for service in services if issubclass(service, Driver)), DRIVER)

    def owner(name: str) -> str:
        return driver if name == DRIVER else name

    for service in services:
        for item in service.inputs:
            topic = item.topic if isinstance(item, Delayed) else item
            delayed = isinstance(item, Delayed) or topic.kind is Kind.LATCHED
            found.append(Edge(owner(topic.owner), service.name, topic.key, "topic", delayed))
        for query in service.calls:
            found.append(Edge(owner(query.owner), service.name, query.key, "query"))
        if any(topic.key == CMD_JOINTS.key for topic in service.outputs):
            found.append(Edge(service.name, driver, CMD_JOINTS.key, "topic", True))
    return found


def order(services: Iterable[type[Service[Any]]]) -> list[str]:
    """Return the names of the services, sorted so that each follows the services it depends on within a tick.

    Raises:
        ValueError: the edges within a tick form a cycle; names the services in it.
    """
    listed = list(services)
    needs: dict[str, set[str]] = {service.name: set() for service in listed}
    for edge in edges(listed):
        if not edge.delayed and edge.source in needs and edge.source != edge.target:
            needs[edge.target].add(edge.source)
    done: list[str] = []
    while needs:
        free = sorted(name for name, sources in needs.items() if not sources - set(done))
        if not free:
            raise ValueError(f"the services {', '.join(sorted(needs))} wait for each other within a tick")
        for name in free:
            done.append(name)
            del needs[name]
    return done
