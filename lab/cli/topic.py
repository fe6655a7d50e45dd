"""Commands `surefoot topic list|info|echo|pub|hz|top`: topics of the bus and their messages."""

import json as jsonlib
import shutil
import sys
import time
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .completion import topics
from .connect import client
from .output import (
    EXIT_CHECK,
    Connect,
    Json,
    Namespace,
    notify,
    use_json,
    write,
    write_answer,
    write_fields,
    write_json,
    write_table,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from surefoot.bus.interface import Delivery
    from surefoot.client import Client
    from surefoot.schemas.base import Message
    from surefoot.schemas.topics import Topic

    from .top import TopicTraffic

SILENCE_S = 2.0  # s wall, after so long without a message the reason is looked for

CLEAR = "\x1b[H\x1b[2J"
"""Escape sequence that clears a terminal."""
REDRAWN_S = 0.2
"""Wall time between two redraws of a plot in the terminal, s."""
HEADER = ("stamp_ns", "tick", "epoch", "seq", "source")
SHOWN, LONGEST = 24, 200
"""`SHOWN`: most elements of a list, `LONGEST`: most characters of a text, in a readable line; the rest is cut off."""

app = typer.Typer(name="topic", help="Topics: list, show, echo, publish, measure.", no_args_is_help=True)
Key = Annotated[str, typer.Argument(help="Key of a topic, e.g. state/velocity.", autocompletion=topics)]


@app.command("list")
def list_topics(json: Json = False) -> None:
    """List all topics with message, rate and owner."""
    from surefoot.schemas.topics import TOPICS

    use_json(json)
    rows = [_row(topic) for topic in TOPICS]
    if json:
        write_json(rows)
    else:
        names = ("key", "schema", "period", "kind", "owner")
        write_table(
            ("key", "message", "period", "kind", "owner", "in run hash"),
            [(*(row[name] for name in names), "yes" if row["deterministic"] else "-") for row in rows],
        )


@app.command()
def info(key: Key, json: Json = False) -> None:
    """Show one topic and the fields of its message."""
    from surefoot.client import topic_named

    from .fields import describe

    use_json(json)
    topic = topic_named(key)
    row = _row(topic)
    fields = describe(topic.model)
    if json:
        write_json({**row, "fields": fields})
        return
    write(f"{row['key']}: {row['schema']}, {row['period']}, published by {row['owner']}")
    write((topic.model.__doc__ or "").strip())
    write_fields(fields)


@app.command()
def echo(
    key: Key,
    count: Annotated[int, typer.Option("--count", "-n", min=0, help="End after so many messages, 0 = never.")] = 0,
    timeout: Annotated[float, typer.Option(min=0.0, help="End when none comes for so many s, 0 = never.")] = 0.0,
    field: Annotated[str | None, typer.Option(help="Show this field only.")] = None,
    once: Annotated[bool, typer.Option("--once", help="End after one message.")] = False,
    raw: Annotated[bool, typer.Option("--raw", help="One JSON object a line, as on the wire.")] = False,
    plot: Annotated[str | None, typer.Option(help="Draw the curves of this field in the terminal.")] = None,
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Print the messages of a topic as they come, a readable line each; with --raw or --json one JSON object a line.
    With --plot a picture of the last values, through a pipe once at the end."""
    from surefoot.client import topic_named
    from surefoot.errors import Refusal

    use_json(json)
    topic = topic_named(key)
    for name in (field, plot):
        if name is not None and name not in topic.model.model_fields:
            raise typer.BadParameter(f"{key} has no field {name!r}; it has {', '.join(topic.model.model_fields)}")
    if plot is not None and (raw or json or field):
        raise typer.BadParameter("goes without --raw, --json and --field", param_hint="--plot")
    if plot is not None:
        _check_plot(topic, plot)
    show = _printer({field} if field else None, as_json=raw or json) if plot is None else _Plotter(plot)
    with client(connect, namespace) as robot:
        try:
            for number, delivery in enumerate(_deliveries(robot, topic, timeout), 1):
                try:
                    show(delivery.message())
                except Refusal as refusal:
                    notify(f"surefoot: {key}: {refusal.message}")
                if number == count or once:
                    return
        finally:
            if isinstance(show, _Plotter) and show.curves.begun:
                show.draw()
    raise typer.Exit(EXIT_CHECK)


def _check_plot(topic: "Topic[Any]", name: str) -> None:
    """Raise an error if the field `name` of a topic holds no numbers to plot; the error names the fields that do."""
    from .curves import has_numbers

    drawn = [each for each, about in topic.model.model_fields.items() if has_numbers(about.annotation)]
    if name not in drawn:
        text = f"{topic.key}: field {name!r} holds no numbers; those that do are {', '.join(drawn)}"
        raise typer.BadParameter(text, param_hint="--plot")


def _printer(fields: set[str] | None, *, as_json: bool) -> "Callable[[Message], None]":
    """Return a function that prints a message as one line, of these fields (None = all), readable or as JSON."""
    return lambda message: write(message.model_dump_json(include=fields) if as_json else readable(message, fields))


class _Plotter:
    """Plot of a message field in text: redrawn with new messages on a terminal, else written once at the end."""

    def __init__(self, field: str) -> None:
        from .curves import Curves

        self.curves, self._due_s = Curves(field, shutil.get_terminal_size().columns), 0.0

    def __call__(self, message: "Message") -> None:
        self.curves.add(message)
        if sys.stdout.isatty() and time.monotonic() >= self._due_s:
            self._due_s = time.monotonic() + REDRAWN_S
            self.draw()

    def draw(self) -> None:
        """Write the plot; on a terminal it replaces the previous one."""
        write(CLEAR * sys.stdout.isatty() + "\n".join(self.curves.lines()))


@app.command()
def pub(
    key: Key,
    fields: Annotated[str, typer.Argument(help="Fields of the message as a JSON object.")] = "{}",
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Publish one message, checked against its schema, as an operator: services read their inputs from the owners only.
    Commands are queries: `surefoot call cmd/walk`."""
    from pydantic import ValidationError

    from surefoot.bus.codec import refusal_of
    from surefoot.client import topic_named
    from surefoot.errors import SurefootError
    from surefoot.nearest import did_you_mean

    use_json(json)
    topic = topic_named(key)
    try:
        message = topic.model.model_validate_json(fields)
    except ValidationError as error:
        raise refusal_of(error, topic.key) from None
    known = [name for name in topic.model.model_fields if name not in HEADER]
    for name in jsonlib.loads(fields):
        if name not in known:
            hint = f"{did_you_mean(name, known)}; it has {', '.join(known)}"
            raise SurefootError("unknown_key", f"{topic.key} has no field {name!r}{hint}", name)
    with client(connect, namespace) as robot:
        robot.bus.publisher(topic, framed=False).put(message)
    write_answer({"key": topic.key, "published": message}, f"published on {topic.key}: {readable(message)}")


@app.command()
def hz(
    key: Key,
    window: Annotated[float, typer.Option(min=0.1, help="Measure for so many s of wall time.")] = 3.0,
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Measure the message rate of a topic, in wall time and in simulated time. Exit code 1: no message arrived."""
    from surefoot.client import topic_named

    use_json(json)
    topic = topic_named(key)
    arrivals: list[tuple[float, int, int]] = []
    with client(connect, namespace) as robot:
        end = time.monotonic() + window
        for delivery in _deliveries(robot, topic, window):
            raw = delivery.raw()
            size = len(raw.payload) + len(raw.attachment or b"")
            arrivals.append((time.monotonic(), delivery.header().stamp_ns, size))
            if time.monotonic() >= end:
                break
    result = _rates(arrivals)
    if json:
        write_json({"key": topic.key, **result})
    elif len(arrivals) < 2:
        write(f"{topic.key}: {len(arrivals)} messages in {window:g} s")
    else:
        write(
            f"{topic.key}: {result['wall_hz']:.1f} Hz in wall time, {result['simulated_hz']:.1f} Hz in simulated time, "
            f"{result['bytes']:.0f} bytes a message, {result['bytes_per_s'] / 1000:.1f} kB/s"
        )
    if not arrivals:
        raise typer.Exit(EXIT_CHECK)


@app.command()
def top(
    window: Annotated[float, typer.Option(min=0.1, help="Seconds of wall time that the figures are of.")] = 2.0,
    once: Annotated[bool, typer.Option("--once", help="End after the first table.")] = False,
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Show rates, sizes and latencies of all topics, and the support polygon. Exit code 1: nothing came.

    The latency of a topic is the time from the arrival of a tick's first message to that of the topic's own, that of
    its hop the time since the last input of its publisher arrived.
    """
    from .graph import declared
    from .top import Traffic, inputs_of, polygon_lines, watch

    use_json(json)
    traffic = Traffic(inputs=inputs_of(declared()[1]))
    with client(connect, namespace) as robot:
        watch(robot, traffic)
        while True:
            time.sleep(window)
            rows = traffic.rows(window)
            if json:
                write(jsonlib.dumps([row._asdict() for row in rows]))
            else:
                _show_top(rows, polygon_lines(traffic.stability), robot)
            if once:
                break
    if not rows:
        raise typer.Exit(EXIT_CHECK)


def _show_top(rows: "Sequence[TopicTraffic]", polygon: "Sequence[str]", robot: "Client") -> None:
    """Write the table of topic traffic and the support polygon; on a terminal they replace the previous output."""
    if sys.stdout.isatty():
        write(CLEAR)
    if not rows:
        notify("surefoot: no message" + _why(robot))
        return
    cells = [
        (
            row.key,
            f"{row.hz:.1f}",
            f"{row.kb_per_s:.1f}",
            f"{row.bytes:.0f}",
            f"{row.p50_ms:.2f}",
            f"{row.p99_ms:.2f}",
            f"{row.hop_p50_ms:.2f}",
            f"{row.hop_p99_ms:.2f}",
        )
        for row in rows
    ]
    columns = ("topic", "Hz", "kB/s", "bytes", "p50 ms", "p99 ms", "hop p50", "hop p99")
    write_table(columns, cells, right=tuple(range(1, len(columns))))
    for line in polygon:
        write(line)


def _deliveries(robot: "Client", topic: "Topic[Any]", timeout_s: float) -> "Any":
    """Yield the messages of a topic; end when none arrives for `timeout_s` s of wall time (0 = never)."""
    queue: SimpleQueue[Delivery] = SimpleQueue()
    robot.bus.subscribe(topic, queue.put)
    last = time.monotonic()
    silent = False
    held = _latched(robot, topic)
    if held is not None:
        yield held
    while True:
        try:
            delivery = queue.get(timeout=0.2)
        except Empty:
            silence = time.monotonic() - last
            if not silent and silence >= min(SILENCE_S, timeout_s or SILENCE_S):
                silent = True
                notify(f"surefoot: nothing on {topic.key} for {silence:.1f} s" + _why(robot))
            if 0.0 < timeout_s <= silence:
                return
            continue
        silent = False
        if not delivery.prime:
            last = time.monotonic()
            yield delivery


def readable(message: "Message", fields: set[str] | None = None) -> str:
    """Return a message as one line: simulated time and tick, then fields (None = all); numbers with four digits."""
    content = message.model_dump(mode="json", include=fields)
    shown = [f"{name}={_text(value)}" for name, value in content.items() if name not in HEADER]
    return f"t={message.stamp_ns * 1e-9:.3f} s, tick {message.tick}: {', '.join(shown)}"


def _text(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "-"}[value]
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list | tuple):
        more = f" ... {len(value)} in all" if len(value) > SHOWN else ""
        return f"[{' '.join(_text(part) for part in value[:SHOWN])}{more}]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{name}={_text(part)}" for name, part in value.items()) + "}"
    text = str(value)
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."


def _why(robot: "Client") -> str:
    """Return the reason why no message arrives, from the state of simulated time (e.g. paused), as text."""
    still = robot.standing_still()
    return f": {still}" if still else ""


def _latched(robot: "Client", topic: "Topic[Any]") -> "Delivery | None":
    """Return the latest message of a latched topic, by a query to its owner; None if the owner has no such query."""
    from surefoot.bus.interface import Delivery
    from surefoot.errors import CallError
    from surefoot.schemas.topics import QUERIES, Kind

    query = next((query for query in QUERIES if query.key == topic.key and query.reply is topic.model), None)
    if query is None or topic.kind is not Kind.LATCHED:
        return None
    try:
        return Delivery(topic, robot.call(query, 2.0), None)
    except CallError:
        return None


def _rates(arrivals: list[tuple[float, int, int]]) -> dict[str, float]:
    gaps = len(arrivals) - 1
    wall = arrivals[-1][0] - arrivals[0][0] if gaps > 0 else 0.0
    simulated = (arrivals[-1][1] - arrivals[0][1]) * 1e-9 if gaps > 0 else 0.0
    size = sum(item[2] for item in arrivals)
    return {
        "messages": len(arrivals),
        "wall_hz": gaps / wall if wall > 0 else 0.0,
        "simulated_hz": gaps / simulated if simulated > 0 else 0.0,
        "bytes": size / len(arrivals) if arrivals else 0.0,
        "bytes_per_s": size / wall if wall > 0 else 0.0,
    }


def _row(topic: "Topic[Any]") -> dict[str, Any]:
    if topic.period_ns:
        period = f"{topic.period_ns / 1e6:g} ms"
    elif topic.wall_period_s:
        period = f"{topic.wall_period_s:g} s (wall)"
    else:
        period = "event"
    return {
        "key": topic.key,
        "schema": topic.model.schema_name(),
        "period": period,
        "kind": topic.kind.value,
        "owner": topic.owner,
        "deterministic": topic.deterministic,
    }
