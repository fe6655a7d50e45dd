"""The part of the command line that is built: one command, or outlines of all, as the whole shows them."""

import os
import subprocess
import sys

import pytest
import typer

from surefoot.lab.cli import main as cli
from surefoot.lab.cli.needed import COMPLETING, needed, outline

WHOLE = typer.main.get_command(cli.app)


def helped(app, words):
    """Return the help that an app prints for a command, by its words."""
    command = typer.main.get_command(app) if isinstance(app, typer.Typer) else app
    context = command.make_context("surefoot", [], resilient_parsing=True)
    for word in words:
        command = command.commands[word]
        context = command.make_context(word, [], parent=context, resilient_parsing=True)
    return command.get_help(context)


def places(command, words=()):
    """Yield the words of a group and of all below it."""
    yield words
    for name, each in getattr(command, "commands", {}).items():
        yield from places(each, (*words, name))


def count(command):
    return sum(1 + count(each) for each in getattr(command, "commands", {}).values())


@pytest.mark.parametrize("words", sorted(places(WHOLE)), ids=" ".join)
def test_help_is_that_of_the_whole(words):
    assert helped(needed(cli.app, [*words, "--help"]), words) == helped(WHOLE, words)


@pytest.mark.parametrize("words", sorted(places(WHOLE)), ids=" ".join)
def test_what_the_program_builds_helps_as_the_whole(words):
    assert helped(cli.app_for([*words, "--help"]), words) == helped(WHOLE, words)


@pytest.mark.parametrize("columns", [40, 63, 300])
def test_the_index_has_the_help_texts_of_the_commands(columns, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))
    assert helped(cli.app_for(["--help"]), []) == helped(WHOLE, [])
    assert list(typer.main.get_command(cli.app_for([])).commands) == list(WHOLE.commands)


@pytest.mark.parametrize("words", [["--help"], ["status"], ["fit", "--help"]])
def test_a_command_imports_no_other(words, tmp_path):
    code = (
        f"import sys; from surefoot.lab.cli.entry import main\ntry: main({words})\nexcept SystemExit: pass\n"
        "import surefoot.lab.cli.index as index\n"
        "loaded = [name for name, each in index.INDEX.items() if 'surefoot.lab.' + each.module in sys.modules]\n"
        "print(*loaded, *[name for name in ('zenoh', 'numpy', 'surefoot.schemas') if name in sys.modules])"
    )
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(tmp_path), "XDG_STATE_HOME": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    others = {"up", "down", "status", "logs", "health", "supervise", "view", "fit"}  # one module; it has --view
    loaded = set(done.stdout.splitlines()[-1].split())
    assert loaded <= others
    assert ("status" in loaded) == (words == ["status"])


@pytest.mark.parametrize("words", [words for words in places(WHOLE) if words], ids=" ".join)
def test_one_command_is_built_for_its_words(words):
    part = typer.main.get_command(needed(cli.app, ["--debug", *words]))
    inside = part
    for word in words:
        assert list(inside.commands) == [word]
        inside = inside.commands[word]


def test_words_that_name_nothing_get_the_whole_and_its_near_words():
    assert count(typer.main.get_command(needed(cli.app, ["nothing"]))) == count(WHOLE)


def test_an_outline_has_no_options():
    outlined = typer.main.get_command(outline(cli.app))
    assert set(outlined.commands) == set(WHOLE.commands)
    assert {parameter.name for each in outlined.commands.values() for parameter in each.params} == set()


def test_a_shell_that_completes_gets_the_whole(monkeypatch):
    monkeypatch.setenv(COMPLETING, "complete_bash")
    assert needed(cli.app, []) is cli.app


@pytest.mark.parametrize(
    ("module", "absent"),
    [
        ("surefoot.client", ("asyncio", "numpy", "numba", "scipy", "jsonschema", "mcap")),
        ("surefoot.schemas.topics", ("importlib.metadata", "numpy")),
        ("surefoot.services.supervisor.processes.status", ("numpy", "surefoot.schemas.sim")),
        (
            "surefoot.lab.cli.main",
            ("asyncio", "importlib.metadata", "pydantic", "rich", "surefoot.schemas"),
        ),
    ],
)
def test_what_every_command_imports_is_light(module, absent):
    code = f"import {module}, sys; print([name for name in {absent} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
