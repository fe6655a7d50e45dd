"""Output that all commands share: exit codes, JSON or tables, errors as one sentence."""

import errno
import json
import os
import re
import shutil
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from surefoot.errors import EXIT_USAGE

from .completion import robots
from .table import table_lines

EXIT_CHECK, EXIT_INTERRUPT = 1, 130
USAGE = (
    "unknown_topic", "unknown_query", "malformed", "invalid", "unknown_key", "not_installed", "unreadable", "not_found",
    "no_samples", "not_live", "unknown_name",
)  # fmt: skip
"""Error codes caused by the user's arguments or files; a command that fails with one exits with `EXIT_USAGE`."""
WRONG_PATH = (FileNotFoundError, FileExistsError, IsADirectoryError, NotADirectoryError)
"""Exceptions that a wrong path given by the user causes; those of a full or read-only disk are not among them."""

Json = Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")]
Connect = Annotated[
    str | None, typer.Option("--connect", help="Router of the system, e.g. tcp/127.0.0.1:7447 [SUREFOOT_CONNECT].")
]
Namespace = Annotated[
    str | None, typer.Option("--namespace", help="Prefix of its keys, e.g. surefoot/ragno [SUREFOOT_NAMESPACE].")
]
Listen = Annotated[
    str | None, typer.Option("--listen", help="Endpoint of the router, e.g. tcp/127.0.0.1:7448 [SUREFOOT_LISTEN].")
]
RobotChoice = Annotated[
    str | None,
    typer.Option("--robot", help="Name of a robot or its folder [that of the compose file].", autocompletion=robots),
]


@dataclass
class OutputState:
    """Settings of the command line's output: JSON or tables, log lines or plain lines."""

    debug: bool = False
    json: bool = False
    log: bool = False
    """True: notices are log lines with time and level; False: plain lines for people."""


state = OutputState()


def use_json(wanted: bool) -> bool:
    """Set the output format of this command: True: JSON, False: text for people; return `wanted`."""
    state.json = wanted
    return wanted


def write(text: str) -> None:
    """Write one line to the standard output."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def notify(text: str, level: str = "info") -> None:
    """Write a line for people, not for programs, to standard error, with time and level if `state.log` is True."""
    from surefoot.logline import log_line, write_line

    write_line(log_line(level, "supervisor", text.removeprefix("surefoot: ")) if state.log else text)


def near(path: Path) -> str:
    """Return a path as text: relative if it lies below the working folder, else absolute."""
    whole = path.resolve()
    return str(whole.relative_to(Path.cwd())) if whole.is_relative_to(Path.cwd()) else str(whole)


def refuse_existing(path: Path, *, force: bool, folder: bool = False) -> None:
    """Refuse to overwrite a file or non-empty folder unless `force`, or a file by a folder and the reverse.

    Args:
        path: file or folder that will be written.
        force: True: existing content may be overwritten; False: it is refused.
        folder: True: a folder will be written; False: a file.

    Raises:
        typer.BadParameter: the path is refused; the text names it.
        NotADirectoryError: a file stands where the path needs a folder.
    """
    refuse_unreachable(path, makes_folders=True)
    if path.exists() and path.is_dir() != folder:
        kinds = ("file", "folder") if folder else ("folder", "file")
        raise typer.BadParameter(f"{near(path)} is a {kinds[0]}, allowed is a {kinds[1]}")
    there = path.is_dir() and any(path.iterdir()) if path.is_dir() else path.exists()
    if there and not force:
        raise typer.BadParameter(f"{near(path)} exists; choose another name, or overwrite it with --force")


def refuse_unreachable(path: Path, *, makes_folders: bool) -> None:
    """Refuse a path to write to that lies in no folder, before the work whose result it is to hold.

    Args:
        path: file or folder that will be written.
        makes_folders: True: the command makes folders that are missing on the way; False: the last one must be there.

    Raises:
        NotADirectoryError: a file stands where the path needs a folder.
        FileNotFoundError: the folder is missing.
    """
    there = next((folder for folder in path.parents if folder.exists()), Path())
    if not there.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(path))
    if there != path.parent and not makes_folders:
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))


def write_json(content: Any) -> None:
    """Write one JSON value to the standard output."""
    write(json.dumps(content, indent=None if isinstance(content, str) else 1, default=_plain))


def write_answer(content: Any, text: str) -> None:
    """Write the result of a command to the standard output: `content` as JSON if `use_json` was set, else `text`."""
    if state.json:
        write_json(content)
    else:
        write(text)


def _plain(value: Any) -> Any:
    if hasattr(value, "model_dump"):
        return value.model_dump(mode="json")
    if hasattr(value, "__dataclass_fields__"):
        return {name: getattr(value, name) for name in value.__dataclass_fields__}
    return str(value)


def write_table(
    columns: Sequence[str], rows: Iterable[Sequence[Any]], title: str = "", right: Sequence[int] = ()
) -> None:
    """Write a table fitted to the width of the terminal (no limit in a pipe), then an empty line.

    `right`: indices of the right-aligned columns.
    """
    terminal = sys.stdout.isatty() and os.environ.get("TERM") != "dumb"
    width = shutil.get_terminal_size((0, 0)).columns or None
    if title:
        write(title)
    for line in table_lines(columns, rows, right, width, coloured=terminal and not os.environ.get("NO_COLOR")):
        write(line)
    write("")


def write_fields(fields: Mapping[str, Sequence[Mapping[str, str]]], title: str = "") -> None:
    """Write a table of fields for each model in `fields` (rows by model name), the outer model first."""
    for number, (model, rows) in enumerate(fields.items()):
        columns = ("field", "type", "default", "limits", "what it is")
        name = f"{title} {model}".strip() if number == 0 else model
        write_table(columns, [tuple(row[column] for column in columns) for row in rows], name)


def fail(error: Exception) -> int:
    """Write an error as one sentence (or one JSON object) and return the exit code of the command."""
    from surefoot.bus.endpoint import without_source

    code = str(getattr(error, "code", "") or "internal")
    said = str(error) if code != "not_found" or getattr(error, "file", "") else getattr(error, "message", str(error))
    message, field = without_source(said) or type(error).__name__, str(getattr(error, "field", None) or "")
    names = {field, field.replace("_", "-"), field.rpartition(".")[2]}
    if (
        field.isprintable()  # a line break in it stands quoted in the sentence
        and field
        and code != "not_found"
        and not any(re.search(rf"(?<!\w){re.escape(name)}(?!\w)", message) for name in names)
    ):
        message = f"{field}: {message}"
    exit_code = EXIT_CHECK
    if isinstance(error, OSError) and error.errno is not None:
        code = errno.errorcode.get(error.errno, code)
        where = error.filename or ("the working folder" if error.errno == errno.ENOENT else "")  # of os.getcwd
        message = f"{where}: {error.strerror}" if where else str(error.strerror)
    if _is_usage(error):
        exit_code = EXIT_USAGE
    elif not hasattr(error, "code") and not isinstance(error, OSError):
        message = f"internal error: {type(error).__name__}: {message} (surefoot --debug ... shows where)"
    if state.json:
        _write_error(code, message, getattr(error, "field", None) or None)
    else:
        notify(f"surefoot: {message}", "error")
    return exit_code


def misused(error: Any, *, json: bool) -> int:
    """Report a wrong command line, with its usage or as one JSON object; return the exit code."""
    if hasattr(cause := error.__cause__, "errors"):  # of pydantic, whose sentence leaves the value out
        error.message = f"{error.message.rstrip('.')} (got {cause.errors()[0]['input']!r})"
    if json:
        _write_error("usage", error.format_message(), getattr(getattr(error, "param", None), "name", None))
    else:
        error.show()
    return int(error.exit_code)


def _write_error(code: str, message: str, field: str | None) -> None:
    try:
        write_json({"error": {"code": code, "message": message, "field": field}})
    except OSError:  # a full disk behind the output
        notify(f"surefoot: {message}", "error")


def _is_usage(error: Exception) -> bool:
    """Return True if the user's arguments or files caused an error, False if the system did."""
    if getattr(error, "code", "") in USAGE or (isinstance(error, WRONG_PATH) and error.filename is not None):
        return True
    return any(kind.__name__ in ("TableError", "ConfigError") for kind in type(error).__mro__)
