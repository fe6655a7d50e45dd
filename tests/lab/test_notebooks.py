"""Notebooks of the examples: the format, and that their cells print what is stored, without Jupyter."""

import json
from pathlib import Path

import pytest

from tests.notebooks import code_cells, notebooks, outputs, printed

FORMAT = (4, 4)
PARTS = ("stability", "estimation", "terrain", "navigation", "bags")


def strings(value):
    return isinstance(value, list) and all(isinstance(line, str) for line in value)


@pytest.mark.parametrize("path", notebooks(), ids=lambda path: path.stem)
def test_a_notebook_is_one_by_the_format(path: Path) -> None:
    """Fields of nbformat 4.4: of the notebook, of cells of markdown and code, of outputs as a stream."""
    content = json.loads(path.read_text(encoding="utf-8"))
    assert set(content) == {"cells", "metadata", "nbformat", "nbformat_minor"}
    assert (content["nbformat"], content["nbformat_minor"]) == FORMAT
    assert content["metadata"]["kernelspec"] == {"display_name": "Python 3", "language": "python", "name": "python3"}
    numbers = []
    for cell in content["cells"]:
        assert isinstance(cell["metadata"], dict)
        assert strings(cell["source"])
        assert all(line.endswith("\n") for line in cell["source"][:-1])
        assert not cell["source"][-1].endswith("\n")
        if cell["cell_type"] == "markdown":
            assert set(cell) == {"cell_type", "metadata", "source"}
            continue
        assert cell["cell_type"] == "code"
        assert set(cell) == {"cell_type", "execution_count", "metadata", "outputs", "source"}
        numbers.append(cell["execution_count"])
        for output in cell["outputs"]:
            assert set(output) == {"name", "output_type", "text"}
            assert (output["name"], output["output_type"]) == ("stdout", "stream")
            assert strings(output["text"])
    assert numbers == list(range(1, len(numbers) + 1))


@pytest.mark.parametrize("path", notebooks(), ids=lambda path: path.stem)
def test_its_cells_print_what_is_stored(path: Path) -> None:
    cells = code_cells(json.loads(path.read_text(encoding="utf-8")))
    assert [outputs(text) for text in printed(cells)] == [cell["outputs"] for cell in cells], (
        "python -m tests.notebooks stores what the cells print"
    )


def test_the_tour_has_ten_cells_over_all_parts_of_the_library() -> None:
    (tour,) = (path for path in notebooks() if path.stem == "tour")
    cells = code_cells(json.loads(tour.read_text(encoding="utf-8")))
    source = "".join("".join(cell["source"]) for cell in cells)
    assert len(cells) == 10
    assert all(f"surefoot.{part}." in source for part in PARTS)
    assert all(cell["outputs"] for cell in cells)
