"""Commands `surefoot node list|info`: services of a running system; topics and queries that a service uses."""

from contextlib import suppress
from typing import TYPE_CHECKING, Any

import typer

from .connect import client
from .output import Connect, Json, Namespace, use_json, write, write_json, write_table
from .param import ServiceName, known_service

if TYPE_CHECKING:
    from surefoot.client import Client
    from surefoot.schemas.system import Health

app = typer.Typer(name="node", help="Services of a running system: list, show.", no_args_is_help=True)


@app.command("list")
def list_nodes(connect: Connect = None, namespace: Namespace = None, json: Json = False) -> None:
    """List the running services with process, state and computing time per tick."""
    from surefoot.lockstep.discover import service_names

    use_json(json)
    with client(connect, namespace) as robot:
        found = [health for name in service_names() if (health := _health(robot, name)) is not None]
    if json:
        write_json(found)
        return
    rows = [
        (h.service, h.state, h.pid, f"{h.tick_p50_us:.0f} / {h.tick_p99_us:.0f}", f"{h.rss_mb:.0f}", h.instance)
        for h in found
    ]
    write_table(("node", "state", "pid", "tick us p50 / p99", "MB", "instance"), rows, right=(2, 3, 4))


@app.command()
def info(service: ServiceName, connect: Connect = None, namespace: Namespace = None, json: Json = False) -> None:
    """Show the topics that a service reads and publishes, the queries that it answers and asks, and its state."""
    from surefoot.errors import BusError

    use_json(json)
    declared, health = _declared(known_service(service)), None
    with suppress(BusError), client(connect, namespace) as robot:
        health = _health(robot, service)
    if json:
        write_json({"service": service, **declared, "health": health})
        return
    if health is None:
        write(f"{service}: does not run")
    else:
        late = ", ".join(f"{key} silent for {age:.1f} s" for key, age in health.late.items())
        write(f"{service}: {health.state}, process {health.pid}, version {health.version}{f', {late}' if late else ''}")
    write_table(("", "key"), [(verb, key) for verb, keys in declared.items() for key in keys])


def _health(robot: "Client", service: str) -> "Health | None":
    """Return the health message of a service; None if the service does not answer."""
    from surefoot.errors import CallError
    from surefoot.schemas.system import HealthRequest
    from surefoot.schemas.topics import HEALTH_GET

    try:
        return robot.bus.call(HEALTH_GET.of(service), HealthRequest(), 1.0).health
    except CallError:
        return None


def _declared(service: str) -> dict[str, list[str]]:
    """Return the keys that a service declares, by verb (reads, publishes, answers, asks)."""
    from surefoot.lockstep.discover import service_class
    from surefoot.lockstep.join import Delayed

    kind: Any = service_class(service)
    reads = [f"{each.topic.key} (a tick late)" if isinstance(each, Delayed) else each.key for each in kind.inputs]
    return {
        "reads": [*reads, *(topic.key for topic in kind.observes)],
        "publishes": [topic.key for topic in kind.outputs],
        "answers": [query.key for query in kind.serves],
        "asks": [query.key for query in kind.calls],
    }
