"""`surefoot warm`."""

from typing import Annotated

import typer

from surefoot.lab.cli.output import Json, tell, use_json, write, write_json


def warm(
    force: Annotated[bool, typer.Option("--force", help="Compile even if that was done before.")] = False,
    json: Json = False,
) -> None:
    """Compile the numeric kernels, so that every later start is quick."""
    from surefoot.kernels.warming import is_cold, warm_all

    use_json(json)
    took = warm_all(tell) if force or is_cold() else {}
    if json:
        write_json({"compiled": bool(took), "seconds": took})
    else:
        write(f"{len(took)} modules compiled" if took else "the kernels are warm")
