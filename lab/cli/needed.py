"""Reduction of a typer app to the command that was typed, so that typer does not build the options of all others."""

import inspect
import math
import os
from collections.abc import Callable, Iterator, Sequence
from copy import copy
from functools import wraps
from typing import Any, cast

import typer
from typer.models import ArgumentInfo

from surefoot.errors import FieldError

COMPLETING = "_SUREFOOT_COMPLETE"
"""Environment variable that a shell sets when it asks for completions of a command line."""


def needed(app: typer.Typer, words: Sequence[str]) -> typer.Typer:
    """Return an app with only the command that `words` name; if they name none, all commands without their options.

    Shell completion and unknown words get the whole app.
    """
    if COMPLETING in os.environ:
        return app
    name = typed(words)
    return outline(app) if name is None else _named(app, name, words[words.index(name) + 1 :]) or app


def typed(words: Sequence[str]) -> str | None:
    """Return the first word that is no option, the name of a command; None without one."""
    return next((word for word in words if not word.startswith("-")), None)


def outline(app: typer.Typer) -> typer.Typer:
    """Return a copy of an app whose commands keep name and help text but no options, enough for the help of a group."""
    commands = [
        _changed(each, name=_command(each), callback=nothing, help=each.help or inspect.getdoc(each.callback))
        for each in app.registered_commands
    ]
    groups = [
        _changed(group, typer_instance=_part(inside) if name else outline(inside))
        for group, name, inside in _groups(app)
    ]
    return _part(app, commands, groups)


def _named(app: typer.Typer, name: str, rest: Sequence[str]) -> typer.Typer | None:
    """Return an app with only the command or group of this name, for the words `rest` after it; None if absent."""
    for command in app.registered_commands:
        if _command(command) == name:
            return _part(app, [_changed(command, callback=_finite(cast("Callable[..., Any]", command.callback)))])
    for group, own, inside in _groups(app):
        part = needed(inside, rest) if own == name else None if own else _named(inside, name, rest)
        if part is not None:
            return _part(app, [], [_changed(group, typer_instance=part)])
    return None


def _finite(callback: Callable[..., Any]) -> Callable[..., Any]:
    """Return the command function with a check that refuses NaN and infinity in numeric options, naming the option."""

    @wraps(callback)
    def checked(**values: Any) -> Any:
        for field, value in values.items():
            if isinstance(value, float) and not math.isfinite(value):
                given = inspect.signature(callback).parameters[field]
                stated = (given.default, *getattr(given.annotation, "__metadata__", ()))
                argument = any(isinstance(each, ArgumentInfo) for each in stated)
                word = field if argument else f"--{field.replace('_', '-')}"
                raise FieldError("invalid", word, f"got {value:g}, allowed are finite numbers")
        return callback(**values)

    return checked


def _groups(app: typer.Typer) -> Iterator[tuple[Any, str, typer.Typer]]:
    """Yield (group, name, its app) of each group of an app; an empty name: its commands belong to the app itself."""
    for group in app.registered_groups:
        inside = cast("typer.Typer", group.typer_instance)
        yield group, next((name for name in (group.name, inside.info.name) if isinstance(name, str)), ""), inside


def _command(command: Any) -> str:
    return command.name or typer.main.get_command_name(command.callback.__name__)


def _part(app: typer.Typer, commands: Sequence[Any] = (), groups: Sequence[Any] = ()) -> typer.Typer:
    return _changed(app, registered_commands=list(commands), registered_groups=list(groups))


def _changed(whole: Any, **fields: Any) -> Any:
    part = copy(whole)
    vars(part).update(fields)
    return part


def nothing() -> None:
    """Do nothing, in place of a command whose name and help text alone are shown."""
