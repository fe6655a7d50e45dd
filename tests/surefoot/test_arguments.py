"""Arguments at the border of the library: what is no number, no flag, no path is refused by its field."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from surefoot.arguments import array, file_path, flag, number, whole
from surefoot.errors import FieldError
from tests.surefoot.expect import expect_error

NONE: Any = None


@pytest.mark.parametrize(
    "value",
    [NONE, "1", 1j, np.ma.array([1.0], mask=[True]), np.datetime64("2026-01-01"), np.array(["a"]), object()],
    ids=["none", "text", "complex", "masked", "time", "texts", "object"],
)
def test_what_is_no_number_is_no_array_and_no_number(value: Any) -> None:
    with expect_error(FieldError, "type", text="expected numbers in m"):
        array(value, "size", np.shape(value), "m")
    with pytest.raises(FieldError):
        number(value, "size", "m")


@pytest.mark.parametrize("value", [True, np.True_])
@pytest.mark.parametrize("check", [number, whole])
def test_a_flag_is_no_number(check: Callable[[Any, str], Any], value: Any) -> None:
    with expect_error(FieldError, "type", text="got "):
        check(value, "size")


def test_a_flag_is_true_or_false_or_one_or_zero() -> None:
    assert [flag(value, "on") for value in (True, np.False_, 1, np.int64(0))] == [True, False, True, False]
    for value in (2, -1, 1.0, "yes", NONE, np.int8(5)):
        with expect_error(FieldError, "type", text="expected True or False"):
            flag(value, "on")


@pytest.mark.parametrize("value", ["", "a\0b", 3, NONE, b"a"], ids=repr)
def test_what_is_no_path_is_refused(value: Any) -> None:
    with expect_error(FieldError, "type", text="expected the path of a file"):
        file_path(value, "map")
