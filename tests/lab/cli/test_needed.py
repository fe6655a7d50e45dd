"""The part of the command line that is built: one command, or outlines of all, as the whole shows them."""

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
