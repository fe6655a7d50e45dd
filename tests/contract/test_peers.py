"""The comparison with other projects: every figure stands in the linked section of measured.md, with its command."""

import re
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
ROW = re.compile(r"^\| .+ \(\[figures\]\(measured\.md#([\w-]+)\)\) \| (.+) \| (.+) \|$", re.MULTILINE)
NUMBER = re.compile(r"\d+(?:\.\d+)?")


def sections() -> dict[str, str]:
    """Return the text of each section of measured.md by its anchor."""
    parts = re.split(r"^## ", (DOCS / "measured.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    return {re.sub(r"[^\w -]", "", part.partition("\n")[0].lower()).replace(" ", "-"): part for part in parts}


def test_figures_are_those_of_the_page_that_they_link_by_their_commands() -> None:
    text = (DOCS / "peers.md").read_text(encoding="utf-8")
    rows = ROW.findall(text)
    assert len(rows) == text.partition("\n## Side by side\n")[2].count("\n| ") - 1
    for anchor, figure, commands in rows:
        section = sections()[anchor]
        there = NUMBER.findall(section)
        assert [number for number in NUMBER.findall(figure) if number not in there] == [], figure
        asked = re.findall(r"`python -m benchmarks ([^`]+)`", commands)
        assert asked
        for command in asked:
            assert f"`{command}`" in section, command


def test_each_project_has_both_columns() -> None:
    rows = [line for line in (DOCS / "peers.md").read_text(encoding="utf-8").splitlines() if line.startswith("| [")]
    assert len(rows) == 7
    assert all(len(cell) > 40 for line in rows for cell in line.strip("| ").split(" | ")[1:])
