"""``surefoot-service <name> [options]``: starts one service of the folder `services`, found by its name."""

import importlib
import pkgutil
import sys

import services


def service_names() -> tuple[str, ...]:
    """Return the folders in `services` that have a module `service`."""
    found: list[str] = []
    for module in pkgutil.iter_modules(services.__path__):
        folders = (f"{path}/{module.name}" for path in services.__path__)
        if module.ispkg and any(inner.name == "service" for inner in pkgutil.iter_modules(folders)):
            found.append(module.name)
    return tuple(found)


def main(arguments: list[str] | None = None) -> None:
    """Run a service; the remaining arguments are its own."""
    words = sys.argv[1:] if arguments is None else arguments
    names = service_names()
    if not words or words[0] in ("-h", "--help"):
        sys.stdout.write(f"usage: surefoot-service <name> [options]\nservices: {', '.join(names)}\n")
        sys.exit(0 if words else 2)
    if words[0] not in names:
        from surefoot.tables import did_you_mean

        hint = did_you_mean(words[0], names)
        sys.stderr.write(f"no service is named {words[0]!r}{hint}; there are {', '.join(names)}\n")
        sys.exit(2)
    from surefoot.launch import main as run

    run(importlib.import_module(f"services.{words[0]}.service").SERVICE, words[1:])


if __name__ == "__main__":
    main()
