"""Command line, tables and clocks that all benchmarks share.

A benchmark file makes one `Bench` and registers its parts, functions whose parameters are the options: parameters
before ``/`` are arguments by position, the others ``--options``; "Args:" of the docstring and `COMMON` are their help.
"""

import argparse
import inspect
import math
import re
import resource
import time
import types
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

import numpy as np

from surefoot.errors import SurefootError

COMMON = {
    "seeds": "count, or first:end",
    "results": "file to continue with, one line a run; runs that it holds are not repeated",
    "processes": "runs at a time",
}
"""Help texts of the options that have one meaning in every part of a benchmark, by name of the option."""
F = TypeVar("F", bound=Callable[..., Any])
Call = Callable[[], object]


@dataclass(frozen=True)
class Part:
    """One part of a benchmark: the function that runs it, and its cheap options."""

    run: Callable[..., Any]
    quick: str | None
    """Options of the smallest run, of a few seconds, as on the command line; None = there is no cheap run."""


@dataclass
class Bench:
    """Parts of one benchmark file by name."""

    name: str
    parts: dict[str, Part] = field(default_factory=dict[str, Part])

    def part(self, quick: str | None = None) -> Callable[[F], F]:
        """Return a decorator that registers a function as a part of the benchmark, under the function's name.

        Args:
            quick: options of the smallest run, None = there is no cheap run.
        """

        def register(run: F) -> F:
            self.parts[run.__name__.strip("_").replace("_", "-")] = Part(run, quick)
            return run

        return register

    def main(self, words: Sequence[str]) -> None:
        """Run the part that the first word names, else the first part; without words run all parts.

        ``--quick`` stands for the options of the smallest run.
        """
        if not words or list(words) == ["--quick"]:
            for name, part in self.parts.items():
                if not words or part.quick is not None:
                    print(f"-- {name}", flush=True)
                    self._run(name, words)
        elif words[0] in ("-h", "--help") and len(self.parts) > 1:
            for name, part in self.parts.items():
                print(f"{name:12} {first_line(part.run.__doc__)}")
            print(
                f"\npython -m benchmarks {self.name} PART --help lists the options of a part; without one all are run"
            )
        else:
            self._run(*self.chosen(words))

    def chosen(self, words: Sequence[str]) -> tuple[str, Sequence[str]]:
        """Return the part that the first word names, else the first part, and the remaining words."""
        return (words[0], words[1:]) if words and words[0] in self.parts else (next(iter(self.parts)), words)

    def _run(self, name: str, words: Sequence[str]) -> None:
        part = self.parts[name]
        quick = (part.quick or "").split()
        given = [other for word in words for other in (quick if word == "--quick" else [word])]
        parser, parameters = parser_of(f"python -m benchmarks {self.name} {name}", part.run)
        values = vars(parser.parse_args(given))
        for p in parameters:
            if is_dataclass(p.annotation) and isinstance(p.annotation, type):
                values[p.name] = p.annotation(**{name: values.pop(name) for name in options_of(p.annotation)})
        at = [values.pop(p.name) for p in parameters if p.kind is p.POSITIONAL_ONLY]
        rest = [word for p in parameters if p.kind is p.VAR_POSITIONAL for word in values.pop(p.name)]
        part.run(*at, *rest, **values)


def first_line(docstring: str | None) -> str:
    """Return the first line of a docstring."""
    return (docstring or "").strip().partition("\n")[0]


def parser_of(program: str, run: Callable[..., Any]) -> tuple[argparse.ArgumentParser, list[inspect.Parameter]]:
    """Return the parser of a function's parameters, and these; fields of a dataclass are options of their own."""
    head, helps = described(inspect.getdoc(run) or "", "Args")
    helps = COMMON | helps
    parser = argparse.ArgumentParser(program, description=head, formatter_class=argparse.RawDescriptionHelpFormatter)
    parameters = list(inspect.signature(run).parameters.values())
    for p in parameters:
        about = helps.get(p.name, "")
        if is_dataclass(p.annotation):
            known = {each.name: each for each in fields(p.annotation)}
            for name, words in options_of(p.annotation).items():
                _add(parser, name, known[name].type, known[name].default, words)
        elif p.kind is p.VAR_POSITIONAL:
            parser.add_argument(p.name, nargs="*", help=about)
        elif p.kind is p.POSITIONAL_ONLY:
            parser.add_argument(p.name, nargs="?", default=p.default, help=about, **_values(p.annotation))
        else:
            _add(parser, p.name, p.annotation, p.default, about)
    return parser, parameters


def described(text: str, section: str) -> tuple[str, dict[str, str]]:
    """Return the part of a docstring before a section, and the texts of the names in this section."""
    head, _, tail = text.partition(f"\n{section}:\n")
    found = re.findall(r"^    (\w+): (.*(?:\n {8}.*)*)", tail, re.MULTILINE)
    return head, {name: " ".join(words.split()).replace("%", "%%") for name, words in found}


def options_of(group: Any) -> dict[str, str]:
    """Return the fields of a dataclass that are options, and their help: those below "Attributes:" of its docstring."""
    return described(inspect.getdoc(group) or "", "Attributes")[1]


def _add(parser: argparse.ArgumentParser, name: str, annotation: Any, default: Any, about: str) -> None:
    """Add to a parser the option of a function's parameter; a trailing underscore of its name is left out."""
    option = f"--{name.rstrip('_').replace('_', '-')}"
    about += "" if default in (None, "", False) else f" (default: {default})".replace("%", "%%")
    if annotation is bool:
        parser.add_argument(option, dest=name, action="store_true", help=about)
    else:
        parser.add_argument(option, dest=name, default=default, help=about, **_values(annotation))


def _values(annotation: Any) -> dict[str, Any]:
    """Return the keywords of `add_argument` for an annotation: choices, or a type that accepts finite numbers only."""
    kind = get_args(annotation)[0] if get_origin(annotation) in (Union, types.UnionType) else annotation
    if get_origin(kind) is Literal:
        return {"choices": get_args(kind)}
    return {"type": finite_number if kind is float else kind}


def finite_number(text: str) -> float:
    """Return the finite number in an option's text; any other text raises an error that the parser reports."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a finite number")
    return value


def words_of(text: str) -> tuple[str, ...]:
    """Return the items of a comma-separated list; an empty text has none."""
    return tuple(word.strip() for word in text.split(",")) if text else ()


def numbers_of(text: str) -> tuple[float, ...]:
    """Return the numbers of a comma-separated list (raises SurefootError: an item is no number)."""
    try:
        return tuple(float(word) for word in words_of(text))
    except ValueError:
        raise SurefootError("invalid", f"got {text!r}, must be numbers, by commas") from None


def cell(value: object) -> str:
    """Return a value as text: floats with four digits, None as nothing."""
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def table(title: str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a table: the first column to the left, the others to the right."""
    texts = [list(header), *([cell(value) for value in row] for row in rows)]
    widths = [max(len(row[k]) for row in texts if k < len(row)) for k in range(len(header))]
    print(title, flush=True)
    for row in texts:
        cells = [text.rjust(width) for text, width in zip(row[1:], widths[1:], strict=False)]
        print("  ".join(["", row[0].ljust(widths[0]), *cells]).rstrip(), flush=True)


def goal(
    what: str, value: float, relation: Literal["<=", ">="] = "<=", bound: float | None = None, unit: str = ""
) -> None:
    """Print a figure, its goal `relation` `bound`, and whether it is met; without a bound the figure only."""
    shown = f"{what:52} {value:12.4g} {unit}"
    if bound is not None:
        met = value <= bound if relation == "<=" else value >= bound
        shown += f"   goal {relation} {bound:g}: {'met' if met else 'MISSED'}"
    print(shown.rstrip(), flush=True)


def best_of(function: Call, blocks: int = 5, calls: int = 1, clock: Callable[[], float] = time.perf_counter) -> float:
    """Return the smallest mean time of a call over blocks of calls, s, after one call to warm up.

    Short blocks find a moment in which a busy machine is idle.
    """
    function()
    best = float("inf")
    for _ in range(blocks):
        began = clock()
        for _ in range(calls):
            function()
        best = min(best, (clock() - began) / calls)
    return best


def in_turns(functions: dict[str, Call], rounds: int = 30) -> dict[str, float]:
    """Return the smallest time of each call, s, over rounds in which all take turns."""
    best = dict.fromkeys(functions, float("inf"))
    for function in functions.values():
        function()
    for _ in range(rounds):
        for name, function in functions.items():
            best[name] = min(best[name], seconds_of(function))
    return best


def seconds_of(function: Call, clock: Callable[[], float] = time.perf_counter) -> float:
    """Return the time of one call, s."""
    began = clock()
    function()
    return clock() - began


def children_s() -> float:
    """Return the processor time of all child processes that have ended, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def of_children(function: Call) -> tuple[float, float]:
    """Return the processor time of the child processes that a call waits for, and its wall time, s."""
    before, began = children_s(), time.monotonic()
    function()
    wall = time.monotonic() - began
    return children_s() - before, wall


def microseconds(costs: Sequence[float]) -> tuple[float, float]:
    """Return the median and the 99th percentile of times in s, us."""
    return round(1e6 * float(np.median(costs)), 1), round(1e6 * float(np.percentile(costs, 99)), 1)
