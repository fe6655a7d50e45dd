"""Commands `surefoot goal ...`: pause, resume and cancel the goal of the navigator."""

from typing import Annotated, Any

import typer

from .connect import client
from .output import EXIT_CHECK, Connect, Json, Namespace, use_json, write_answer
from .sim import AtTick

app = typer.Typer(name="goal", help="The goal of the navigator: pause, resume, cancel.", no_args_is_help=True)
GoalId = Annotated[str | None, typer.Option(help="Only if this is the goal [any].")]


@app.command()
def pause(
    goal_id: GoalId = None, at_tick: AtTick = None, connect: Connect = None, namespace: Namespace = None,
    json: Json = False,
) -> None:  # fmt: skip
    """Let the robot stand; the goal stays, and its time limits stand still."""
    _act("pause", "the robot stands until the goal is resumed", (goal_id, at_tick), connect, namespace, json=json)


@app.command()
def resume(
    goal_id: GoalId = None, at_tick: AtTick = None, connect: Connect = None, namespace: Namespace = None,
    json: Json = False,
) -> None:  # fmt: skip
    """Let the robot go on to its goal after a pause."""
    _act("resume", "the robot goes on to its goal", (goal_id, at_tick), connect, namespace, json=json)


@app.command()
def cancel(
    goal_id: GoalId = None, at_tick: AtTick = None, connect: Connect = None, namespace: Namespace = None,
    json: Json = False,
) -> None:  # fmt: skip
    """End the goal; the robot comes to stand on all feet."""
    _act("cancel", "the goal ends", (goal_id, at_tick), connect, namespace, json=json)


def _act(
    what: str, text: str, given: tuple[str | None, int | None], connect: str | None, namespace: str | None, *,
    json: bool,
) -> None:  # fmt: skip
    """Send a request to the navigator and write `text`, or the reply as JSON; exit with code 1 if it is refused.

    `given`: name of the goal, and tick; None = any goal, the next tick.
    """
    use_json(json)
    fields: dict[str, Any] = dict(zip(("goal_id", "at_tick"), given, strict=True))
    with client(connect, namespace) as robot:
        reply = robot.call(f"navigator/{what}", **{name: value for name, value in fields.items() if value is not None})
    write_answer(reply.model_dump(mode="json"), reply.reason or text)
    if not reply.accepted:
        raise typer.Exit(EXIT_CHECK)
