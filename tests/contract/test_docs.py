"""The pages are true to the tree: links, paths, modules, targets of make; generated pages are those of now."""

import importlib.util
import re
import shlex
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from surefoot.lab import configuration_page
from surefoot.lab.cli.graph import declared, mermaid
from surefoot.lab.cli.main import app
from surefoot.lab.topics_page import page

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
DECISIONS = ROOT / "docs" / "decisions"

BLOCK = re.compile(r"^```(.*?)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"`([^`\n]+)`")
LINK = re.compile(r'\]\(([^)\s]+)(?: "[^"]*")?\)')
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)
RUN = re.compile(r"python -m ([\w.]+)")
SHELL = re.compile(r"^(?:[A-Z_]+=\S+ )*surefoot (.+)$", re.MULTILINE)
MAKE = re.compile(r"make ([a-z][\w-]*)")
PATH = re.compile(r"[\w<>*.-]+(/[\w<>*.-]+)*/?")
NAME = re.compile(r"surefoot(\.\w+)+")
PLACEHOLDER = re.compile(r"<[^>]*>")
ENDING = re.compile(r"\.(py|md|toml|yaml|json|png|cff)$")
DECISION = re.compile(r"^\*\*(.+?)\*\*", re.MULTILINE)
ROW = re.compile(r"^\| (.+) \| \d{4}-\d\d-\d\d \| (?:in force|rejected) \| \[.+\]\((.+)\) \|$", re.MULTILINE)
FAULT = re.compile(r"^\| ((?!fault |---)[^|]+?) \| [^|]+ \| [^|]+ \| ([^|]+) \|$", re.MULTILINE)
UNIT = re.compile(
    r"(?<![\w/])(mm?|ms|s|rad|deg|N|Nm|Hz|kg|kB|MB|%|1/\w+|\w+/(s|m|rad|kg)\d?|no unit|share|part|factor|coefficient"
    r"|weight|radii|way per stroke|rise per way)(?!\w)"
)
"""Pattern of units, and of words for what has none."""
NUMBERS = 3
"""Most numbers in a paragraph or remark of docs/measured.md; more are rows of a table."""
NUMBER = re.compile(r"(?<![\w.])\d+(?: \d{3})*(?:\.\d+)?(?:e-?\d+)?(?![\w]*/)")
NO_FIGURE = re.compile(r"`[^`\n]*`|\]\([^)]*\)|\b\d{4}-\d\d-\d\d\b")
"""Pattern of what holds digits but states no figure: code, targets of links, dates."""
MADE = {line.strip("/") for line in (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()}
"""Names that commands make, as `runs` by `surefoot run`: they are there or not."""
FOLDERS = {path.name for path in ROOT.iterdir() if path.is_dir() and not path.name.startswith(".")} - MADE


def each_page() -> pytest.MarkDecorator:
    return pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))


def shown(path: Path) -> str:
    """Return the text of a page without the blocks that are files of their own."""
    return BLOCK.sub(lambda block: "" if "=" in block[1] else block[0], path.read_text(encoding="utf-8"))


def codes(path: Path) -> list[str]:
    """Return what stands between backticks in the text of a page."""
    return CODE.findall(BLOCK.sub("", path.read_text(encoding="utf-8")))


def anchors(path: Path) -> set[str]:
    """Return the anchors of the headings of a page."""
    headings = HEADING.findall(BLOCK.sub("", path.read_text(encoding="utf-8")))
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def exists(path: str) -> bool:
    """Return whether a file or folder has this path, with placeholders in angle brackets."""
    pattern = PLACEHOLDER.sub("*", path).rstrip("/")
    return any(found.is_dir() or not path.endswith("/") for found in ROOT.glob(pattern))


def of_the_tree(word: str) -> bool:
    """Return whether a word in backticks is a path from the top of the repository."""
    if not PATH.fullmatch(word) or "/" not in word or word.partition("/")[0] not in FOLDERS:
        return False
    return word.endswith("/") or bool(ENDING.search(word)) or not re.search(r"[<>.]", word)


@each_page()
def test_links_lead_somewhere(path: Path) -> None:
    for link in LINK.findall(shown(path)):
        target, _, anchor = link.partition("#")
        if "://" in target:
            continue
        file = (path.parent / target).resolve() if target else path
        assert file.exists(), link
        assert path.parent == ROOT or file.is_relative_to(ROOT / "docs"), f"{link}: the site has pages of docs/ only"
        assert not anchor or anchor in anchors(file), link


@each_page()
def test_paths_exist(path: Path) -> None:
    names = {file.name for folder in FOLDERS for file in (ROOT / folder).rglob("*") if ENDING.search(file.name)}
    for word in codes(path):
        if of_the_tree(word):
            assert exists(word), word
        elif "/" not in word and PATH.fullmatch(word) and ENDING.search(word):
            assert word in names or (ROOT / word).exists(), word


@each_page()
def test_modules_exist(path: Path) -> None:
    for module in RUN.findall(shown(path)):
        spec = importlib.util.find_spec(module)
        assert spec is not None, module
        if spec.submodule_search_locations is not None:
            assert importlib.util.find_spec(f"{module}.__main__") is not None, module


@each_page()
def test_names_are_in_their_modules(path: Path) -> None:
    for word in codes(path):
        if not NAME.fullmatch(word) or ENDING.search(word):
            continue
        module, _, name = word.rpartition(".")
        place = importlib.util.find_spec(module)
        assert place is not None, word
        if place.submodule_search_locations is not None and importlib.util.find_spec(word):
            continue
        assert place.origin is not None, word
        assert re.search(rf"\b{name}\b", Path(place.origin).read_text(encoding="utf-8")), word


@each_page()
def test_names_are_in_the_files_beside_them(path: Path) -> None:
    found = re.findall(r"`(\w+)` in `([\w/]+\.py)`|`([\w/]+\.py)`: `(\w+)`", path.read_text(encoding="utf-8"))
    for before, file, other, after in found:
        if (place := ROOT / (file or other)).is_file():  # else it is beside the file that is named before it
            assert re.search(rf"\b{before or after}\b", place.read_text(encoding="utf-8")), (
                place.name,
                before or after,
            )


@each_page()
def test_targets_of_make_exist(path: Path) -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    in_blocks = "\n".join(text for _, text in BLOCK.findall(path.read_text(encoding="utf-8")))
    words = [*codes(path), *re.findall(r"^make .*", in_blocks, re.MULTILINE)]
    assert {target for word in words for target in MAKE.findall(word)} <= targets


@cache
def commands() -> Any:
    """Return the tree of all commands, which takes 70 ms to build."""
    return get_command(app)


@each_page()
def test_commands_in_blocks_are_those_of_the_command_line(path: Path) -> None:
    for _, block in BLOCK.findall(shown(path)):
        for line in SHELL.findall(block):
            words = shlex.split(line, comments=True)
            command = commands()
            while hasattr(command, "commands"):
                name = words.pop(0)
                assert name in command.commands, line
                command = command.commands[name]
            command.make_context(name, words)  # raises: an option or a value is none


def test_page_of_topics_is_the_generated_one() -> None:
    path = ROOT / "docs" / "topics.md"
    assert path.read_text(encoding="utf-8") == page(), "python -m surefoot.lab.topics_page > docs/topics.md"


def test_the_picture_of_the_architecture_is_the_declared_dataflow() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    assert f"```mermaid\n{mermaid(declared()[1])}\n```" in text, "surefoot graph --format mermaid"


def test_page_of_parameters_is_the_generated_one() -> None:
    text = (ROOT / "docs" / "configuration.md").read_text(encoding="utf-8")
    assert text == configuration_page.page(), "python -m surefoot.lab.configuration_page > docs/configuration.md"
    lines = [line.rsplit(" | ", 2) for line in text.splitlines() if line.startswith("| `")]
    assert all(meaning for _, meaning, _ in lines), "a field of a Config has no description"
    reals = [line for line in lines if re.search(r"\| float\b", line[0])]
    assert [line[0] for line in reals if not UNIT.search(" | ".join(line[1:]))] == []


def crowded(text: str) -> list[str]:
    """Return the paragraphs and remarks of a page with more than `NUMBERS` numbers."""
    prose = [line for line in text.splitlines() if not line.startswith(("|", "#"))]
    return [line for line in prose if len(NUMBER.findall(NO_FIGURE.sub("", line))) > NUMBERS]


def test_figures_of_measured_stand_in_tables() -> None:
    assert not crowded((ROOT / "docs" / "measured.md").read_text(encoding="utf-8"))
    assert crowded("- 3 of 1000 files in 2 s, 7 refused\n")
    assert not crowded("- since 2026-11-26 2 of `0:30`, 10 000\n")


def test_the_readme_is_a_screen_and_a_half() -> None:
    lines = LINK.sub("]", (ROOT / "README.md").read_text(encoding="utf-8")).splitlines()
    assert sum(max(1, -(-len(line) // 110)) for line in lines) <= 80, "docs/guide.md has room"


def test_nothing_cites_what_a_reader_does_not_have() -> None:
    files = [file for folder in FOLDERS - {"tests"} for file in (ROOT / folder).rglob("*.[pmty][ydoa]*")]
    citing = [file.relative_to(ROOT) for file in (*files, *PAGES) if file.is_file() and cites_a_note(file)]
    assert not citing


def cites_a_note(file: Path) -> bool:
    return bool(re.search(r"design note", file.read_text(encoding="utf-8", errors="replace")))


def test_each_fault_is_provoked_by_a_test() -> None:
    rows = FAULT.findall((ROOT / "docs" / "faults.md").read_text(encoding="utf-8"))
    assert len(rows) >= 20
    for fault, tests in rows:
        named = [word.partition("::") for word in CODE.findall(tests)]
        assert named, fault
        for file, _, test in named:
            assert f"def {test}(" in (ROOT / file).read_text(encoding="utf-8"), (fault, file, test)


def test_every_decision_is_in_the_index() -> None:
    index = ROW.findall((DECISIONS / "README.md").read_text(encoding="utf-8"))
    found = [
        (head.rstrip(".:"), path.name)
        for path in DECISIONS.glob("*.md")
        if path.name != "README.md"
        for head in DECISION.findall(path.read_text(encoding="utf-8"))
    ]
    assert sorted(index) == sorted(found)
