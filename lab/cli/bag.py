"""Commands `surefoot bag record|play|info`: record the bus to an MCAP file, publish one, show its content."""

from pathlib import Path
from typing import Annotated

import typer

from .connect import client
from .output import (
    EXIT_CHECK,
    Connect,
    Json,
    Listen,
    Namespace,
    notify,
    refuse_existing,
    use_json,
    write,
    write_answer,
    write_json,
)
from .progress import Progress

app = typer.Typer(name="bag", help="Recordings (MCAP): record, play, show.", no_args_is_help=True)
File = Annotated[Path, typer.Argument(help="MCAP file.")]
SHOWN = 100
"""Largest length of a metadata entry in the readable output of `bag info`, characters; the rest is cut off."""
Keys = Annotated[list[str] | None, typer.Option("--key", "-k", help="Only this topic; may be given several times.")]


@app.command()
def info(
    file: File,
    verify: Annotated[
        bool, typer.Option("--verify", help="Read all of it and compare checksums. Exit code 1: it is damaged.")
    ] = False,
    json: Json = False,
) -> None:
    """Show the content of a recording: duration, metadata, number of messages by topic."""
    from surefoot.record.recording import recording_info

    use_json(json)
    if verify:
        _verify(file, json=json)
        return
    content = recording_info(file)
    if json:
        write_json(content)
        return
    duration = (content["end_ns"] - content["start_ns"]) * 1e-9
    write(f"{file}: {content['messages']} messages, {duration:.2f} s of simulated time")
    for name, entries in content["metadata"].items():
        write(f"{name}: " + ", ".join(f"{key}={_short(value)}" for key, value in entries.items()))
    for key, count in content["topics"].items():
        write(f"{count:>9}  {key}")


def _short(value: str) -> str:
    return value if len(value) <= SHOWN else f"{value[:SHOWN]}... ({len(value)} characters; --json shows all)"


def _verify(file: Path, *, json: bool) -> None:
    with Progress(f"checksums of {file.name}", reads=[file]):
        from surefoot.record.recording import verify_recording

        found = verify_recording(file)
    readable = found.messages.total()
    if json:
        shown = ("chunks", "damaged", "messages", "lost", "uncounted", "problems", "lost_share")
        parts = {name: getattr(found, name) for name in shown}
        write_json({"path": str(file), "ok": found.whole, "readable": readable, **parts})
    else:
        lost = f"{'at least ' * found.uncounted}{found.lost or 'none'} lost"
        lost = "how many are lost is unknown" if found.uncounted and not found.lost else lost
        write(f"{file}: {'whole' if found.whole else 'damaged'}, {readable} messages can be read, {lost}")
        write(f"{found.chunks} chunks with a checksum each, {found.damaged} damaged")
        for problem in found.problems:
            write(f"problem  {problem}")
        for key, count in sorted(found.messages.items()):
            write(f"{count:>9}  {key}")
    if not found.whole:
        raise typer.Exit(EXIT_CHECK)


@app.command()
def record(
    file: Annotated[Path, typer.Option("--out", "-o", help="MCAP file to write.")] = Path("bag.mcap"),
    key: Keys = None,
    duration: Annotated[float, typer.Option(min=0.0, help="End after so many s of wall time, 0 = Ctrl-C.")] = 0.0,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file.")] = False,
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Record messages of the bus as an observer, until Ctrl-C; unlike the service recorder, this may miss some. Exit
    code 1: no message arrived."""
    from .bags import record_bag

    use_json(json)
    refuse_existing(file, force=force)
    with client(connect, namespace) as robot:
        notify(f"recording to {file}; end with Ctrl-C")
        count = record_bag(robot, file, key or [], duration)
        still = "" if count else robot.standing_still()
    write_answer(
        {"file": str(file), "messages": count}, f"{count} messages in {file}" + (f": {still}" if still else "")
    )
    if not count:
        raise typer.Exit(EXIT_CHECK)


@app.command()
def play(
    file: File,
    rate: Annotated[float, typer.Option(min=0.0, help="Speed, 1 = as recorded, 0 = as fast as it goes.")] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Begin again at the end.")] = False,
    start: Annotated[float, typer.Option(min=0.0, help="Begin so many s after the beginning.")] = 0.0,
    end: Annotated[float | None, typer.Option(min=0.0, help="End so many s after the beginning.")] = None,
    key: Keys = None,
    listen: Listen = None,
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Publish a recording on its keys: into a running system with --connect, else behind a router of its own. Exit code
    1: there was nothing to play."""
    from .bags import play_bag

    use_json(json)
    count = play_bag(
        file, rate, loop=loop, window=(start, end), keys=key or [], listen=listen, connect=connect, namespace=namespace
    )
    write_answer({"file": str(file), "messages": count}, f"{count} messages played")
    if not count:
        raise typer.Exit(EXIT_CHECK)
