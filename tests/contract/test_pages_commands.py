"""Every `surefoot` command between backticks on the pages exists, with its options; the site takes every page in.

Those that are quick and need neither a system nor a recording are executed here as they stand;
`tests/e2e/test_page_commands.py` executes the others or names what does.
"""

import importlib.util
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from itertools import takewhile
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml

from surefoot.lab.cli.main import app, main

from .test_docs import BLOCK, CODE, PAGES, ROOT

ENDS = {"|", "&&", ";", "&", ">", "2>&1"}
QUICK = re.compile(
    "(-h|--help|--version|list|(topic|service|robot|schema) list|graph .+|(topic|service) info [a-z/]+|schema file .+|"
    "robot (check|show) ragno.*|robot export lupo .+|robot import lupo.xml .+|footholds show ragno|"
    r"security (init( ragno --host 10\.0\.0\.7)?|show ragno --grants))"
)
"""Commands without placeholders that take less than 3 s in an empty folder; sorted, an export precedes its import."""
WORD = re.compile(r"[a-z][a-z0-9|-]*")


def written(text: str) -> Iterator[list[str]]:
    """Yield the words of each command between backticks of a page, `a|b` taken apart, without comments and pipes."""
    for line in CODE.findall(BLOCK.sub("", text)):
        if not line.startswith("surefoot "):
            continue
        try:
            words = list(takewhile(lambda word: word not in ENDS, shlex.split(line, comments=True)[1:]))
        except ValueError:  # a piece of a command
            continue
        choices = words[0].split("|") if words and WORD.fullmatch(words[0]) else words[:1]
        yield from ([choice, *words[1:]] for choice in choices)


@cache
def commands() -> Any:
    """Return the tree of all commands, which takes 70 ms to build."""
    return typer.main.get_command(app)


def wrong(words: list[str]) -> str:
    """Return what no command knows of these words; empty if all is known."""
    command = commands()
    rest = list(words)
    while rest and hasattr(command, "commands") and WORD.fullmatch(rest[0]):
        if "|" in rest[0]:
            return "" if all(each in command.commands for each in rest[0].split("|")) else rest[0]
        if rest[0] not in command.commands:
            return rest[0]
        command = command.commands[rest.pop(0)]
    known = {option for param in command.params for option in (*param.opts, *param.secondary_opts)} | {"-h", "--help"}
    asked = [word.partition("=")[0] for word in rest if re.fullmatch(r"-{1,2}[a-z][a-z-]*(=.*)?", word)]
    return next((option for option in asked if option not in known), "")


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_commands_and_options_exist(path: Path) -> None:
    asked = list(written(path.read_text(encoding="utf-8")))
    assert {" ".join(words): wrong(words) for words in asked if wrong(words)} == {}


def test_quick_commands_work_as_they_stand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    found = {shlex.join(words) for path in PAGES for words in written(path.read_text(encoding="utf-8"))}
    quick = sorted(each for each in found if QUICK.fullmatch(each))
    if importlib.util.find_spec("cryptography") is None:
        quick = [each for each in quick if not each.startswith("security")]
    assert len(quick) > 12
    for each in quick:
        with pytest.raises(SystemExit) as ended:
            main(shlex.split(each))
        printed = capsys.readouterr()
        assert (ended.value.code or 0, bool(printed.out)) == (0, True), f"surefoot {each}: {printed.err}"


def test_a_wrong_command_or_option_is_found() -> None:
    text = "`surefoot rum flat`, `surefoot run|up flat --sede 3`, `surefoot bag export x --to tum | head  # -q`\n"
    assert [wrong(words) for words in written(text)] == ["rum", "--sede", "--sede", ""]


def test_the_site_names_every_page() -> None:
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    named = re.findall(r"[\w/-]+\.md", str(yaml.safe_load(text)["nav"]))
    pages = {path.relative_to(ROOT / "docs").as_posix() for path in PAGES if path.parent != ROOT}
    assert set(named) == pages | {"index.md", "examples.md", "changes.md", "library.md"}
    assert len(named) == len(set(named))


def test_the_site_is_built_and_asks_for_nothing_from_elsewhere(tmp_path: Path) -> None:
    if importlib.util.find_spec("mkdocs") is None or importlib.util.find_spec("mkdocstrings_handlers") is None:
        pytest.skip("no mkdocs: pip install -e '.[docs]'")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-d", str(tmp_path / "site")]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True, timeout=120)
    pages = list((tmp_path / "site").rglob("*.html"))
    assert len(pages) > len(PAGES)
    for page in pages:
        assert not re.search(r"<(script|link|img)[^>]*(src|href)=\"?https?://", page.read_text(encoding="utf-8")), page
    assert "Static stability" in (tmp_path / "site" / "library.html").read_text(encoding="utf-8")
