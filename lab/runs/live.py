"""One scenario from start to verdict."""

import shlex
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from surefoot.errors import BusError, CallError
from surefoot.robot.reader import load_robot
from surefoot.schemas.sim import ResetReply, ResetRequest, SimStatus
from surefoot.schemas.system import RecorderReply, RecorderRequest
from surefoot.schemas.topics import RECORDER_STATUS, SIM_RESET, TICK_S
from surefoot.services.supervisor.processes.session import Session
from surefoot.services.supervisor.processes.startable import system_of
from surefoot.services.supervisor.scenarios.director import Director
from surefoot.services.supervisor.scenarios.scenario import Scenario
from surefoot.version import VERSION

from ..report.judge import RunVerdict, judge
from ..report.page import About, write_report
from ..report.plots import Timing
from ..report.traces import Traces, read_traces

START_S = 90.0  # s wall, until the simulator serves: cold kernels are compiled at the first start
STALL_S = 150.0  # s wall without a tick after which a run is given up (longer than the simulator's own patience)
RECORDER_S = 10.0  # s wall, for the recorder to close its file


@dataclass(frozen=True)
class Options:
    """Options of a run.

    Attributes:
        seed: None = the scenario's own.
        record: write an MCAP file.
        rtf: None = lockstep as fast as it goes; else paced at this real-time factor.
        strict: no actuation delay.
        listen: endpoint of the router, None = SUREFOOT_LISTEN or the default.
        out: folder for recording and report, None = a new one under `runs`.
    """

    seed: int | None = None
    record: bool = True
    rtf: float | None = None
    strict: bool = False
    listen: str | None = None
    out: Path | None = None


@dataclass(frozen=True)
class RunProgress:
    """Progress of a run: control ticks, simulated time (s), real-time factor so far."""

    ticks: int
    time: float
    rtf: float


@dataclass(frozen=True)
class RunOutcome:
    """Result of a run."""

    scenario: str
    seed: int
    verdict: RunVerdict
    report: Path | None
    """None where it could not be written; a note of the verdict gives the reason."""
    recording: Path | None
    start_s: float
    """Wall time from the command to tick 0."""
    timings: Mapping[str, Timing]
    """Time in a tick by service."""
    interrupted: bool = False
    """It was ended from outside, by SIGINT or SIGTERM."""


class Beside(AbstractContextManager[Any], Protocol):
    """Activity beside a run: entered when the world is built, left after the last tick, before services are ended."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the report."""
        ...


def run_scenario(
    scenario: Scenario,
    options: Options,
    tell: Callable[[str], None] = lambda text: None,
    show: Callable[[RunProgress], None] = lambda progress: None,
    meddle: Callable[[Session], Beside] | None = None,
) -> RunOutcome:
    """Start the system, conduct the scenario, check its limits, write the report, stop everything.

    Args:
        scenario: what to do.
        options: how.
        tell: called with each message on what the system does.
        show: called with the progress.
        meddle: makes the activity beside the run.

    Raises:
        FileError: the compose file cannot be used.
        BusError: the system could not be brought up. A stalled or interrupted run has a report, too.
    """
    began = time.monotonic()
    compose = system_of(scenario)
    plan = _planned(scenario, options)
    director = Director(scenario)
    with Session(
        compose, listen=options.listen, director=director, environment=_environment(plan), tell=tell
    ) as session:
        tell(f"run {_reset(session, plan).run_id} begins")
        interrupted = False
        beside = None if meddle is None else meddle(session)
        try:
            with beside or nullcontext():
                start_s, problems = _follow(session, scenario, director, began, show)
        except KeyboardInterrupt:  # the report shows the ticks that there are
            start_s, problems, interrupted = 0.0, ["it was interrupted"], True
        recorded = _recorder(session) if "recorder" in session.alive else None
        health = session.health()
        restarts = [f"{row.service} was restarted {row.restarts}x" for row in session.rows() if row.restarts]
        late, status, wall_s = session.supervisor.late, session.supervisor.status, session.supervisor.wall_s
    silences = [f"{n}: {key} was silent for {s:.2f} s" for n, h in health.items() for key, s in h.silences.items()]
    unrecorded = _unrecorded(plan.recording, recorded)
    traces = read_traces(session.supervisor.kept, session.supervisor.notes)
    verdict = judge(
        traces, scenario.limits, wall_s=wall_s,
        message_hash=recorded.run_hash if recorded else "",
        comparable=not restarts and options.rtf is None and (status is None or status.comparable),
        problems=(*problems, *session.supervisor.stops(), *director.problems, *director.unfinished()),
        notes=(
            *director.notes, *(beside.notes if beside else ()), *restarts, *silences, *_late(late), *unrecorded,
        ),
    )  # fmt: skip
    timings = {n: Timing(h.tick_p50_us, h.tick_p99_us) for n, h in health.items() if h.tick_p50_us > 0}
    written = plan.recording if plan.recording is not None and plan.recording.exists() else None
    try:
        report = _report(plan, session.robot, traces, verdict, timings, written)
    except OSError as error:
        why = f"the report could not be written: {error.strerror or error}"
        report, verdict = None, replace(verdict, notes=(*verdict.notes, why))
    return RunOutcome(scenario.name, plan.seed, verdict, report, written, start_s, timings, interrupted)


def _environment(plan: "_Plan") -> dict[str, str]:
    """Return variables of the services of a run; the scenario's own count most."""
    return {
        "SUREFOOT_RECORDER_PATH": str(plan.recording or ""),
        "SUREFOOT_SIMULATOR_AUTOSTART": "false",  # the first epoch is ours
        **plan.scenario.environment,
    }


class _Plan(NamedTuple):
    """Input and output files of a run."""

    scenario: Scenario
    options: Options
    seed: int
    out: Path
    """Folder of recording and report."""
    recording: Path | None
    """MCAP file to write."""


def _planned(scenario: Scenario, options: Options) -> _Plan:
    """Choose seed and files of a run (raises OSError where nothing can be written, before anything is started)."""
    seed = scenario.seed if options.seed is None else options.seed
    out = options.out or _new_folder(scenario.name, seed)
    if not out.exists():
        out.mkdir(parents=True)
        out.rmdir()
    return _Plan(scenario, options, seed, out, (out / "run.mcap").resolve() if options.record else None)


def _reset(session: Session, plan: _Plan) -> ResetReply:
    """Build the world as soon as the simulator serves; the others may still be starting."""
    if not session.wait_for(lambda: bool(session.driver), START_S):
        raise BusError("not_ready", f"no service of {session.compose.path} drives after {START_S:g} s")
    if not session.answers(SIM_RESET):
        raise BusError("no_simulator", f"a scenario needs a simulator; {session.driver} does not answer sim/reset")
    scenario, options = plan.scenario, plan.options
    return session.call(
        SIM_RESET,
        ResetRequest(
            seed=plan.seed,
            world=scenario.world,
            expect=session.expected,
            mode="lockstep" if options.rtf is None else "paced",
            rtf=options.rtf or 0.0,
            actuation_delay_ticks=0 if options.strict else scenario.actuation_delay_ticks,
            policy=scenario.policy,
            max_ticks=scenario.max_ticks,
        ),
    )


def _follow(
    session: Session, scenario: Scenario, director: Director, began: float, show: Callable[[RunProgress], None]
) -> tuple[float, list[str]]:
    """Step the system until the last tick; return the start-up time, s, and the problems."""
    supervisor = session.supervisor
    start_s, last, moved = 0.0, 0, time.monotonic()
    while not supervisor.ended.is_set():
        try:
            session.step()
        except BusError as error:  # a service is not restarted any more: a problem of the report
            return start_s, [error.message]
        now = time.monotonic()
        if supervisor.ticks != last:
            if last == 0:
                start_s = now - began
            last, moved = supervisor.ticks, now
            wall = max(supervisor.wall_s, 1e-3)
            show(RunProgress(last, last * TICK_S, last * TICK_S / wall))
        if now - moved > STALL_S:
            waiting = {name: health.waiting_for for name, health in session.health().items() if health.waiting_for}
            words = "; ".join(f"{name} waits for {', '.join(keys)}" for name, keys in waiting.items())
            return start_s, [f"no tick for {STALL_S:g} s at tick {last}" + (f": {words}" if words else "")]
        supervisor.ended.wait(0.05)
    return start_s, ["it was ended by max_duration_s"] if not director.ended and scenario.steps else []


def _recorder(session: Session) -> RecorderReply | None:
    """Wait until the recorder has the last tick on disk."""
    deadline = time.monotonic() + RECORDER_S
    while True:
        try:
            reply = session.call(RECORDER_STATUS, RecorderRequest(), 2.0)
        except CallError:
            return None
        if reply.finished or time.monotonic() > deadline:
            return reply
        time.sleep(0.02)


def _late(status: SimStatus | None) -> list[str]:
    """Return a note on paced time that fell behind."""
    if status is None:
        return []
    return [f"late: real-time factor {status.rtf:.2f} at tick {status.tick}, {status.pace:g} was asked for"]


def _unrecorded(wanted: Path | None, recorded: RecorderReply | None) -> list[str]:
    """Return a note on a recording that ended early."""
    failed = wanted is not None and recorded is not None and recorded.finished and not recorded.path
    return ["the recording could not be written to its end; `surefoot logs recorder` shows why"] if failed else []


def _new_folder(scenario: str, seed: int) -> Path:
    stem = Path("runs") / f"{scenario}-seed{seed}-{datetime.now():%Y%m%d-%H%M%S}"
    folder, number = stem, 1
    while folder.exists():
        number += 1
        folder = stem.with_name(f"{stem.name}-{number}")
    return folder


def _report(
    plan: _Plan,
    robot: str,
    traces: Traces,
    verdict: RunVerdict,
    timings: dict[str, Timing],
    recording: Path | None,
) -> Path:
    scenario, options = plan.scenario, plan.options
    flags = " --strict" if options.strict else ""
    flags += f" --rtf {options.rtf:g}" if options.rtf is not None else ""
    facts = {
        "Again": f"surefoot run {shlex.quote(scenario.name)} --seed {plan.seed}{flags}",
        "Robot": robot,
        "World": scenario.world.model_dump_json(exclude_none=True),
        "Version": VERSION,
    }
    if recording is not None:
        facts["Recording"] = recording.name
    feet = tuple(leg.name for leg in load_robot(robot).legs)
    about = About(scenario.name, scenario.description, plan.seed, facts, scenario.limits, feet, timings)
    return write_report(plan.out / "report.html", about, traces, verdict)
