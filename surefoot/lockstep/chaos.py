"""Faults from a seed, on the in-memory bus: messages dropped, duplicated, reordered, delayed, corrupted and forged,
services killed and frozen. Time is virtual, so that a seed replays a failure to the bit.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from random import Random
from typing import Any, Literal, get_args

from surefoot.bus.interface import Delivery, Raw
from surefoot.bus.memory import MemoryBus
from surefoot.errors import BusError
from surefoot.lockstep.driver import DriverNode
from surefoot.lockstep.local import node_of
from surefoot.lockstep.node import Node
from surefoot.lockstep.service import Service
from surefoot.schemas.topics import Topic

Kind = Literal["drop", "duplicate", "reorder", "delay", "corrupt", "forge", "freeze", "kill", "terminate", "slow"]
KINDS: tuple[Kind, ...] = get_args(Kind)[:8]
"""Kinds on the in-memory bus; a live system knows the last five."""
IDLE_S = 0.01  # s, virtual time passes by so much when no service has anything to do
FREEZE_S = (0.3, 1.0, 5.0)  # s of virtual time
RESTART_S = 1.5  # s of virtual time from the death of a service to its successor
MOST_MESSAGES = 20  # deliveries that one event spoils
FORGER = "forger"
JOIN_S = 1.0  # s of virtual time after which a service that is back must be on the roster
STALL_S = 300.0  # s of virtual time without a tick after which a run counts as stalled


@dataclass(frozen=True)
class Event:
    """One fault.

    Attributes:
        kind: what happens.
        tick: control tick of the driver in which it begins.
        service: whose messages are spoilt, or who is frozen, slowed, ended or killed.
        count: deliveries it spoils, or messages that are forged; 0 of kinds that spoil none.
        size: delay in rounds of the bus, or s of a freeze or of slow running.
    """

    kind: Kind
    tick: int
    service: str
    count: int = 0
    size: float = 0.0


@dataclass(frozen=True)
class Outcome:
    """What became of an event.

    Attributes:
        event: the event.
        began: virtual s (live: wall s) since the start.
        spoilt: deliveries that it spoiled.
        recovered: when all was as before, in the same time; None = never.
        noticed: when it was first noticed, None = never.
        by: who noticed, and how, in words.
    """

    event: Event
    began: float
    spoilt: int = 0
    recovered: float | None = None
    noticed: float | None = None
    by: str = ""


def draw_events(
    seed: int, number: int, services: Sequence[str], ticks: int, kinds: Sequence[Kind] = KINDS
) -> tuple[Event, ...]:
    """Return so many events, in the order of their ticks; the same for the same seed.

    Args:
        seed: of the draw.
        number: of events.
        services: who may be hit; the first is the driver, which is neither killed nor frozen.
        ticks: of the run; no event begins in its last fifth, so that the end shows whether everything recovered.
        kinds: to draw from.
    """
    random = Random(seed)
    found: list[Event] = []
    for _ in range(number):
        kind = random.choice(kinds)
        hits_process = kind in ("freeze", "kill")
        service = random.choice(services[1:] if hits_process else services)
        size = random.choice(FREEZE_S) if kind == "freeze" else float(random.randint(1, 30))
        count = 0 if hits_process else random.randint(1, MOST_MESSAGES)
        found.append(Event(kind, random.randint(1, max(1, ticks * 4 // 5)), service, count, size))
    return tuple(sorted(found, key=lambda event: event.tick))


class ChaosBus(MemoryBus):
    """A bus that spoils deliveries of chosen owners."""

    def __init__(self, seed: int) -> None:
        super().__init__()
        self._random = Random(seed)
        self.left: dict[Event, int] = {}
        """Deliveries that active events may still spoil."""
        self.spoilt: dict[Event, int] = {}
        self._held: list[tuple[int, Callable[[Delivery], Any], Delivery]] = []
        self._round = 0
        self.forge: Callable[[Topic[Any], Delivery], Delivery | None] = lambda topic, delivery: None
        """Makes what a forger publishes before the owner's own message, None for nothing."""

    def subscribe(self, topic: Topic[Any], sink: Callable[[Delivery], Any], *, bounded: bool = False) -> None:
        super().subscribe(topic, lambda delivery: self._pass(delivery, sink), bounded=bounded)

    def _pass(self, delivery: Delivery, sink: Callable[[Delivery], Any]) -> None:
        event = next((e for e, left in self.left.items() if left > 0 and e.service == delivery.topic.owner), None)
        if event is None:
            sink(delivery)
            return
        self.left[event] -= 1
        self.spoilt[event] = self.spoilt.get(event, 0) + 1
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
                forged = None if delivery.prime else self.forge(delivery.topic, delivery)
                if forged is not None:
                    sink(forged)
                sink(delivery)

    def turn(self) -> bool:
        """Begin a round: deliver what was held back until now; return whether there was anything."""
        self._round += 1
        due = [item for item in self._held if item[0] <= self._round]
        self._held = [item for item in self._held if item[0] > self._round]
        for _, sink, delivery in due:
            sink(delivery)
        return bool(due) or bool(self._held)

    def unserve(self, node: Node) -> None:
        """Forget the queries of a service that is gone."""
        for query in node.service.serves:
            self._servers.pop(query.key, None)


class ChaosSystem:
    """Services in one process, and events that hit them.

    Args:
        makers: by name, what makes a service; the driver first. A killed one is made anew.
        events: in the order of their ticks.
        seed: of what is random in the events.
    """

    def __init__(self, makers: Mapping[str, Callable[[], Service[Any]]], events: Sequence[Event], seed: int) -> None:
        self.now = 0.0
        self.bus = ChaosBus(seed)
        self._makers = dict(makers)
        self._waiting = list(events)
        self.outcomes: list[Outcome] = []
        self._frozen: dict[str, float] = {}
        self._dead: dict[str, float] = {}
        self._back: dict[str, float] = {}
        self._refused_before: dict[Event, dict[tuple[str, str], int]] = {}
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
            self.bus.pump_with(query, lambda name=name, node=node: name not in self._frozen and node.pump_once())

    def run(self, finished: Callable[[], bool], watch: Callable[[], None] = lambda: None) -> None:
        """Let the services work in turn, and the events happen, until ``finished``.

        Args:
            finished: asked after each round.
            watch: called after each round; raises when something unsafe has happened.

        Raises:
            BusError: no tick for ``STALL_S`` of virtual time.
        """
        tick, moved = -1, self.now
        while not finished():
            progressed = self.bus.turn()
            self._happen()
            self._notice()
            for name, node in list(self.nodes.items()):
                if name not in self._frozen and name not in self._dead:
                    progressed = node.pump_once() or progressed
                    node.timers()
            watch()
            if not progressed:
                self.now += IDLE_S
            if self.driver.leader.tick != tick:
                tick, moved = self.driver.leader.tick, self.now
                self._close_events()
            if self.now - moved > STALL_S:
                leader = self.driver.leader
                why = f"no tick after {tick} for {STALL_S:g} s; {leader.state}, waits for {leader.missing()}"
                raise BusError("stalled", why)

    def _happen(self) -> None:
        """Begin the events that are due, end the freezes, start the successors."""
        for name in [name for name, until in self._frozen.items() if until <= self.now]:
            self._frozen.pop(name)
            self._back[name] = self.now
            self.bus.announce(name, self.nodes[name].instance)
        for name in [name for name, until in self._dead.items() if until <= self.now]:
            self._dead.pop(name)
            self._back[name] = self.now
            self._start(name)
        while self._waiting and self._waiting[0].tick <= self.driver.leader.tick:
            event = self._waiting.pop(0)
            if event.service in self._dead or event.service in self._frozen:
                continue
            self.outcomes.append(Outcome(event, self.now))
            self._refused_before[event] = self._refused()
            if event.kind == "freeze":
                self._frozen[event.service] = self.now + event.size
                if event.size >= 1.0:  # the lease is over: its token is gone
                    self.bus.depart(event.service)
            elif event.kind == "kill":
                self._dead[event.service] = self.now + RESTART_S
                self.bus.unserve(self.nodes[event.service])
                self.bus.depart(event.service)
            else:
                self.bus.left[event] = event.count

    def _refused(self) -> dict[tuple[str, str], int]:
        return {(name, why): n for name, node in self.nodes.items() for why, n in node.refused.items()}

    def _notice(self) -> None:
        """Note who is first to see an event: a driver that waits, or a service that counts one refusal more."""
        leader = self.driver.leader
        for place, outcome in enumerate(self.outcomes):
            event = outcome.event
            if outcome.noticed is not None or outcome.recovered is not None:
                continue
            by = f"{self.driver.name}: {leader.reason}" if event.service in leader.lost else ""
            if not by and self.bus.spoilt.get(event):
                before = self._refused_before[event]
                by = next((f"{n}: {why}" for (n, why), k in self._refused().items() if k > before.get((n, why), 0)), "")
            if by:
                self.outcomes[place] = replace(outcome, noticed=self.now, by=by)

    def _close_events(self) -> None:
        """Note that events are over: a tick comes, with everybody on the roster."""
        self._notice()
        leader = self.driver.leader
        if self._frozen or self._dead or not set(leader.expect) <= set(leader.members):
            return
        for place, outcome in enumerate(self.outcomes):
            if outcome.recovered is None and not self.bus.left.get(outcome.event):
                spoilt = self.bus.spoilt.get(outcome.event, 0)
                self.outcomes[place] = replace(outcome, recovered=self.now, spoilt=spoilt)

    def absent(self) -> tuple[str, ...]:
        """Return the services that should be back on the roster and up to date, and are not.

        Who is still frozen or dead, or has been back for less than ``JOIN_S``, is not among them.
        """
        leader = self.driver.leader
        excused = {*self._frozen, *self._dead, *(n for n, at in self._back.items() if self.now - at < JOIN_S)}
        behind = {name for name, member in leader.members.items() if member.done < leader.tick}
        return tuple(n for n in leader.expect if n not in excused and (n not in leader.members or n in behind))

    def close(self) -> None:
        """End all services."""
        for node in self.nodes.values():
            node.service.on_stop()
        self.bus.close()
