"""Checks of what a program passes to the client, without numpy, whose import would double that of the client."""

import re
from numbers import Real
from typing import Any

from surefoot.errors import FieldError, InvalidField, shown

LONGEST_S = 1e9
"""Largest wait that a caller may request, s of wall time; a larger one is refused."""
_ENDPOINT = re.compile(r"[a-z][a-z0-9_-]*/(\[[^\]]*\]|[^/]*):\d+.*")
_PART = re.compile(r"[^/*$#?]+(/[^/*$#?]+)*")


def key_part(value: Any, field: str, example: str) -> str:
    """Return a part of the keys' prefix after a check that keys can hold it.

    Args:
        value: name of a robot or of a fleet.
        field: name of the argument.
        example: name that the error message shows as an allowed one.

    Raises:
        FieldError: `type`, or `invalid` for an endpoint or for characters that a key cannot hold.
    """
    what = f"expected the name of a {field}, such as {example!r}"
    if not isinstance(value, str):
        raise FieldError("type", field, f"got {shown(value)}, {what}")
    if _ENDPOINT.fullmatch(value):
        raise InvalidField(field, f"got {value!r}, {what}; an endpoint is passed as endpoint={value!r}")
    if not _PART.fullmatch(value):
        raise InvalidField(field, f"got {shown(value)}, {what}, without *, $, # and ?")
    return value


def wait_s(value: Any, none: str, field: str = "timeout_s") -> float | None:
    """Return the longest wait, s, after a check that it is None or a number from 0 to `LONGEST_S`.

    Args:
        value: s of wall time, or None.
        none: what None stands for, in the error message.
        field: name of the argument.

    Raises:
        FieldError: `type` or `range`.
    """
    if value is None:
        return None
    allowed = f"0 to {LONGEST_S:g} s, or None for {none}"
    if not isinstance(value, Real):
        raise FieldError("type", field, f"got {shown(value)}, allowed is {allowed}")
    if not 0.0 <= float(value) <= LONGEST_S:
        raise FieldError("range", field, f"got {float(value):g}, allowed is {allowed}")
    return float(value)
