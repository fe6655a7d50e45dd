"""`surefoot view`."""

import os
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from .connect import client
from .output import Connect, Namespace, write

if TYPE_CHECKING:
    from ..view.server import ViewServer


def view(
    file: Annotated[Path | None, typer.Argument(help="MCAP file to look at [the system that runs].")] = None,
    port: Annotated[int | None, typer.Option(min=0, max=65535, help="Port on 127.0.0.1, 0 = any [7480].")] = None,
    robot: Annotated[str | None, typer.Option(help="Robot description: a name, or a folder [the driver's].")] = None,
    duration: Annotated[float, typer.Option(min=0.0, help="End after so many s of wall time, 0 = Ctrl-C.")] = 0.0,
    connect: Connect = None,
    namespace: Namespace = None,
) -> None:
    """Show a running system, or a recording, in a browser on this machine; over SSH by a tunnel. Ends with Ctrl-C."""
    from ..view.live import LiveFrames, robot_behind
    from ..view.server import PORT, ViewServer, live_page

    where = PORT if port is None else port
    if file is not None:
        from ..report.recorded import report_recording

        with TemporaryDirectory() as folder:
            path, _ = report_recording(file, None, Path(folder) / "report.html")
            text = path.read_text(encoding="utf-8")
        _serve(ViewServer(lambda: text, None, where), duration)
        return
    with client(connect, namespace) as found:
        live = LiveFrames(found, robot_behind(found, robot))
        try:
            _serve(ViewServer(lambda: live_page(found.bus.endpoint.namespace), live, where), duration)
        finally:
            live.close()


def _serve(server: "ViewServer", duration_s: float) -> None:
    """Serve until Ctrl-C, or for so long."""
    for line in server.hints(os.environ):
        write(line)
    end = time.monotonic() + duration_s if duration_s > 0 else float("inf")
    try:
        while time.monotonic() < end:
            time.sleep(max(0.0, min(0.5, end - time.monotonic())))
    finally:
        server.close()
