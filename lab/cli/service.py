"""Commands `surefoot service list|info|call`: queries of the services; `surefoot call` is a short form."""

import json as jsonlib
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from .completion import queries
from .connect import client
from .output import (
    EXIT_CHECK,
    Connect,
    Json,
    Namespace,
    notify,
    refuse_existing,
    use_json,
    write,
    write_fields,
    write_json,
    write_table,
)

app = typer.Typer(name="service", help="Queries the services answer: list, show, call.", no_args_is_help=True)
Key = Annotated[str, typer.Argument(help="Key of a query, e.g. stability/check.", autocompletion=queries)]


@app.command("list")
def list_queries(json: Json = False) -> None:
    """List all queries with request, reply and owner."""
    from surefoot.schemas.topics import QUERIES

    use_json(json)
    rows = [{"key": q.key, "request": q.request.__name__, "reply": q.reply.__name__, "owner": q.owner} for q in QUERIES]
    if json:
        write_json(rows)
    else:
        write_table(("key", "request", "reply", "owner"), [tuple(row.values()) for row in rows])


@app.command()
def info(key: Key, json: Json = False) -> None:
    """Show the fields of a request and of its reply, and a call to paste."""
    from surefoot.client import query_named

    from .fields import describe, example

    use_json(json)
    query = query_named(key)
    fields = {"request": describe(query.request), "reply": describe(query.reply)}
    paste = f"surefoot call {query.key.replace('*', 'walker')} '{jsonlib.dumps(example(query.request))}'"
    if json:
        write_json({"key": query.key, "owner": query.owner, **fields, "example": paste})
        return
    write(f"{query.key}, answered by {query.owner}: {(query.request.__doc__ or '').strip()}")
    for kind, found in fields.items():
        write_fields(found, kind)
    write(f"Example: {paste}")


@app.command()
def call(
    key: Key,
    request: Annotated[str, typer.Argument(help="Request as a JSON object, `-` reads it from the input.")] = "{}",
    timeout: Annotated[float | None, typer.Option(min=0.01, help="Wait so many s [the query's own].")] = None,
    out: Annotated[
        Path | None, typer.Option(help="Write the reply to this file, numbers included: a height map as .npz.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite that file.")] = False,
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Call a query and print its reply as JSON. Exit code 1: it was not accepted, or no service answered."""
    from surefoot.client import query_named

    use_json(json)
    query = query_named(key)
    if out is not None:
        refuse_existing(out, force=force)
    fields = _fields(sys.stdin.read() if request == "-" else request)
    _check(query, fields)
    with client(connect, namespace) as robot:
        reply = robot.call(query, timeout, **fields)
        for _, process in robot.bus.refused:
            why = f"which is not {query.owner}, or only has its name"
            notify(f"refused: an answer of process {process!r}, {why}", "warning")
    if out is not None:
        _save(reply, out)
    content = reply.model_dump(mode="json")
    if json:
        write(jsonlib.dumps(content))
    else:
        write_json(content)
    if content.get("accepted") is False:
        raise typer.Exit(EXIT_CHECK)


def _save(reply: Any, out: Path) -> None:
    """Write a reply to a file: a height map in its own file format, other raw bytes unchanged, all else as JSON."""
    from surefoot.disk import whole
    from surefoot.geometry.heightmap import HeightMap
    from surefoot.geometry.heightmap_files import save
    from surefoot.schemas.terrain import HeightMapMessage

    if isinstance(reply, HeightMapMessage):
        save(HeightMap.from_wire(reply.model_dump(), reply.data), out)
        return
    with whole(out) as part:
        part.write_bytes(getattr(reply, "data", b"") or f"{reply.model_dump_json(indent=1)}\n".encode())


def _fields(text: str) -> dict[str, Any]:
    try:
        fields = jsonlib.loads(text)
    except ValueError as error:
        raise typer.BadParameter(f"the request is not JSON: {error}") from None
    if not isinstance(fields, dict):
        raise typer.BadParameter(f"the request must be a JSON object such as '{{}}', got {text[:60]!r}")
    return fields


def _check(query: Any, fields: dict[str, Any]) -> None:
    """Refuse a request with an unknown field (the error names the nearest known one) or an invalid value."""
    from surefoot.client import make_request
    from surefoot.errors import SurefootError
    from surefoot.nearest import did_you_mean

    known = query.request.model_fields
    for name in fields:
        if name not in known:
            hint = did_you_mean(name, known)
            message = f"{query.key} has no field {name!r}{hint}; it has {', '.join(known) or 'none'}"
            raise SurefootError("invalid", message, name)
    make_request(query, fields)
