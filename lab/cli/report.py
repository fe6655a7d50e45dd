"""Command `surefoot report`: a recording as one HTML file."""

from pathlib import Path
from typing import Annotated

import typer

from .output import EXIT_CHECK, Json, near, refuse_unreachable, use_json, write_answer
from .progress import Progress


def report(
    file: Annotated[Path, typer.Argument(help="MCAP file of a run.")],
    scenario: Annotated[str | None, typer.Option(help="Hold it against the limits of this scenario.")] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="HTML file [beside the recording].")] = None,
    json: Json = False,
) -> None:
    """Write the report of a recording, by the limits it carries. Exit code 1: a limit was not met, or a part is lost.

    A recording holds no steps that were refused or unfinished: its best verdict is that all limits are met. Where a
    part of it or the data of a limit is missing, and no other limit is missed, the answer is NO VERDICT.
    """
    use_json(json)
    if out is not None and (out.suffix.lower() not in (".html", ".htm") or out.is_dir()):
        raise typer.BadParameter(f"got {near(out)}, allowed is a file *.html", param_hint="--out")
    if out is not None:
        refuse_unreachable(out, makes_folders=True)
    with Progress(f"report of {file.name}", reads=[file]) as progress:
        from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario

        from ..report.judge import METRICS
        from ..report.recorded import report_recording

        progress.at(0.0)
        loaded = None if scenario is None else load_scenario(find_scenario(scenario))
        path, verdict = report_recording(file, loaded, out or file.with_suffix(".html"), progress.at)
    missed = [row for row in verdict.rows if row.ok is False]
    lines = [("note", note) for note in verdict.notes]
    lines += [("missed", f"{METRICS[r.name].title}: {r.text}, the limit is {r.limit_text}") for r in missed]
    lines += [("report", near(path)), ("verdict", verdict.word)]
    write_answer(
        {
            "ok": verdict.ok,
            "verdict": verdict.word,
            "failed": [row.name for row in verdict.rows if row.ok is False],
            "notes": verdict.notes,
            "values": {r.name: r.value for r in verdict.rows},
            "report": near(path),
        },
        "\n".join(f"{name:<14}{text}" for name, text in lines),
    )
    if not verdict.ok or verdict.partly:
        raise typer.Exit(EXIT_CHECK)
