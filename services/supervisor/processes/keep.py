"""Start, supervision and stop of a system of services, in this process or in the background."""

import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from surefoot.errors import BusError, CallError
from surefoot.logline import said
from surefoot.schemas.sim import ResetRequest, World
from surefoot.schemas.topics import SIM_RESET

from ..scenarios.recorded import about_run
from .compose import Compose
from .process import Child, busy_s
from .rundir import RunFolder
from .session import STEP_S, Session
from .system import SELF

DRIVER_S = 5.0  # s wall, after all services of a system are there one of them must drive
READY_S = 90.0  # s wall without progress of the start: processor time of its services; the first compiles kernels
CALM_S = 0.2  # s wall between two looks at a system in which all is well; the end of a process is noticed at once
MOST_S = 10.0 * READY_S  # s wall, whatever progress there is


@dataclass(frozen=True)
class StartOrder:
    """Settings of the run that the simulator begins once all services are there.

    Attributes:
        world: world to build.
        seed: seed of all random numbers of the run.
        rtf: real-time factor, simulated over wall time; 0 = as fast as possible.
        record: path of the MCAP file of the recording, None = none.
        robot: name or folder of the robot, None = that of the compose file.
        files: paths of the files that are attached to the recording, by name.
    """

    world: World
    seed: int = 0
    rtf: float = 1.0
    record: Path | None = None
    robot: str | None = None
    files: Mapping[str, str] = field(default_factory=dict[str, str])

    @property
    def request(self) -> ResetRequest:
        """Request that begins the run; the names of the services to wait for are not filled in yet."""
        return ResetRequest(seed=self.seed, world=self.world, mode="paced", rtf=self.rtf)

    def arguments(self) -> list[str]:
        """Return these settings as command-line options of `surefoot up`."""
        words = ["--terrain", self.world.terrain, "--seed", str(self.seed), "--rtf", str(self.rtf)]
        words += ["--robot", self.robot] if self.robot is not None else []
        return [*words, "--record", str(self.record.resolve()), "--force"] if self.record is not None else words


def keep(
    compose: Compose,
    order: StartOrder,
    stop: threading.Event,
    *,
    listen: str | None = None,
    spawn: bool = True,
    notify: Callable[[str], None] = lambda text: None,
    ready: Callable[[dict[str, Any]], None] = lambda report: None,
) -> None:
    """Start a system, supervise it until the event `stop` is set, and end its processes.

    `order`: settings of the run; `listen`: endpoint of the router, None = SUREFOOT_LISTEN or the default; `spawn`
    False: a container engine starts the processes; `notify` is called with each notice, `ready` with the report of the
    system once all services are ready.

    Raises:
        RunFolderError: the system is up already.
        RobotError: no such robot.
        BusError: the port is taken, a service is not restarted any more, or the simulator refuses the world.
    """
    environment = {
        "SUREFOOT_RECORDER_PATH": str(order.record.resolve()) if order.record is not None else "",
        "SUREFOOT_RECORDER_ABOUT": about_run(
            compose.robot, compose.name, compose.services, order.request, files=order.files
        ),
        "SUREFOOT_SIMULATOR_AUTOSTART": "false",  # time begins when everybody is there
    }
    with Session(compose, listen=listen, environment=environment, spawn=spawn, notify=notify) as session:
        wanted = set(session.system.service_names)
        reported, written, trouble = False, None, ""
        reset_by, alone_since = "", 0.0
        while not stop.is_set():
            session.step()
            rows = session.rows()
            if rows != written and session.folder.write_rows(rows):
                written = rows
            if session.folder.trouble not in ("", trouble):
                trouble = session.folder.trouble
                notify(trouble)
            driver = session.instance_of(session.driver)
            if driver and driver != reset_by and wanted <= set(session.alive):
                if session.answers(SIM_RESET):  # else the driver of a real robot, which starts the clock itself
                    _reset(session, order, notify)
                reset_by = driver
            if driver or not wanted <= set(session.alive):
                alone_since = 0.0
            else:
                alone_since = alone_since or time.monotonic()
                if time.monotonic() - alone_since > DRIVER_S:
                    raise BusError("not_ready", f"no service of {compose.path} drives; one must be the robot's driver")
            if not reported and session.supervisor.ticks > 0 and (session.system.settled() or not spawn):
                report = session.report()
                session.folder.write_ready(report)
                ready(report)
                reported = True
            session.system.wait(CALM_S if reported and session.calm() else STEP_S)


def _reset(session: Session, order: StartOrder, notify: Callable[[str], None]) -> None:
    """Reset the simulator so that simulated time runs; needed again after each restart of the simulator."""
    try:
        session.call(SIM_RESET, order.request.model_copy(update={"expect": session.expected}))
    except CallError as error:
        problem = f"the simulation could not be started: {error.message}"
        if error.code not in ("absent", "timeout"):  # the request is wrong, and stays so
            raise BusError(error.code, problem, error.field) from None
        notify(problem)


def start_detached(
    compose: Compose, system: str, order: StartOrder, listen: str | None, notify: Callable[[str], None]
) -> dict[str, Any]:
    """Start `surefoot up` in a session of its own, wait until it is ready and return its report.

    Args:
        compose: the system.
        system: its name, for the notice.
        order: settings of its run.
        listen: endpoint of the router; None = SUREFOOT_LISTEN or the default.
        notify: called with a notice of the start.

    Raises:
        RunFolderError: the system is up already.
        BusError: the system ended before it was ready; the message holds the last lines of its log.
    """
    folder = RunFolder(compose.name)
    folder.refuse_held()
    folder.clear_ready()
    command = [sys.executable, "-m", "surefoot.lab.cli.main", "up", "--log", str(Path(compose.path).resolve())]
    command += [*order.arguments(), *(["--listen", listen] if listen else [])]
    notify(f"starting {system}")
    child = Child(SELF, command, {}, folder.log(SELF))
    waited = threading.Event()
    began = moved = time.monotonic()
    spent = 0.0
    while (now := time.monotonic()) - moved < READY_S and now - began < MOST_S:
        report = folder.ready()
        if report is not None:
            return report
        busy = busy_s((child.pid, *(process.pid for process in folder.processes().values())))
        if busy != spent:
            spent, moved = busy, now
        if child.poll() is not None:
            words = said(child.last_words(1))
            raise BusError("service_failed", words or f"it ended with exit code {child.poll()}; see {child.log}")
        waited.wait(0.02)
    child.terminate()
    child.wait(10.0)
    raise BusError("not_ready", f"{compose.name} is not ready after {now - began:.0f} s; see `surefoot logs`")
