"""`surefoot bridge foxglove`."""

from typing import Annotated

import typer

from .output import Connect, Json, Namespace, use_json
from .viewing import Duration, Shape, seen, show_place, until

app = typer.Typer(help="Live bridges to the viewers of others.", no_args_is_help=True)


@app.callback()
def bridges() -> None:
    """Live bridges to the viewers of others."""


@app.command()
def foxglove(
    port: Annotated[int | None, typer.Option(min=0, max=65535, help="Port on 127.0.0.1, 0 = any [8765].")] = None,
    robot: Shape = None,
    duration: Duration = 0.0,
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Serve the running system to Foxglove, Lichtblick or another client of their WebSocket. Ends with Ctrl-C."""
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
