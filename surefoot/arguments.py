"""Checks of the arguments of the public functions; code behind these functions does not repeat the checks."""

import math
import operator
from collections.abc import Iterable, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import FieldError
from surefoot.errors import shown as shown
from surefoot.nearest import did_you_mean

WIDEST_ANGLE = 12.6
"""Largest absolute joint angle, rad; a larger one is refused, as probably in degrees."""
FARTHEST_FOOT = 10.0
"""Largest absolute coordinate of a foot in base_link or from the IMU, m; a larger one is refused, as probably in
millimetres."""

NO_NUMBERS = "cSUmM"
"""Kinds of numpy's types that are no real numbers, though numpy converts them: complex, bytes, text, times."""


def array(
    value: Any, field: str, shape: Sequence[int | str], unit: str = "", *,
    low: float = -math.inf, high: float = math.inf, nan: bool = False, inf: bool = False,
) -> Array:  # fmt: skip
    """Return a checked copy of an array argument, of the expected shape, in `unit`, float64 in C order.

    Args:
        value: anything that numpy makes an array of numbers of; nothing is reshaped.
        field: name of the argument.
        shape: expected length of each dimension; a letter stands for any length, the same letter for the same one.
        unit: unit of the values, for the error message; empty = none.
        low, high: allowed values, both included.
        nan: NaN is allowed, and stands for unknown.
        inf: +inf is allowed, and stands for unlimited.

    Raises:
        FieldError: `type`, `shape`, `not_finite` or `range`, with what was received and what is allowed.
    """
    of, lengths = f" in {unit}" if unit else "", dict[str, int]()
    try:
        if value is None or np.ma.is_masked(value) or np.asarray(value).dtype.kind in NO_NUMBERS:
            raise TypeError("none, masked, complex, text or times")
        found = np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError, OverflowError):
        raise FieldError("type", field, f"got {shown(value)}, expected numbers{of}") from None
    fits = found.ndim == len(shape) and all(
        size == (wanted if isinstance(wanted, int) else lengths.setdefault(wanted, size))
        for size, wanted in zip(found.shape, shape, strict=True)
    )
    if not fits:
        wanted = f"shape ({', '.join(map(str, shape))}{',' * (len(shape) == 1)})" if shape else "one number"
        raise FieldError("shape", field, f"got shape {found.shape}, expected {wanted}{of}")
    bad = ~np.isfinite(found) & ~(np.isnan(found) & nan) & ~(np.isposinf(found) & inf)
    if bad.any():
        raise FieldError("not_finite", field, f"got {_first(found, bad)}, expected finite numbers{of}")
    outside = (found < low) | ((found > high) & ~np.isposinf(found))
    if outside.any():
        allowed = f"{low:g} to {high:g}{f' {unit}'.rstrip()}{', or inf' if inf else ''}"
        raise FieldError("range", field, f"got {_first(found, outside)}, allowed is {allowed}")
    return found


def shape_of(given: Any) -> tuple[int, ...]:
    """Return the shape of an argument before its check; one of rows of unequal lengths counts as (0,)."""
    try:
        return np.shape(given)
    except ValueError:
        return (0,)


def number(
    value: Any, field: str, unit: str = "", *, low: float = -math.inf, high: float = math.inf, inf: bool = False
) -> float:
    """Return a checked number: `low` to `high`, or +inf where `inf` is true; `field`, `unit`: for the error message.

    Raises:
        FieldError: `type`, `not_finite` or `range`, with what was received and what is allowed.
    """
    if isinstance(value, bool | np.bool_):
        raise FieldError("type", field, f"got {shown(value)}, expected one number{f' in {unit}' if unit else ''}")
    return float(array(value, field, (), unit, low=low, high=high, inf=inf))


def whole(value: Any, field: str, unit: str = "", *, low: int = -(2**63), high: int = 2**63 - 1) -> int:
    """Return a checked whole number, `low` to `high`; `field`, `unit`: for the error message.

    Raises:
        FieldError: `type` or `range`, with what was received and what is allowed.
    """
    try:
        if isinstance(value, bool):
            raise TypeError("bool")
        found = operator.index(value)
    except TypeError:
        text = f"got {shown(value)}, expected a whole number{f' {unit}'.rstrip()}"
        raise FieldError("type", field, text) from None
    if not low <= found <= high:
        raise FieldError("range", field, f"got {found}, allowed is {low} to {high}{f' {unit}'.rstrip()}")
    return found


def flag(value: Any, field: str) -> bool:
    """Return True or False for a flag, numpy's and 0 and 1 too (raises FieldError: `type`)."""
    given = cast("int", value)
    if not isinstance(value, bool | np.bool_ | int | np.integer) or not 0 <= given <= 1:
        raise FieldError("type", field, f"got {shown(given)}, expected True or False")
    return bool(given)


def choice(value: Any, field: str, allowed: Iterable[str]) -> str:
    """Return the value after a check that it is one of the allowed names (raises FieldError: `unknown_name`)."""
    known = tuple(allowed)
    if not isinstance(value, str) or value not in known:
        near = did_you_mean(value, known) if isinstance(value, str) else ""
        raise FieldError("unknown_name", field, f"got {shown(value)}{near}, known are {', '.join(known)}")
    return value


def file_path(value: Any, field: str) -> Path:
    """Return the path of a file (raises FieldError: `type`, no path, or an empty one)."""
    given = cast("str | PathLike[str]", value)
    if not isinstance(value, str | PathLike) or not str(given) or "\0" in str(given):
        raise FieldError("type", field, f"got {shown(given)}, expected the path of a file")
    return Path(given)


def instance(value: Any, field: str, kind: type[Any], what: str) -> None:
    """Check the type of an argument (raises FieldError: `type`, with what is expected in words)."""
    if not isinstance(value, kind):
        raise FieldError("type", field, f"got {shown(value)}, expected {what}")


def _first(found: Array, wrong: NDArray[np.bool_]) -> str:
    """Return the first value of `found` where `wrong` (same shape) is set, and its index, as text."""
    at = tuple(int(i) for i in np.argwhere(wrong)[0])
    where = f" at [{', '.join(map(str, at))}]" if at else ""
    return f"{float(found[at])!r}{where}"
