"""Types of hand-written files: what each takes and refuses, and the sentence of the first refusal."""

import math
from typing import Annotated, Any, Literal

import pytest
from pydantic import AfterValidator, Field, TypeAdapter, ValidationError

from surefoot import tables
from tests.surefoot.expect import expect_error

TAKEN: list[tuple[Any, list[Any], list[Any]]] = [
    (tables.Text, ["a", "some text"], ["", b"a", 1, None]),
    (tables.Name, ["a", "left_leg2"], ["", "A", "2a", "a-b", "_a", b"a", 1]),
    (tables.Number, [0, 1.5, -3], ["1.5", True, math.nan, math.inf, None]),
    (tables.Positive, [1e-9, 2], [0, -1.0, math.inf, "1"]),
    (tables.NotNegative, [0, 2.5], [-1e-9, -1, math.nan]),
    (tables.Whole, [0, -7], [1.0, "1", True]),
    (tables.Vector, [[1, 2.0, 3]], [[1, 2], [1, 2, 3, 4], [1, 2, "3"], [1, 2, math.nan], (1, "2", 3)]),
]


@pytest.mark.parametrize(("kind", "good", "bad"), TAKEN, ids=range(len(TAKEN)))
def test_a_type_takes_these_values_and_refuses_those(kind: Any, good: list[Any], bad: list[Any]) -> None:
    adapter = TypeAdapter[Any](kind)
    for value in good:
        assert adapter.validate_python(value) == value
    for value in bad:
        with pytest.raises(ValidationError):
            adapter.validate_python(value)


def _even(value: int) -> int:
    if value % 2:
        raise tables.refused("duplicate", f"is odd: {value}", "part")
    return value


class Inner(tables.FileModel):
    """Table inside the table."""

    size: float = 1.0


class Content(tables.FileModel):
    """Content of a file."""

    kind: Literal["round", "square"]
    inner: dict[str, Inner] = Field(default_factory=dict)
    even: Annotated[int, AfterValidator(_even)] = 0
    text: Annotated[str, Field(min_length=2)] = "ab"
    free: float = 0.0


GOOD = {"kind": "round"}


@pytest.mark.parametrize(
    ("change", "code", "field", "sentence"),
    [
        ({"kind": None}, "type", "kind", "got None, allowed are round, square"),
        ({"kind": "squere"}, "value", "kind", "got 'squere' (did you mean 'square'?), allowed are round, square"),
        ({"free": math.nan}, "value", "free", "got nan; input should be a finite number"),
        ({"free": "1"}, "type", "free", "got '1'; input should be a valid number"),
        ({"text": "a"}, "type", "text", "got 'a'; string should have at least 2 characters"),
        ({"even": 3}, "duplicate", "even.part", "is odd: 3"),
        ({"inner": {"a": {"sise": 2.0}}}, "unknown_key", "inner.a.sise", "known are size"),
        ({"inner": {1: {}}}, "value", "inner", "input should be a valid string"),
        ({"other": 1}, "unknown_key", "other", "is not known here; known are even, free, inner, kind, text"),
    ],
)
def test_a_refusal_has_code_field_and_sentence(change: dict[str, Any], code: str, field: str, sentence: str) -> None:
    assert tables.validated(Content, GOOD).kind == "round"
    with expect_error(tables.TableError, code=code, field=field, text=sentence):
        tables.validated(Content, GOOD | change)


def test_a_missing_field_is_missing_and_not_a_wrong_value() -> None:
    with pytest.raises(tables.TableError) as caught:
        tables.validated(Content, {}, path="file.part")
    assert (caught.value.code, caught.value.field) == ("missing", "file.part.kind")
    assert str(caught.value).endswith("is missing")


def test_what_is_no_table_is_refused_at_the_file() -> None:
    with expect_error(tables.TableError, code="type", field="file"):
        tables.validated(Content, [1])


def test_validators_raise_the_codes_of_fields() -> None:
    for code in tables.CODES:
        assert tables.refused(code, "sentence").type == code


@pytest.mark.parametrize("content", [b"a = ", b"a = 1\na = 2", b"\xff\xfe", b"a = " + b"[" * 100_000])
def test_a_file_that_is_no_toml_is_refused_by_its_name(tmp_path: Any, content: bytes) -> None:
    path = tmp_path / "x.toml"
    path.write_bytes(content)
    with expect_error(tables.TableError, code="syntax", field="x.toml", text="is not valid TOML"):
        tables.read_toml(path)
