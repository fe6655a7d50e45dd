"""Commands `surefoot up|down|status|logs|health|supervise`: start, stop and observe whole systems."""

import json as jsonlib
import os
import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .completion import services, systems
from .connect import client
from .output import (
    EXIT_CHECK,
    Connect,
    Json,
    Listen,
    Namespace,
    RobotChoice,
    notify,
    refuse_existing,
    state,
    use_json,
    write,
    write_answer,
    write_json,
    write_table,
)
from .view import view_system
from .viewing import View, seen, viewer

if TYPE_CHECKING:
    from surefoot.services.supervisor.processes.rundir import RunFolder

OPEN = "without certificates, loopback is trust in every local user: see `surefoot up --secure`"
System = Annotated[
    str,
    typer.Argument(help="Name of a compose file (see `surefoot list`), its path or folder.", autocompletion=systems),
]


def up(
    system: System = "ragno",
    robot: RobotChoice = None,
    detach: Annotated[bool, typer.Option("--detach", "-d", help="Return when everything is ready.")] = False,
    terrain: Annotated[str, typer.Option(help="Kind of terrain or path of a terrain file (simulation).")] = "flat",
    seed: Annotated[int, typer.Option(min=0, help="Seed of the world (simulation).")] = 0,
    rtf: Annotated[float, typer.Option(min=0.0, max=1000.0, help="Real-time factor, 0 = as fast as it goes.")] = 1.0,
    record: Annotated[Path | None, typer.Option(help="MCAP file to write [no recording].")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite that file.")] = False,
    view: View = False,
    listen: Listen = None,
    secure: Annotated[bool, typer.Option("--secure", help="Ask for certificates (`surefoot security init`).")] = False,
    json: Json = False,
    log: Annotated[bool, typer.Option("--log", hidden=True, help="Write lines of a log, each with its time.")] = False,
) -> None:
    """Start the services of a compose file and keep them running."""
    from surefoot.bus.endpoint import is_secure, secured, to_listen
    from surefoot.schemas.sim import World
    from surefoot.services.supervisor.processes.keep import StartOrder, keep, start_detached
    from surefoot.services.supervisor.processes.ports import refuse_in_use
    from surefoot.services.supervisor.processes.rundir import RunFolder
    from surefoot.services.supervisor.processes.session import namespace_of
    from surefoot.services.supervisor.processes.startable import startable

    from ..runs.attached import attached
    from .before import check_system
    from .warming import warm_if_cold

    use_json(json)
    state.log = log
    endpoint = to_listen(listen)  # a wrong endpoint is reported before anything starts
    listen = secured(endpoint) if secure else listen
    if record is not None:
        refuse_existing(record, force=force)
    compose = startable(system, environ=os.environ, robot=robot)
    RunFolder(compose.name).refuse_held()
    refuse_in_use(listen or endpoint)
    files = {} if record is None else attached(compose)
    order = StartOrder(World(terrain=terrain), seed, rtf, record, None if robot is None else compose.robot, files)
    if not log:  # else `start_detached` runs this, after the same checks
        check_system(compose, order.world, seed)
        warm_if_cold(compose, endpoint, notify)
        if not is_secure((listen or endpoint,)):
            notify(OPEN)

    def show(report: dict[str, Any]) -> None:
        if log:
            notify("everything is ready")
        else:
            _show_up(compose.name, report, json=json)

    place = listen or endpoint, namespace_of(compose.robot), compose.robot
    if detach:
        show(start_detached(compose, system, order, listen, notify))
        if view:
            with seen(*place) as shown:
                view_system(shown)
        return
    with viewer(*place, wanted=view), _until_signal() as stop:
        keep(compose, order, stop, listen=listen, notify=notify, ready=show)


def supervise(
    system: System = "ragno",
    no_spawn: Annotated[
        bool, typer.Option("--no-spawn", help="Start no processes: a container engine does that.")
    ] = False,
    terrain: Annotated[str, typer.Option(help="Kind of terrain (simulation).")] = "flat",
    listen: Listen = None,
) -> None:
    """Run the router, and supervise a system whose services are started by a container engine."""
    from surefoot.schemas.sim import World
    from surefoot.services.supervisor.processes.compose import load_compose
    from surefoot.services.supervisor.processes.keep import StartOrder, keep

    compose = load_compose(system)
    with _until_signal() as stop:
        keep(compose, StartOrder(World(terrain=terrain)), stop, listen=listen, spawn=not no_spawn, notify=notify)


def down(
    system: Annotated[
        str | None, typer.Argument(help="Name of the system [the one that runs].", autocompletion=systems)
    ] = None,
    every: Annotated[bool, typer.Option("--all", help="Stop every system.")] = False,
    json: Json = False,
) -> None:
    """Stop a running system, or the remaining processes of one that crashed.

    Of several, the one at SUREFOOT_LISTEN is meant; else name one, or --all.
    """
    from surefoot.bus.endpoint import from_environment
    from surefoot.services.supervisor.processes.identity import end

    use_json(json)
    stopped: list[str] = []
    if system is not None:
        _check_known(Path(system).stem)
    meant = _folders(system)
    there = [folder for folder in meant if folder.held() or folder.orphans()]
    if len(there) > 1 and not every:
        here = from_environment("SUREFOOT_LISTEN")
        places = [(folder, folder.endpoint(orphaned=True)) for folder in there]
        there = [folder for folder, place in places if place is not None and place.connect == here] or there
        meant = there
    if len(there) > 1 and not every:
        names = ", ".join(folder.name for folder in there)
        raise typer.BadParameter(f"{len(there)} systems run: {names}; name one, or stop all with --all")
    for folder in meant:
        supervisor = folder.supervisor() if folder.held() else None
        if supervisor is not None:
            if not end(supervisor, grace_s=30.0):
                notify(f"surefoot: process {supervisor.pid} could not be ended")
                raise typer.Exit(EXIT_CHECK)
            stopped.append(folder.name)
        folder.acquire()
        if folder.end_leftovers() and folder.name not in stopped:
            stopped.append(folder.name)
        folder.release()
    write_answer({"stopped": stopped}, f"stopped {', '.join(stopped)}" if stopped else _idle(system))


def status(
    system: Annotated[
        str | None, typer.Argument(help="Name of the system [the one that runs].", autocompletion=systems)
    ] = None,
    json: Json = False,
) -> None:
    """Show the running systems and their health. Exit code 1: nothing runs, or a service is not healthy."""
    use_json(json)
    if system is not None:
        _check_known(Path(system).stem)
    found: dict[str, dict[str, Any]] = {}
    for folder in _folders(system):
        if folder.held() or folder.orphans():
            from .status_of import status_of

            found[folder.name] = status_of(folder)
    if json:
        write_json(found)
    elif not found:
        what = _idle(system)
        write(what if "; " in what else f"{what}; start a system with `surefoot up`")
    for name, content in found.items() if not json else ():
        _show_status(name, content)
    if not found or any(row["state"] != "healthy" for content in found.values() for row in content["services"]):
        raise typer.Exit(EXIT_CHECK)


def _idle(system: str | None) -> str:
    """Return the sentence that the named system does not run, or, for None, that no system runs."""
    from surefoot.services.supervisor.processes.rundir import unreadable

    others = ", ".join(folder.name for folder in _folders(None) if folder.held()) if system is not None else ""
    if others:
        return f"{Path(system or '').stem} does not run; running: {others}"
    hidden = unreadable()
    return f"nothing is running; {hidden}" if hidden else "nothing is running"


def logs(
    service: Annotated[str | None, typer.Argument(help="Name of a service [all].", autocompletion=services)] = None,
    system: Annotated[str | None, typer.Option(help="Name of the system [the last one that ran].")] = None,
    lines: Annotated[int, typer.Option("--lines", "-n", min=0, help="Lines from the end of each log.")] = 20,
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Go on as lines come; end with Ctrl-C.")] = False,
    json: Json = False,
) -> None:
    """Show the logs of the services in the order of time."""
    from surefoot.services.supervisor.processes.logs import follow_logs, last_lines

    use_json(json)
    if system is not None:
        _check_known(Path(system).stem)
    folders = _folders(system)
    found = {name: path for folder in folders[-1:] for name, path in folder.logs().items()}
    if service is not None and service not in found:
        raise typer.BadParameter(f"no log of {service!r}; there are {', '.join(found) or 'none'}")
    chosen = {name: path for name, path in found.items() if service in (None, name)}
    rows = last_lines(chosen, lines)
    for name, line in rows:
        _show_line(name, line, json=json)
    if not rows and lines:
        notify(f"no lines so far of {', '.join(chosen) or 'any service'}")
    if follow:
        for name, line in follow_logs(chosen):
            _show_line(name, line, json=json)


def health(
    service: Annotated[str, typer.Argument(help="Name of a service.", autocompletion=services)],
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Request the health of a service, as the probe in compose files. Exit code 1: it is not healthy."""
    from surefoot.schemas.system import HealthRequest
    from surefoot.schemas.topics import HEALTH_GET

    use_json(json)
    with client(connect, namespace) as robot:
        found = robot.bus.call(HEALTH_GET.of(service), HealthRequest(), 2.0).health
    write_answer(
        found, f"{service}: {found.state}" + (f", waits for {', '.join(found.waiting_for)}" * bool(found.waiting_for))
    )
    if found.state not in ("joining", "ready", "running"):
        raise typer.Exit(EXIT_CHECK)


def _folders(system: str | None) -> list["RunFolder"]:
    """Return the run folders of a system, or of all systems for None, with running systems last."""
    from surefoot.services.supervisor.processes.rundir import RunFolder, run_folders

    if system is not None:
        return [RunFolder(Path(system).stem)]
    return sorted(run_folders(), key=lambda folder: (folder.held() or bool(folder.orphans()), folder.touched()))


def _check_known(name: str) -> None:
    """Raise an error for the name of a system that neither has run here nor could be started."""
    from surefoot.files import names
    from surefoot.nearest import did_you_mean
    from surefoot.services.supervisor.processes.rundir import run_folders

    folders = run_folders()
    known = sorted({*names("compose", ".yaml"), *(folder.name for folder in folders)})
    if name not in known:
        running = ", ".join(folder.name for folder in folders if folder.held()) or "none"
        hint = did_you_mean(name, known)
        raise typer.BadParameter(f"no system {name!r}{hint}; known are {', '.join(known)}; running: {running}")


@contextmanager
def _until_signal() -> Iterator[threading.Event]:
    """Yield an event that SIGTERM, SIGINT and SIGHUP set, in place of their default action, so that services stop.

    A system whose terminal is closed ends; one that was started by `nohup`, which ignores SIGHUP, goes on.
    """
    stop = threading.Event()
    numbers = [signal.SIGTERM, signal.SIGINT]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, lambda *_: stop.set()) for number in numbers}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _show_up(name: str, content: dict[str, Any], *, json: bool) -> None:
    """Show a system that has just started, and commands to use with it."""
    hints = (
        "Watch it from another shell:",
        "  surefoot view",
        "  surefoot topic echo state/velocity",
        f"From any Zenoh client: connect to {content['connect']}, subscribe to {content['namespace']}/state/velocity "
        "(JSON)",
        f"Stop it with `surefoot down {name}`.",
    )
    _show_status(name, content, hints, json=json)


def _show_status(name: str, content: dict[str, Any], hints: Sequence[str] = (), *, json: bool = False) -> None:
    """Show the status of a system as a table with hints below, or as JSON without hints."""
    if json:
        write_json(content)
        return
    colours = {"healthy": "green", "starting": "yellow", "backoff": "yellow"}
    rows = [
        (
            row["service"],
            (row["state"], colours.get(row["state"], "bold red")),
            row.get("doing", ""),
            row["pid"] or "",
            row["restarts"],
            f"{row['tick_p50_us']:.0f} / {row['tick_p99_us']:.0f}" if "tick_p50_us" in row else "",
            f"{row['rss_mb']:.0f}" if "rss_mb" in row else "",
            _remarks(row),
        )
        for row in content["services"]
    ]
    title = f"{name}: {content['namespace']} at {content['connect']}" if content["connect"] else ""
    columns = ("service", "state", "doing", "pid", "restarts", "tick us p50 / p99", "MB", "remarks")
    write_table(columns, rows, title, right=(3, 4, 5, 6))
    if remarks := _remarks({"detail": "", **content.get("supervisor", {})}):
        write(f"supervisor: {remarks}")
    if "time" in content:
        write(content["time"]["words"])
    if "detail" in content:
        write(content["detail"])
    for hint in hints:
        write(hint)


def _remarks(row: dict[str, Any]) -> str:
    """Return remarks on a service as text: reason of ill health, trouble, silent inputs, refusals, dropped messages."""
    silent = [f"{key} silent for {age:.1f} s" for key, age in row.get("late", {}).items()]
    refused = [f"{n}x {reason}" for reason, n in _refusals(row)]
    dropped = [f"{n}x {key} dropped" for key, n in row.get("dropped", {}).items()]
    return ", ".join([*filter(None, (row["detail"], row.get("trouble", ""))), *silent, *refused, *dropped])


def _refusals(row: dict[str, Any]) -> list[tuple[str, int]]:
    """Return (reason, number) of the requests that a service refused, without those for joining too early."""
    return [(reason, n) for reason, n in row.get("refused", {}).items() if not reason.startswith("join_")]


def _show_line(name: str, line: str, *, json: bool) -> None:
    from surefoot.logline import read_log_line

    found = read_log_line(line)
    if json:
        known: dict[str, Any] = vars(found) if found is not None else {"time": None, "level": None, "tick": None}
        write(jsonlib.dumps({**known, "service": name, "text": line if found is None else found.text}))
    else:
        write(line if found is not None else f"{name}: {line}")
