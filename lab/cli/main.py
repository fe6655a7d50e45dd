"""Command line `surefoot`: one module for each command, of which only that of the typed one is imported."""

import os
import shutil
import signal
import sys
import threading
from collections.abc import Sequence
from importlib import import_module

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy, as in every service

import typer

from surefoot.errors import EXIT_USAGE

from .compiling import compilation_reported, costs_of
from .index import INDEX
from .needed import COMPLETING, needed, nothing, typed
from .output import EXIT_CHECK, EXIT_INTERRUPT, fail, misused, notify, state
from .rooms import paper_commands, room_modules


def program() -> typer.Typer:
    """Return the app of the program with its own options and no command."""
    empty = typer.Typer(
        name="surefoot",
        help="Support stack for legged robots: run scenarios, start and watch services, talk to them.",
        no_args_is_help=True,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    empty.callback()(common)
    return empty


def _narrow() -> dict[str, int]:
    """Return click's setting for help texts on a terminal below 52 columns, which it would fill as if it had 52."""
    columns = shutil.get_terminal_size().columns
    return {"terminal_width": columns - 2} if 20 < columns < 52 else {}


def whole() -> typer.Typer:
    """Return the app with all commands, for shell completion and unknown words; imports all their modules."""
    app = program()
    rooms = dict.fromkeys(entry.module for entry in INDEX.values() if not entry.function)
    for name, entry in INDEX.items():
        if entry.function:
            _add(app, name)
    for module in (*rooms, *(each for each in room_modules() if each not in rooms)):
        app.add_typer(import_module(f"surefoot.lab.{module}").app)
    app.add_typer(paper_commands())
    return app


def app_for(words: Sequence[str]) -> typer.Typer:
    """Return the app for the words of a command line: one command, or names and help texts of all if they name none."""
    name = typed(words)
    if COMPLETING in os.environ or (name is not None and name not in INDEX):
        return needed(whole(), words)
    app = program()
    if name is not None:
        _add(app, name)
        return needed(app, words)
    for each, entry in INDEX.items():
        app.command(each, help=entry.help)(nothing)
    app.add_typer(paper_commands())
    return needed(app, words)


def _add(app: typer.Typer, name: str) -> None:
    """Add a command of the index to an app, or all that its module has where that has an app of its own."""
    entry = INDEX[name]
    module = import_module(f"surefoot.lab.{entry.module}")
    if entry.function:
        app.command(name)(getattr(module, entry.function))
    else:
        app.add_typer(module.app)


def __getattr__(name: str) -> typer.Typer:
    """Return the whole app as `app`, made at its first use."""
    if name != "app":
        raise AttributeError(name)
    return globals().setdefault("app", whole())


def _version(wanted: bool) -> None:
    if wanted:
        from surefoot.version import VERSION

        sys.stdout.write(VERSION + "\n")
        raise typer.Exit


def common(
    debug: bool = typer.Option(False, "--debug", help="Show tracebacks of errors."),
    version: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Show the version."),
) -> None:
    """Set the options that all commands share: tracebacks of errors, version."""
    state.debug = debug


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; exit code 0: ok, 1: a check failed, 2: usage error, 130: interrupted.

    SIGTERM, and SIGHUP of a terminal that is closed, end a command as Ctrl-C does, so that the command removes
    half-written files.
    """
    for number in (signal.SIGTERM, signal.SIGHUP):
        if threading.current_thread() is threading.main_thread() and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, signal.default_int_handler)
    words = sys.argv[1:] if arguments is None else arguments
    try:
        with compilation_reported(notify, costs_of(words)):
            code = app_for(words)(args=words, prog_name="surefoot", standalone_mode=False, **_narrow())
        sys.exit(code if isinstance(code, int) else 0)
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPT)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the reader has gone
        sys.exit(EXIT_CHECK)
    except Exception as error:
        if hasattr(error, "show"):  # typer's own: words that are no use of the command
            sys.exit(misused(error, json="--json" in words))
        if state.debug:
            raise
        sys.exit(fail(error))


__all__ = ["EXIT_CHECK", "EXIT_INTERRUPT", "EXIT_USAGE", "main"]

if __name__ == "__main__":
    main()
