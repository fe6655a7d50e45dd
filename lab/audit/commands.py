"""Command `surefoot audit`: check the stability margins of a recorded walk by independent proofs."""

from pathlib import Path
from typing import Annotated

import typer

from ..cli.output import EXIT_CHECK, Json, use_json, write, write_json, write_table
from ..cli.progress import Progress

app = typer.Typer()
SHOWN = 20
"""Largest number of contradicted stability margins that the printed table lists."""


@app.command()
def audit(
    recording: Annotated[Path, typer.Argument(help="MCAP recording of a walk.")],
    json: Json = False,
) -> None:
    """Check every stability margin in a recording, by proofs that need no solver. Exit code 1: one is contradicted.

    Contact forces prove that the robot was in equilibrium, twists that it could not be with its CoM further out. Both
    are checked by code that is independent of the service that found them.
    """
    use_json(json)
    with Progress(f"proofs of {recording.name}", reads=[recording]) as progress:
        from .walk import audit as check

        found = check(recording, progress.at)
    bad = found.contradicted
    proved = sum(claim.proved for claim in found.claims)
    if json:
        write_json({
            "robot": found.robot, "steps": found.steps, "claims": len(found.claims), "proved": proved,
            "contradicted": [vars(claim) for claim in bad], "unchecked": found.unchecked, "notes": found.notes,
        })  # fmt: skip
    else:
        write(
            f"{found.robot}, {found.steps} steps: {len(found.claims)} margins claimed, {proved} proved, "
            f"{len(found.claims) - proved - len(bad)} not proved, {len(bad)} contradicted, {found.unchecked} unchecked"
        )
        for note in found.notes:
            write(f"note  {note}")
        if bad:
            columns = ("tick", "step", "claimed m", "at least m", "at most m")
            rows = [(c.tick, c.step, f"{c.claimed:.4f}", f"{c.least:.4f}", f"{c.most:.4f}") for c in bad[:SHOWN]]
            write_table(columns, rows, right=range(len(columns)))
    if bad:
        raise typer.Exit(EXIT_CHECK)
