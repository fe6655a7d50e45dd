"""Commands `surefoot run` (a scenario with all services) and `surefoot list` (scenarios, systems, robots, services)."""

import os
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import typer

from .completion import scenarios
from .output import (
    EXIT_CHECK,
    EXIT_INTERRUPT,
    Json,
    Listen,
    RobotChoice,
    near,
    notify,
    refuse_existing,
    use_json,
    write,
    write_json,
    write_table,
)
from .progress import Progress
from .viewing import View, viewer

if TYPE_CHECKING:
    from ..runs.live import RunOutcome, RunProgress


def run(
    scenario: Annotated[
        str,
        typer.Argument(help="Name of a scenario (see `surefoot list`) or path of its file.", autocompletion=scenarios),
    ],
    robot: RobotChoice = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of everything random [the scenario's].")] = None,
    record: Annotated[bool, typer.Option("--record/--no-record", help="Write an MCAP recording.")] = True,
    rtf: Annotated[
        float | None,
        typer.Option(min=0.01, max=1000.0, help="Pace at this real-time factor instead of lockstep at full speed."),
    ] = None,
    strict: Annotated[bool, typer.Option("--strict", help="Lockstep without actuation delay.")] = False,
    view: View = False,
    listen: Listen = None,
    out: Annotated[Path | None, typer.Option(help="Folder for recording and report [a new one under runs/].")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite what is in that folder.")] = False,
    json: Json = False,
) -> None:
    """Run a scenario with every service live, check its limits, write a report. Exit code 1: a limit was not met."""
    from surefoot.bus.endpoint import to_listen
    from surefoot.robot.reader import load_robot
    from surefoot.services.supervisor.processes.ports import refuse_in_use
    from surefoot.services.supervisor.processes.rundir import RunFolder
    from surefoot.services.supervisor.processes.session import namespace_of
    from surefoot.services.supervisor.processes.startable import system_of
    from surefoot.services.supervisor.scenarios.scenario import load_scenario

    from ..runs.live import Options, conduct
    from .before import check_system
    from .warming import warm_if_cold

    use_json(json)
    line = _ProgressLine(Path(scenario).stem, quiet=json)
    loaded = load_scenario(scenario)
    if robot is not None:
        loaded = replace(loaded, robot=robot)
    endpoint = to_listen(listen)  # what is wrong is reported before kernels are compiled
    if out is not None:
        refuse_existing(out, force=force, folder=True)
    compose = system_of(loaded, os.environ)
    RunFolder(compose.name).refuse_held()
    refuse_in_use(endpoint)
    check_system(compose, loaded.world, loaded.seed if seed is None else seed)
    warm_if_cold(compose, endpoint, notify)
    options = Options(seed, record, rtf, strict, listen, out)
    with viewer(endpoint, namespace_of(compose.robot), compose.robot, wanted=view), line:
        outcome = conduct(loaded, compose, options, line.notify, line.show)
    _show(outcome, json=json)
    if robot is not None and scenario == "stand" and outcome.verdict.ok and not json and load_robot(robot).nlegs >= 4:
        write(f"next: surefoot run crawl-flat --robot {quote(robot)}")
    if outcome.interrupted:
        raise typer.Exit(EXIT_INTERRUPT)
    if not outcome.verdict.ok:
        raise typer.Exit(EXIT_CHECK)


def list_all(json: Json = False) -> None:
    """List scenarios, systems, robots and services."""
    from surefoot.files import names
    from surefoot.lockstep.discover import service_names
    from surefoot.robot.reader import robot_names
    from surefoot.services.supervisor.processes.compose import load_compose
    from surefoot.services.supervisor.scenarios.scenario import load_scenario

    use_json(json)
    scenarios = {name: load_scenario(name).description for name in names("scenarios", ".toml")}
    systems = {name: tuple(load_compose(name).services) for name in names("compose", ".yaml")}
    content = {"scenarios": scenarios, "systems": systems, "robots": robot_names(), "services": service_names()}
    if json:
        write_json(content)
        return
    write_table(("scenario", "what happens"), scenarios.items())
    write_table(("system", "services"), [(name, " ".join(found)) for name, found in systems.items()])
    write_table(("kind", "names"), [(kind, " ".join(content[kind])) for kind in ("robots", "services")])


def _show(outcome: "RunOutcome", *, json: bool) -> None:
    from ..report.judge import METRICS

    verdict = outcome.verdict
    report = None if outcome.report is None else near(outcome.report)
    recording = None if outcome.recording is None else near(outcome.recording)
    if json:
        content = {
            "scenario": outcome.scenario,
            "seed": outcome.seed,
            "ok": verdict.ok,
            "values": {row.name: row.value for row in verdict.rows},
            "failed": [row.name for row in verdict.rows if row.ok is False],
            "problems": verdict.problems,
            "notes": verdict.notes,
            "message_hash": verdict.message_hash,
            "comparable": verdict.comparable,
            "start_s": round(outcome.start_s, 3),
            "tick_us": {name: {"p50": t.p50_us, "p99": t.p99_us} for name, t in outcome.timings.items()},
            "report": report,
            "recording": recording,
        }
        write_json(content)
        return
    marks = {True: ("ok", "bold green"), False: ("FAILED", "bold red"), None: ("", "")}
    rows = [
        (METRICS[row.name].title, row.text, row.limit_text, marks[row.ok])
        for row in verdict.rows
        if row.value is not None or row.limits
    ]
    title = f"{outcome.scenario}, seed {outcome.seed}"
    write_table(("quantity", "value", "limit", "verdict"), rows, title, right=(1, 2))
    hashed = verdict.message_hash + ("" if verdict.comparable else "  (not comparable)")
    lines = [("message hash", hashed if verdict.message_hash else None)]
    lines += [("note", note) for note in verdict.notes] + [("problem", problem) for problem in verdict.problems]
    lines += [("recording", recording), ("report", report), ("verdict", verdict.word)]
    for name, text in lines:
        if text is not None:
            write(f"{name:<14}{text}")


class _ProgressLine:
    """Progress display of a scenario run: one line that is rewritten on a terminal, a few lines in a file or pipe."""

    recording: Path | None = None
    """Recording that the run writes; None = none, or the run has not begun."""

    def __init__(self, name: str, *, quiet: bool) -> None:
        self._name, self._quiet, self._progress, self._begun = name, quiet, None, False
        self._rewrites = sys.stderr.isatty() and not quiet

    def __enter__(self) -> "_ProgressLine":
        self._rewrite("starting")
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._rewrite()
        if kind is not None and issubclass(kind, KeyboardInterrupt):
            notify(f"{self._name}: interrupted before {self._left}")

    @property
    def _left(self) -> str:
        """Return what an interrupt left out, and what is kept."""
        if not self._begun:
            return "the run began; nothing was recorded"
        if self.recording is None or not self.recording.exists():
            return "its report was written; nothing was recorded"
        kept = near(self.recording)
        return f"its report was written; {kept} is kept, `surefoot report {quote(kept)}` makes the report"

    def notify(self, text: str) -> None:
        """Show a notice of the system, on a terminal in place of the progress line."""
        self._rewrite(text)
        if not self._rewrites and not self._quiet:
            notify(text)

    def show(self, progress: "RunProgress") -> None:
        """Show the progress of the scenario run, on a terminal in place of the last progress line."""
        self._begun, self.recording = True, progress.recording
        self._rewrite(f"{progress.time:.2f} s simulated of at most {progress.most:g} s, {progress.rtf:.1f}x real time")
        if not self._rewrites and not self._quiet:
            self._progress = self._progress or Progress(self._name)  # begun now: the start is no share of the run
            self._progress.at(progress.time / progress.most, f"of at most {progress.most:g} s simulated")

    def _rewrite(self, text: str = "") -> None:
        """Replace the progress line by a text, cut to the width of the terminal; an empty text clears the line."""
        if self._rewrites:
            line = f"{self._name}: {text}"[: shutil.get_terminal_size().columns - 1] if text else ""
            sys.stderr.write("\r\x1b[2K" + line)
            sys.stderr.flush()
