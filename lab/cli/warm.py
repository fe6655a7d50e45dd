"""Command `surefoot warm`: kernels compiled ahead of time."""

from typing import Annotated

import typer

from .completion import systems
from .output import Json, notify, use_json, write, write_json


def warm(
    system: Annotated[
        list[str] | None, typer.Argument(help="Names or paths of compose files [ragno].", autocompletion=systems)
    ] = None,
    every: Annotated[
        bool, typer.Option("--all", help="Of every system, and of rare queries too, which else compile when asked.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Rehearse even if that was done before.")] = False,
    json: Json = False,
) -> None:
    """Compile the numeric kernels that the services of systems use, so that every later start is quick."""
    from . import warming

    use_json(json)
    chosen = warming.all_systems() if every else warming.systems_of(system or [warming.DEFAULT_SYSTEM])
    jobs = warming.jobs_of(chosen, rare=every)
    found = warming.warm(jobs, notify) if force or warming.is_cold(jobs) else []
    if json:
        write_json({"compiled": bool(found), "services": [each.row() for each in found]})
        return
    for each in found:
        write(f"{each.service:12} {each.robot:10} {each.kernels:4} kernels {each.seconds:6.1f} s")
    if not found:
        write("the kernels are warm")
