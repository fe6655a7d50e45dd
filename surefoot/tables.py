"""Validation of hand-written files by pydantic models; errors name code, path of the field and allowed values."""

import re
import reprlib
import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar, cast

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from surefoot.errors import FieldError, printable
from surefoot.nearest import did_you_mean, nearest

UNIT_SLACK = 1e-6
"""Largest deviation from 1 of the length of a unit vector in a file; a larger one is refused."""

Text = Annotated[str, Field(strict=True, min_length=1)]
Name = Annotated[str, Field(strict=True, pattern="^[a-z][a-z0-9_]*$")]
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Whole = Annotated[int, Field(strict=True)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]

CODES = ("missing", "type", "value", "unknown_key", "unknown_name", "duplicate")
"""Codes of fields that are refused in a hand-written file; validators raise errors of these types by `refused`."""
_UNKNOWN = ("extra_forbidden", "invalid_key", "unexpected_keyword_argument")
_LENGTHS = ("too_short", "too_long", "string_too_short")

_SHORT = reprlib.Repr()
_SHORT.maxlevel = 2
_SHORT.maxstring = _SHORT.maxother = 120
shown = _SHORT.repr
"""Return a shortened text of a received value, for an error message; a few lines of YAML with aliases can stand for
gigabytes."""

M = TypeVar("M")


class TableError(FieldError):
    """Error of a field that cannot be used, such as `chains.leg.links[1].mass`.

    Its code is one of `CODES`, `syntax` or `not_found`.
    """

    def in_file(self, path: Path) -> Self:
        """Return the error with the file before the field in its text; `message` and `field` stay as they are."""
        self.args = (printable(f"{path}: {self}"),)
        return self


class FileModel(BaseModel):
    """A table of a hand-written file: unknown keys are refused, a value has exactly the stated type."""

    model_config = ConfigDict(
        strict=True, extra="forbid", frozen=True, allow_inf_nan=False, validate_by_name=True, defer_build=True
    )


def refused(code: str, message: str, field: str = "") -> PydanticCustomError:
    """Build the error that a pydantic validator raises to refuse a value.

    Args:
        code: one of `CODES`.
        message: text of the error.
        field: path of the field, relative to the validated value; empty for the value itself.
    """
    return PydanticCustomError(code, "{message}", {"message": message, "field": field})  # pyright: ignore[reportArgumentType] - any text is a type


def validated(model: type[M], data: object, error: type[TableError] = TableError, path: str = "") -> M:
    """Return the content of a file, validated, as an instance of `model`.

    Args:
        model: pydantic model or pydantic dataclass.
        data: content as read from the file.
        error: raised for the first field that cannot be used.
        path: path of the content within the file, for the error; empty for the whole file.
    """
    try:
        return _adapter(model).validate_python(data, by_alias=True, by_name=False)
    except ValidationError as exc:
        raise table_error(exc, model, error, path) from None


def table_error(exc: ValidationError, model: Any, error: type[TableError], path: str = "") -> TableError:
    """Return the first error of a pydantic validation of `model` as an `error` with code, field and message."""
    first, *others = exc.errors(include_url=False)
    loc, context = first["loc"], first.get("ctx", {})
    code = _code(first)
    if loc[-1:] == ("[key]",):
        code, loc = "value", loc[:-2]
    for part in (*loc, *filter(None, [context.get("field")])):
        path += f"[{part}]" if isinstance(part, int) else f".{part}"
    text = _sentence(code, first, model)
    if code == "missing":  # a misspelled key is two errors: the right one is missing, the wrong one unknown
        beside = [str(e["loc"][-1]) for e in others if e["type"] in _UNKNOWN and e["loc"][:-1] == first["loc"][:-1]]
        text += f"; {near!r} is not known here" if (near := nearest(str(first["loc"][-1]), beside)) else ""
    return error(code, path.removeprefix(".") or "file", text)


def read_toml(path: Path, error: type[TableError] = TableError) -> dict[str, object]:
    """Return the content of a TOML file (raises `error` with code `syntax` when it is not TOML)."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as err:
        raise error("syntax", path.name, f"is not valid TOML: {err}") from err


def unknown_key(key: object, known: Sequence[str]) -> str:
    """Return the error message on an unknown key, with the most similar known key and all known ones."""
    return f"is not known here{did_you_mean(str(key), known)}; known are {', '.join(sorted(known))}"


def as_table(value: object) -> Mapping[str, Any]:
    """Return the value if it is a table, else an empty table."""
    return cast("Mapping[str, Any]", value) if isinstance(value, Mapping) else {}


@cache
def _adapter(model: type[M]) -> TypeAdapter[M]:
    return TypeAdapter(model)


def _code(first: ErrorDetails) -> str:
    kind, value = first["type"], first["input"]
    if kind in CODES:
        return kind
    if kind in _UNKNOWN:
        return "unknown_key"
    empty = kind == "literal_error" and not (isinstance(value, str) and value)
    return "type" if empty or kind in _LENGTHS or kind.endswith("_type") else "value"


def _sentence(code: str, first: ErrorDetails, model: Any) -> str:
    context = first.get("ctx", {})
    if first["type"] in _UNKNOWN:
        return unknown_key(first["loc"][-1], known_keys(model, first["loc"][:-1]))
    if "field" in context:
        return context["message"]
    if code == "missing":
        return "is missing"
    got = f"got {shown(first['input'])}"
    if first["type"] == "literal_error":
        allowed = re.findall(r"'([^']*)'", context["expected"])
        return f"{got}{did_you_mean(str(first['input'])[:80], allowed)}, allowed are {', '.join(allowed)}"
    return f"{got}; {first['msg'][0].lower()}{first['msg'][1:]}"


def known_keys(model: Any, loc: Sequence[object]) -> list[str]:
    """Return the keys that the table at the path `loc` of a model may have, from the model's JSON Schema."""
    schema: Any = _adapter(model).json_schema()
    nodes: list[Any] = [schema]
    for part in (*loc, None):
        for node in nodes:  # grows by what the nodes refer to
            nodes += [schema["$defs"][name.rpartition("/")[2]] for name in [node.get("$ref")] if name]
            nodes += [*node.get("anyOf", ()), *node.get("oneOf", ()), *node.get("allOf", ())]
        if part is not None:
            inner = [node.get(name) for node in nodes for name in ("items", "additionalProperties")]
            inner += [node.get("properties", {}).get(part) for node in nodes]
            inner += [value for node in nodes for value in node.get("patternProperties", {}).values()]
            nodes = [node for node in inner if hasattr(node, "get")]
    return list(dict.fromkeys(key for node in nodes for key in node.get("properties", ())))
