"""Command ``surefoot-service <name> [options]``: starts a service of this or another installed package."""

import gc
import importlib
import pkgutil
import sys
from functools import cache
from typing import Any

GROUP = "surefoot.services"
"""Entry-point group by which other packages add services (name = class); names of surefoot's own take precedence."""


def service_names() -> tuple[str, ...]:
    """Return the names of all services, those of other packages last."""
    from importlib.metadata import entry_points

    ours = own_service_names()
    return (*ours, *sorted({point.name for point in entry_points(group=GROUP)} - set(ours)))


def service_class(name: str) -> Any:
    """Return the class of a service (raises KeyError: no service has that name)."""
    if name in own_service_names():
        return importlib.import_module(f"surefoot.services.{name}.service").SERVICE
    from importlib.metadata import entry_points

    return entry_points(group=GROUP)[name].load()


@cache
def own_service_names() -> tuple[str, ...]:
    """Return the names of surefoot's own services: folders in `services` that have a module `service`."""
    found: list[str] = []
    places = list(importlib.import_module("surefoot.services").__path__)
    for module in pkgutil.iter_modules(places):
        folders = (f"{path}/{module.name}" for path in places)
        if module.ispkg and any(inner.name == "service" for inner in pkgutil.iter_modules(folders)):
            found.append(module.name)
    return tuple(found)


def main(arguments: list[str] | None = None) -> None:
    """Run the service named by the first argument; the remaining arguments are its own."""
    from surefoot.lockstep.ending import ENDING  # first of all: SIGTERM may come while the rest is imported

    ENDING.watch()
    words = sys.argv[1:] if arguments is None else arguments
    if not words or words[0] in ("-h", "--help"):
        sys.stdout.write(f"usage: surefoot-service <name> [options]\nservices: {', '.join(service_names())}\n")
        sys.exit(0 if words else 2)
    gc.disable()  # nothing that is imported becomes garbage: a tenth of the start; `run` enables it again
    try:
        service = service_class(words[0])
    except KeyError:
        from surefoot.nearest import did_you_mean

        names = service_names()
        hint = did_you_mean(words[0], names)
        sys.stderr.write(f"no service is named {words[0]!r}{hint}; there are {', '.join(names)}\n")
        sys.exit(2)
    from surefoot.lockstep.launch import main as run

    run(service, words[1:])


if __name__ == "__main__":
    main()
