"""Rules of the wire that hold for every model and every row, none of them listed by hand."""

import json
import math
from typing import Any, get_args

import jsonschema
import pytest
from pydantic import TypeAdapter, ValidationError

from surefoot.bus.codec import MAX_BULK_BYTES, check_encoding, decode, encode, encoding_of, json_schema
from surefoot.errors import Refusal
from surefoot.schemas import base
from surefoot.schemas.calibration import FIELDS as CALIBRATE_FIELDS
from surefoot.schemas.calibration import CalibrateRequest
from surefoot.schemas.cmd import FIELDS as WALK_FIELDS
from surefoot.schemas.cmd import WalkCommand
from surefoot.schemas.hw import Imu, JointCommand
from surefoot.schemas.sim import FaultRequest, PushRequest, ResetRequest
from surefoot.schemas.stability import RegionRequest
from surefoot.schemas.terrain import HeightMapMessage
from surefoot.schemas.topics import QUERIES, TOPICS, Kind, Query, Topic
from tests.surefoot.expect import expect_error

MODELS: list[type[base.Wire]] = sorted(
    {t.model for t in TOPICS} | {q.request for q in QUERIES} | {q.reply for q in QUERIES}, key=lambda m: m.__name__
)


@pytest.mark.parametrize("model", MODELS, ids=lambda m: m.__name__)
def test_every_field_is_described(model: type[base.Wire]) -> None:
    for name, field in model.model_fields.items():
        described = field.description or any(getattr(m, "description", None) for m in field.metadata)
        assert described, f"{model.__name__}.{name} has no description (unit and frame)"


@pytest.mark.parametrize("model", MODELS, ids=lambda m: m.__name__)
def test_models_are_frozen_finite_and_have_a_valid_schema(model: type[base.Wire]) -> None:
    assert model.model_config.get("frozen") is True
    assert model.model_config.get("allow_inf_nan") is False
    schema = json_schema(model)
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["$id"] == model.schema_name()


@pytest.mark.parametrize("model", MODELS, ids=lambda m: m.__name__)
def test_unknown_fields(model: type[base.Wire]) -> None:
    extra = model.model_config.get("extra")
    if issubclass(model, base.Request) or model is JointCommand:
        assert extra == "forbid"
    elif issubclass(model, base.Message | base.Reply):
        assert extra == "ignore"


@pytest.mark.parametrize("topic", TOPICS, ids=lambda t: t.key)
def test_rows_are_consistent(topic: Topic[Any]) -> None:
    assert topic.key == topic.key.lower()
    assert all(part == "*" or part.replace("_", "").isalnum() for part in topic.key.split("/"))
    if topic.kind is Kind.SAMPLE:
        assert topic.period_ns > 0
        assert topic.period_ticks == 0
    if topic.kind is Kind.STATUS:
        assert not topic.deterministic


def test_keys_are_unique() -> None:
    assert len({t.key for t in TOPICS}) == len(TOPICS)
    assert len({q.key for q in QUERIES}) == len(QUERIES)


IMU = Imu(acc=(0.1, -1 / 3, 9.81), gyro=(1e-17, 0.0, -5.5), stamp_ns=123, tick=4, epoch=1, seq=4, source="driver")


def test_round_trip_is_exact() -> None:
    assert decode(Imu, *encode(IMU), encoding_of(Imu)) == IMU


def test_newer_minor_version_is_read_and_unknown_fields_of_messages_ignored() -> None:
    payload = encode(IMU)[0][:-1] + b',"temperature":21.5}'
    assert decode(Imu, payload, None, "application/json;surefoot/Imu/1.7") == IMU


@pytest.mark.parametrize("encoding", ["application/json;surefoot/Imu/2.0", "application/json;surefoot/JointState/1.0"])
def test_another_named_schema_or_major_version_is_refused(encoding: str) -> None:
    with expect_error(Refusal, "schema"):
        decode(Imu, encode(IMU)[0], None, encoding)


@pytest.mark.parametrize(
    "encoding", ["", "application/json", "zenoh/bytes", "text/plain", "application/json;other/Thing"]
)
def test_absent_or_generic_encoding_means_the_current_schema(encoding: str) -> None:
    check_encoding(Imu, encoding)
    assert decode(Imu, encode(IMU)[0], None, encoding) == IMU


@pytest.mark.parametrize(
    ("payload", "code", "field"),
    [
        (b"{", "malformed", None),
        (b"\xff\xfe", "malformed", None),
        (b'{"acc":[0,0,NaN],"gyro":[0,0,0]}', "invalid", "acc.2"),
        (b'{"acc":[0,0,1e999],"gyro":[0,0,0]}', "invalid", "acc.2"),
        (b'{"acc":[0,0],"gyro":[0,0,0]}', "invalid", "acc"),
        (b'{"gyro":[0,0,0]}', "invalid", "acc"),
        (b'{"acc":' + b"9" * 10_000_000 + b"}", "too_large", None),
    ],
)
def test_bad_payloads_are_named_refusals(payload: bytes, code: str, field: str | None) -> None:
    with expect_error(Refusal, code) as caught:
        decode(Imu, payload)
    if field is not None:
        assert caught.value.field is not None
        assert caught.value.field.startswith(field.split(".")[0])


@pytest.mark.parametrize(("field", "least"), [("tick", -1), ("epoch", 0), ("seq", 0)])
def test_numbers_of_a_header_have_a_least_value(field: str, least: int) -> None:
    head = '{"acc":[0,0,9.81],"gyro":[0,0,0],"%s":%d}'
    assert getattr(decode(Imu, (head % (field, least)).encode()), field) == least
    with expect_error(Refusal, "invalid", field):
        decode(Imu, (head % (field, least - 1)).encode())


@pytest.mark.parametrize("field", ["tick", "epoch"])
def test_a_request_about_a_tick_names_one_that_can_be(field: str) -> None:
    with expect_error(Refusal, "invalid", field):
        decode(base.TickRequest, b'{"%s":-1}' % field.encode())


def test_lists_of_joints_and_feet_are_bounded() -> None:
    assert len(JointCommand(position=(0.0,) * base.MAX_JOINTS).position) == base.MAX_JOINTS
    with expect_error(Refusal, "invalid", "position"):
        decode(JointCommand, json.dumps({"position": [0.0] * (base.MAX_JOINTS + 1)}).encode())
    bounds = TypeAdapter(base.PerFoot)
    assert len(bounds.validate_python([0.0] * base.MAX_FEET)) == base.MAX_FEET
    with pytest.raises(ValidationError):
        bounds.validate_python([0.0] * (base.MAX_FEET + 1))


def test_infinity_cannot_be_built_either() -> None:
    with pytest.raises(ValidationError):
        Imu(acc=(math.inf, 0.0, 0.0), gyro=(0.0, 0.0, 0.0))


def test_models_hold_no_query_without_request_and_reply() -> None:
    for query in QUERIES:
        assert isinstance(query, Query)
        assert issubclass(query.request, base.Request)
        assert issubclass(query.reply, base.Wire)


def _numbers(schema: Any, path: str = "") -> list[str]:
    """Where a validation schema takes a number that need not be one."""
    if isinstance(schema, dict):
        loose = [path] if schema.get("type") in ("float", "int") and not schema.get("strict") else []
        return loose + [found for key, value in schema.items() for found in _numbers(value, f"{path}.{key}")]
    return [found for part in schema for found in _numbers(part, path)] if isinstance(schema, list) else []


@pytest.mark.parametrize("model", MODELS, ids=lambda m: m.__name__)
def test_every_number_of_every_model_is_strict(model: type[base.Wire]) -> None:
    assert _numbers(model.__pydantic_core_schema__) == []


@pytest.mark.parametrize("value", [True, False, "1", "0.5"])
def test_neither_a_truth_value_nor_a_text_is_a_number(value: object) -> None:
    for model, fields in (
        (WalkCommand, {"action": "walk", "distance": value}),
        (PushRequest, {"force": [0.0, value, 0.0], "duration": 1.0}),
        (ResetRequest, {"world": {"friction": value}}),
        (ResetRequest, {"seed": value}),
    ):
        with pytest.raises(ValidationError):
            model.model_validate(fields)
        with pytest.raises(Refusal) as refusal:
            decode(model, json.dumps(fields).encode())
        assert refusal.value.field


def directions(value: object) -> dict[str, Any]:
    return {"contacts": [], "directions": value}


@pytest.mark.parametrize(
    ("model", "fields", "field", "text"),
    [
        # of several types: named as it was sent
        (RegionRequest, directions(0), "directions", "greater than or equal to 1"),
        (RegionRequest, directions("x"), "directions", "integer"),
        (RegionRequest, directions([]), "directions", "at least 1 item"),
        (RegionRequest, directions([[1, 0], ["x", 0]]), "directions.1.0", "number"),
        # unknown: keeps its name whatever that is
        (RegionRequest, {"contacts": [], "constrained-int": 1}, "constrained-int", ""),
        (JointCommand, {"position": [0.0], "speed": 1}, "speed", ""),
        # of another action: the message names those that take it, or what this one takes
        (WalkCommand, {"action": "stop", "distance": 1.0}, "distance", "'walk'"),
        (WalkCommand, {"action": "turn", "angle": 0.2, "distance": 1.0}, "distance", "angle, duration, gait"),
        (WalkCommand, {"action": "walk", "shift": [0.0, 0.0]}, "shift", "'stand'"),
        (ResetRequest, {"rtf": 2.0}, "rtf", "'paced'"),
        (FaultRequest, {"kind": "imu_drop", "value": 1.0}, "value", "'imu_bias'"),
        (CalibrateRequest, {"action": "status", "apply": False}, "apply", "'finish'"),
    ],
)
def test_a_wrong_field_is_refused_by_name(
    model: type[base.Wire], fields: dict[str, Any], field: str, text: str
) -> None:
    with expect_error(Refusal, field=field, text=text):
        decode(model, json.dumps(fields).encode())


def test_an_explicit_null_is_no_field() -> None:
    assert decode(WalkCommand, b'{"action": "stop", "distance": null, "shift": null}') == WalkCommand(action="stop")
    assert set(CALIBRATE_FIELDS) == set(get_args(CalibrateRequest.model_fields["action"].annotation))
    assert set(WALK_FIELDS) == set(get_args(WalkCommand.model_fields["action"].annotation))


@pytest.mark.parametrize("name", ["friction\n", "a\tb", "\u2028", "x" * 5000])
def test_a_field_of_any_name_is_refused_in_one_short_line(name: str) -> None:
    with pytest.raises(Refusal) as refusal:
        decode(ResetRequest, json.dumps({"seed": 0, "world": {name: None}}).encode())
    assert str(refusal.value).isprintable()
    assert len(str(refusal.value)) < 300


def test_an_array_beyond_the_largest_is_refused_before_its_header_is_read() -> None:
    with expect_error(Refusal, "too_large"):
        decode(HeightMapMessage, bytes(MAX_BULK_BYTES + 1), b"{")


@pytest.mark.parametrize("length", [0.0, 1e-9, 1.0 - 1.1 * base.UNIT_WITHIN, 1.0 + 1.1 * base.UNIT_WITHIN, 2.0, 1e300])
def test_a_quaternion_that_is_no_rotation_is_refused(length: float) -> None:
    adapter = TypeAdapter[Any](base.QuatWxyz)
    for direction in ((1.0, 0.0, 0.0, 0.0), (0.5, -0.5, 0.5, -0.5), (0.0, 0.6, 0.0, 0.8)):
        given = tuple(length * part for part in direction)
        with pytest.raises(ValidationError, match=r"a quaternion of length .*, allowed is 1 within 0\.01"):
            adapter.validate_python(given)
        for near in (1.0 - 0.9 * base.UNIT_WITHIN, 1.0 + 0.9 * base.UNIT_WITHIN, -1.0):
            adapter.validate_python(tuple(near * part for part in direction))
