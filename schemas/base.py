"""Base classes of everything on the wire.

Three kinds of model, one rule each about unknown fields (they differ because their readers differ):

* ``Message``: published. Unknown fields are ignored, so a newer publisher of the same major version can be read.
* ``Request``: asked of a queryable, or a command. Unknown fields are refused by name: a typo must not be obeyed.
* ``Reply``: answered by a queryable. Unknown fields are ignored, as in messages.

All are frozen and finite: JSON has no infinity or NaN, an absent number is ``null`` beside a status with the reason.
Numbers are numbers: ``true`` and ``"1"`` are refused where one is expected, in every model.
"""

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Self, cast

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, GetCoreSchemaHandler, ValidationInfo
from pydantic_core import CoreSchema, PydanticCustomError

MAX_JOINTS = 64
MAX_FEET = 8
UNIT_WITHIN = 0.01
"""Largest deviation of a quaternion's length from 1 at which it is accepted as a rotation; beyond it the message is
refused."""

Vec2 = tuple[float, float]
Vec3 = tuple[float, float, float]


def _unit(quat_wxyz: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    length = math.hypot(*quat_wxyz)
    if not abs(length - 1.0) <= UNIT_WITHIN:
        raise PydanticCustomError(
            "not_unit", "a quaternion of length {length}, allowed is 1 within {within}",
            {"length": f"{length:.3g}", "within": UNIT_WITHIN},
        )  # fmt: skip
    return quat_wxyz


QuatWxyz = Annotated[
    tuple[float, float, float, float],
    AfterValidator(_unit),
    Field(description="unit quaternion, order w x y z (MuJoCo's), rotates body to world"),
]
PerJoint = Annotated[tuple[float, ...], Field(max_length=MAX_JOINTS)]
PerFoot = Annotated[tuple[float, ...], Field(max_length=MAX_FEET)]


def _strict_numbers(schema: Any) -> Any:
    """Return a schema with every number strict: pydantic's ``strict`` setting would also refuse a list for a tuple."""
    if isinstance(schema, dict):
        known = cast("dict[str, Any]", schema)
        kept = {key: value if key == "metadata" else _strict_numbers(value) for key, value in known.items()}
        return {**kept, "strict": True} if known.get("type") in ("float", "int") else kept
    if isinstance(schema, list):
        return [_strict_numbers(part) for part in cast("list[Any]", schema)]
    return schema


class Strict(BaseModel):
    """Base of models whose number fields refuse booleans and text; the validator is built at its first use."""

    model_config = ConfigDict(defer_build=True)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: type[BaseModel], handler: GetCoreSchemaHandler, /) -> CoreSchema:
        """Return pydantic's schema with strict numbers; called by pydantic."""
        return _strict_numbers(handler(source))


class Wire(Strict):
    """Base of all models on the wire: it has a name and a version."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    schema_version: ClassVar[str] = "1.0"
    """Version of the model, major.minor: an addition raises minor, any other change raises major."""

    @classmethod
    def schema_name(cls) -> str:
        """Name and version of the model as in the Zenoh encoding, e.g. ``surefoot/Imu/1.0``."""
        return f"surefoot/{cls.__name__}/{cls.schema_version}"


class Header(Wire):
    """Header of every published message; the runtime fills it in."""

    stamp_ns: int = Field(default=0, description="simulated (or hardware) time of the SAMPLE, ns")
    tick: int = Field(default=0, ge=-1, description="control tick of the release of this message")
    epoch: int = Field(default=0, ge=0, description="rises by one at every reset or restore")
    seq: int = Field(default=0, ge=0, description="number of the message within its key and epoch: tick // period")
    source: str = Field(default="", description="name of the publishing service")


class Message(Header):
    """Base of published messages, which carry the fields of `Header`; a reader ignores unknown fields."""

    def stamped(self, stamp_ns: int, tick: int, epoch: int, seq: int, source: str) -> Self:
        """Return this message under a filled-in header.

        The object itself is changed although messages are frozen: nothing else refers to it yet, and a copy would
        cost more than the validation. ``relabelled`` returns a copy instead.
        """
        vars(self).update(stamp_ns=stamp_ns, tick=tick, epoch=epoch, seq=seq, source=source)
        return self

    def relabelled(self, stamp_ns: int, tick: int, epoch: int, seq: int, source: str) -> Self:
        """Return a copy under another header, for messages that are kept and published again."""
        return self.model_copy().stamped(stamp_ns, tick, epoch, seq, source)


class Bulk(Message):
    """A message whose numbers travel as raw bytes: payload = ``data``, the other fields are the attachment's JSON."""

    data: bytes = Field(default=b"", exclude=True, repr=False, description="raw little-endian array")

    def data_bytes(self) -> int:
        """Return the length of ``data`` that the other fields state, bytes."""
        raise NotImplementedError


class Request(Wire):
    """Base of requests and commands: unknown fields are refused."""

    model_config = ConfigDict(extra="forbid")


def belonging(value: Any, info: ValidationInfo, choice: str, fields: Mapping[str, tuple[str, ...]]) -> Any:
    """Refuse a field that is given and does not go with the choice of another field; for ``field_validator``.

    Args:
        value: received value of the field; an explicit null counts as an absent field.
        info: pydantic's data on the validation, with the values of the fields before this one.
        choice: name of the field that chooses; it stands before those that depend on it.
        fields: by choice, the fields that go with it.
    """
    chosen = str(info.data.get(choice))
    if value is None or chosen not in fields or info.field_name in fields[chosen]:
        return value
    takers = " or ".join(repr(taker) for taker, names in fields.items() if info.field_name in names)
    takes = f", which takes {', '.join(fields[chosen])}" if fields[chosen] else ""
    raise PydanticCustomError(
        "does_not_belong",
        "goes with {choice} {takers} only, not with {chosen}{takes}",
        {"choice": choice, "takers": takers, "chosen": repr(chosen), "takes": takes},
    )


class BulkRequest(Request):
    """Base of requests that may carry raw bytes: then payload = ``data``, attachment = JSON; else JSON alone."""

    data: bytes = Field(default=b"", exclude=True, repr=False, description="raw little-endian array")


class TickRequest(Request):
    """A request whose answer depends on live state: the server answers once it has consumed ``tick`` of ``epoch``."""

    epoch: int | None = Field(default=None, ge=0, description="epoch of the asker; null = whatever runs")
    tick: int | None = Field(default=None, ge=0, description="tick the answer must have seen; null = the latest")


class Reply(Wire):
    """Base of replies of queryables: unknown fields are ignored."""


class ErrorReply(Reply):
    """Refusal of a request by a queryable, sent as a Zenoh error reply."""

    code: str = Field(description="short machine-readable reason, e.g. bad_request, not_ready, refused")
    message: str = Field(description="one sentence with the received value and the allowed ones")
    field: str | None = Field(default=None, description="path of the offending field, dots between levels")
