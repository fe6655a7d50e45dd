"""`surefoot param list|get|set`: the configuration of a running service."""

from typing import TYPE_CHECKING, Annotated

import typer

from .completion import parameters, services
from .connect import client
from .output import Connect, Json, Namespace, use_json, write_answer, write_json, write_table

if TYPE_CHECKING:
    from surefoot.schemas.system import ConfigReply, ServiceParameter

app = typer.Typer(help="Parameters of running services: list, get, set.", no_args_is_help=True)
ServiceName = Annotated[str, typer.Argument(help="Name of a service.", autocompletion=services)]
Name = Annotated[str, typer.Argument(help="Name of a parameter.", autocompletion=parameters)]


@app.command("list")
def list_parameters(
    service: ServiceName, connect: Connect = None, namespace: Namespace = None, json: Json = False
) -> None:
    """List the parameters of a running service; those marked live can be set."""
    use_json(json)
    reply = _config(service, connect, namespace)
    if json:
        write_json(reply)
        return
    rows = [(p.name, p.value, p.default, "live" if p.live else "-", p.meaning) for p in reply.parameters]
    write_table(("parameter", "value", "default", "set", "unit and meaning"), rows, service)


@app.command()
def get(
    service: ServiceName, name: Name, connect: Connect = None, namespace: Namespace = None, json: Json = False
) -> None:
    """Print the present value of a parameter, as JSON."""
    use_json(json)
    found = _named(_config(service, connect, namespace), service, name)
    write_answer(found, found.value)


@app.command("set")
def set_parameter(
    service: ServiceName,
    name: Name,
    value: Annotated[str, typer.Argument(help="New value, as in the environment.")],
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Change a live parameter between two ticks. A restart of the service brings the old value back."""
    from surefoot.schemas.system import ConfigureRequest
    from surefoot.schemas.topics import CONFIGURE

    use_json(json)
    query, request = CONFIGURE.of(known_service(service)), ConfigureRequest(values={name: value})
    with client(connect, namespace) as robot:
        found = _named(robot.bus.call(query, request), service, name)
    write_answer(found, f"{service}: {name} = {found.value}")


def _config(service: str, connect: str | None, namespace: str | None) -> "ConfigReply":
    from surefoot.schemas.system import ConfigRequest
    from surefoot.schemas.topics import CONFIG_GET

    query = CONFIG_GET.of(known_service(service))
    with client(connect, namespace) as robot:
        return robot.bus.call(query, ConfigRequest())


def known_service(service: str) -> str:
    """Return the name of a service; refuse what cannot stand in a key."""
    from surefoot.lockstep.discover import service_names
    from surefoot.nearest import did_you_mean

    known = service_names()
    if service not in known:
        raise typer.BadParameter(f"no service {service!r}{did_you_mean(service, known)}; known are {', '.join(known)}")
    return service


def _named(reply: "ConfigReply", service: str, name: str) -> "ServiceParameter":
    from surefoot.errors import SurefootError
    from surefoot.nearest import did_you_mean

    names = [each.name for each in reply.parameters]
    if name not in names:
        hint = did_you_mean(name, names)
        raise SurefootError(
            "unknown_key", f"{service} has no parameter {name!r}{hint}; it has {', '.join(names)}", name
        )
    return reply.parameters[names.index(name)]
