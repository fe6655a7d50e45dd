"""Fields of a message or request in readable form (type, default, limits, meaning), and an example request."""

import json
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

_LIMITS = {
    "minimum": ">= {}",
    "exclusiveMinimum": "> {}",
    "maximum": "<= {}",
    "exclusiveMaximum": "< {}",
    "minLength": "at least {} characters",
    "maxLength": "at most {} characters",
    "pattern": "like {}",
}

_FEET = [
    {"position": [x, y, 0.0], "normal": [0.0, 0.0, 1.0], "mu": 0.5} for x, y in ((0.1, 0.1), (0.1, -0.1), (-0.1, 0.0))
]
_EXAMPLES: dict[str, dict[str, Any]] = {
    "WalkCommand": {"action": "walk", "distance": 0.5},
    "SelectRequest": {
        "base": {"position": [0.0, 0.0, 0.1]},
        "legs": [{"leg": "lf", "nominal": [0.17, 0.11, 0.0], "stroke": [-0.05, 0.0, 0.0]}],
    },
    "RegionRequest": {"contacts": _FEET, "directions": 16},
    "CheckRequest": {"contacts": _FEET, "com": [0.02, 0.0], "movement": [0.05, 0.0, 0.0]},
    "ComRequest": {"joints": [0.0] * 18, "robot": "ragno"},
    "WhatifRequest": {"contacts": _FEET, "com": [0.02, 0.0]},
    "EquilibriumRequest": {"contacts": _FEET, "com": [0.02, 0.0]},
    "BatchRequest": {"sets": [{"contacts": _FEET, "com": [0.02, 0.0]}]},
    "CalibrateRequest": {"action": "status"},
    "ConfigureRequest": {"values": {"mu": "0.5"}},
}
"""Example field values by request model, for requests whose fields must be consistent with each other or the robot."""


def describe(model: type[BaseModel]) -> dict[str, list[dict[str, str]]]:
    """Return rows (name, type, default, limits, meaning), one per field, by name of the model or inner model."""
    schema = model.model_json_schema()
    inner = {name: found for name, found in schema.get("$defs", {}).items() if "properties" in found}
    return {name: list(_rows(found)) for name, found in {model.__name__: schema, **inner}.items()}


def example(model: type[BaseModel]) -> dict[str, Any]:
    """Return an example of a request as JSON values: one that the robot Ragno's services accept, else typed fillers."""
    if model.__name__ in _EXAMPLES:
        return _EXAMPLES[model.__name__]
    schema = model.model_json_schema()
    return _object(schema, schema.get("$defs", {}))


def _rows(schema: dict[str, Any]) -> Iterator[dict[str, str]]:
    required = schema.get("required", ())
    for name, field in schema.get("properties", {}).items():
        yield {
            "field": name,
            "type": _type(field),
            "default": "required" if name in required else json.dumps(field.get("default")),
            "limits": ", ".join(_limits(field)),
            "what it is": field.get("description", ""),
        }


def _type(field: dict[str, Any]) -> str:
    if "$ref" in field:
        return str(field["$ref"]).rpartition("/")[2]
    if "const" in field or "enum" in field:
        return " | ".join(json.dumps(value) for value in field.get("enum", [field.get("const")]))
    if "anyOf" in field or "oneOf" in field:
        return " | ".join(dict.fromkeys(_type(part) for part in field.get("anyOf") or field["oneOf"]))
    if "prefixItems" in field:
        return f"[{', '.join(_type(part) for part in field['prefixItems'])}]"
    if field.get("type") == "array":
        return f"list of {_type(field.get('items', {}))}"
    return str(field.get("type", "any"))


def _limits(field: dict[str, Any]) -> Iterator[str]:
    for name, words in _LIMITS.items():
        if name in field:
            yield words.format(field[name])
    if "prefixItems" not in field and ("minItems" in field or "maxItems" in field):
        yield f"{field.get('minItems', 0)} to {field.get('maxItems', 'any number of')} entries"
    for part in field.get("anyOf", ()):
        yield from _limits(part)


def _object(schema: dict[str, Any], inner: dict[str, Any]) -> dict[str, Any]:
    required = schema.get("required", ())
    return {name: _value(field, inner) for name, field in schema.get("properties", {}).items() if name in required}


def _value(field: dict[str, Any], inner: dict[str, Any]) -> Any:
    if "$ref" in field:
        found = inner[field["$ref"].rpartition("/")[2]]
        return _object(found, inner) if "properties" in found else _value(found, inner)
    for choice in ("enum", "anyOf", "oneOf"):
        if choice in field:
            return field["enum"][0] if choice == "enum" else _value(field[choice][0], inner)
    if "const" in field:
        return field["const"]
    if "prefixItems" in field:  # a vector: its last axis, for a normal must not be zero; a quaternion: no rotation
        values = [_value(part, inner) for part in field["prefixItems"]]
        return [1.0, 0.0, 0.0, 0.0] if values == [0.5] * 4 else [0.0, 0.0, 1.0] if values == [0.5] * 3 else values
    match field.get("type"):
        case "array":
            return [_value(field.get("items", {}), inner)] * max(1, field.get("minItems", 0))
        case "integer":
            return field.get("minimum", 1)
        case "number":
            return min(0.5, field.get("maximum", 0.5))
        case "boolean":
            return True
        case "string":
            return "name"
        case _:
            return None
