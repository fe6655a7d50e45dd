"""Command `surefoot stop`: emergency stop. The services keep running; the robot holds its joints."""

from typing import Annotated

import typer

from .completion import systems
from .output import Connect, Json, Namespace, use_json
from .stopping import REASON, TIMEOUT_S, report, stop_all


def stop(
    system: Annotated[
        str | None, typer.Argument(help="Name of a system [every system that runs].", autocompletion=systems)
    ] = None,
    reason: Annotated[str, typer.Option(help="Reason; logs and the report show it.")] = REASON,
    timeout: Annotated[float, typer.Option(min=0.1, help="Repeat it so many s until the driver confirms.")] = TIMEOUT_S,
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Emergency stop of every system that runs, or of one: the robot holds its joints until the next reset. Exit code
    1: a driver did not confirm."""
    from .running import systems

    use_json(json)
    code = report(stop_all(systems(connect, namespace, system, orphaned=True), reason, timeout), json=json)
    if code:
        raise typer.Exit(code)
