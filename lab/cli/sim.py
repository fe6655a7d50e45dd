"""Commands `surefoot sim ...`: pause, step and pace of simulated time, pushes, faults, and resets."""

from typing import Annotated, Any

import typer

from .connect import client
from .negative import NumbersCommand
from .output import EXIT_CHECK, Connect, Json, Namespace, use_json, write_answer

app = typer.Typer(name="sim", help="Simulated time: pause, step, disturb, begin anew.", no_args_is_help=True)
AtTick = Annotated[int | None, typer.Option(min=0, help="Control tick it happens in (reproducible) [the next].")]


@app.command()
def status(connect: Connect = None, namespace: Namespace = None, json: Json = False) -> None:
    """Show the state of simulated time: tick, pace, running or paused."""
    from surefoot.simtime import pace

    use_json(json)
    with client(connect, namespace) as robot:
        found = robot.call("sim/status")
    write_answer(found, pace(found))


@app.command()
def pause(at_tick: AtTick = None, connect: Connect = None, namespace: Namespace = None, json: Json = False) -> None:
    """Pause simulated time after a control tick."""
    _act("sim/pause", {"at_tick": at_tick}, "simulated time pauses at tick {tick}", connect, namespace, json=json)


@app.command()
def resume(connect: Connect = None, namespace: Namespace = None, json: Json = False) -> None:
    """Resume simulated time after a pause."""
    _act("sim/step", {"ticks": None}, "simulated time goes on from tick {tick}", connect, namespace, json=json)


@app.command(cls=NumbersCommand)
def step(
    ticks: Annotated[int, typer.Argument(min=1, help="Control ticks of 10 ms.")] = 1,
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Advance simulated time by some control ticks, then pause."""
    text = f"{ticks} ticks from tick {{tick}} on, then a pause"
    _act("sim/step", {"ticks": ticks}, text, connect, namespace, json=json)


@app.command(cls=NumbersCommand)
def speed(
    factor: Annotated[float, typer.Argument(min=0.0, help="Real-time factor, 0 = as fast as it goes.")],
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Set the real-time factor at which simulated time runs."""
    text = f"simulated time runs at {factor:g} times real time" if factor else "simulated time runs as fast as it goes"
    _act("sim/speed", {"rtf": factor}, text, connect, namespace, json=json)


@app.command(cls=NumbersCommand)
def push(
    forward: Annotated[float, typer.Argument(help="Force along world x, N.")],
    left: Annotated[float, typer.Argument(help="Force along world y, N.")] = 0.0,
    up: Annotated[float, typer.Argument(help="Force along world z, N.")] = 0.0,
    duration: Annotated[float, typer.Option(min=0.01, help="s")] = 0.2,
    body: Annotated[str, typer.Option(help="Link the force acts on.")] = "trunk",
    at_tick: AtTick = None,
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Push the robot with a force, N, along the world axes, e.g. `surefoot sim push -5` along -x."""
    fields = {"force": (forward, left, up), "duration": duration, "body": body, "at_tick": at_tick}
    _act(
        "sim/push", fields, f"{body} is pushed from tick {{tick}} on for {duration:g} s", connect, namespace, json=json
    )


@app.command()
def fault(
    kind: Annotated[str, typer.Argument(help="Kind of fault: `surefoot call sim/features` lists them.")],
    target: Annotated[str, typer.Option(help="Joint, leg or sensor, where the fault has one.")] = "",
    value: Annotated[float, typer.Option(help="Size, where the fault has one.")] = 0.0,
    duration: Annotated[float, typer.Option(min=0.01, help="s")] = 1.0,
    at_tick: AtTick = None,
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Inject a fault of a joint, leg or sensor into the simulation for a limited time."""
    fields = {"kind": kind, "target": target, "value": value, "duration": duration, "at_tick": at_tick}
    _act("sim/fault", fields, f"{kind} from tick {{tick}} on for {duration:g} s", connect, namespace, json=json)


@app.command("set", cls=NumbersCommand)
def set_quantity(
    quantity: Annotated[str, typer.Argument(help="friction, mass or servo.")],
    value: Annotated[float, typer.Argument(help="Friction coefficient, or factor on mass or servo gain.")],
    at_tick: AtTick = None,
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Change friction, mass or servo gain of the simulated world while it runs."""
    fields = {"quantity": quantity, "value": value, "at_tick": at_tick}
    _act("sim/set", fields, f"{quantity} is {value:g} from tick {{tick}} on", connect, namespace, json=json)


@app.command()
def reset(
    terrain: Annotated[str | None, typer.Option(help="Kind of terrain or path of a terrain file [as it was].")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of everything random [as it was].")] = None,
    rtf: Annotated[float | None, typer.Option(min=0.0, help="Pace, 0 = as fast as it goes [as it was].")] = None,
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Begin a new run: terrain, pace and expected services stay as they were unless given."""
    fields: dict[str, Any] = {"keep": True}
    if terrain is not None:
        fields["world"] = {"terrain": terrain}
    if seed is not None:
        fields["seed"] = seed
    if rtf is not None:
        fields |= {"mode": "paced", "rtf": rtf}
    _act("sim/reset", fields, "run {run_id} begins", connect, namespace, json=json)


def _act(
    key: str, fields: dict[str, Any], text: str, connect: str | None, namespace: str | None, *, json: bool
) -> None:
    """Send a request to the simulator and write `text`, or the reply as JSON; exit with code 1 if it is refused."""
    from surefoot.errors import CallError

    use_json(json)
    with client(connect, namespace) as robot:
        try:
            reply = robot.call(key, **{name: value for name, value in fields.items() if value is not None})
        except CallError as error:
            if error.code != "absent":
                raise
            why = "the driver of a real robot has no simulated time"
            raise CallError("absent", f"no driver answers {key}: {why}") from None
    content = reply.model_dump(mode="json")
    write_answer(content, content.get("reason") or text.format(**content))
    if content.get("accepted") is False:
        raise typer.Exit(EXIT_CHECK)
