"""The published JSON Schemas, and what may change: ``python -m tests.contract.published`` writes those of new versions.

Same version = same schema (descriptions aside). A newer minor version may add fields that need not be given, and may
accept more values in requests. Everything else is another major version.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from surefoot.schemas.base import ErrorReply, Header, Request, Wire
from surefoot.schemas.topics import QUERIES, TOPICS

FILE = Path(__file__).with_name("published_schemas.json")
WORDS = ("title", "description", "$id", "$schema")

MODELS: dict[str, type[Wire]] = {
    model.__name__: model
    for model in sorted(
        {Header, ErrorReply, *(t.model for t in TOPICS), *(q.request for q in QUERIES), *(q.reply for q in QUERIES)},
        key=lambda model: model.__name__,
    )
}


def shape(model: type[Wire]) -> dict[str, Any]:
    """Demands of a reader, without descriptions."""
    return strip(model.model_json_schema(mode="validation"))


def strip(node: Any, names: bool = False) -> Any:
    """A schema without its words; ``names`` = the keys of this object are field names."""
    if isinstance(node, dict):
        return {
            key: strip(value, key in ("properties", "$defs"))
            for key, value in node.items()
            if names or key not in WORDS
        }
    return [strip(item) for item in node] if isinstance(node, list) else node


def load() -> dict[str, dict[str, Any]]:
    """Published shapes by name and version, e.g. ``Imu/1.0``."""
    return json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}


def number(version: str) -> tuple[int, int]:
    major, minor = version.split(".")
    return int(major), int(minor)


def breaks(old: Any, new: Any, asked: bool, where: str = "") -> list[str]:
    """Part of ``new`` that is more than an addition that need not be given.

    Args:
        old: published shape.
        new: shape of a newer minor version.
        asked: of a request: the server reads, so it may accept more.
        where: path, for the complaints.
    """
    if not isinstance(old, dict) or not isinstance(new, dict):
        return [] if old == new else [f"{where}: {old!r} became {new!r}"]
    found: list[str] = []
    for field in set(new.get("required", ())) - set(old.get("required", ())):
        found.append(f"{where}.{field} must be given now")
    if not asked:
        for field in set(old.get("required", ())) - set(new.get("required", ())):
            found.append(f"{where}.{field} may be missing now")
    for group in ("properties", "$defs"):
        for name in old.get(group, {}).keys() - new.get(group, {}).keys():
            found.append(f"{where}.{name} is gone")
        for name in old.get(group, {}).keys() & new.get(group, {}).keys():
            found += breaks(old[group][name], new[group][name], asked, f"{where}.{name}")
    for key in (old.keys() | new.keys()) - {"required", "properties", "$defs"}:
        if asked and key == "enum" and set(old.get(key, ())) <= set(new.get(key, ())):
            continue
        found += breaks(old.get(key), new.get(key), asked, f"{where}.{key}")
    return found


def complaints(name: str, version: str, new: dict[str, Any], asked: bool, published: dict[str, Any]) -> list[str]:
    """Why a schema must not carry this version."""
    found: list[str] = []
    for key, old in published.items():
        known, _, at = key.partition("/")
        if known != name or number(at)[0] != number(version)[0]:
            continue
        if at == version and old != new:
            found.append(f"{name} {version} differs from what is published: raise the version")
        elif number(at) < number(version):
            found += [
                f"{name} {at} -> {version}: {reason}; raise the major version" for reason in breaks(old, new, asked)
            ]
        elif number(at) > number(version):
            found.append(f"{name} {version} is older than the published {at}")
    return found


def main() -> int:
    """Adds the schemas of new versions to the file."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--unreleased", action="store_true", help="overwrite versions that nobody has used yet")
    replace = parser.parse_args().unreleased
    published = load()
    for name, model in MODELS.items():
        key = f"{name}/{model.schema_version}"
        found = (
            []
            if replace
            else complaints(name, model.schema_version, shape(model), issubclass(model, Request), published)
        )
        if found:
            sys.stderr.write("\n".join(found) + "\n")
            return 1
        published[key] = shape(model)
    lines = (f"{json.dumps(key)}: {json.dumps(published[key], sort_keys=True)}" for key in sorted(published))
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
