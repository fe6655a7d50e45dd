"""`surefoot why`."""

from pathlib import Path
from typing import Annotated

import typer

from ..cli.output import EXIT_CHECK, Json, use_json, write, write_json, write_table

app = typer.Typer()
Recording = Annotated[Path, typer.Argument(help="MCAP file of a run.")]


@app.command()
def why(file: Recording, json: Json = False) -> None:
    """Walk back from a fall, stop, halt, missed goal or slip to its first cause. Exit code 1: something went wrong."""
    from .why import explain

    use_json(json)
    found = explain(file)
    if json:
        write_json({"sentence": found.sentence, **vars(found)})
    else:
        write(found.sentence)
        rows = [each for each in (found.cause, *found.chain, found.outcome) if each is not None]
        if rows:
            write_table(("time", "kind", "what was seen"), [(f"{e.begin:.2f} s", e.code, e.text) for e in rows])
    if found.outcome is not None:
        raise typer.Exit(EXIT_CHECK)
