"""Commands `surefoot schema list|show|file|export`: JSON Schemas of bus messages and of hand-written files."""

import json as jsonlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .completion import beginning
from .output import Json, use_json, write_answer, write_json, write_table

if TYPE_CHECKING:
    from surefoot.schemas.base import Wire

app = typer.Typer(
    name="schema", help="JSON Schemas of everything on the wire, and of hand-written files.", no_args_is_help=True
)
FILES = ("robot", "scenario", "system", "imu", "camera", "depth-camera", "ranger")
"""Kinds of hand-written files that have a JSON Schema."""


def models() -> "dict[str, type[Wire]]":
    """Return every pydantic model that a topic or a query carries, by class name."""
    from surefoot.schemas.base import ErrorReply
    from surefoot.schemas.topics import QUERIES, TOPICS

    found: list[type[Wire]] = [topic.model for topic in TOPICS]
    found += [model for query in QUERIES for model in (query.request, query.reply)]
    return {model.__name__: model for model in sorted({*found, ErrorReply}, key=lambda model: model.__name__)}


@app.command("list")
def list_schemas(json: Json = False) -> None:
    """List all messages, requests and replies with their versions."""
    use_json(json)
    rows = {name: (model.schema_name(), (model.__doc__ or "").split("\n")[0]) for name, model in models().items()}
    if json:
        write_json({name: schema for name, (schema, _) in rows.items()})
    else:
        write_table(("name", "on the wire", "what it is"), [(name, *row) for name, row in rows.items()])


@app.command()
def show(
    name: Annotated[str, typer.Argument(help="Name of a model, e.g. VelocityEstimate.")], json: Json = False
) -> None:
    """Print the JSON Schema of one model."""
    from surefoot.bus.codec import json_schema
    from surefoot.nearest import did_you_mean

    use_json(json)
    found = models()
    model = found.get(name.split("/")[1] if name.startswith("surefoot/") else name)
    if model is None:
        raise typer.BadParameter(f"no model is named {name!r}{did_you_mean(name, found)}; see `surefoot schema list`")
    write_json(json_schema(model))


def _kinds(incomplete: str) -> list[str]:
    """Return the kinds of hand-written files that begin with `incomplete`."""
    return beginning(FILES, incomplete)


@app.command("file")
def show_file(
    kind: Annotated[
        str, typer.Argument(help="Kind of hand-written file: " + ", ".join(FILES) + ".", autocompletion=_kinds)
    ],
    json: Json = False,
) -> None:
    """Print the JSON Schema of a kind of hand-written file, for editors."""
    from surefoot.nearest import did_you_mean

    use_json(json)
    if kind not in FILES:
        raise typer.BadParameter(f"no kind {kind!r}{did_you_mean(kind, FILES)}; there are {', '.join(FILES)}")
    write_json(file_schema(kind))


def file_schema(kind: str) -> dict[str, Any]:
    """Return the JSON Schema of a kind of hand-written file, one of `FILES`."""
    from surefoot.robot.files import RobotFile
    from surefoot.robot.profiles import CameraFile, DepthCameraFile, ImuFile, RangerFile
    from surefoot.services.supervisor.processes.compose import ComposeFile
    from surefoot.services.supervisor.scenarios.scenario import scenario_schema

    if kind == "scenario":
        return scenario_schema()
    models = {
        "robot": RobotFile, "system": ComposeFile, "imu": ImuFile, "camera": CameraFile,
        "depth-camera": DepthCameraFile, "ranger": RangerFile,
    }  # fmt: skip
    return models[kind].model_json_schema()


@app.command()
def export(
    folder: Annotated[Path, typer.Argument(help="Folder to write one <name>.json per model to.")], json: Json = False
) -> None:
    """Write the JSON Schema of every model, and the table of keys, into a folder."""
    from surefoot.bus.codec import encoding_of, json_schema
    from surefoot.schemas.topics import QUERIES, TOPICS

    use_json(json)
    folder.mkdir(parents=True, exist_ok=True)
    found = models()
    for name, model in found.items():
        _write(folder / f"{name}.json", json_schema(model))
    topics = {
        t.key: {"schema": t.model.__name__, "encoding": encoding_of(t.model), "kind": t.kind.value, "owner": t.owner}
        for t in TOPICS
    }
    queries = {q.key: {"request": q.request.__name__, "reply": q.reply.__name__, "owner": q.owner} for q in QUERIES}
    _write(folder / "keys.json", {"topics": topics, "queries": queries})
    write_answer(
        {"folder": str(folder), "schemas": list(found)}, f"{len(found)} schemas and keys.json written to {folder}"
    )


def _write(path: Path, content: object) -> None:
    path.write_text(jsonlib.dumps(content, indent=2) + "\n", encoding="utf-8")
