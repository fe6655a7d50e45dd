"""Versions of the wire: the published schemas stand, and old and new readers understand old and new messages."""

import json
from typing import Any

import pytest
from pydantic import create_model

from surefoot.bus.codec import decode, encoding_of
from surefoot.errors import Refusal
from surefoot.schemas.base import Bulk, Header, Message, Reply, Request, Wire
from surefoot.schemas.cmd import WalkCommand
from surefoot.schemas.hw import JointCommand
from tests.contract.published import MODELS, breaks, complaints, load, number, shape

PUBLISHED = load()
STRICT = (Request, JointCommand)
"""Requests and commands: an unknown field is refused, whatever its version."""

STRAYS: dict[type[Wire], tuple[str, ...]] = {WalkCommand: ("shift",)}
"""Fields that do not go with the first action, which `sample` takes."""


def sample(node: dict[str, Any], top: dict[str, Any]) -> Any:
    """A value that a schema allows, with every field."""
    if "$ref" in node:
        name = node["$ref"].rsplit("/", 1)[1]
        value = sample(top["$defs"][name], top)
        strays = {model.__name__: fields for model, fields in STRAYS.items()}.get(name, ())
        return {key: part for key, part in value.items() if key not in strays} if strays else value
    if "anyOf" in node:
        return sample(next(kind for kind in node["anyOf"] if kind.get("type") != "null"), top)
    if "const" in node or "enum" in node:
        return node.get("const", node.get("enum", [None])[0])
    match node.get("type"):
        case "object":
            return {name: sample(field, top) for name, field in node.get("properties", {}).items() if name != "data"}
        case "array" if "prefixItems" in node:
            values = [sample(item, top) for item in node["prefixItems"]]
            return [1, 0, 0, 0] if len(values) == 4 else values  # a quaternion
        case "array":
            return [sample(node.get("items", {}), top) for _ in range(max(1, node.get("minItems", 0)))]
        case "string":
            return "x" * max(1, node.get("minLength", 0))
        case "boolean":
            return True
        case "integer" | "number":
            low = node.get("minimum", node.get("exclusiveMinimum", 0))
            return low + 1 if "exclusiveMinimum" in node and node.get("maximum", 2) >= low + 1 else low or 0
    return 0


def wire(model: type[Wire], **more: Any) -> tuple[bytes, bytes | None]:
    """Payload and attachment of a message of a model, with further fields."""
    schema = model.model_json_schema(mode="validation")
    fields = {name: value for name, value in sample(schema, schema).items() if name not in STRAYS.get(model, ())}
    text = json.dumps({**fields, **more}).encode()
    return (bytes(model.model_validate_json(text).data_bytes()), text) if issubclass(model, Bulk) else (text, None)


def named(model: type[Wire], minor: int) -> str:
    """The encoding of another minor version."""
    head, _, version = encoding_of(model).rpartition("/")
    return f"{head}/{version.split('.')[0]}.{minor}"


@pytest.mark.parametrize("name", MODELS)
def test_published_schema_stands(name: str) -> None:
    model = MODELS[name]
    how = "run `python -m tests.contract.published` and commit the file"
    assert f"{name}/{model.schema_version}" in PUBLISHED, f"{name} {model.schema_version} is not published: {how}"
    assert complaints(name, model.schema_version, shape(model), issubclass(model, Request), PUBLISHED) == []


@pytest.mark.parametrize("name", [name for name, model in MODELS.items() if not issubclass(model, STRICT)])
def test_old_reader_understands_a_newer_minor_message(name: str) -> None:
    model = MODELS[name]
    payload, attachment = wire(model)
    newer, newer_attachment = wire(model, something_new={"deep": [1, 2]})
    assert decode(model, newer, newer_attachment, named(model, 99)) == decode(model, payload, attachment)


@pytest.mark.parametrize("name", MODELS)
def test_new_reader_understands_an_older_minor_message(name: str) -> None:
    model = MODELS[name]
    newer = create_model(name, __base__=model, something_new=(int, 7))
    major, minor = number(model.schema_version)
    newer.schema_version = f"{major}.{minor + 1}"
    payload, attachment = wire(model)
    read = decode(newer, payload, attachment, named(model, 0))
    assert read.model_dump(exclude={"something_new"}) == decode(model, payload, attachment).model_dump()
    assert vars(read)["something_new"] == 7
    assert breaks(shape(model), shape(newer), issubclass(model, Request)) == []


@pytest.mark.parametrize("name", [name for name, model in MODELS.items() if issubclass(model, STRICT)])
def test_what_is_asked_is_never_half_understood(name: str) -> None:
    model = MODELS[name]
    payload, _ = wire(model)
    decode(model, payload, None, named(model, 99))  # a newer asker that uses nothing new
    with pytest.raises(Refusal) as caught:
        decode(model, wire(model, something_new=1)[0], None, named(model, 99))
    assert caught.value.field == "something_new"


@pytest.mark.parametrize("name", MODELS)
def test_another_major_version_is_refused_both_ways(name: str) -> None:
    model = MODELS[name]
    payload, attachment = wire(model)
    major, _ = number(model.schema_version)
    for version in (f"{major - 1}.9", f"{major + 1}.0"):
        with pytest.raises(Refusal) as caught:
            decode(model, payload, attachment, encoding_of(model).rpartition("/")[0] + f"/{version}")
        assert caught.value.code == "schema"


OLD: dict[str, Any] = {
    "type": "object",
    "required": ["a"],
    "properties": {"a": {"type": "number"}, "b": {"enum": ["x", "y"], "default": "x"}},
}


@pytest.mark.parametrize(
    ("change", "message", "request_"),
    [
        ({"properties": {**OLD["properties"], "c": {"type": "number", "default": 0}}}, True, True),
        ({"properties": {**OLD["properties"], "c": {"type": "number"}}, "required": ["a", "c"]}, False, False),
        ({"properties": {"a": {"type": "number"}}}, False, False),
        ({"properties": {**OLD["properties"], "a": {"type": "integer"}}}, False, False),
        ({"properties": {**OLD["properties"], "a": {"type": "number", "maximum": 1}}}, False, False),
        ({"properties": {**OLD["properties"], "b": {"enum": ["x", "y", "z"], "default": "x"}}}, False, True),
        ({"properties": {**OLD["properties"], "b": {"enum": ["x"], "default": "x"}}}, False, False),
        ({"properties": {**OLD["properties"], "b": {"enum": ["x", "y"], "default": "y"}}}, False, False),
        ({"required": []}, False, True),
    ],
    ids=["new", "new required", "gone", "type", "limit", "more values", "fewer values", "default", "less required"],
)
def test_the_rule_of_minor_versions(change: dict[str, Any], message: bool, request_: bool) -> None:
    new = {**OLD, **change}
    assert (breaks(OLD, new, False) == []) is message
    assert (breaks(OLD, new, True) == []) is request_


def test_the_rule_of_equal_and_older_versions() -> None:
    published = {"Thing/1.1": OLD, "Thing/2.0": {"type": "object"}}
    assert complaints("Thing", "1.1", OLD, False, published) == []
    assert complaints("Thing", "1.1", {**OLD, "required": []}, False, published)
    assert complaints("Thing", "1.0", OLD, False, published)
    assert complaints("Thing", "3.0", {}, False, published) == []
    assert complaints("Other", "1.0", {}, False, published) == []


def test_every_kind_of_model_is_here() -> None:
    for kind in (Header, Message, Request, Reply, Bulk):
        assert any(issubclass(model, kind) for model in MODELS.values())
