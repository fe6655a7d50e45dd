"""Wire format of messages: JSON, with schema and version in the Zenoh encoding; large arrays raw, header attached."""

from functools import cache
from typing import Any, TypeVar

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from surefoot.bus.sizes import MAX_BULK_BYTES, MAX_JSON_BYTES
from surefoot.errors import Refusal
from surefoot.schemas.base import Bulk, BulkRequest, Header, Message, Wire

W = TypeVar("W", bound=Wire)

_JSON = "application/json"
_OCTETS = "application/octet-stream"


@cache
def encoding_of(model: type[Wire]) -> str:
    """Return the Zenoh encoding of a model, e.g. ``application/json;surefoot/Imu/1.0``.

    The first call builds the model's validator, which would else be built with its first message.
    """
    model.model_rebuild()
    return f"{_OCTETS if issubclass(model, Bulk) else _JSON};{model.schema_name()}"


@cache
def _plain(model: type[Wire]) -> bool:
    """Return whether a model carries no raw bytes; the result is cached, as the test is slow for a small message."""
    return not issubclass(model, (Bulk, BulkRequest))


def encode(message: Wire) -> tuple[bytes, bytes | None]:
    """Return payload and attachment of a message; the attachment is the JSON part of a bulk message, else None."""
    text = message.__pydantic_serializer__.to_json(message)
    if _plain(type(message)):
        return text, None
    if isinstance(message, Bulk) or (isinstance(message, BulkRequest) and message.data):
        return message.data, text
    return text, None


def decode(model: type[W], payload: bytes, attachment: bytes | None = None, encoding: str = "") -> W:
    """Return the message decoded from a payload and its attachment.

    Raises:
        Refusal: too_large, schema (another named schema or major version), malformed, or invalid (names the field).
    """
    if encoding:
        check_encoding(model, encoding)
    if _plain(model):
        return validate_json(model, payload)
    if issubclass(model, Bulk) or (attachment is not None and issubclass(model, BulkRequest)):
        check_size(len(payload), bulk=True)
        head = validate_json(model, attachment or b"{}")
        if isinstance(head, Bulk) and len(payload) != head.data_bytes():
            text = f"{model.__name__}: payload of {len(payload)} bytes; its header states {head.data_bytes()}"
            raise Refusal("malformed", text, "data")
        return head.model_copy(update={"data": payload})
    return validate_json(model, payload)


def check_size(size: int, *, bulk: bool) -> None:
    """Raise Refusal (too_large) if a payload of `size` bytes is larger than any legal one; `bulk`: with an array."""
    most = MAX_BULK_BYTES if bulk else MAX_JSON_BYTES
    if size > most:
        raise Refusal("too_large", f"payload of {size} bytes; at most {most} are accepted")


def validate_json(model: type[W], payload: bytes) -> W:
    """Return the message decoded from a JSON text.

    Raises:
        Refusal: too_large, malformed, or invalid (names the field).
    """
    check_size(len(payload), bulk=False)
    try:
        return model.__pydantic_validator__.validate_json(payload)
    except ValidationError as error:
        raise refusal_of(error, model.__name__) from None


def refusal_of(error: ValidationError, what: str) -> Refusal:
    """Return the first error of a pydantic validation as a Refusal that names the field and the received value."""
    first = first_complaint(error)
    field = ".".join(_shown(str(part)) for part in first["loc"]) or None
    if first["type"] == "json_invalid":
        return Refusal("malformed", f"{what}: {first['msg']}", field)
    got = repr(first.get("input"))
    got = got if len(got) <= 120 else got[:117] + "..."
    return Refusal("invalid", f"{what}{'.' + field if field else ''}: {first['msg']} (got {got})", field)


def _shown(name: str) -> str:
    """Return the name of a field that a sender chose, shortened and on one line, for an error message."""
    name = name if name.isprintable() else repr(name)[1:-1]
    return name if len(name) <= 60 else name[:57] + "..."


def first_complaint(error: ValidationError) -> ErrorDetails:
    """Return the first error of a pydantic validation; its path ``loc`` lacks pydantic's names of union members.

    Of several errors about one union (a number or a list of directions) it is the one with the longest path: the
    sender of a list gets the error of its third row, not that it is no number.
    """
    found = [(_sent(one), one) for one in error.errors(include_url=False, include_context=False)]
    loc, first = found[0]
    if len(loc) < len(first["loc"]):
        same = [(where, one) for where, one in found if where[: len(loc)] == loc]
        loc, first = max(same, key=lambda f: (len(f[0]), not f[1]["type"].endswith("_type")))
    return {**first, "loc": loc}


def _sent(complaint: ErrorDetails) -> tuple[int | str, ...]:
    """Return the path of an invalid field as it was sent, without pydantic's names of union members."""
    loc = complaint["loc"]
    last = len(loc) - 1 if complaint["type"] == "extra_forbidden" else len(loc)
    return tuple(part for i, part in enumerate(loc) if i >= last or isinstance(part, int) or part.isidentifier())


def check_encoding(model: type[Wire], encoding: str) -> None:
    """Raise a Refusal if an encoding names another schema or major version than the model's; accept unnamed ones."""
    _, _, schema = encoding.partition(";")
    owner, _, rest = schema.partition("/")
    if owner != "surefoot":
        return
    name, _, version = rest.partition("/")
    if name != model.__name__:
        raise Refusal("schema", f"got a {name!r}, expected {model.__name__!r}")
    if version.split(".")[0] != model.schema_version.split(".")[0]:
        raise Refusal(
            "schema", f"{name} version {version!r} has another major number than ours, {model.schema_version!r}"
        )


def read_header(payload: bytes, attachment: bytes | None) -> Header:
    """Return only the header of an encoded message, for a process that forwards messages without decoding them."""
    return validate_json(Header, attachment or payload)


def json_schema(model: type[Wire]) -> dict[str, Any]:
    """Return the JSON Schema of a model as published by ``surefoot schema export``."""
    schema = model.model_json_schema(mode="serialization" if issubclass(model, Message) else "validation")
    schema["$id"] = model.schema_name()
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    return schema
