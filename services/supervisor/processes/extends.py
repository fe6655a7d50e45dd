"""`extends` of the Compose Specification: a service begins as one of another file, or of the same file."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, cast

from surefoot.files import FileError
from surefoot.nearest import did_you_mean
from surefoot.tables import FileModel, Text, shown, validated

Raw = Mapping[str, Any]

MERGED = ("environment", "depends_on", "healthcheck")
"""Keys of a service whose maps are merged with the inherited ones; any other key replaces the inherited value."""


class Extends(FileModel):
    """Table `extends` of a service: the service, of the same or another file, whose content it begins with."""

    service: Text
    file: Text = ""


def extended(content: object, path: Path, read: Callable[[Path], object], error: type[FileError]) -> Any:
    """Return the content of a compose file with what its services extend filled in.

    Args:
        content: the file's content, as read from YAML.
        path: the file; paths of other files are relative to it.
        read: reads the content of another file.
        error: class of the error that is raised for an invalid `extends`.
    """
    if not isinstance(content, Mapping) or not isinstance(content.get("services"), Mapping):
        return content
    files = {path: cast("Raw", content["services"])}

    def resolved(name: str, file: Path, chain: tuple[tuple[Path, str], ...]) -> Any:
        own = files[file][name]
        if not isinstance(own, Mapping) or "extends" not in own:
            return own
        where, own = f"services.{name}.extends", dict(cast("Raw", own))
        wanted = own.pop("extends")
        if not isinstance(wanted, str):
            base = validated(Extends, wanted, error, where)
            wanted, place = base.service, file.parent / base.file if base.file else file
        else:
            place = file
        here = (file.resolve(), name)
        if here in chain:
            raise error("value", where, f"{name!r} of {file.name} extends itself by a detour")
        if place not in files:
            files[place] = _services(read(place), place, error)
        if wanted not in files[place]:
            hint, known = did_you_mean(wanted, files[place]), ", ".join(map(str, files[place]))
            raise error("unknown_name", f"{where}.service", f"got {wanted!r}{hint}, {place.name} has {known}")
        base = resolved(wanted, place, (*chain, here))
        return _merged(base, own) if isinstance(base, Mapping) else own

    return {**content, "services": {name: resolved(name, path, ()) for name in files[path]}}


def _services(content: object, path: Path, error: type[FileError]) -> Raw:
    """Return the table `services` of a compose file that another one extends."""
    if not isinstance(content, Mapping):
        raise error("type", path.name, f"expected a table, got {shown(content)}")
    if "services" not in content:
        raise error("missing", f"{path.name}.services", "is missing")
    if not isinstance(content["services"], Mapping):
        raise error("type", f"{path.name}: services", f"expected a table, got {shown(content['services'])}")
    return content["services"]


def _merged(base: Raw, own: Raw) -> dict[str, Any]:
    result = {**base, **own}
    for key in MERGED:
        if key in base and key in own:
            below, above = _as_map(key, base[key]), _as_map(key, own[key])
            if below is not None and above is not None:
                result[key] = {**below, **above}
    return result


def _as_map(key: str, value: Any) -> dict[str, Any] | None:
    """Return the map form of a list under `key`; None for a value that is neither list nor map."""
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
