"""Commands `surefoot bridge foxglove|ros2`: live bridges to Foxglove (WebSocket) and to ROS 2 (Zenoh)."""

from pathlib import Path
from typing import Annotated

import typer

from .output import Connect, Json, Namespace, use_json
from .viewing import Duration, Shape, seen, show_place, until

app = typer.Typer(name="bridge", help="Live bridges to the programs of others.", no_args_is_help=True)


@app.callback()
def bridges() -> None:
    """Bridge a running system to Foxglove or ROS 2 (group of commands `surefoot bridge`)."""


@app.command()
def foxglove(
    port: Annotated[int | None, typer.Option(min=0, max=65535, help="Port on 127.0.0.1, 0 = any [8765].")] = None,
    robot: Shape = None,
    duration: Duration = 0.0,
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Serve the running system to Foxglove, Lichtblick or another client of their protocol, until Ctrl-C.

    With --duration it also ends after so many s of wall time; 0 = never.
    """
    from ..scene.pages import LAYOUT, WEB
    from ..view.bridge import PORT, FoxgloveBridge

    use_json(json)
    with seen(connect, namespace, robot) as shown:
        bridge = FoxgloveBridge(shown.client, shown.robot, PORT if port is None else port)
        try:
            show_place("bridge", bridge.url, bridge.port, {"layout": str(WEB / LAYOUT)})
            until(duration)
        finally:
            bridge.close()


@app.command()
def ros2(
    names: Annotated[Path | None, typer.Option(help="TOML file with a table [ros2]: topics, frames, router.")] = None,
    odom: Annotated[str | None, typer.Option(help="Topic of the odometry, e.g. /odometry/filtered.")] = None,
    base_state: Annotated[str | None, typer.Option(help="Topic of the base's state, e.g. /base_state.")] = None,
    router: Annotated[str | None, typer.Option(help="That of rmw_zenohd [tcp/127.0.0.1:7447].")] = None,
    more: Annotated[list[str], typer.Option("--set", help="FIELD=VALUE of docs/configuration.md, ros2.")] = [],  # noqa: B006
    robot: Shape = None,
    connect: Connect = None,
    namespace: Namespace = None,
) -> None:
    """Publish the running system on ROS 2 over Zenoh, with topic names of a file or of options, until Ctrl-C."""
    from surefoot.lockstep.launch import main
    from surefoot.services.ros2.service import SERVICE

    from .running import only_one, systems

    system = only_one(systems(connect, namespace), "--namespace or --connect")
    shape = robot or system.robot or system.namespace.rpartition("/")[2]
    given = {"odom": odom, "base_state": base_state, "router": router}
    fields = [f"robot={shape!r}", *(f"{name}={value!r}" for name, value in given.items() if value is not None), *more]
    words = ["--connect", system.connect, "--namespace", system.namespace]
    words += [] if names is None else ["--config", str(names)]
    main(SERVICE, [*words, *(word for field in fields for word in ("--set", field))])
