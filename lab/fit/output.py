"""Fitted navigation model as a TOML file, with the 95 % interval of each value as a comment."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from surefoot.errors import SurefootError
from surefoot.services.navigator.policy.params import NavigationModel, load

from .result import Fitted, Interval


def fitted_toml(found: Fitted, base: str, recordings: Sequence[str]) -> str:
    """Return the TOML text of a navigation model that extends the model `base` by the fitted values.

    Args:
        found: fitted values by dotted key.
        base: name or file of the model from which all other values are taken.
        recordings: names of the recordings.
    """
    tables: dict[str, list[str]] = {"": [f'extends = "{base}"', 'name = "fitted"']}
    for key, interval in found.values.items():
        table, _, name = key.rpartition(".")
        tables.setdefault(table, []).append(f"{name} = {_number(name, interval)}{_comment(interval)}")
    lines = [f"# Fitted to {len(recordings)} recordings ({found.sightings} sightings); behind # the 95 % interval."]
    for table, entries in tables.items():
        lines += [*([f"[{table}]"] if table else []), *entries, ""]
    return "\n".join(lines)


def check_out(out: Path, base: str) -> None:
    """Raise SurefootError if the file of the fitted model does not end in .toml, or is the file of its base model.

    Args:
        out: file to write.
        base: name or file of the model that it will extend.
    """
    if out.suffix != ".toml":
        raise SurefootError("invalid", f"got {str(out)!r}, allowed is a file *.toml", "out")
    if base.endswith(".toml") and Path(base).resolve() == out.resolve():
        raise SurefootError("invalid", f"got {str(out)!r}, allowed is another file than that of --params", "out")


def write_model(found: Fitted, base: str, recordings: Sequence[str], out: Path) -> NavigationModel:
    """Write the fitted model and return it; an existing file stays unchanged if the model is invalid.

    Args:
        found: fitted values by dotted key.
        base: name or file of the model from which all other values are taken.
        recordings: names of the recordings.
        out: TOML file to write.

    Raises:
        ConfigError: the values make no valid model; nothing is written.
    """
    if base.endswith(".toml"):
        base = Path(os.path.relpath(base, out.parent)).as_posix()
    trial = out.with_name(f".{out.stem}.{os.getpid()}.toml")
    try:
        trial.write_text(fitted_toml(found, base, recordings), encoding="utf-8")
        model = load(trial)
        trial.replace(out)
    finally:
        trial.unlink(missing_ok=True)
    return model


def _number(name: str, interval: Interval) -> Any:
    return int(interval.value) if name == "frames" else f"{round(interval.value, 9):.6g}"


def _comment(interval: Interval) -> str:
    low, high = (f"{round(end, 9):.4g}" for end in (interval.low, interval.high))
    samples = f", {interval.count} samples" if interval.count else ""
    return "" if low == high else f"  # {low} to {high}{samples}"
