"""Expectations that several folders of tests share."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import ANY

import pytest


@contextmanager
def expect_error(
    kind: type[Exception], code: object = ANY, field: object = ANY, text: str = "", without: str | None = None
) -> Iterator[pytest.ExceptionInfo[Any]]:
    """Require an error of this kind with this code, field and part of its message, and without the other text."""
    with pytest.raises(kind) as caught:
        yield caught
    error: Any = caught.value
    assert code is ANY or error.code == code
    assert field is ANY or error.field == field
    assert text in str(error)
    assert without is None or without not in str(error)
