"""Strict reading of nested TOML tables: every refusal names the field."""

import math
import re
import reprlib
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.linear import norm
from surefoot.nearest import did_you_mean

_NAME = re.compile(r"[a-z][a-z0-9_]*")
UNIT_SLACK = 1e-6
"""What rounding in a file may take from the length of a unit vector."""

_SHORT = reprlib.Repr()
_SHORT.maxlevel = 2
_SHORT.maxstring = _SHORT.maxother = 120
shown = _SHORT.repr
"""A received value in a sentence: a few lines of YAML with aliases can stand for gigabytes."""


class TableError(ValueError):
    """A field that cannot be used.

    Attributes:
        code: `missing`, `type`, `value`, `unknown_key`, `unknown_name`, `duplicate`, `syntax` or `not_found`.
        field: dotted path of the field, as in `chains.leg.links[1].mass`.
        message: one sentence that quotes the received value and says what is allowed.
    """

    def __init__(self, code: str, field: str, message: str) -> None:
        super().__init__(f"{field}: {message}")
        self.code = code
        self.field = field
        self.message = message


def read_toml(path: Path, error: type[TableError] = TableError) -> dict[str, object]:
    """Read a file (raises `error` with code `syntax` when it is not TOML)."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as err:
        raise error("syntax", path.name, f"is not valid TOML: {err}") from err


class Table:
    """A table that notes which keys were asked for, so that `close` can refuse the others by name."""

    def __init__(self, data: object, path: str = "", error: type[TableError] = TableError) -> None:
        if not isinstance(data, Mapping):
            raise error("type", path or "file", f"expected a table, got {shown(data)}")
        self._data = cast("Mapping[str, object]", data)
        self._path = path
        self._error = error
        self._known: set[str] = set()

    def refuse(self, code: str, key: str, message: str) -> TableError:
        """Build the error of a field of this table."""
        return self._error(code, self.field(key), message)

    def field(self, key: str) -> str:
        """Dotted path of a key of this table."""
        return f"{self._path}.{key}" if self._path else key

    def has(self, key: str) -> bool:
        """Tell whether the key is given; to ask makes it an allowed one."""
        self._known.add(key)
        return key in self._data

    def keys(self) -> list[str]:
        """All keys in the order of the file."""
        return list(self._data)

    def raw(self, key: str) -> object:
        """Value as read from the file."""
        self._known.add(key)
        if key not in self._data:
            raise self.refuse("missing", key, "is missing")
        return self._data[key]

    def text(self, key: str, allowed: tuple[str, ...] = ()) -> str:
        """Non-empty text, one of `allowed` if given."""
        value = self.raw(key)
        if not isinstance(value, str) or not value:
            raise self.refuse("type", key, f"expected text, got {shown(value)}")
        if allowed and value not in allowed:
            hint = did_you_mean(value, allowed)
            raise self.refuse("value", key, f"got {shown(value)}{hint}, allowed are {', '.join(allowed)}")
        return value

    def name(self, key: str) -> str:
        """Lower-case identifier."""
        value = self.text(key)
        if not _NAME.fullmatch(value):
            raise self.refuse("value", key, f"got {shown(value)}, expected lower-case letters, digits and underscores")
        return value

    def flag(self, key: str, default: bool) -> bool:
        """Boolean with a default."""
        value = self.raw(key) if self.has(key) else default
        if not isinstance(value, bool):
            raise self.refuse("type", key, f"expected true or false, got {shown(value)}")
        return value

    def number(
        self,
        key: str,
        *,
        default: float | None = None,
        above: float = -math.inf,
        at_least: float = -math.inf,
        at_most: float = math.inf,
    ) -> float:
        """Finite number inside the stated range."""
        if default is not None and not self.has(key):
            return default
        value = self._finite(self.raw(key), key)
        if not value > above and above != -math.inf:
            raise self.refuse("value", key, f"got {value}, must be above {above}")
        if not at_least <= value <= at_most:
            raise self.refuse("value", key, f"got {value}, must be in [{at_least}, {at_most}]")
        return value

    def integer(self, key: str, *, at_least: int, at_most: int) -> int:
        """Whole number inside the stated range."""
        value = self.raw(key)
        if isinstance(value, bool) or not isinstance(value, int):
            raise self.refuse("type", key, f"expected a whole number, got {shown(value)}")
        if not at_least <= value <= at_most:
            raise self.refuse("value", key, f"got {value}, must be in [{at_least}, {at_most}]")
        return value

    def vector(self, key: str, size: int, default: tuple[float, ...] | None = None) -> NDArray[np.float64]:
        """Finite numbers, shape (size,)."""
        if default is not None and not self.has(key):
            return np.array(default, dtype=np.float64)
        return self._vector(self.raw(key), key, size)

    def vectors(self, key: str, size: int) -> NDArray[np.float64]:
        """A list of vectors, shape (n, size)."""
        value = self.raw(key)
        if not isinstance(value, list):
            raise self.refuse("type", key, f"expected a list of lists of {size} numbers, got {shown(value)}")
        rows = [self._vector(row, f"{key}[{i}]", size) for i, row in enumerate(cast("list[object]", value))]
        return np.array(rows, dtype=np.float64).reshape(len(rows), size)

    def unit(self, key: str, size: int, default: tuple[float, ...] | None = None) -> NDArray[np.float64]:
        """A vector of length 1, shape (size,)."""
        vector = self.vector(key, size, default)
        length = norm(vector)
        if abs(length - 1.0) > UNIT_SLACK:
            raise self.refuse("value", key, f"got {vector.tolist()} of length {length:.6g}, expected length 1")
        return vector / length

    def table(self, key: str) -> "Table":
        """Sub-table."""
        return Table(self.raw(key), self.field(key), self._error)

    def tables(self, key: str) -> list["Table"]:
        """Array of tables, at least one."""
        value = self.raw(key)
        if not isinstance(value, list) or not value:
            raise self.refuse("type", key, f"expected at least one table, got {shown(value)}")
        rows = cast("list[object]", value)
        return [Table(row, self.field(f"{key}[{i}]"), self._error) for i, row in enumerate(rows)]

    def items(self) -> Iterator[tuple[str, "Table"]]:
        """Every entry as a sub-table, in the order of the file."""
        for key in self._data:
            yield key, self.table(key)

    def close(self) -> None:
        """Refuse the first key that nobody asked for.

        Raises:
            TableError: code `unknown_key`.
        """
        for key in self._data:
            if key not in self._known:
                hint, known = did_you_mean(key, self._known), ", ".join(sorted(self._known))
                raise self.refuse("unknown_key", key, f"is not known here{hint}; known are {known}")

    def _finite(self, value: object, key: str) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self.refuse("type", key, f"expected a number, got {shown(value)}")
        if not math.isfinite(value):
            raise self.refuse("value", key, f"got {value}, must be finite")
        return float(value)

    def _vector(self, value: object, key: str, size: int) -> NDArray[np.float64]:
        if not isinstance(value, list) or len(cast("list[object]", value)) != size:
            raise self.refuse("type", key, f"expected {size} numbers, got {shown(value)}")
        row = cast("list[object]", value)
        return np.array([self._finite(x, f"{key}[{i}]") for i, x in enumerate(row)], dtype=np.float64)
