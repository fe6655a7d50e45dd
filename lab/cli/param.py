"""Commands `surefoot param list|get|set`: the configuration parameters of a running service."""

from typing import TYPE_CHECKING, Annotated

import typer

from .completion import parameters, services
from .connect import client
from .negative import NumbersCommand
from .output import Connect, Json, Namespace, use_json, write_answer, write_json, write_table

if TYPE_CHECKING:
    from surefoot.schemas.system import ConfigReply, ServiceParameter

app = typer.Typer(name="param", help="Parameters of running services: list, get, set.", no_args_is_help=True)
ServiceName = Annotated[str, typer.Argument(help="Name of a service.", autocompletion=services)]
AnyService = Annotated[
    str | None, typer.Argument(help="Name of a service [all that run].", autocompletion=services, show_default=False)
]
Name = Annotated[str, typer.Argument(help="Name of a parameter.", autocompletion=parameters)]
AnyName = Annotated[
    str | None, typer.Argument(help="Name of a parameter [all].", autocompletion=parameters, show_default=False)
]


@app.command("list")
def list_parameters(
    service: AnyService = None, connect: Connect = None, namespace: Namespace = None, json: Json = False
) -> None:
    """List the parameters of a running service, or of all that run; those marked live can be set."""
    use_json(json)
    if service is not None:
        _show(_config(service, connect, namespace), service, json=json)
        return
    found = _configs(connect, namespace)
    if json:
        write_json({name: reply.model_dump(mode="json") for name, reply in found.items()})
        return
    for name, reply in found.items():
        _show(reply, name, json=False)


def _show(reply: "ConfigReply", service: str, *, json: bool) -> None:
    """Write the parameters of a service as a table, or as JSON."""
    if json:
        write_json(reply)
        return
    rows = [(p.name, p.value, p.default, "live" if p.live else "-", p.meaning) for p in reply.parameters]
    write_table(("parameter", "value", "default", "set", "unit and meaning"), rows, service)


@app.command()
def get(
    service: ServiceName,
    name: AnyName = None,
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Print the present value of a parameter, as JSON; without its name list all of the service."""
    use_json(json)
    if name is None:
        _show(_config(service, connect, namespace), service, json=json)
        return
    found = _named(_config(service, connect, namespace), service, name)
    write_answer(found, found.value)


@app.command("set", cls=NumbersCommand)
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


def _configs(connect: str | None, namespace: str | None) -> "dict[str, ConfigReply]":
    """Return the configuration of each running service that answers, by service name."""
    from surefoot.errors import CallError
    from surefoot.lockstep.discover import service_names
    from surefoot.schemas.system import ConfigRequest
    from surefoot.schemas.topics import CONFIG_GET

    found: dict[str, ConfigReply] = {}
    with client(connect, namespace) as robot:
        for service in service_names():
            try:
                found[service] = robot.bus.call(CONFIG_GET.of(service), ConfigRequest())
            except CallError as error:
                if error.code != "absent":
                    raise
    return found


def known_service(service: str) -> str:
    """Return `service` unchanged if a service has this name; else raise an error that lists the known names."""
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
