"""Model of random faults, for the in-memory bus and for live processes: events that a seed draws, and outcomes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from random import Random
from typing import Literal, NamedTuple, get_args

from surefoot.schemas.topics import CMD_JOINTS

Kind = Literal["drop", "duplicate", "reorder", "delay", "corrupt", "forge", "freeze", "kill", "terminate", "slow"]
MESSAGES: tuple[Kind, ...] = ("drop", "duplicate", "reorder", "delay", "corrupt", "forge")
"""Kinds of faults that spoil only messages; a lockstep run with them equals the run without faults bit by bit."""
FREEZE_S = (0.3, 1.0, 5.0)
"""Durations of a service freeze to draw from, s; a driver is frozen for less than `DRIVER_FREEZE_S`."""
DRIVER_FREEZE_S = 3.0
SLOW_S = (1.0, 3.0)
"""Durations for which a service is slowed down, to draw from, wall time, s."""
MOST_MESSAGES = 20
"""Largest number of deliveries that one event spoils, and number of commands that it forges in a live system."""
MOST_ROUNDS = 30
"""Largest delay of a delivery, in rounds of the bus."""
SWARM_SHARE = 0.5
"""Probability with which each kind of faults is enabled in the run of a seed."""
FORGER = "forger"
"""Sender name of forged messages."""
FORGED_RAD = 0.4
"""Difference between a forged joint command and the real one, rad."""


@dataclass(frozen=True)
class ChaosEvent:
    """Random fault drawn from a seed: kind, target service, tick, number of messages and size."""

    kind: Kind
    tick: int
    """Control tick of the driver in which the event begins."""
    service: str
    """Owner of the spoilt messages, or the service that is frozen, slowed, ended or killed."""
    count: int = 0
    """Number of deliveries that the event spoils, or of messages that are forged; 0 of kinds that spoil none."""
    size: float = 0.0
    """Delay in rounds of the bus, or duration of a freeze or of slow running, s."""


@dataclass(frozen=True)
class ChaosOutcome:
    """Outcome of one event; times are virtual s (in a live system wall s) since the start."""

    event: ChaosEvent
    began: float
    spoilt: int = 0
    """Number of deliveries that the event spoilt."""
    recovered: float | None = None
    """Time at which the system was as before, s; None = never."""
    noticed: float | None = None
    """Time at which a participant first noticed the event, s; None = never."""
    by: str = ""
    """Participant that noticed the event first, and by what sign."""


@dataclass(frozen=True, kw_only=True)
class ChaosRun:
    """Result of a run with random faults: outcomes of the events, violations of safety, and a fall."""

    seed: int
    """Seed of the events."""
    outcomes: tuple[ChaosOutcome, ...]
    """Outcome of each event that happened."""
    violations: tuple[str, ...]
    """Unsafe states and missing recoveries, in words; empty = none."""
    ticks: int
    """Control ticks that the run took."""
    kinds: tuple[Kind, ...] = ()
    """Kinds of faults that the seed left on."""
    fell_at: int | None = None
    """Tick in which the robot fell; None = it did not. A fall is a violation unless the robot also falls when it is
    held at the moment in which its commands ended: see `surefoot.lab.chaos.run.falls_when_held`."""


class Stage(NamedTuple):
    """Environment of a run with faults (in-memory bus or live processes): possible kinds, and how one is drawn."""

    kinds: tuple[Kind, ...]
    first_tick: int
    """First control tick in which an event may begin."""
    fault: Callable[[Random, Kind, Sequence[str]], tuple[str, int, float]]
    """Draws service, count and size of an event of a kind; the first service is the driver."""


def swarm(stage: Stage, seed: int) -> tuple[Kind, ...]:
    """Return the kinds of faults that a seed allows in its run, at least one.

    Two faults can hide each other's failures, and a run in which every kind happens shows no kind alone (swarm testing,
    Groce et al., ISSTA 2012).
    """
    random = Random(f"swarm {seed}")
    kept: tuple[Kind, ...] = tuple(kind for kind in stage.kinds if random.random() < SWARM_SHARE)
    return kept or (random.choice(stage.kinds),)


def draw_events(
    stage: Stage, seed: int, number: int, services: Sequence[str], ticks: int, kinds: Sequence[Kind] = ()
) -> tuple[ChaosEvent, ...]:
    """Return random faults in the order of their ticks, identical for equal seeds.

    Args:
        stage: `MEMORY` or `LIVE`.
        seed: seed of the random generator.
        number: number of events to draw.
        services: names of services that may be hit, the driver first (it is not killed).
        ticks: of the run; no event begins in its last fifth, so that the end shows whether everything recovered.
        kinds: to draw from; empty = those that the seed allows, see `swarm`.
    """
    random, kinds = Random(seed), kinds or swarm(stage, seed)
    found: list[ChaosEvent] = []
    for _ in range(number):
        kind = random.choice(kinds)
        service, count, size = stage.fault(random, kind, services)
        tick = random.randint(stage.first_tick, max(stage.first_tick, ticks * 4 // 5))
        found.append(ChaosEvent(kind, tick, service, count, size))
    return tuple(sorted(found, key=lambda event: event.tick))


def _fault_in_memory(random: Random, kind: Kind, services: Sequence[str]) -> tuple[str, int, float]:
    """Draw a fault of messages or of a service; the driver is neither killed nor frozen."""
    hits_process = kind in ("freeze", "kill")
    service = random.choice(services[1:] if hits_process else services)
    size = random.choice(FREEZE_S) if kind == "freeze" else float(random.randint(1, MOST_ROUNDS))
    return service, 0 if hits_process else random.randint(1, MOST_MESSAGES), size


def _live_fault(random: Random, kind: Kind, services: Sequence[str]) -> tuple[str, int, float]:
    """Draw a fault of a process; the driver is neither killed nor ended, nor frozen until its lease is over."""
    service = random.choice(services[1:] if kind in ("kill", "terminate") else services)
    freezes = [s for s in FREEZE_S if s < DRIVER_FREEZE_S] if service == services[0] else FREEZE_S
    frozen, slow = random.choice(freezes), random.choice(SLOW_S)  # both, so that a seed keeps its events
    if kind == "forge":
        return CMD_JOINTS.owner, MOST_MESSAGES, 0.0
    return service, 0, {"freeze": frozen, "slow": slow}.get(kind, 0.0)


MEMORY = Stage(get_args(Kind)[:8], 1, _fault_in_memory)
"""The in-memory bus: messages are spoilt, services killed and frozen, in virtual time."""
LIVE = Stage(("kill", "terminate", "freeze", "slow", "forge"), 120, _live_fault)
"""Live processes: killed, ended, frozen, slowed, and commands forged, once the robot stands and walks."""
