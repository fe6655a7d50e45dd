"""Every example is short, has a docstring, and compiles; ``tests/e2e`` runs them against a live system."""

import ast
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").rglob("*.py"))
GALLERY = [path for path in EXAMPLES if path.parent.name == "library"]
MAX_LINES = 60
MAX_GALLERY_LINES = 10
"""Largest number of lines of code of a program of the library: those of statements that are no import and no docstring,
without comments and empty lines."""


def lines_of_code(text: str) -> int:
    """Return the number of lines of a module's statements behind its docstring, without imports and comments."""
    body = (node for node in ast.parse(text).body[1:] if not isinstance(node, ast.Import | ast.ImportFrom))
    numbers = {k for node in body for k in range(node.lineno, (node.end_lineno or node.lineno) + 1)}
    lines = [line.strip() for k, line in enumerate(text.splitlines(), 1) if k in numbers]
    return sum(bool(line) and not line.startswith("#") for line in lines)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_example_is_short_and_explained(path: Path) -> None:
    text = path.read_text()
    assert ast.get_docstring(ast.parse(text))
    assert len(text.splitlines()) <= MAX_LINES


def test_twenty_programs_of_ten_lines_show_the_library() -> None:
    lengths = {path.stem: lines_of_code(path.read_text()) for path in GALLERY}
    assert len(lengths) == 20
    assert {name: lines for name, lines in lengths.items() if lines > MAX_GALLERY_LINES} == {}


def test_lines_of_code_are_those_of_statements() -> None:
    text = '"""Doc."""\n\nimport os\n\n# a remark\nfor k in range(3):\n\n    # another\n    print(\n        k,\n    )\n'
    assert lines_of_code(text) == 4
