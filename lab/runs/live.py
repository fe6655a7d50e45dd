"""Run of a scenario on a live system of processes, from its start to the verdict."""

import platform
import shlex
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from surefoot.errors import CallError, SurefootError
from surefoot.record.recording import open_readable
from surefoot.schemas.sim import ResetRequest
from surefoot.schemas.status import SimStatus
from surefoot.schemas.system import RecorderReply, RecorderRequest
from surefoot.schemas.topics import RECORDER_STATUS, TICK_S
from surefoot.services.supervisor.processes.compose import Compose
from surefoot.services.supervisor.processes.session import Session
from surefoot.services.supervisor.processes.startable import system_of
from surefoot.services.supervisor.scenarios.director import Director
from surefoot.services.supervisor.scenarios.recorded import about_run
from surefoot.services.supervisor.scenarios.scenario import Scenario
from surefoot.version import VERSION

from ..report.judge import RunVerdict, judge
from ..report.page import About, write_report
from ..report.plots import Timing
from ..report.recorded import HASH_SHOWN, filmed
from ..report.traces import Traces, read_traces, sights_of
from ..report.why import explain
from ..scene.film import Film
from .attached import attached

START_S = 90.0  # s wall, until the simulator serves: cold kernels are compiled at the first start
STALL_S = 150.0  # s wall without a tick after which a run is given up (longer than the simulator's own patience)
RECORDER_S = 10.0  # s wall, for the recorder to close its file
LIBRARIES = ("mujoco", "numpy", "numba", "scipy", "eclipse-zenoh", "pydantic")
"""Names of the libraries whose versions the report of a run lists."""


@dataclass(frozen=True)
class Options:
    """Options of a live run of a scenario.

    Attributes:
        seed: seed of the run; None = the scenario's own.
        record: True: record the run to an MCAP file; False: do not.
        rtf: real-time factor at which the run is paced; None = lockstep at full speed.
        strict: True: no actuation delay; False: the delay that the scenario sets.
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
    """Progress of a run: control ticks, simulated time (s), mean real-time factor, longest simulated time (s).

    recording: file that the run writes; None = none.
    """

    ticks: int
    time: float
    rtf: float
    most: float
    recording: Path | None = None

    @classmethod
    def at(cls, ticks: int, wall_s: float, most: float, recording: Path | None = None) -> "RunProgress":
        """Return the progress after `ticks` ticks and `wall_s` s of wall time; `most`: longest simulated time, s."""
        return cls(ticks, ticks * TICK_S, ticks * TICK_S / wall_s, most, recording)


@dataclass(frozen=True)
class RunOutcome:
    """Result of a live run of a scenario: verdict, paths of recording and report, timing."""

    scenario: str
    seed: int
    verdict: RunVerdict
    report: Path | None
    """Path of the HTML report; None = it could not be written, a note of the verdict states why."""
    recording: Path | None
    start_s: float
    """Wall time from the start of the system to control tick 0, s; 0 if the run was interrupted."""
    timings: Mapping[str, Timing]
    """Computing time per control tick (median and 99th percentile, us), by service."""
    interrupted: bool = False
    """True: the run was interrupted by SIGINT or SIGTERM; False: it ended by itself."""


class Beside(AbstractContextManager[Any], Protocol):
    """Context manager of an activity in parallel with a run: entered with the world built, left before services end."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks of the activity for the report of the run."""
        ...


def run_scenario(
    scenario: Scenario,
    options: Options,
    notify: Callable[[str], None] = lambda text: None,
    show: Callable[[RunProgress], None] = lambda progress: None,
    meddle: Callable[[Session], Beside] | None = None,
) -> RunOutcome:
    """Start the system of a scenario, run the scenario, check its limits, write the report, stop the system.

    Args:
        scenario: scenario to run.
        options: options of the run.
        notify: called with each notice of the system.
        show: called with the progress of the run.
        meddle: returns an activity in parallel with the run, e.g. faults; None = no activity.

    Raises:
        BusError: the system could not be started. A run that stalls or is interrupted is reported as well.
    """
    return conduct(scenario, system_of(scenario), options, notify, show, meddle)


def conduct(
    scenario: Scenario,
    compose: Compose,
    options: Options,
    notify: Callable[[str], None] = lambda text: None,
    show: Callable[[RunProgress], None] = lambda progress: None,
    meddle: Callable[[Session], Beside] | None = None,
) -> RunOutcome:
    """Start a system, run a scenario on it, check its limits, write the report, stop the system.

    Args:
        scenario, compose, options: scenario, system to start, options of the run.
        notify, show: called with each notice of the system, and with the progress of the run.
        meddle: returns an activity in parallel with the run, e.g. faults; None = no activity.

    Raises:
        BusError: the system could not be started. A run that stalls or is interrupted is reported as well.
    """
    began = time.monotonic()
    seed = scenario.seed if options.seed is None else options.seed
    out = _writable(options.out or _new_folder(scenario.name, seed))
    recording = (out / "run.mcap").resolve() if options.record else None
    request, about = _reset(scenario, options, seed), _about(scenario, compose, options, seed)
    director = Director(scenario)
    files = {} if recording is None else attached(compose, scenario.environment)
    environment = {
        "SUREFOOT_RECORDER_PATH": str(recording) if recording else "",
        "SUREFOOT_RECORDER_ABOUT": about_run(compose.robot, compose.name, compose.services, request, scenario, files),
        "SUREFOOT_SIMULATOR_AUTOSTART": "false",  # the first epoch is ours
        **scenario.environment,
    }
    with Session(compose, listen=options.listen, director=director, environment=environment, notify=notify) as session:
        notify(f"run {session.begin(request, START_S).run_id} begins")
        beside, interrupted = None if meddle is None else meddle(session), False
        most = scenario.max_duration_s
        try:
            with beside or nullcontext():
                start_s, problems = session.follow(
                    began, STALL_S, lambda ticks, wall_s: show(RunProgress.at(ticks, wall_s, most, recording))
                )
        except KeyboardInterrupt:  # the report covers what there is
            start_s, problems, interrupted = 0.0, ["it was interrupted"], True
        end = _End.of(session, 0.0 if interrupted else RECORDER_S)
    supervisor = session.supervisor
    written = recording if recording is not None and recording.exists() else None
    facts = {**about.facts, **end.facts(supervisor.wall_s, start_s), **({"Recording": written.name} if written else {})}
    about = replace(about, timings=end.timings, feet=session.feet, facts=facts)
    verdict = judge(
        traces := read_traces(supervisor.kept, supervisor.notes),
        scenario.limits,
        wall_s=supervisor.wall_s,
        message_hash=end.recorded.run_hash if end.recorded else "",
        comparable=end.comparable and options.rtf is None,
        problems=(*problems, *supervisor.stops(), *director.problems, *director.unfinished()),
        notes=(*director.notes, *(beside.notes if beside else ()), *end.notes, *_unrecorded(recording, end.recorded)),
    )
    report, verdict = _reported(out / "report.html", about, traces, verdict, written)
    return RunOutcome(scenario.name, seed, verdict, report, written, start_s, end.timings, interrupted)


def _explained(verdict: RunVerdict, recording: Path | None) -> RunVerdict:
    """Return the verdict; of a failed run with the sentence on its first cause before the notes."""
    if verdict.ok or recording is None:
        return verdict
    try:
        found = explain(recording)
    except SurefootError:
        return verdict
    if found.outcome is None:
        return verdict
    return replace(verdict, notes=(found.sentence, *verdict.notes), why=found.sentence)


class _End(NamedTuple):
    """State of the services of a run after its last control tick.

    Attributes:
        recorded: reply of the recorder; None = no recorder, or no reply.
        timings: computing time per control tick, by service.
        notes: sentences on restarts, silent inputs, and a paced run that fell behind real time.
        comparable: True if no service was restarted and the simulator calls the run comparable, else False.
        configuration: hash of the effective configuration of each service.
    """

    recorded: RecorderReply | None
    timings: dict[str, Timing]
    notes: tuple[str, ...]
    comparable: bool
    configuration: dict[str, str]

    def facts(self, wall_s: float, start_s: float) -> dict[str, str]:
        """Return the facts for the report that are known after the run: times, versions, configuration hashes."""
        hashes = ", ".join(f"{name} {found[:HASH_SHOWN]}" for name, found in self.configuration.items() if found)
        return {
            "Wall time": f"{wall_s:.1f} s from the first to the last tick, {start_s:.1f} s until the first",
            "Libraries": ", ".join(f"{name} {version(name)}" for name in LIBRARIES),
            "Python": platform.python_version(),
            "Configuration": hashes,
        }

    @classmethod
    def of(cls, session: Session, patience_s: float) -> "_End":
        """Request the state of the services after the run; wait at most `patience_s` s for the recorder to finish."""
        recorded = recorder_of(session, patience_s) if "recorder" in session.alive else None
        health, status = session.health(), session.supervisor.status
        timings = {n: Timing(h.tick_p50_us, h.tick_p99_us) for n, h in health.items() if h.tick_p50_us > 0}
        silences = [f"{n}: {key} was silent for {s:.2f} s" for n, h in health.items() for key, s in h.silences.items()]
        restarts = [f"{row.service} was restarted {row.restarts}x" for row in session.rows() if row.restarts]
        notes = (*restarts, *silences, *_late(session.supervisor.late))
        hashes = {name: found.config_hash for name, found in health.items()}
        return cls(recorded, timings, notes, not restarts and (status is None or status.comparable), hashes)


def _reset(scenario: Scenario, options: Options, seed: int) -> ResetRequest:
    """Return the reset request that begins the run, without the services to wait for."""
    return ResetRequest(
        seed=seed,
        world=scenario.world,
        mode="lockstep" if options.rtf is None else "paced",
        rtf=options.rtf or 0.0,
        actuation_delay_ticks=0 if options.strict else scenario.actuation_delay_ticks,
        policy=scenario.policy,
        max_ticks=scenario.max_ticks,
    )


def _about(scenario: Scenario, compose: Compose, options: Options, seed: int) -> About:
    """Return the facts for the report that are known before the run: command, robot, world, version."""
    flags = " --strict" if options.strict else ""
    flags += f" --rtf {options.rtf:g}" if options.rtf is not None else ""
    facts = {
        "Again": f"surefoot run {shlex.quote(scenario.name)} --seed {seed}{flags}",
        "Robot": compose.robot,
        "World": scenario.world.model_dump_json(exclude_none=True),
        "Version": VERSION,
    }
    return About(scenario.name, scenario.description, seed, facts, scenario.limits)


def recorder_of(session: Session, patience_s: float) -> RecorderReply | None:
    """Return the recorder's status once the last tick is on disk, or after `patience_s` s; None = no reply."""
    deadline = time.monotonic() + patience_s
    while True:
        try:
            reply = session.call(RECORDER_STATUS, RecorderRequest(), 2.0)
        except CallError:
            return None
        if reply.finished or time.monotonic() > deadline:
            return reply
        time.sleep(0.02)


def _reported(
    path: Path, about: About, traces: Traces, verdict: RunVerdict, recording: Path | None
) -> tuple[Path | None, RunVerdict]:
    """Write the report; return its path (None = it could not be written), and the verdict, with a note in that case."""
    verdict = _explained(verdict, recording)
    about, film = _filmed(recording, about)
    verdict = verdict if film is None else replace(verdict, notes=(*verdict.notes, *film.notes))
    if recording is not None:  # the supervisor, whose messages the traces are, receives no images
        traces.sights = sights_of(recording)
    try:
        return write_report(path, about, traces, verdict, film), verdict
    except OSError as error:
        why = f"the report could not be written: {error.strerror or error}"
        return None, replace(verdict, notes=(*verdict.notes, why))


def _filmed(recording: Path | None, about: About) -> tuple[About, Film | None]:
    """Return the facts of the report, and the replay of the recording; None = no recording, or not readable."""
    if recording is None:
        return replace(about, no_film="the run was not recorded"), None
    try:
        return filmed(open_readable(recording), about)
    except SurefootError as error:
        return replace(about, no_film=error.message), None


def _late(status: SimStatus | None) -> list[str]:
    """Return a note if the paced run fell behind real time; an empty list if it did not."""
    if status is None:
        return []
    return [f"late: real-time factor {status.rtf:.2f} at tick {status.tick}, {status.pace:g} was asked for"]


def _unrecorded(wanted: Path | None, recorded: RecorderReply | None) -> list[str]:
    """Return notes if the recording ended before the run; an empty list if it is complete."""
    if wanted is None or recorded is None or not recorded.trouble:
        return []
    return ["the recording could not be written to its end; `surefoot logs recorder` shows why", recorded.trouble]


def _writable(folder: Path) -> Path:
    """Check, before a run starts, that a folder exists or can be made (raises OSError); return the folder."""
    if not folder.exists():
        folder.mkdir(parents=True)
        folder.rmdir()
    return folder


def _new_folder(scenario: str, seed: int) -> Path:
    """Return the path of a folder under `runs/` that is not there yet, for recording and report of a run."""
    stem = Path("runs") / f"{scenario}-seed{seed}-{datetime.now():%Y%m%d-%H%M%S}"
    folder, number = stem, 1
    while folder.exists():
        number += 1
        folder = stem.with_name(f"{stem.name}-{number}")
    return folder
