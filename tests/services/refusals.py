"""The check that a call is refused, with its code and field."""

from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import ANY

import pytest


@contextmanager
def refused(
    kind: type[Exception], code: object = ANY, field: object = ANY
) -> Iterator[pytest.ExceptionInfo[Exception]]:
    """Expect an error of this class in the block; its code and its field are compared where they are given."""
    with pytest.raises(kind) as caught:
        yield caught
    error: object = caught.value
    if code is not ANY:
        assert error.code == code, error.code  # type: ignore[attr-defined]
    if field is not ANY:
        assert error.field == field, error.field  # type: ignore[attr-defined]
