"""`surefoot view`."""

import os
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from .connect import joined
from .output import Connect, Json, Namespace, notify, state, use_json, write, write_json

if TYPE_CHECKING:
    from ..view.server import ViewServer
    from .running import RunningSystem

KNOCK_S = 0.2
"""Wall time between two looks whether a system answers."""


def view(
    file: Annotated[Path | None, typer.Argument(help="MCAP file to look at [the system that runs].")] = None,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Port on 127.0.0.1, 0 = any [7480, or any when it is taken].")
    ] = None,
    robot: Annotated[str | None, typer.Option(help="Robot description: a name, or a folder [the driver's].")] = None,
    wait: Annotated[float, typer.Option(min=0.0, help="Wait for so many s until a system answers.")] = 0.0,
    duration: Annotated[float, typer.Option(min=0.0, help="End after so many s of wall time, 0 = Ctrl-C.")] = 0.0,
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Show a running system, or a recording, in a browser on this machine; over SSH by a tunnel. Ends with Ctrl-C."""
    use_json(json)
    if file is not None:
        from ..view.server import ViewServer

        _serve(ViewServer(_recorded(file), None, port, _warn), duration)
        return
    system = _system(connect, namespace, wait)
    view_system(system.connect, system.namespace, robot or system.robot, port, duration)


def view_system(
    connect: str, namespace: str, robot: str | None = None, port: int | None = None, duration_s: float = 0.0
) -> None:
    """Show the system at an endpoint, whose keys have a prefix, until Ctrl-C or for so long."""
    from ..view.live import LiveFrames, robot_behind
    from ..view.page import live_page
    from ..view.server import ViewServer
    from .running import only_one, systems
    from .stopping import TIMEOUT_S, stop_all

    def stop(reason: str) -> tuple[bool, str]:
        (found,) = stop_all((only_one(systems(connect, namespace), "--connect"),), reason, TIMEOUT_S)
        return bool(found.driver), found.stopped or found.detail

    with joined(connect, namespace) as client:
        live = LiveFrames(client, robot_behind(client, robot, _warn), stop)
        try:
            _serve(ViewServer(live_page(namespace), live, port, _warn), duration_s)
        finally:
            live.close()


def _system(connect: str | None, namespace: str | None, wait_s: float) -> "RunningSystem":
    """Return the system that is meant, at the latest after so much wall time."""
    from .running import only_one, systems
    from .stopping import answers

    end = time.monotonic() + wait_s
    while True:
        found = only_one(systems(connect, namespace), "--namespace or --connect")
        if answers(found.connect) or time.monotonic() >= end:
            return found
        time.sleep(KNOCK_S)


def _recorded(file: Path) -> str:
    """Return the report of a recording, whose replay is the view of it."""
    from ..report.recorded import report_recording

    _warn(f"reading {file}")
    with TemporaryDirectory() as folder:
        path, _ = report_recording(file, None, Path(folder) / "report.html")
        return path.read_text(encoding="utf-8")


def _serve(server: "ViewServer", duration_s: float) -> None:
    """Serve until Ctrl-C, or for so long."""
    tunnel = server.tunnel(os.environ)
    if state.json:
        write_json({"url": server.url, "tunnel": tunnel})
    else:
        write((f"on your own machine: {tunnel}\n" if tunnel else "") + f"view: {server.url}")
    end = time.monotonic() + duration_s if duration_s > 0.0 else float("inf")
    try:
        while (left := end - time.monotonic()) > 0.0:
            time.sleep(min(0.5, left))
    finally:
        server.close()


def _warn(text: str) -> None:
    notify(f"surefoot: {text}")
