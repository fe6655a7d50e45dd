"""`surefoot report`."""

from pathlib import Path
from typing import Annotated

import typer

from .output import EXIT_CHECK, Json, near, use_json, write, write_json


def report(
    file: Annotated[Path, typer.Argument(help="MCAP file of a run.")],
    scenario: Annotated[str | None, typer.Option(help="Hold it against the limits of this scenario.")] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="HTML file [beside the recording].")] = None,
    json: Json = False,
) -> None:
    """Judge a recording again, by the limits it carries, and write its report. Exit code 1: a limit was not met."""
    from surefoot.record.recording import recording_info
    from surefoot.robot.reader import load_robot
    from surefoot.services.supervisor.scenarios.recorded import SCENARIO, recorded_scenario
    from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario

    from ..report.judge import judge
    from ..report.page import About, write_report
    from ..report.traces import traces_of
    from ..report.why import explain

    use_json(json)
    metadata = recording_info(file)["metadata"]
    run, summary = metadata.get("run", {}), metadata.get("surefoot", {})
    loaded = None if scenario is None else load_scenario(find_scenario(scenario))
    if loaded is None and SCENARIO in metadata:
        loaded = recorded_scenario(metadata, file)
    limits = {} if loaded is None else loaded.limits
    traces, found = traces_of(file), explain(file)
    notes = () if found.outcome is None else (found.sentence,)
    verdict = judge(traces, limits, message_hash=summary.get("run_hash", ""), notes=notes)
    about = About(
        scenario=file.stem if loaded is None else loaded.name,
        description=str(file) if loaded is None else loaded.description,
        seed=int(run.get("seed", "0")),
        facts={"Recording": str(file), **{name.capitalize(): value for name, value in run.items()}},
        limits=limits,
        feet=load_robot(run.get("robot", "ragno")).leg_names,
    )
    path = write_report(out or file.with_suffix(".html"), about, traces, verdict)
    if json:
        write_json({"ok": verdict.ok, "values": {r.name: r.value for r in verdict.rows}, "report": near(path)})
    else:
        write(f"report        {near(path)}")
    if not verdict.ok:
        raise typer.Exit(EXIT_CHECK)
