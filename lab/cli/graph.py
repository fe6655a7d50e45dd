"""Command `surefoot graph`: the topics and queries between services, as text, JSON, Mermaid or DOT."""

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from .output import Json, use_json, write, write_json, write_table

if TYPE_CHECKING:
    from surefoot.lockstep.graph import Edge


class Form(StrEnum):
    """Output format of `surefoot graph`: plain text, Mermaid or DOT."""

    TEXT = "text"
    MERMAID = "mermaid"
    DOT = "dot"


SIMULATOR = "simulator"
"""Name of the driver service that stands for all drivers in the graph of services."""
MOST_SOURCES = 3
"""Number of services: a service that reads topics of more than this many, and publishes none to others, is drawn with a
single arrow from all of them."""


def graph(
    form: Annotated[Form, typer.Option("--format", help="How to write it.")] = Form.TEXT,
    json: Json = False,
) -> None:
    """Print the topics and queries that connect the services, from the declarations of the services."""
    use_json(json)
    order, found = declared()
    if json:
        write_json({"order": order, "edges": found})
    elif form is Form.TEXT:
        write("order within a tick: " + " -> ".join(order))
        rows = [(e.source, e.target, e.key, e.kind + (", one tick late" if e.delayed else "")) for e in found]
        write_table(("from", "to", "key", "kind"), rows)
    else:
        write(mermaid(found) if form is Form.MERMAID else _dot(found))


def declared() -> "tuple[list[str], list[Edge]]":
    """Return the service names in tick order, and the topic and query edges; the simulator stands for all drivers."""
    from surefoot.lockstep.discover import service_class, service_names
    from surefoot.lockstep.driver import Driver
    from surefoot.lockstep.graph import edges, order

    found = [service_class(name) for name in service_names()]
    services = [s for s in found if not issubclass(s, Driver) or s.name == SIMULATOR]
    return order(services), sorted(edges(services), key=lambda edge: (edge.source, edge.target, edge.key))


def mermaid(edges: "list[Edge]") -> str:
    """Return the dataflow as a Mermaid flowchart, the figure of docs/architecture.md.

    Solid arrows are topics of the same tick, dotted ones topics that arrive one tick late, thick ones requests, drawn
    from the caller to the service that answers. Services that read from more than
    `MOST_SOURCES` others and publish no topic get one arrow together.
    """
    topics = [edge for edge in edges if edge.kind == "topic"]
    sources = {edge.target: {e.source for e in topics if e.target == edge.target} for edge in topics}
    readers = sorted(name for name, found in sources.items() if len(found) > MOST_SOURCES)
    readers = [name for name in readers if not any(edge.source == name for edge in topics)]
    lines = ["flowchart LR"]
    for source, target, arrow, keys in _arrows([edge for edge in topics if edge.target not in readers]):
        lines.append(f'  {source} {arrow}|"{"<br/>".join(keys)}"| {target}')
    for owner, caller, _, keys in _arrows([edge for edge in edges if edge.kind == "query"]):
        lines.append(f'  {caller} ==>|"{"<br/>".join(keys)}"| {owner}')
    publishers = sorted({edge.source for edge in topics if edge.target in readers})
    lines.append(f"  {' & '.join(publishers)} -->|all topics| {' & '.join(readers)}")
    return "\n".join(lines)


def _arrows(edges: "list[Edge]") -> list[tuple[str, str, str, list[str]]]:
    """Group edges by source, target and arrow (dotted if one tick late); return rows (source, target, arrow, keys)."""
    found: dict[tuple[str, str, str], list[str]] = {}
    for edge in edges:
        found.setdefault((edge.source, edge.target, "-.->" if edge.delayed else "-->"), []).append(edge.key)
    return [(*ends, keys) for ends, keys in found.items()]


def _dot(edges: "list[Edge]") -> str:
    lines = ["digraph surefoot {", "  rankdir=LR; node [shape=box];"]
    for source, target, arrow, keys in _arrows(edges):
        style = "dashed" if arrow == "-.->" else "solid"
        label = "\\n".join(keys)
        lines.append(f'  "{source}" -> "{target}" [label="{label}", style={style}];')
    return "\n".join([*lines, "}"])
