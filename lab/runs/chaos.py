"""A scenario under faults from a seed, in one process on the in-memory bus: what happened, and whether it was safe."""

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
from surefoot.lockstep.chaos import FORGER, KINDS, ChaosSystem, Event, Kind, Outcome, draw_events
from surefoot.lockstep.leader import COMMANDER
from surefoot.lockstep.service import Service
from surefoot.schemas.hw import JointCommand
from surefoot.schemas.sim import ResetRequest
from surefoot.schemas.state import VelocityEstimate
from surefoot.schemas.system import RecorderRequest
from surefoot.schemas.topics import HW_TICK, RECORDER_STATUS, SIM_RESET, Topic
from surefoot.services.simulator.service import Simulator
from surefoot.services.supervisor.processes.compose import ComposeError, load_compose
from surefoot.services.supervisor.scenarios.director import Director
from surefoot.services.supervisor.scenarios.scenario import Scenario
from surefoot.services.supervisor.service import Supervisor

from .local import build_services

SAFE = ("recorder", Supervisor.name)
"""Services that are not hit: they keep what happened."""
HELD_TICKS = 300  # a held robot that stands after 3 s does not fall any more
FORGED_RAD = 0.4  # rad, by which a forged command differs from the real one
FORGED_M_PER_S = 3.0  # m/s, the same for a velocity


@dataclass(frozen=True)
class ChaosRun:
    """What came of a run.

    Attributes:
        seed: of the events.
        outcomes: the events that happened.
        violations: what was unsafe or did not recover, in words; empty = nothing.
        ticks: control ticks.
        run_hash: of everything deterministic, the same whenever the seed is replayed.
        unbound: messages of strangers that were refused.
        wall_s: virtual time of the run, s.
        fell_at: tick in which the robot fell, None = it did not. A fall is a violation unless the robot falls, too,
            when it is held at the moment in which its commands ended: see ``falls_when_held``.
    """

    seed: int
    outcomes: tuple[Outcome, ...]
    violations: tuple[str, ...]
    ticks: int
    run_hash: str
    unbound: int
    wall_s: float
    fell_at: int | None = None


def run_chaos(
    scenario: Scenario,
    seed: int,
    events: int,
    kinds: tuple[Kind, ...] = KINDS,
    ticks: int | None = None,
    *,
    paced: bool = False,
) -> ChaosRun:
    """Conduct a scenario while so many events happen.

    Args:
        scenario: what to do; its own seed is that of the world.
        seed: of the events.
        events: how many.
        kinds: to draw from.
        ticks: of the run over which the events are spread, None = half of the scenario's longest duration.
        paced: time goes on in real time, as on a robot, whoever is missing; else it waits (lockstep).
    """
    hit = ("driver", *(name for name in _members(scenario) if name not in SAFE))
    run = _conduct(scenario, draw_events(seed, events, hit, ticks or scenario.max_ticks // 2, kinds), seed, paced=paced)
    if run.fell_at is None:
        return run
    outages = [o.event.tick for o in run.outcomes if paced and o.event.service == COMMANDER]
    tick = max((tick for tick in outages if tick <= run.fell_at), default=None)
    if tick is None or not falls_when_held(scenario, tick):
        return replace(run, violations=(f"the robot fell before tick {run.fell_at}", *run.violations))
    return run


def falls_when_held(scenario: Scenario, tick: int) -> bool:
    """Return whether the robot falls within 3 s when nothing happens but that no command comes from a tick on.

    So the driver holds the joints where they are. A robot that falls then could not have been held.
    """
    lost = (Event("freeze", tick, COMMANDER, size=math.inf),)
    return _conduct(scenario, lost, 0, paced=True, max_ticks=tick + HELD_TICKS).fell_at is not None


def _members(scenario: Scenario) -> tuple[str, ...]:
    compose = load_compose(find("compose", scenario.compose, ".yaml", ComposeError))
    return tuple(name for name in compose.service_names if name != Simulator.name)


def _made(name: str, compose: Any, director: Director, environment: Mapping[str, str]) -> Service[Any]:
    return build_services((name,), compose, director, None, environment)[0]


def _conduct(
    scenario: Scenario, events: Sequence[Event], seed: int, *, paced: bool, max_ticks: int | None = None
) -> ChaosRun:
    compose = load_compose(find("compose", scenario.compose, ".yaml", ComposeError))
    director, names = Director(scenario), _members(scenario)
    with tempfile.TemporaryDirectory() as folder:
        memory = {"SUREFOOT_WALKER_MEMORY": str(Path(folder) / "walker.json")}
        makers: dict[str, Callable[[], Service[Any]]] = {
            name: partial(_made, name, compose, director, memory) for name in (Simulator.name, *names)
        }
        system = ChaosSystem(makers, events, seed)
        request = ResetRequest(
            seed=scenario.seed, world=scenario.world, expect=names, policy="hold",
            max_ticks=max_ticks or scenario.max_ticks, actuation_delay_ticks=scenario.actuation_delay_ticks,
            mode="paced" if paced else "lockstep", rtf=float(paced),
        )  # fmt: skip
        run = _follow(system, request)
    if max_ticks is None:
        run = replace(run, violations=(*run.violations, *director.problems, *director.unfinished()))
    return replace(run, seed=seed)


def _follow(system: ChaosSystem, request: ResetRequest) -> ChaosRun:
    """Let a system run to its end."""
    simulator = system.driver.service
    assert isinstance(simulator, Simulator)
    leader, violations, fallen = system.driver.leader, list[str](), list[int]()
    system.bus.forge = _forge

    def watch() -> None:
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
    return ChaosRun(0, found, tuple(violations), leader.tick + 1, run_hash, unbound, system.now, fell_at)


def _forge(topic: Topic[Any], delivery: Delivery) -> Delivery | None:
    """What a stranger publishes before the owner: the same header, other content."""
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
