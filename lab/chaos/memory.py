"""Random faults on the in-memory bus: messages dropped, duplicated, reordered, delayed, corrupted or forged, services
killed or frozen. Time is virtual, so that a seed replays a failure to the bit.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from random import Random
from typing import Any

from surefoot.bus.interface import Delivery, Raw
from surefoot.bus.memory import MemoryBus
from surefoot.errors import BusError
from surefoot.lockstep.driver import DriverNode
from surefoot.lockstep.local import node_of
from surefoot.lockstep.node import Node
from surefoot.lockstep.service import Service
from surefoot.schemas.topics import Topic

from .events import ChaosEvent, ChaosOutcome

IDLE_S = 0.01
"""Virtual time by which a round advances the clock if no service has work, s."""
LEASE_S = 1.0
"""Duration of a service freeze, s of virtual time, from which on the service loses its liveliness token; shorter
than the lease of Zenoh, so that more of them lose it."""
RESTART_S = 1.5
"""Virtual time from the kill of a service to the start of its successor, s."""
JOIN_S = 1.0
"""Virtual time after the return of a service, s, from which on its absence from the lockstep roster is an error."""
PATIENT_S = 5.0
"""Longest virtual time that a query waits for a frozen service to answer, s."""
STALL_S = 300.0
"""Virtual time without a control tick after which a run counts as stalled and ends with an error, s."""


Forge = Callable[[Topic[Any], Delivery], Delivery | None]
"""Function that returns a forged delivery, sent before the given one of the topic's owner; None = no forgery."""


class ChaosBus(MemoryBus):
    """In-memory bus that drops, repeats, delays, corrupts or forges messages of the services of active faults."""

    def __init__(self, seed: int, forge: Forge) -> None:
        super().__init__()
        self._random, self._forge = Random(seed), forge
        self.left: dict[ChaosEvent, int] = {}
        """Number of deliveries that each active fault has still to affect."""
        self.spoilt = Counter[ChaosEvent]()
        """Number of deliveries that each fault has affected so far."""
        self._held: list[tuple[int, Callable[[Delivery], Any], Delivery]] = []
        self._round = 0

    def subscribe(self, topic: Topic[Any], sink: Callable[[Delivery], Any], *, bounded: bool = False) -> None:
        super().subscribe(topic, lambda delivery: self._pass(delivery, sink), bounded=bounded)

    def _pass(self, delivery: Delivery, sink: Callable[[Delivery], Any]) -> None:
        event = next((e for e, left in self.left.items() if left > 0 and e.service == delivery.topic.owner), None)
        if event is None:
            sink(delivery)
            return
        self.left[event] -= 1
        self.spoilt[event] += 1
        match event.kind:
            case "drop":
                return
            case "duplicate":
                sink(delivery)
                sink(delivery)
            case "reorder" | "delay":
                rounds = int(event.size) if event.kind == "delay" else self._random.randint(1, 3)
                self._held.append((self._round + rounds, sink, delivery))
            case "corrupt":
                payload = delivery.raw().payload if not delivery.prime else b""
                cut = payload[: self._random.randint(0, max(0, len(payload) - 1))] + b"\xff"
                sink(Delivery(delivery.topic, None, Raw(cut, None, ""), None, delivery.sender))
            case _:
                forged = None if delivery.prime else self._forge(delivery.topic, delivery)
                if forged is not None:
                    sink(forged)
                sink(delivery)

    def turn(self) -> bool:
        """Begin a round: deliver delayed messages that are due; return True if any were due or are still delayed."""
        self._round += 1
        due = [item for item in self._held if item[0] <= self._round]
        self._held = [item for item in self._held if item[0] > self._round]
        for _, sink, delivery in due:
            sink(delivery)
        return bool(due) or bool(self._held)

    def unserve(self, node: Node) -> None:
        """Remove the queries of a service that has ended from the bus."""
        for query in node.service.serves:
            self._servers.pop(query.key, None)


class ChaosSystem:
    """System of services in one process on a `ChaosBus`, with given faults at given ticks.

    Args:
        makers: factory of each service by name, the driver first; it also makes the successor of a killed one.
        events: faults in the order of their ticks.
        seed: seed of the random parts of the faults.
        forge: returns a forged delivery, sent before the given one of the topic's owner; None = no forgery.
    """

    def __init__(
        self, makers: Mapping[str, Callable[[], Service[Any]]], events: Sequence[ChaosEvent], seed: int, forge: Forge
    ) -> None:
        self.now = 0.0
        self.bus = ChaosBus(seed, forge)
        self._makers = dict(makers)
        self._waiting = list(events)
        self.outcomes: list[ChaosOutcome] = []
        self._frozen: dict[str, float] = {}
        self._dead: dict[str, float] = {}
        self._back: dict[str, float] = {}
        self._refused_before: dict[ChaosEvent, dict[tuple[str, str], int]] = {}
        self._at_work: list[Node] = []
        self.nodes: dict[str, Node] = {}
        for name in makers:
            self._start(name)
        driver = next(iter(self.nodes.values()))
        assert isinstance(driver, DriverNode)
        self.driver = driver

    def _start(self, name: str) -> None:
        node = node_of(self._makers[name](), self.bus, lambda: self.now)
        self.nodes[name] = node
        node.start()
        for query in node.service.serves:
            self.bus.pump_with(query, lambda name=name, node=node: self._answer(name, node))

    def _answer(self, name: str, node: Node) -> bool:
        """Let a service handle a pending query; return True if it did, False if it stays frozen or has none.

        While the service is frozen its caller waits, as over Zenoh: virtual time passes and other services go on.
        """
        until = self.now + PATIENT_S
        while name in self._frozen and len(self._at_work) == 1 and self.now < until:
            self._work(self.bus.turn())
            self._over_freezes()
        return name not in self._frozen and node.pump_once()

    def run(
        self, finished: Callable[[], bool], watch: Callable[[], None] = lambda: None, stall_s: float | None = None
    ) -> None:
        """Run the services in turn, with the faults at their ticks, until `finished` returns True.

        Args:
            finished: called after each round of all services; True ends the run.
            watch: called after each round.
            stall_s: virtual time without a tick after which the run counts as stalled, s; None = `STALL_S`.

        Raises:
            BusError: the run has stalled.
        """
        longest = STALL_S if stall_s is None else stall_s
        tick, moved = -1, self.now
        while not finished():
            progressed = self.bus.turn()
            self._happen()
            self._notice()
            self._work(progressed)
            watch()
            if self.driver.leader.tick != tick:
                tick, moved = self.driver.leader.tick, self.now
                self._close_events()
            if self.now - moved > longest:
                leader = self.driver.leader
                why = f"no tick after {tick} for {longest:g} s; {leader.state}, waits for {leader.missing()}"
                raise BusError("stalled", why)

    def _work(self, progressed: bool) -> None:
        """Let each service that is neither absent nor waiting work once; advance virtual time if not `progressed`."""
        for name, node in list(self.nodes.items()):
            if name not in self._frozen and name not in self._dead and node not in self._at_work:
                self._at_work.append(node)
                progressed = node.pump_once() or progressed
                node.timers()
                self._at_work.pop()
        if not progressed:
            self.now += IDLE_S

    def _over_freezes(self) -> None:
        for name in self._over(self._frozen):
            self.bus.announce(name, self.nodes[name].instance)

    def _happen(self) -> None:
        """Begin faults that are due, end freezes whose time is over, restart killed services after `RESTART_S`."""
        self._over_freezes()
        for name in self._over(self._dead):
            self._start(name)
        leader = self.driver.leader
        reached = max(leader.tick, 0) if leader.state == "running" else leader.tick
        while self._waiting and self._waiting[0].tick <= reached:
            event = self._waiting.pop(0)
            if event.service in self._dead or event.service in self._frozen:
                continue
            self.outcomes.append(ChaosOutcome(event, self.now))
            self._refused_before[event] = self._refused()
            if event.kind == "freeze":
                self._frozen[event.service] = self.now + event.size
                if event.size >= LEASE_S:
                    self.bus.depart(event.service)
            elif event.kind == "kill":
                self._dead[event.service] = self.now + RESTART_S
                self.bus.unserve(self.nodes[event.service])
                self.bus.depart(event.service)
            else:
                self.bus.left[event] = event.count

    def _over(self, absences: dict[str, float]) -> list[str]:
        """Remove services whose absence is over from `absences` (name to virtual end time, s); return their names."""
        names = [name for name, until in absences.items() if until <= self.now]
        for name in names:
            del absences[name]
            self._back[name] = self.now
        return names

    def _refused(self) -> dict[tuple[str, str], int]:
        return {(name, why): n for name, node in self.nodes.items() for why, n in node.refused.items()}

    def _notice(self) -> None:
        """Record the first sign of each fault: the driver misses the service, or a service counts a new refusal."""
        leader = self.driver.leader
        for place, outcome in enumerate(self.outcomes):
            event = outcome.event
            if outcome.noticed is not None or outcome.recovered is not None:
                continue
            by = f"{self.driver.name}: {leader.reason}" if event.service in leader.lost else ""
            if not by and self.bus.spoilt[event]:
                before = self._refused_before[event]
                by = next((f"{n}: {why}" for (n, why), k in self._refused().items() if k > before.get((n, why), 0)), "")
            if by:
                self.outcomes[place] = replace(outcome, noticed=self.now, by=by)

    def _close_events(self) -> None:
        """Record the recovery from all faults that are over, if every expected service is on the lockstep roster."""
        self._notice()
        leader = self.driver.leader
        if self._frozen or self._dead or not set(leader.expect) <= set(leader.members):
            return
        for place, outcome in enumerate(self.outcomes):
            if outcome.recovered is None and not self.bus.left.get(outcome.event):
                spoilt = self.bus.spoilt[outcome.event]
                self.outcomes[place] = replace(outcome, recovered=self.now, spoilt=spoilt)

    def absent(self) -> tuple[str, ...]:
        """Return the services that should be on the lockstep roster and at the current tick, but are not.

        A service that is frozen or dead, or has been back for less than `JOIN_S`, is not among them.
        """
        leader = self.driver.leader
        excused = {*self._frozen, *self._dead, *(n for n, at in self._back.items() if self.now - at < JOIN_S)}
        behind = {name for name, member in leader.members.items() if member.done < leader.tick}
        return tuple(n for n in leader.expect if n not in excused and (n not in leader.members or n in behind))

    def close(self) -> None:
        """End all services of the system."""
        for node in self.nodes.values():
            node.service.on_stop()
        self.bus.close()
