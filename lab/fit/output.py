"""A fitted model as a TOML file, with the interval of each number beside it."""

from collections.abc import Sequence
from typing import Any

from surefoot.lab.fit.estimate import Fitted, Interval


def fitted_toml(found: Fitted, base: str, recordings: Sequence[str]) -> str:
    """Return the text of a model that extends `base` with what was fitted.

    Args:
        found: numbers by dotted key.
        base: name or file of the model that gives the rest.
        recordings: names of the files.
    """
    tables: dict[str, list[str]] = {"": [f'extends = "{base}"', 'name = "fitted"']}
    for key, interval in found.values.items():
        table, _, name = key.rpartition(".")
        tables.setdefault(table, []).append(f"{name} = {_number(name, interval)}{_comment(interval)}")
    lines = [f"# Fitted to {len(recordings)} recordings ({found.sightings} sightings); behind # the 95 % interval."]
    for table, entries in tables.items():
        lines += [*([f"[{table}]"] if table else []), *entries, ""]
    return "\n".join(lines)


def _number(name: str, interval: Interval) -> Any:
    return int(interval.value) if name == "frames" else f"{interval.value:.6g}"


def _comment(interval: Interval) -> str:
    if interval.low == interval.high:
        return ""
    samples = f", {interval.count} samples" if interval.count else ""
    return f"  # {interval.low:.4g} to {interval.high:.4g}{samples}"
