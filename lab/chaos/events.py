"""Model of random faults, for the in-memory bus and live processes: events drawn from a seed, and their outcomes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from random import Random
from typing import Literal, NamedTuple, get_args

from surefoot.schemas.topics import CMD_JOINTS

Kind = Literal["drop", "duplicate", "reorder", "delay", "corrupt", "forge", "freeze", "kill", "terminate", "slow"]
MESSAGES: tuple[Kind, ...] = ("drop", "duplicate", "reorder", "delay", "corrupt", "forge")
"""Kinds of faults that affect only messages; a lockstep run with them equals the run without faults bit by bit."""
FREEZE_S = (0.3, 1.0, 5.0)
"""Possible durations of a service freeze, s; for a live driver only those below `DRIVER_FREEZE_S`."""
DRIVER_FREEZE_S = 3.0
SLOW_S = (1.0, 3.0)
"""Possible durations, s of wall time, for which a service is slowed down."""
MOST_MESSAGES = 20
"""Largest number of deliveries that an event affects on the in-memory bus; number of commands it forges when live."""
MOST_ROUNDS = 30
"""Largest delay of a delivery by a fault, in rounds of the in-memory bus."""
SWARM_SHARE = 0.5
"""Probability with which a seed enables each kind of fault for its run."""
FORGER = "forger"
"""Name of the bus participant that publishes forged messages."""
FORGED_RAD = 0.4
"""Offset of every joint angle in a forged joint command: from the real command in memory, from the truth live, rad."""


@dataclass(frozen=True)
class ChaosEvent:
    """Random fault drawn from a seed: kind, target service, tick, number of messages and size."""

    kind: Kind
    tick: int
    """Control tick of the driver in which the event begins; 0 = before tick 0, once all services are ready."""
    service: str
    """Service whose published messages are affected, or that is frozen, slowed, terminated or killed."""
    count: int = 0
    """Number of deliveries that the event affects, or of messages that it forges; 0 for faults of a process."""
    size: float = 0.0
    """Delay of a delivery, rounds of the in-memory bus, or duration of a freeze or of slow running, s."""


@dataclass(frozen=True)
class ChaosOutcome:
    """Outcome of a fault; times in s since the start of the run, virtual (in a live system: wall time)."""

    event: ChaosEvent
    began: float
    spoilt: int = 0
    """Number of deliveries that the fault affected."""
    recovered: float | None = None
    """Time since the start of the run at which all services worked again, s; None = never."""
    noticed: float | None = None
    """Time since the start of the run at which a participant first noticed the fault, s; None = never."""
    by: str = ""
    """Name of the participant that noticed the fault first, and its sign (reason, log text); empty = none did."""


@dataclass(frozen=True, kw_only=True)
class ChaosRun:
    """Result of a run with random faults: outcomes of the events, violations of safety, and a fall."""

    seed: int
    """Seed from which the faults were drawn."""
    outcomes: tuple[ChaosOutcome, ...]
    """Outcome of each fault that was injected."""
    violations: tuple[str, ...]
    """Unsafe states and missing recoveries, a sentence each; empty = none, the run passed."""
    ticks: int
    """Number of control ticks that the run took."""
    kinds: tuple[Kind, ...] = ()
    """Kinds of faults that were enabled in the run."""
    fell_at: int | None = None
    """Control tick in which the robot fell; None = it did not. A fall is a violation unless the robot would also fall
    with its joints held from the tick at which its commands ended, see `surefoot.lab.chaos.run.falls_when_held`."""


class FaultDraw(NamedTuple):
    """Environment of a run with faults (in-memory bus or live processes): possible kinds, and how one is drawn."""

    kinds: tuple[Kind, ...]
    first_tick: int
    """First control tick in which a fault may begin."""
    fault: Callable[[Random, Kind, Sequence[str]], tuple[str, int, float]]
    """Function (random generator, kind, services, driver first) that returns service, count and size of a fault."""


def swarm(stage: FaultDraw, seed: int) -> tuple[Kind, ...]:
    """Return the kinds of faults that a seed enables for its run, at least one.

    A fault can mask the failure that another one causes, so each run has a random subset of the kinds (swarm testing,
    Groce et al., ISSTA 2012).
    """
    random = Random(f"swarm {seed}")
    kept: tuple[Kind, ...] = tuple(kind for kind in stage.kinds if random.random() < SWARM_SHARE)
    return kept or (random.choice(stage.kinds),)


def draw_events(
    stage: FaultDraw, seed: int, number: int, services: Sequence[str], ticks: int, kinds: Sequence[Kind] = ()
) -> tuple[ChaosEvent, ...]:
    """Return random faults in the order of their ticks, identical for equal seeds.

    Args:
        stage: `MEMORY` or `LIVE`.
        seed: seed of the random generator.
        number: number of events to draw.
        services: names of services that may be hit, the driver first (it is not killed).
        ticks: length of the run, control ticks; no event begins in its last fifth, so that the end shows recovery.
        kinds: kinds of faults to draw from; empty = those that the seed enables, see `swarm`.
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
    """Draw service, count and size of a fault on the in-memory bus; the driver is neither killed nor frozen."""
    hits_process = kind in ("freeze", "kill")
    service = random.choice(services[1:] if hits_process else services)
    size = random.choice(FREEZE_S) if kind == "freeze" else float(random.randint(1, MOST_ROUNDS))
    return service, 0 if hits_process else random.randint(1, MOST_MESSAGES), size


def _live_fault(random: Random, kind: Kind, services: Sequence[str]) -> tuple[str, int, float]:
    """Draw service, count and size of a live fault; the driver is not killed or terminated, frozen < 3 s."""
    service = random.choice(services[1:] if kind in ("kill", "terminate") else services)
    freezes = [s for s in FREEZE_S if s < DRIVER_FREEZE_S] if service == services[0] else FREEZE_S
    frozen, slow = random.choice(freezes), random.choice(SLOW_S)  # both, so that a seed keeps its events
    if kind == "forge":
        return CMD_JOINTS.owner, MOST_MESSAGES, 0.0
    return service, 0, {"freeze": frozen, "slow": slow}.get(kind, 0.0)


MEMORY = FaultDraw(get_args(Kind)[:8], 1, _fault_in_memory)
"""Stage of faults on the in-memory bus, in virtual time, from control tick 1: of messages, and `freeze`, `kill`."""
LIVE = FaultDraw(("kill", "terminate", "freeze", "slow", "forge"), 120, _live_fault)
"""Stage of faults of live processes, in wall time, from control tick 120 on, when the robot stands and walks."""
