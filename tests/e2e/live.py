"""A live system made by hand: a router, a supervisor and one process per service, each started and ended by its id."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from surefoot.bus.interface import Life
from surefoot.bus.seals import VARIABLE
from surefoot.bus.zenoh import ZenohBus, ZenohOptions
from surefoot.files import find
from surefoot.lab.report.judge import RunVerdict, judge
from surefoot.lab.report.traces import read_traces
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.node import Node
from surefoot.schemas.sim import ResetRequest
from surefoot.schemas.system import Health, HealthRequest, RecorderRequest, ServiceStatus
from surefoot.schemas.topics import HEALTH_GET, RECORDER_STATUS, SIM_RESET
from surefoot.services.supervisor.processes.compose import ComposeError, load_compose
from surefoot.services.supervisor.scenarios.director import Director
from surefoot.services.supervisor.scenarios.scenario import Scenario
from surefoot.services.supervisor.service import Supervisor
from tests.ports import free_port
from tests.processes import end_process

ROOT = Path(__file__).parents[2]
START_S = 240.0  # s wall, a first start compiles kernels
RUN_S = 240.0  # s wall without the end of a run
STOP_S = 60.0  # s wall for an end; takes less than 2
SERVICES = tuple(
    name for name in load_compose(find("compose", "ragno", ".yaml", ComposeError)).services if name != Supervisor.name
)
"""Services that the compose file starts beside the supervisor."""
SHORT = """
description = "Ragno stands up and walks two steps over rough ground"
max_duration_s = 10.0
seed = 5
[world]
terrain = "rough"
[[step]]
when = "ready"
do = "walk"
distance = 0.05
[limits]
no_fall = true
"""


def environment(folder: Path, **more: str) -> dict[str, str]:
    """That of a child: nothing of the caller's settings, its own folders of state and certificates."""
    kept = {key: value for key, value in os.environ.items() if key == VARIABLE or not key.startswith("SUREFOOT_")}
    own = {"XDG_STATE_HOME": str(folder / "state"), "XDG_CONFIG_HOME": str(folder / "config")}
    return {**kept, **own, "PYTHONPATH": str(ROOT), "NO_COLOR": "1", **more}


def wait_until(condition: Callable[[], bool], seconds: float, what: str) -> None:
    """Waits for something another thread or process does."""
    deadline, pause = time.monotonic() + seconds, threading.Event()
    while not condition():
        assert time.monotonic() < deadline, f"not within {seconds:g} s: {what}"
        pause.wait(0.01)


@dataclass(frozen=True)
class Conducted:
    """Outcome of a scenario."""

    verdict: RunVerdict
    run_hash: str
    recording: str


class Live:
    """Router, supervisor and services; a context manager that leaves no process behind."""

    def __init__(self, folder: Path, record: bool = False) -> None:
        self.folder = folder
        self.port = free_port()
        self.address, self.namespace = f"tcp/127.0.0.1:{self.port}", f"test{self.port}/ragno"
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self.alive: dict[str, str] = {}
        self.bag = folder / "run.mcap" if record else None
        self.supervisor = Supervisor(ServiceConfig(), watched=self)

    def __enter__(self) -> Self:
        self.bus = ZenohBus(ZenohOptions("router", (), (self.address,), self.namespace))
        self.bus.watch(self._on_life)
        self.node = Node(self.supervisor, self.bus)
        self._thread = threading.Thread(target=self.node.run, daemon=True)
        self.node.start()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            for process in self.processes.values():
                process.send_signal(signal.SIGCONT)
                process.terminate()
            for process in self.processes.values():
                end_process(process)
        finally:
            self.node.stop()
            self._thread.join(STOP_S)
            self.bus.close()

    def _on_life(self, life: Life) -> None:
        if life.alive:
            self.alive[life.service] = life.instance
        elif self.alive.get(life.service) == life.instance:
            del self.alive[life.service]

    # -- processes -----------------------------------------------------------------------------------------------------

    def spawn(self, name: str) -> None:
        """Start a service, with its output in a file; it handles SIGINT whatever it inherits. Any thread may do so."""
        own = {
            "SUREFOOT_SIMULATOR_AUTOSTART": "false",
            "SUREFOOT_RECORDER_PATH": "" if self.bag is None else str(self.bag),
        }
        command = [sys.executable, "-m", "surefoot.lockstep.discover", name]
        command += ["--connect", self.address, "--namespace", self.namespace]
        with self.log(name).open("ab") as log:
            self.processes[name] = subprocess.Popen(
                self.words(name, command), cwd=self.folder, env=environment(self.folder, **own), start_new_session=True,
                stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
            )  # fmt: skip

    def words(self, name: str, words: list[str]) -> list[str]:
        """Return the words that start a service on its host."""
        return words

    def log(self, name: str) -> Path:
        """Return what a service wrote."""
        return self.folder / f"{name}.log"

    def start(self, names: Iterable[str], *, one_by_one: bool = False) -> None:
        """Starts services; ``one_by_one`` waits until each is there before the next."""
        for name in names:
            self.spawn(name)
            if one_by_one:
                wait_until(lambda name=name: name in self.alive, START_S, f"{name} is there")
        wait_until(lambda: set(self.processes) <= set(self.alive), START_S, f"all are there; {sorted(self.alive)} are")

    # what the supervisor needs of the system around it
    name = "test"

    def heard(self, service: str, pid: int, *, well: bool) -> None:
        """A heartbeat: nothing is done about it."""

    def ticked(self, owner: str) -> None:
        """A tick: nothing is done about it."""

    def rows(self) -> tuple[ServiceStatus, ...]:
        """No table."""
        return ()

    def signal_kill(self, service: str) -> None:
        """kill -9, and a new process at once."""
        self.processes[service].kill()
        self.processes[service].wait(STOP_S)
        self.spawn(service)

    def stop(self, number: signal.Signals) -> dict[str, tuple[int | None, float]]:
        """Asks all processes to end; exit code and time of each."""
        ends: dict[str, tuple[int | None, float]] = {}
        for name, process in self.processes.items():
            began = time.monotonic()
            process.send_signal(number)
            try:
                ends[name] = (process.wait(STOP_S), time.monotonic() - began)
            except subprocess.TimeoutExpired:
                ends[name] = (None, STOP_S)
        return ends

    # -- talking -------------------------------------------------------------------------------------------------------

    def health(self, name: str) -> Health:
        """The health of a service, now."""
        return self.bus.call(HEALTH_GET.of(name), HealthRequest()).health

    def reset(self, **request: Any) -> int:
        """Begins a run; returns its epoch."""
        return self.bus.call(SIM_RESET, ResetRequest(expect=(*SERVICES, Supervisor.name), **request)).epoch

    def conduct(self, scenario: Scenario) -> Conducted:
        """Runs a scenario on the services that are there."""
        director = Director(scenario)
        self.supervisor.director = director
        self.supervisor.ended.clear()
        epoch = self.reset(
            seed=scenario.seed, world=scenario.world, policy=scenario.policy, max_ticks=scenario.max_ticks,
            actuation_delay_ticks=scenario.actuation_delay_ticks,
        )  # fmt: skip
        assert self.supervisor.ended.wait(RUN_S), f"no end of the run: {self.health('simulator')}"
        found: list[Any] = []

        def finished() -> bool:
            reply = self.bus.call(RECORDER_STATUS, RecorderRequest())
            found[:] = [reply]
            return reply.finished and reply.epoch == epoch

        wait_until(finished, STOP_S, "the recorder has the last tick")
        status = self.supervisor.status
        verdict = judge(
            read_traces(self.supervisor.kept, self.supervisor.notes), scenario.limits, message_hash=found[0].run_hash,
            comparable=status is None or status.comparable, wall_s=self.supervisor.wall_s,
            problems=(*director.problems, *director.unfinished()), notes=tuple(director.notes),
        )  # fmt: skip
        self.supervisor.director = None
        return Conducted(verdict, found[0].run_hash, found[0].path)
