"""`extends` of the Compose Specification: a service begins as one of another file, or of the same file."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, cast

from surefoot.files import FileError
from surefoot.nearest import did_you_mean
from surefoot.tables import Table

Raw = Mapping[str, Any]

MERGED = ("environment", "depends_on", "healthcheck")
"""Maps of a service that are merged key by key; every other key of the service itself replaces the inherited one."""


def extended(services: Raw, path: Path, read: Callable[[Path], object], error: type[FileError]) -> dict[str, Any]:
    """Return the services of a file with what they extend filled in, as read from YAML.

    Args:
        services: entries of the file's `services`.
        path: the file; others are found relative to it.
        read: reads the content of another file.
        error: to raise.
    """
    return {name: _resolved(name, services, path, read, error, ()) for name in services}


def _resolved(
    name: str,
    services: Raw,
    path: Path,
    read: Callable[[Path], object],
    error: type[FileError],
    chain: tuple[tuple[Path, str], ...],
) -> Any:
    own = services[name]
    if not isinstance(own, Mapping) or "extends" not in own:
        return own
    own = dict(cast("Raw", own))
    where = f"services.{name}.extends"
    base_name, base_path = _wanted(own.pop("extends"), where, path, error)
    here = (path.resolve(), name)
    if here in chain:
        raise error("value", where, f"{name!r} of {path.name} extends itself by a detour")
    others = services
    if base_path != path:
        content = Table(read(base_path), base_path.name, error)
        others = cast("Raw", content.raw("services"))
        Table(others, f"{base_path.name}: services", error)
    if base_name not in others:
        hint = did_you_mean(base_name, others)
        known = ", ".join(map(str, others))
        raise error("unknown_name", f"{where}.service", f"got {base_name!r}{hint}, {base_path.name} has {known}")
    base = _resolved(base_name, others, base_path, read, error, (*chain, here))
    return _merged(base, own) if isinstance(base, Mapping) else own


def _wanted(value: object, where: str, path: Path, error: type[FileError]) -> tuple[str, Path]:
    """Name of the service that is extended, and its file."""
    if isinstance(value, str):
        return value, path
    table = Table(value, where, error)
    service = table.text("service")
    file = path.parent / table.text("file") if table.has("file") else path
    table.close()
    return service, file


def _merged(base: Raw, own: Raw) -> dict[str, Any]:
    result = {**base, **own}
    for key in MERGED:
        if key in base and key in own:
            below, above = _as_map(key, base[key]), _as_map(key, own[key])
            if below is not None and above is not None:
                result[key] = {**below, **above}
    return result


def _as_map(key: str, value: Any) -> dict[str, Any] | None:
    """The map form of a list; None when it is neither, which the reader of the key will refuse."""
    if isinstance(value, Mapping):
        return dict(cast("Raw", value))
    if not isinstance(value, list) or not all(isinstance(item, str) for item in cast("list[Any]", value)):
        return None
    items = cast("list[str]", value)
    if key == "depends_on":
        return {item: {"condition": "service_started"} for item in items}
    if key == "environment" and all("=" in item for item in items):
        return dict(item.split("=", 1) for item in items)
    return None
