"""The page of equations is true: each function exists, and its docstring or module names the equation's number."""

import ast
import re
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "equations.md").read_text(encoding="utf-8")
ROW = re.compile(r"^\| (?P<quantity>.+?) \| .+ \| (?P<source>.+?) \| `(?P<name>\w+)` in `(?P<path>\S+\.py)` \|$", re.M)
NUMBER = re.compile(r"(?:\(|Eq\. )(\d+)\)")
SPAN = re.compile(r"\((\d+)\)\s?(?:-|to)\s?\((\d+)\)")


class Row(NamedTuple):
    """One quantity of the page, the source of its equation, and the function by name and file."""

    quantity: str
    source: str
    name: str
    path: str


ROWS = [Row(**found.groupdict()) for found in ROW.finditer(PAGE)]


@cache
def module(path: str) -> ast.Module:
    return ast.parse((ROOT / path).read_text(encoding="utf-8"))


def cited(text: str) -> set[int]:
    """Return the numbers of equations that a text names, those between the ends of "(2)-(4)" too."""
    spans = [range(int(low), int(high) + 1) for low, high in SPAN.findall(text)]
    return {int(number) for number in NUMBER.findall(text)}.union(*spans)


def test_every_row_of_the_page_is_one_of_functions() -> None:
    lines = [line for line in PAGE.splitlines() if line.startswith("| ") and not line.startswith("| quantity ")]
    assert len(ROWS) == len(lines)
    assert len({(row.name, row.path) for row in ROWS}) == len(ROWS)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.quantity)
def test_the_function_exists_and_names_its_equation(row: Row) -> None:
    tree = module(row.path)
    found = [node for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == row.name]
    assert len(found) == 1, f"{row.path} has no {row.name}"
    text = f"{ast.get_docstring(tree)} {ast.get_docstring(found[0])}"
    assert cited(row.source) <= cited(text), text


def test_equations_of_a_span_are_cited() -> None:
    assert cited("equations (2)-(4), and (7) to (9) of a paper (2011, Eq. 10)") == {2, 3, 4, 7, 8, 9, 10}
