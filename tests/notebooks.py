"""Notebooks of the examples without Jupyter: ``python -m tests.notebooks`` runs cells and stores what they print."""

import ast
import contextlib
import io
import json
import sys
from pathlib import Path
from typing import Any

EXAMPLES = Path(__file__).parents[1] / "examples"


def notebooks() -> list[Path]:
    """Return the notebooks of the examples."""
    return sorted(EXAMPLES.rglob("*.ipynb"))


def code_cells(content: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the cells of a notebook that are run."""
    return [cell for cell in content["cells"] if cell["cell_type"] == "code"]


def printed(cells: list[dict[str, Any]]) -> list[str]:
    """Run cells in one namespace, as a notebook does, and return what each prints, with the value of its last line."""
    names: dict[str, Any] = {"__name__": "__main__"}
    shown: list[str] = []
    for number, cell in enumerate(cells, 1):
        tree = ast.parse("".join(cell["source"]), f"cell {number}")
        last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
        with contextlib.redirect_stdout(io.StringIO()) as out:
            exec(compile(tree, f"cell {number}", "exec"), names)
            if isinstance(last, ast.Expr):
                value = eval(compile(ast.Expression(last.value), f"cell {number}", "eval"), names)
                if value is not None:
                    out.write(f"{value!r}\n")
        shown.append(out.getvalue())
    return shown


def outputs(text: str) -> list[dict[str, Any]]:
    """Return the outputs of a cell that printed a text."""
    return [{"name": "stdout", "output_type": "stream", "text": text.splitlines(keepends=True)}] if text else []


def run(path: Path) -> None:
    """Run a notebook and store what its cells print."""
    content = json.loads(path.read_text(encoding="utf-8"))
    cells = code_cells(content)
    for number, (cell, text) in enumerate(zip(cells, printed(cells), strict=True), 1):
        cell |= {"execution_count": number, "outputs": outputs(text)}
    path.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    for notebook in notebooks():
        run(notebook)
        sys.stdout.write(f"{notebook.name}\n")
