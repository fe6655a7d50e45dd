"""Command `surefoot reproduce`: recomputes the results of the papers."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.lab.cli.output import EXIT_CHECK, Json, near, notify, use_json, write, write_json, write_table
from surefoot.lab.cli.progress import Progress

if TYPE_CHECKING:
    from surefoot.lab.report.findings import Reproduction

PAPERS = {
    "osswald": ".osswald.navigation",
    "walas-footholds": ".walas.footholds",
    "walas-stability": ".walas.stability",
    "wawrzynski": ".wawrzynski.velocity",
}
"""Module of each paper by name, with `reproduce(folder, progress)`, and with `SYSTEM = None` if no system's kernels are
needed."""
WITH_LIVE = ("osswald",)
"""Names of the papers whose `reproduce` also takes `live`, a results file of runs of the simulated robot."""

RESUMED = ("walas-footholds",)
"""Names of the papers whose output folder keeps finished runs, so that an interrupted study is continued."""

app = typer.Typer()


@app.command()
def reproduce(
    paper: Annotated[str, typer.Argument(help=f"What to reproduce: {', '.join(PAPERS)}.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder for the figures [runs/<paper>].")] = None,
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="Draw the figures.")] = True,
    live: Annotated[
        Path | None, typer.Option("--live", help="Results of python -m benchmarks goals to compare (osswald).")
    ] = None,
    strict: Annotated[bool, typer.Option("--strict", help="Known deviations fail too.")] = False,
    json: Json = False,
) -> None:
    """Compute the figures and numbers of a paper again and print its values beside those of this project.

    What the paper states is confirmed, not confirmed, or a known deviation; limits that it does not state are ok or
    FAILED. Exit code 1: something is not confirmed or FAILED; with --strict known deviations count as well.
    """
    import importlib

    from surefoot.errors import SurefootError
    from surefoot.lab.cli.warming import DEFAULT_SYSTEM, systems_of, warm_if_cold
    from surefoot.nearest import did_you_mean

    use_json(json)
    if paper not in PAPERS:
        known = ", ".join(PAPERS)
        hint = did_you_mean(paper, PAPERS)
        raise SurefootError("invalid", f"got {paper!r}{hint}; known are {known}", "paper")
    if live is not None and paper not in WITH_LIVE:
        raise SurefootError("invalid", f"got {paper!r}, which takes no live runs; {', '.join(WITH_LIVE)} does", "live")
    folder = (out or Path("runs") / paper) if figures else None
    kept = "nothing was written"
    if folder is not None and paper in RESUMED:
        kept = f"what is done is in {near(folder)}, and the same command goes on from there"
    module = importlib.import_module(PAPERS[paper], __package__)
    if getattr(module, "SYSTEM", DEFAULT_SYSTEM) is not None:
        warm_if_cold(systems_of([DEFAULT_SYSTEM])[0], None, notify)
    more = {} if live is None else {"live": live}
    with Progress(paper, kept) as progress:
        found: Reproduction = module.reproduce(folder, progress.at, **more)
    passed = found.ok if strict else found.as_recorded
    if json:
        write_json(
            {
                "title": found.title,
                "ok": passed,
                "findings": [vars(f) | {"verdict": f.verdict} for f in found.findings],
                "figures": [str(path) for path in found.figures],
                "notes": found.notes,
            }
        )
    else:
        _show(found, passed=passed)
    if not passed:
        raise typer.Exit(EXIT_CHECK)


def _show(found: "Reproduction", *, passed: bool) -> None:
    from surefoot.lab.report.findings import CONFIRMED, DEVIATION, MET, MISSED, NOT_CONFIRMED

    styles = {CONFIRMED: "bold green", MET: "bold green", NOT_CONFIRMED: "bold red", MISSED: "bold red"}
    styles |= {DEVIATION: "bold yellow", "": ""}
    rows = [(f.where, f.what, f.paper or "-", f.ours, f.limit, (f.verdict, styles[f.verdict])) for f in found.findings]
    write_table(("where", "quantity", "paper", "ours", "limit", "verdict"), rows, found.title, right=(2, 3))
    for f in found.findings:
        if f.known:
            again = ", but it was confirmed this time" if f.ok else ""
            write(f"known   {f.where}, {f.what}: {f.known}{again}")
    for note in found.notes:
        write(f"note    {note}")
    for path in found.figures:
        write(f"figure  {path}")
    counts = [(name, sum(f.verdict == name for f in found.findings)) for name in styles if name]
    write(f"verdict {'PASS' if passed else 'FAIL'}: {', '.join(f'{n} {name}' for name, n in counts if n)}")
