"""Run of a scenario in one process on the in-memory bus; services, lockstep, verdict and hash are those of a live run.

Studies over many seeds are built on it, see `surefoot.lab.studies`.
"""

import gc
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from surefoot.errors import SurefootError
from surefoot.lockstep.config import ServiceConfig, load_config
from surefoot.lockstep.discover import service_class
from surefoot.lockstep.driver import DriverNode
from surefoot.lockstep.local import LocalSystem
from surefoot.lockstep.service import Service
from surefoot.schemas.sim import ResetRequest
from surefoot.schemas.system import RecorderRequest
from surefoot.schemas.topics import HEALTH, RECORDER_STATUS, SIM_RESET, TICK_S
from surefoot.services.supervisor.processes.compose import Compose
from surefoot.services.supervisor.processes.startable import system_of
from surefoot.services.supervisor.scenarios.director import Director
from surefoot.services.supervisor.scenarios.recorded import about_run
from surefoot.services.supervisor.scenarios.scenario import Scenario
from surefoot.services.supervisor.service import Supervisor

from ..report.judge import RunVerdict, judge
from ..report.traces import read_traces
from .attached import attached


@dataclass(frozen=True)
class LocalRun:
    """Result of a run in one process: seed, verdict on the limits, run hash, number of control ticks, wall time (s)."""

    seed: int
    verdict: RunVerdict
    run_hash: str
    ticks: int
    wall_s: float

    @property
    def rtf(self) -> float:
        """Real-time factor of the run: its simulated time over its wall time."""
        return self.ticks * TICK_S / self.wall_s


def build_services(
    names: Iterable[str],
    compose: Compose,
    director: Director,
    recording: Path | None,
    more: Mapping[str, str] | None = None,
    about: str = "",
) -> list[Service[Any]]:
    """Return services of a compose file as objects; the supervisor runs the scenario of `director`.

    Args:
        names: names of the services to build, in this order.
        compose: system with the configuration of the services.
        director: executes the steps of the scenario.
        recording: MCAP file to write; None = only the run hash is computed.
        more: further environment variables that configure services.
        about: facts on the run that are written to the recording.
    """
    built: list[Service[Any]] = []
    robot = compose.robot
    for name in names:
        if name == Supervisor.name:
            built.append(Supervisor(ServiceConfig(robot=robot), director))
            continue
        kind: type[Service[Any]] = service_class(name)
        overrides = [f"robot={robot!r}"]
        if "autostart" in kind.Config.model_fields:  # the first epoch is ours
            overrides.append("autostart=false")
        environment = {**compose.services[name].environment, **director.scenario.environment, **(more or {})}
        config = load_config(kind.Config, name, None, environment, overrides)
        if name == "recorder":
            config = config.model_copy(update={"path": None if recording is None else str(recording), "about": about})
        built.append(kind(config))
    return built


def _refuse_kills(scenario: Scenario) -> None:
    """Raise SurefootError if a step ends a service: in one process there is none that could end alone."""
    if killed := next((step.service for step in scenario.steps if step.do == "kill"), ""):
        text = f"got kill of {killed}, allowed are the other steps: all services run in this process (surefoot run)"
        raise SurefootError("invalid", text, "step")


def run_local(
    scenario: Scenario,
    seed: int | None = None,
    *,
    strict: bool = False,
    recording: Path | None = None,
    without: Iterable[str] = (),
    meddle: Callable[[LocalSystem], None] = lambda system: None,
) -> LocalRun:
    """Run a scenario in this process; return verdict, run hash and times.

    Args:
        scenario: scenario to run.
        seed: seed of the run; None = the scenario's own.
        strict: True: no actuation delay; False: the delay that the scenario sets.
        recording: MCAP file to write; None = only the run hash is computed.
        without: names of services to leave out.
        meddle: called with the system before the run begins, e.g. to wrap methods of its services.

    Raises:
        ComposeError: the system cannot be started.
        ScenarioError: the scenario names a service that the system lacks, or configures one wrongly.
        SurefootError: a step of the scenario ends a service, which in one process is none that could end alone.
    """
    _refuse_kills(scenario)
    gc.collect()  # the run before in this process refers to itself, and holds its messages: 100 MB of a minute
    seed = scenario.seed if seed is None else seed
    compose, director = system_of(scenario), Director(scenario)
    names = [name for name in compose.services if name not in set(without)]
    request = ResetRequest(
        seed=seed, world=scenario.world, expect=tuple(names),
        actuation_delay_ticks=0 if strict else scenario.actuation_delay_ticks,
        policy=scenario.policy, max_ticks=scenario.max_ticks,
    )  # fmt: skip
    files = {} if recording is None else attached(compose, scenario.environment)
    about = about_run(compose.robot, compose.name, names, request, scenario, files)
    services = build_services(names, compose, director, recording, about=about)
    system = LocalSystem(services)
    supervisor = next(service for service in services if isinstance(service, Supervisor))
    try:
        meddle(system)
        for recorder in (service for service in services if service.name == "recorder"):
            for node in system.nodes:  # health is published by the wall clock, seldom within a run in one process
                recorder.on_message(HEALTH, node.health())
        system.bus.call(SIM_RESET, request)
        leader = next(node.leader for node in system.nodes if isinstance(node, DriverNode))
        system.run_until(lambda: leader.tick >= 0)
        began = time.perf_counter()
        system.run_until(lambda: leader.state == "ended" and leader.all_done())
        wall_s = time.perf_counter() - began
        asked = RECORDER_STATUS, RecorderRequest()
        run_hash = system.bus.call(*asked).run_hash if "recorder" in names else ""
        verdict = judge(
            read_traces(supervisor.kept, supervisor.notes), scenario.limits, wall_s=wall_s,
            message_hash=run_hash, comparable=leader.comparable,
            problems=(*supervisor.stops(), *director.problems, *director.unfinished()), notes=tuple(director.notes),
        )  # fmt: skip
        return LocalRun(seed, verdict, run_hash, leader.tick + 1, wall_s)
    finally:
        system.close()
