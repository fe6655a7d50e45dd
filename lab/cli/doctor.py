"""Command `surefoot doctor`: checks of this machine."""

import typer

from .output import EXIT_CHECK, Json, use_json, write_json, write_table


def doctor(json: Json = False) -> None:
    """Check this machine: versions, kernels, port, Zenoh, timer, simulator, leftovers. Exit code 1: something fails."""
    from .checks import examine

    use_json(json)
    findings = examine()
    colours = {"PASS": "green", "WARN": "yellow", "FAIL": "bold red"}
    if json:
        write_json(findings)
    else:
        rows = [((f.grade, colours[f.grade]), f.what, f.found, f.remedy) for f in findings]
        write_table(("", "what", "found", "what to do"), rows)
    if any(finding.grade == "FAIL" for finding in findings):
        raise typer.Exit(EXIT_CHECK)
