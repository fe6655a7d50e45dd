"""Candidates for shell completion (bash, zsh): names of scenarios, systems, robots, services, parameters; keys.

Each function takes the text that was typed and returns the candidates that begin with it.
"""

from collections.abc import Iterable
from contextlib import suppress

import typer


def beginning(names: Iterable[str], incomplete: str) -> list[str]:
    """Return the names that begin with `incomplete`, sorted."""
    return sorted(name for name in names if name.startswith(incomplete))


def scenarios(incomplete: str) -> list[str]:
    """Return the names of scenarios that begin with `incomplete`."""
    from surefoot.files import names

    return beginning(names("scenarios", ".toml"), incomplete)


def systems(incomplete: str) -> list[str]:
    """Return the names of systems that begin with `incomplete`."""
    from surefoot.files import names

    return beginning(names("compose", ".yaml"), incomplete)


def robots(incomplete: str) -> list[str]:
    """Return the names of robots that begin with `incomplete`."""
    from surefoot.robot.reader import robot_names

    return beginning(robot_names(), incomplete)


def services(incomplete: str) -> list[str]:
    """Return the names of services that begin with `incomplete`."""
    from surefoot.lockstep.discover import service_names

    return beginning(service_names(), incomplete)


def topics(incomplete: str) -> list[str]:
    """Return the keys of topics that begin with `incomplete`."""
    from surefoot.schemas.topics import TOPICS

    return beginning((row.key for row in TOPICS), incomplete)


def queries(incomplete: str) -> list[str]:
    """Return the keys of queries that begin with `incomplete`."""
    from surefoot.schemas.topics import QUERIES

    return beginning((row.key for row in QUERIES), incomplete)


def parameters(ctx: typer.Context, incomplete: str) -> list[str]:
    """Return the names of parameters that begin with `incomplete`, of the service named on the command line, if any.

    Args:
        ctx: words of the command line so far; `service` is the name of a service.
        incomplete: beginning that was typed.
    """
    from surefoot.lockstep.discover import service_class, service_names

    known, names = service_names(), set[str]()
    service = ctx.params.get("service")
    for each in [service] if service in known else known:
        with suppress(ImportError):  # its extra is not installed
            names.update(service_class(each).Config.model_fields)
    return beginning(names, incomplete)
