"""Tables as lines of text: columns where they fit the width, else one block of `name: value` lines for each row."""

from collections.abc import Iterable, Iterator, Sequence
from textwrap import wrap
from typing import Any

from typer import style

GAP = "  "
LEAST_TEXT = 24
"""Least width of a column with wrapped cells, characters; where less is available, each row is printed as a block."""

Cell = tuple[str, str]
"""Cell of a table as (text, style); style: name of a colour, with an optional `bold ` before it, or empty."""


def table_lines(
    columns: Sequence[str],
    rows: Iterable[Sequence[Any]],
    right: Sequence[int] = (),
    width: int | None = None,
    *,
    coloured: bool = False,
) -> Iterator[str]:
    """Yield the lines of a table.

    Args:
        columns: names of the columns.
        rows: cells of each row; a cell is any value or a `Cell`.
        right: indices of the columns that are aligned to the right and never wrapped.
        width: largest length of a line, characters; None = no limit.
        coloured: True: write styles as terminal escape sequences; False: plain text.
    """
    cells = [[_cell(each, coloured) for each in row] for row in rows]
    texts = [[name, *(row[number][0] for row in cells)] for number, name in enumerate(columns)]
    widths = _widths(texts, width, right)
    if widths is None:
        yield from _blocks(columns, cells, width)
        return
    yield from _row([_cell((name, "bold"), coloured) for name in columns], widths, right)
    yield "-" * (sum(widths) + len(GAP) * (len(widths) - 1))
    for row in cells:
        yield from _row(row, widths, right)


def _cell(value: Any, coloured: bool) -> Cell:
    text, look = value if isinstance(value, tuple) else (_text(value), "")
    return text, look if coloured else ""


def _text(value: Any) -> str:
    """Return a value as text; of a dict `name value, name value`, its numbers to four digits."""
    if not isinstance(value, dict):
        return str(value)
    rows: dict[str, Any] = value
    return ", ".join(
        f"{name} {each:.4g}" if isinstance(each, float) else f"{name} {each}" for name, each in rows.items()
    )


def _widths(texts: Sequence[Sequence[str]], width: int | None, right: Sequence[int]) -> list[int] | None:
    """Return column widths, characters, the widest reduced until a line fits `width`; None if that is impossible."""
    widths = [max(len(line) for text in column for line in (text, *text.splitlines())) for column in texts]
    if width is None:
        return widths
    least = [_least(column, wrapped=number not in right) for number, column in enumerate(texts)]
    room = width - len(GAP) * (len(widths) - 1)
    while sum(widths) > room:
        widest = max(range(len(widths)), key=lambda number: (widths[number] > least[number], widths[number]))
        if widths[widest] <= least[widest]:
            return None
        widths[widest] -= 1
    return widths


def _least(column: Sequence[str], *, wrapped: bool) -> int:
    """Return the least width of a column (name, then cells), characters: its longest word, or cell if not wrapped."""
    name, *cells = column
    longest = max((len(text) for text in cells), default=0)
    words = max((len(word) for text in (column if wrapped else [name]) for word in text.split()), default=0)
    return max(words, min(longest, LEAST_TEXT) if wrapped else longest)


def _row(cells: Sequence[Cell], widths: Sequence[int], right: Sequence[int]) -> Iterator[str]:
    """Yield the text lines of a table row: cells wrapped to `widths`, columns of the indices `right` right-aligned."""
    wrapped = [_folded(text, width) for (text, _), width in zip(cells, widths, strict=True)]
    for number in range(max(len(lines) for lines in wrapped)):
        shown: list[str] = []
        for place, (lines, (_, look), width) in enumerate(zip(wrapped, cells, widths, strict=True)):
            text = lines[number] if number < len(lines) else ""
            pad = " " * (width - len(text))
            shown.append(pad + _styled(text, look) if place in right else _styled(text, look) + pad)
        yield GAP.join(shown).rstrip()


def _blocks(columns: Sequence[str], rows: Sequence[Sequence[Cell]], width: int | None) -> Iterator[str]:
    """Yield each row as a block of `name: value` lines, one per non-empty cell, blocks separated by an empty line."""
    for number, row in enumerate(rows):
        if number:
            yield ""
        for name, (text, look) in zip(columns, row, strict=True):
            begin = f"{name}: " if name else ""
            for place, line in enumerate(_folded(begin + text, width, "  ") if text else ()):
                yield line if place else (begin + _styled(line[len(begin) :], look)).rstrip()


def _folded(text: str, width: int | None, indent: str = "") -> list[str]:
    """Return a text as lines of at most `width` characters, broken between words; longer words stay whole."""
    lines = text.splitlines() or [""]
    if width is None:
        return lines
    return [
        piece
        for line in lines
        for piece in (
            [line]
            if len(line) <= width
            else wrap(line, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
        )
    ]


def _styled(text: str, look: str) -> str:
    colour = look.removeprefix("bold").strip()
    return style(text, fg=colour or None, bold=look != colour or None) if text and look else text
