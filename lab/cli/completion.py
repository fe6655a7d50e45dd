"""Names that bash and zsh complete: scenarios, systems, robots, services, keys. See `surefoot --install-completion`.

Each function takes the beginning that was typed and returns the names that begin so.
"""

from collections.abc import Iterable
from contextlib import suppress


def _of(names: Iterable[str], incomplete: str) -> list[str]:
    return sorted(name for name in names if name.startswith(incomplete))


def scenarios(incomplete: str) -> list[str]:
    """Return the names of scenarios that begin with `incomplete`."""
    from surefoot.files import names

    return _of(names("scenarios", ".toml"), incomplete)


def systems(incomplete: str) -> list[str]:
    """Return the names of systems that begin with `incomplete`."""
    from surefoot.files import names

    return _of(names("compose", ".yaml"), incomplete)


def robots(incomplete: str) -> list[str]:
    """Return the names of robots that begin with `incomplete`."""
    from surefoot.robot.reader import robot_names

    return _of(robot_names(), incomplete)


def services(incomplete: str) -> list[str]:
    """Return the names of services that begin with `incomplete`."""
    from surefoot.lockstep.discover import service_names

    return _of(service_names(), incomplete)


def topics(incomplete: str) -> list[str]:
    """Return the keys of topics that begin with `incomplete`."""
    from surefoot.schemas.topics import TOPICS

    return _of((row.key for row in TOPICS), incomplete)


def queries(incomplete: str) -> list[str]:
    """Return the keys of queries that begin with `incomplete`."""
    from surefoot.schemas.topics import QUERIES

    return _of((row.key for row in QUERIES), incomplete)


def parameters(incomplete: str) -> list[str]:
    """Return the names of parameters of any service that begin with `incomplete`."""
    from surefoot.lockstep.discover import service_class, service_names

    names: set[str] = set()
    for each in service_names():
        with suppress(ImportError):  # its extra is not installed
            names.update(service_class(each).Config.model_fields)
    return _of(names, incomplete)
