"""Command `surefoot view`: a system or a recording in a browser."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .output import Connect, Json, Namespace, use_json
from .progress import Progress
from .viewing import Duration, Shape, ShownSystem, remark, seen, show_place, until

if TYPE_CHECKING:
    from ..view.server import ViewServer


def view(
    file: Annotated[Path | None, typer.Argument(help="MCAP file to look at [the system that runs].")] = None,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Port on 127.0.0.1, 0 = any [7480, or any when it is taken].")
    ] = None,
    robot: Shape = None,
    wait: Annotated[float, typer.Option(min=0.0, help="Wait for so many s until a system answers.")] = 0.0,
    duration: Duration = 0.0,
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Show a running system, or a recording, in a browser on this machine; over SSH by a tunnel. Ends with Ctrl-C."""
    use_json(json)
    if file is not None:
        _view_recording(file, port, duration)
        return
    from surefoot.bus.options import threads_that_read

    with threads_that_read(1), seen(connect, namespace, robot, wait) as shown:
        view_system(shown, port, duration)


def view_system(shown: ShownSystem, port: int | None = None, duration_s: float = 0.0) -> None:
    """Serve the live page of a running system until Ctrl-C, or for `duration_s` s of wall time; 0 = no limit."""
    from ..view.live import LiveFrames
    from ..view.page import live_page
    from ..view.server import ViewServer
    from .running import only_one, systems
    from .stopping import TIMEOUT_S, stop_all

    def stop(reason: str) -> tuple[bool, str]:
        now = only_one(systems(shown.system.connect, shown.system.namespace), "--connect")  # it may have been restarted
        (found,) = stop_all((now,), reason, TIMEOUT_S)
        return bool(found.driver), found.stopped or found.detail

    live = LiveFrames(shown.client, shown.robot, stop)
    try:
        _serve(ViewServer(live_page(shown.system.namespace), live, port, remark), duration_s)
    finally:
        live.close()


def _view_recording(file: Path, port: int | None, duration_s: float) -> None:
    """Serve the report of a recording in the browser; the port is bound before the report is made (up to a minute)."""
    from ..view.server import ViewServer

    server = ViewServer("", None, port, remark)
    try:
        server.page = _recorded(file).encode()
    except BaseException:
        server.close()
        raise
    _serve(server, duration_s)


def _recorded(file: Path) -> str:
    """Return the HTML report of a recording, which contains the replay."""
    from tempfile import TemporaryDirectory

    with Progress(f"reading {file}", reads=[file]) as progress, TemporaryDirectory() as folder:
        from ..report.recorded import report_recording

        progress.at(0.0)
        path, _ = report_recording(file, None, Path(folder) / "report.html", progress.at)
        return path.read_text(encoding="utf-8")


def _serve(server: "ViewServer", duration_s: float) -> None:
    show_place("view", server.url, server.port, {})
    try:
        until(duration_s)
    finally:
        server.close()
