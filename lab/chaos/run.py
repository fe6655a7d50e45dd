"""Scenario run with random faults in one process on the in-memory bus, and the check of its safety."""

import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from surefoot.bus.interface import Delivery
from surefoot.errors import BusError
from surefoot.files import find
from surefoot.lockstep.leader import COMMANDER
from surefoot.lockstep.service import Service
from surefoot.schemas.hw import JointCommand
from surefoot.schemas.sim import ResetRequest
from surefoot.schemas.state import VelocityEstimate
from surefoot.schemas.system import RecorderRequest
from surefoot.schemas.topics import HW_TICK, RECORDER_STATUS, SIM_RESET, Topic
from surefoot.services.simulator.service import Simulator
from surefoot.services.supervisor.processes.compose import Compose, ComposeError, load_compose
from surefoot.services.supervisor.scenarios.director import Director
from surefoot.services.supervisor.scenarios.scenario import Scenario
from surefoot.services.supervisor.service import Supervisor

from ..runs.local import build_services
from .events import FORGED_RAD, FORGER, MEMORY, MESSAGES, ChaosEvent, ChaosRun, Kind, draw_events, swarm
from .memory import ChaosSystem

SAFE = ("recorder", Supervisor.name)
"""Services that are never hit by a fault, since they record the run."""
HELD_TICKS = 300
"""Number of control ticks (3 s) for which a robot with held joints is observed for a fall."""
FORGED_M_PER_S = 3.0
"""Velocity along x in a forged velocity estimate, m/s."""
_CLEAN: dict[str, str] = {}


@dataclass(frozen=True, kw_only=True)
class MemoryRun(ChaosRun):
    """Result of a run on the in-memory bus with random faults."""

    run_hash: str
    """Hash of all deterministic messages of the run, equal whenever its seed is replayed."""
    unbound: int
    """Number of messages that services refused because their sender is no member of the system."""
    wall_s: float
    """Duration of the run in virtual time, s."""


def run_chaos(
    scenario: Scenario,
    seed: int,
    events: int,
    kinds: tuple[Kind, ...] = (),
    ticks: int | None = None,
    *,
    paced: bool = False,
    progress: Callable[[float], None] = lambda share: None,
) -> MemoryRun:
    """Run a scenario with random faults on the in-memory bus; return outcomes and violations of safety.

    Args:
        scenario: scenario to run; its own seed is that of the world.
        seed: seed from which the faults are drawn.
        events: number of faults.
        kinds: kinds of faults to draw from; empty = those that the seed enables.
        ticks: number of control ticks over which the faults are spread; None = half of the scenario's duration limit.
        paced: True: time goes on while a service is missing, as on a robot; False: time waits for it (lockstep).
        progress: called with the share of the run's longest duration that has passed, 0 to 1.
    """
    kinds = kinds or swarm(MEMORY, seed)
    found = drawn(scenario, seed, events, kinds, ticks)
    return replace(suffer(scenario, found, seed, paced=paced, progress=progress), kinds=kinds)


def drawn(
    scenario: Scenario, seed: int, events: int, kinds: tuple[Kind, ...] = (), ticks: int | None = None
) -> tuple[ChaosEvent, ...]:
    """Return the faults that a seed draws for a scenario.

    Args:
        scenario: scenario whose services may be hit.
        seed: seed from which the faults are drawn.
        events: number of faults.
        kinds: kinds of faults to draw from; empty = those that the seed enables.
        ticks: number of control ticks over which the faults are spread; None = half of the scenario's duration limit.
    """
    hit = ("driver", *(name for name in _members(scenario) if name not in SAFE))
    return draw_events(MEMORY, seed, events, hit, ticks or scenario.max_ticks // 2, kinds)


def suffer(
    scenario: Scenario,
    events: Sequence[ChaosEvent],
    seed: int,
    *,
    paced: bool = False,
    progress: Callable[[float], None] = lambda share: None,
) -> MemoryRun:
    """Run a scenario on the in-memory bus with given faults, and return the result.

    Args:
        scenario: scenario to run.
        events: faults, in the order of their ticks.
        seed: seed of the random parts of the faults.
        paced: True: time goes on while a service is missing; False: time waits for it (lockstep).
        progress: called with the share of the run's longest duration that has passed, 0 to 1.
    """
    run = _conduct(scenario, events, seed, paced=paced, progress=progress)
    spoilt_only = not paced and bool(events) and {event.kind for event in events} <= set(MESSAGES)
    if spoilt_only and run.run_hash not in ("", _clean_hash(scenario)):
        run = replace(run, violations=("another hash than without faults", *run.violations))
    if run.fell_at is None:
        return run
    outages = [o.event.tick for o in run.outcomes if paced and o.event.service == COMMANDER]
    tick = max((tick for tick in outages if tick <= run.fell_at), default=None)
    if tick is None or not falls_when_held(scenario, tick):
        return replace(run, violations=(f"the robot fell before tick {run.fell_at}", *run.violations))
    return run


def _clean_hash(scenario: Scenario) -> str:
    """Return the run hash of a scenario without faults, computed once and cached."""
    name = repr(scenario)
    if name not in _CLEAN:
        _CLEAN[name] = _conduct(scenario, (), 0, paced=False).run_hash
    return _CLEAN[name]


def falls_when_held(scenario: Scenario, tick: int) -> bool:
    """Return True if the robot falls within 3 s after its joint commands end at a tick, without other faults.

    The driver then holds the joints at their angles. If the robot falls, holding cannot prevent a fall at this tick.
    """
    lost = (ChaosEvent("freeze", tick, COMMANDER, size=math.inf),)
    return _conduct(scenario, lost, 0, paced=True, max_ticks=tick + HELD_TICKS).fell_at is not None


def _members(scenario: Scenario) -> tuple[str, ...]:
    compose = load_compose(find("compose", scenario.compose, ".yaml", ComposeError))
    return tuple(name for name in compose.services if name != Simulator.name)


def _made(name: str, compose: Compose, director: Director, environment: Mapping[str, str]) -> Service[Any]:
    return build_services((name,), compose, director, None, environment)[0]


def _conduct(
    scenario: Scenario,
    events: Sequence[ChaosEvent],
    seed: int,
    *,
    paced: bool,
    max_ticks: int | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> MemoryRun:
    compose = load_compose(find("compose", scenario.compose, ".yaml", ComposeError))
    director, names = Director(scenario), _members(scenario)
    with tempfile.TemporaryDirectory() as folder:
        memory = {"SUREFOOT_WALKER_MEMORY": str(Path(folder) / "walker.json")}
        makers: dict[str, Callable[[], Service[Any]]] = {
            name: partial(_made, name, compose, director, memory) for name in (Simulator.name, *names)
        }
        system = ChaosSystem(makers, events, seed, _forge)
        request = ResetRequest(
            seed=scenario.seed, world=scenario.world, expect=names, policy="hold",
            max_ticks=max_ticks or scenario.max_ticks, actuation_delay_ticks=scenario.actuation_delay_ticks,
            mode="paced" if paced else "lockstep", rtf=float(paced),
        )  # fmt: skip
        run = _follow(system, request, seed, progress)
    if max_ticks is None:
        run = replace(run, violations=(*run.violations, *director.problems, *director.unfinished()))
    return run


def _follow(system: ChaosSystem, request: ResetRequest, seed: int, progress: Callable[[float], None]) -> MemoryRun:
    """Run a system with its faults to the end of the scenario; return the result, with violations and a fall."""
    simulator = system.driver.service
    assert isinstance(simulator, Simulator)
    leader, violations, fallen = system.driver.leader, list[str](), list[int]()

    def watch() -> None:
        progress(leader.tick / leader.end_tick if leader.end_tick else 0.0)
        if not fallen and leader.tick >= 0 and simulator.world.truth().fallen:
            fallen.append(leader.tick)

    run_hash = ""
    try:
        system.bus.call(SIM_RESET, request)
        system.run(lambda: leader.state == "ended" and leader.all_done(), watch)
        if "recorder" in request.expect:
            run_hash = system.bus.call(RECORDER_STATUS, RecorderRequest()).run_hash
        if system.absent():
            violations.append(f"not back: {', '.join(system.absent())}")
    except BusError as error:
        violations.append(error.message)
    finally:
        system.close()
    unbound = sum(node.refused["unbound"] for node in system.nodes.values())
    found, fell_at = tuple(system.outcomes), next(iter(fallen), None)
    return MemoryRun(
        seed=seed, outcomes=found, violations=tuple(violations), ticks=leader.tick + 1, fell_at=fell_at,
        run_hash=run_hash, unbound=unbound, wall_s=system.now,
    )  # fmt: skip


def _forge(topic: Topic[Any], delivery: Delivery) -> Delivery | None:
    """Return a forged delivery with the header of a real one and other content; None for a topic that is not forged."""
    message = delivery.message()
    header = (message.stamp_ns, message.tick, message.epoch, message.seq, message.source)
    if isinstance(message, JointCommand) and message.position is not None:
        forged: Any = JointCommand(position=tuple(q + FORGED_RAD for q in message.position)).stamped(*header)
    elif isinstance(message, VelocityEstimate):
        forged = message.model_copy(update={"velocity": (FORGED_M_PER_S, 0.0, 0.0)})
    elif topic.key == HW_TICK.key:
        forged = message.model_copy(update={"epoch": 10**9})
    else:
        return None
    return Delivery(topic, forged, None, None, FORGER)
