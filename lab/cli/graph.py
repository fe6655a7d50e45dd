"""`surefoot graph`: the dataflow as the services declare it."""

from enum import StrEnum
from typing import Annotated

import typer

from .output import Json, use_json, write, write_json, write_table


class Form(StrEnum):
    """Format of the printed graph."""

    TEXT = "text"
    MERMAID = "mermaid"
    DOT = "dot"


def graph(
    form: Annotated[Form, typer.Option("--format", help="How to write it.")] = Form.TEXT,
    json: Json = False,
) -> None:
    """Print who needs what from whom, from the declarations of the services."""
    from surefoot.lockstep.discover import service_class, service_names
    from surefoot.lockstep.graph import edges, order

    use_json(json)
    services = [service_class(name) for name in service_names()]
    found = sorted(edges(services), key=lambda edge: (edge.source, edge.target, edge.key))
    if json:
        write_json({"order": order(services), "edges": found})
    elif form is Form.TEXT:
        write("order within a tick: " + " -> ".join(order(services)))
        rows = [(e.source, e.target, e.key, e.kind + (", one tick late" if e.delayed else "")) for e in found]
        write_table(("from", "to", "key", "kind"), rows)
    else:
        arrows: dict[tuple[str, str, bool], list[str]] = {}
        for edge in found:
            arrows.setdefault((edge.source, edge.target, edge.delayed), []).append(edge.key)
        write(_mermaid(arrows) if form is Form.MERMAID else _dot(arrows))


def _mermaid(arrows: dict[tuple[str, str, bool], list[str]]) -> str:
    lines = ["flowchart LR"]
    for (source, target, delayed), keys in arrows.items():
        lines.append(f'  {source} {"-.->" if delayed else "-->"}|"{"<br/>".join(keys)}"| {target}')
    return "\n".join(lines)


def _dot(arrows: dict[tuple[str, str, bool], list[str]]) -> str:
    lines = ["digraph surefoot {", "  rankdir=LR; node [shape=box];"]
    for (source, target, delayed), keys in arrows.items():
        style = "dashed" if delayed else "solid"
        label = "\\n".join(keys)
        lines.append(f'  "{source}" -> "{target}" [label="{label}", style={style}];')
    return "\n".join([*lines, "}"])
