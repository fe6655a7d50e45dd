"""Text plot of a message field over simulated time, for `surefoot topic echo --plot`."""

import math
import string
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal, get_args, get_origin

from surefoot.errors import InvalidField
from surefoot.schemas.base import Message

LINES = 15
SPAN_S = 10.0
"""Span of simulated time that the plot of a message field shows, s."""
LABEL = 10
"""Width of the axis labels beside the plot, characters."""
MOST = 8
"""Largest number of curves in a text plot; of a longer list field only the first `MOST` elements are drawn."""


class Curves:
    """Values of a message field over the last `SPAN_S` s of simulated time, and their picture as text.

    Args:
        field: name of the field; each number of a list is a curve of its own.
        columns: width of the picture with its axis labels, characters.
    """

    def __init__(self, field: str, columns: int) -> None:
        self.field = field
        self._columns = max(8, columns - LABEL - 2)
        self._kept: deque[tuple[float, tuple[float, ...]]] = deque()

    def add(self, message: Message) -> None:
        """Add the field's values in a message to the curves (raises InvalidField: the field holds no numbers)."""
        value = message.model_dump(mode="json", include={self.field})[self.field]
        now = message.stamp_ns * 1e-9
        if self._kept and now < self._kept[-1][0]:
            self._kept.clear()
        self._kept.append((now, tuple(_numbers(value, self.field))[:MOST]))
        while self._kept[0][0] < now - SPAN_S:
            self._kept.popleft()

    @property
    def begun(self) -> bool:
        """Return True if a message was added to the curves, else False."""
        return bool(self._kept)

    def lines(self) -> list[str]:
        """Return the plot of the curves as lines of text, with its time span, s, and the newest value of each curve."""
        finite = [value for _, values in self._kept for value in values if math.isfinite(value)]
        if not finite:
            return [f"{self.field}: no value"]
        low, high = min(finite), max(finite)
        middle, half = (low + high) / 2.0, max((high - low) / 2.0, 1e-9 * max(1.0, abs(low)))
        (begin, _), (end, newest) = self._kept[0], self._kept[-1]
        grid = [[" "] * self._columns for _ in range(LINES)]
        for time, values in self._kept:
            column = int((self._columns - 1) * (time - begin) / max(end - begin, 1e-9))
            for letter, value in zip(string.ascii_letters, values, strict=False):
                if math.isfinite(value):
                    grid[round((LINES - 1) * (1.0 - (value - middle) / half) / 2.0)][column] = letter
        labels = {0: middle + half, LINES // 2: middle, LINES - 1: middle - half}
        shown = [
            f"{format(labels[row], '.4g') if row in labels else '':>{LABEL}} |{''.join(cells)}".rstrip()
            for row, cells in enumerate(grid)
        ]
        return [*shown, f"{'':{LABEL}}  {begin:.2f} to {end:.2f} s", *_legend(self.field, newest)]


def _numbers(value: Any, field: str) -> Iterator[float]:
    """Yield the numbers of a field's value, with lists flattened and absent numbers as NaN."""
    if isinstance(value, list):
        for part in value:  # pyright: ignore[reportUnknownVariableType]
            yield from _numbers(part, field)
    elif value is None:
        yield math.nan
    elif isinstance(value, int | float):
        yield float(value)
    else:
        raise InvalidField(field, f"got {value!r}, expected numbers to plot")


def has_numbers(annotation: Any) -> bool:
    """Return True if a field of this type can be plotted: it holds numbers, in lists, or optional; else False."""
    inside = get_args(annotation)
    if get_origin(annotation) is Annotated:
        return has_numbers(inside[0])
    if inside and get_origin(annotation) is not Literal:
        return any(has_numbers(part) for part in inside)
    return annotation is Any or (isinstance(annotation, type) and issubclass(annotation, int | float))


def _legend(field: str, newest: Sequence[float]) -> list[str]:
    names = [field] if len(newest) == 1 else [f"{field}.{i}" for i in range(len(newest))]
    rows = zip(string.ascii_letters, names, newest, strict=False)
    return [f"{letter} {name} {value:.4g}" for letter, name, value in rows]
