"""Mutation of guards: each check that decides or refuses is removed in turn, and a test must notice.

`python -m tests.mutants [MODULE ...] [--most N] [--results FILE]` prints what survived. The tests of a module run once
while the lines are noted that each of them takes; a mutant then runs those alone that take its line, first those in
which the check refuses, until one fails. Each run is a fork of a process that has imported what tests need from others,
so none starts anew.
A module that refuses nothing decides by what it returns: there each early return and each filter counts as a check.
Compiled kernels do not follow a mutant, so tests of a module that has some run them as plain Python.
The campaigns of `test_chaos` are left out, because they take too long for every check.
"""

import argparse
import ast
import copy
import faulthandler
import importlib.abc
import importlib.machinery
import json
import os
import re
import resource
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from tests.guards import GUARDS

ROOT = Path(__file__).parents[1]
LIMIT_S = 30.0
"""Processor time of the tests of one mutant, s; one that never ends is noticed, too."""
BASELINE_S = 300.0
SKIPPED = "not slow and not e2e"
UNTRACED = ("--ignore=tests/surefoot/lockstep/test_chaos.py", "--ignore=tests/surefoot/lockstep/test_zenoh_run.py")
"""Tests that take too long for every mutant."""
IDLE_S = 20.0
"""Time without work after which a run is ended, s: a mutant may wait for ever."""

CHECKS = re.compile(r"_?(check|refuse|require|verify|validate|belonging|finite|count_result)")
"""Names of functions that a statement calls for their refusal alone."""
LIMITS = {"ge", "gt", "le", "lt", "min_length", "max_length", "pattern", "allow_inf_nan", "strict", "extra"}
"""Keywords of pydantic that refuse a value."""


@dataclass(frozen=True)
class Mutant:
    """One check removed."""

    line: int
    what: str
    refusal: int
    """Line that is taken when the check refuses; that of the check where it has none of its own."""
    code: CodeType

    def describe(self, source: list[str]) -> str:
        return f"{self.line}: {self.what}: {source[self.line - 1].strip()}"


# -- the mutants of a module -------------------------------------------------------------------------------------------


def mutants(text: str, path: str) -> Iterator[Mutant]:
    """Yield a module with each of its checks removed."""
    removals = _removals if any(_removals(ast.parse(text))) else _omissions
    for number in range(sum(1 for _ in removals(ast.parse(text)))):
        tree = ast.parse(text)
        line, what, refusal, remove = next(item for n, item in enumerate(removals(tree)) if n == number)
        remove()
        yield Mutant(line, what, refusal, compile(ast.fix_missing_locations(tree), path, "exec"))


def _removals(tree: ast.Module) -> Iterator[tuple[int, str, int, Callable[[], None]]]:
    """Yield line, description, line of the refusal and removal of each check of a tree, always in the same order."""
    for node in ast.walk(tree):
        body = node.body[0].lineno if isinstance(node, ast.If | ast.ExceptHandler) else 0
        for line, what, remove in _removals_at(node):
            yield line, what, body or line, remove


def _omissions(tree: ast.Module) -> Iterator[tuple[int, str, int, Callable[[], None]]]:
    """Yield the same of each early return and each filter of a tree."""
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and isinstance(node.body[-1], ast.Return):
            yield node.lineno, "never returned", node.body[0].lineno, _setter(node, "test", ast.Constant(False))
        elif isinstance(node, ast.comprehension):
            for part in node.ifs:
                rest = [other for other in node.ifs if other is not part]
                unknown = {item.target.id for item in ast.walk(part) if isinstance(item, ast.NamedExpr)}
                kept = [ast.BoolOp(ast.Or(), [part, ast.Constant(True)])] if unknown else []
                yield (
                    part.lineno,
                    f"without `{ast.unparse(part)[:60]}`",
                    part.lineno,
                    _setter(node, "ifs", [*rest, *kept]),
                )


def _removals_at(node: ast.AST) -> Iterator[tuple[int, str, Callable[[], None]]]:
    """Yield line, description and removal of each check that a node is."""
    if isinstance(node, ast.If) and _refuses(node.body):
        yield node.lineno, "never refused", _setter(node, "test", ast.Constant(False))
        yield from _weaker(node, "test", wanted=False)
    elif isinstance(node, ast.Return) and isinstance(node.value, ast.BoolOp | ast.Compare):
        yield from _weaker(node, "value", wanted=True)
        yield from _weaker(node, "value", wanted=False)
    elif isinstance(node, ast.IfExp):
        for name in ("body", "orelse"):
            if isinstance(getattr(node, name), ast.Compare):
                yield node.lineno, f"always met: {name}", _setter(node, name, ast.Constant(True))
    elif isinstance(node, ast.ExceptHandler) and _refuses(node.body):
        if isinstance(node.body[0], ast.Raise) and node.body[0].exc is None:  # passed on past the handlers below
            yield node.lineno, "taken by another handler", _setter(node, "type", ast.Tuple([], ast.Load()))
        else:
            raised = ast.copy_location(ast.Raise(), node)
            yield node.lineno, "error passed on", _setter(node, "body", [raised])
    elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call) and CHECKS.match(_name(node.value)):
        yield node.lineno, "not called", _setter(node, "value", ast.Constant(None))
    elif isinstance(node, ast.Call) and (_name(node) in ("Field", "ConfigDict")):
        for keyword in [keyword for keyword in node.keywords if keyword.arg in LIMITS]:
            rest = [other for other in node.keywords if other is not keyword]
            yield keyword.value.lineno, f"without {keyword.arg}", _setter(node, "keywords", rest)


def _weaker(owner: ast.AST, name: str, *, wanted: bool) -> Iterator[tuple[int, str, Callable[[], None]]]:
    """Yield a condition without each of the parts that make it other than ``wanted``."""
    node = getattr(owner, name)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield from _weaker(node, "operand", wanted=not wanted)
    elif isinstance(node, ast.BoolOp) and isinstance(node.op, ast.And if wanted else ast.Or):
        for place, part in enumerate(node.values):
            rest = node.values[:place] + node.values[place + 1 :]
            yield (
                part.lineno,
                f"without `{ast.unparse(part)[:60]}`",
                _setter(node, "values", [*rest, ast.Constant(wanted)]),
            )
    elif isinstance(node, ast.Compare) and len(node.ops) > 1 and wanted:
        first = ast.Compare(node.left, node.ops[:1], node.comparators[:1])
        last = ast.Compare(node.comparators[-2], node.ops[-1:], node.comparators[-1:])
        for kept, lost in ((first, last), (last, first)):
            yield node.lineno, f"without `{ast.unparse(lost)[:60]}`", _setter(owner, name, copy.deepcopy(kept))


def _setter(node: Any, name: str, value: Any) -> Callable[[], None]:
    return lambda: setattr(node, name, value)


def _name(call: ast.Call) -> str:
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


def _refuses(body: list[ast.stmt]) -> bool:
    """Return whether statements end by leaving, with no result but a reason, a flag or nothing."""
    last = body[-1]
    if isinstance(last, ast.Return):
        plain = isinstance(last.value, ast.Constant | None) or (
            isinstance(last.value, ast.Tuple) and not last.value.elts
        )
        called = isinstance(last.value, ast.Call) and CHECKS.match(_name(last.value))
        return plain or bool(called) or isinstance(last.value, ast.JoinedStr)
    if isinstance(last, ast.Expr) and isinstance(last.value, ast.Call):
        return bool(CHECKS.match(_name(last.value)))
    return isinstance(last, ast.Raise | ast.Continue)


# -- running tests in forks --------------------------------------------------------------------------------------------


class _Mutated(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Gives one module another code."""

    def __init__(self, name: str, path: Path, code: CodeType) -> None:
        self.name, self.path, self.code = name, path, code

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> importlib.machinery.ModuleSpec | None:
        if name != self.name:
            return None
        return importlib.machinery.ModuleSpec(name, self, origin=str(self.path))

    def exec_module(self, module: Any) -> None:
        module.__file__ = str(self.path)
        exec(self.code, module.__dict__)


class _Lines:
    """Pytest plug-in that notes which lines of the guarded modules each passed test takes, and how long it takes."""

    def __init__(self) -> None:
        self.names = {str(ROOT / name): name for name in GUARDS}
        self.known, self.taken = dict[str, str | None](), dict[str, set[int]]()
        self.found = dict[str, tuple[float, dict[str, list[int]]]]()

    def _trace(self, frame: FrameType, event: str, argument: Any) -> Any:
        name = frame.f_code.co_filename
        if name not in self.known:
            self.known[name] = self.names.get(os.path.realpath(name))
        module = self.known[name]
        if module is None:
            return None
        lines = self.taken.setdefault(module, set())
        lines.add(frame.f_lineno)

        def note(frame: FrameType, event: str, argument: Any) -> Any:
            lines.add(frame.f_lineno)
            return note

        return note

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self.taken = {}
        threading.settrace(self._trace)  # of servers that tests start
        sys.settrace(self._trace)

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.when == "call" and report.passed:
            self.found[report.nodeid] = (report.duration, {})

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        sys.settrace(None)
        threading.settrace(None)  # type: ignore[arg-type]
        if nodeid in self.found:
            taken = {module: sorted(lines) for module, lines in self.taken.items()}
            self.found[nodeid] = (self.found[nodeid][0], taken)


def _forked(work: Callable[[], int], limit_s: float) -> int:
    """Return the exit code of work in a child process without output; -signal when it was ended."""
    child = os.fork()
    if child == 0:
        code = 70
        try:
            silent = os.open(os.devnull, os.O_WRONLY)
            os.dup2(silent, 1)
            os.dup2(silent, 2)
            resource.setrlimit(resource.RLIMIT_CPU, (int(limit_s), int(limit_s) + 1))
            os.setpgid(0, 0)
            code = work()
        except BaseException:
            traceback.print_exc()
            raise
        finally:
            os._exit(code)
    worked, since = 0, time.monotonic()
    while time.monotonic() - since < IDLE_S:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        if (now := _work_of(child)) != worked:
            worked, since = now, time.monotonic()
        time.sleep(0.02)
    with suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return -signal.SIGKILL


def _work_of(process: int) -> int:
    """Return the processor time of a process and of the children that it has waited for, in steps of the clock."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:15]))


def _plain_kernels() -> None:
    """Let kernels be the functions that they are made of."""
    from surefoot.kernels import box, jit

    class PlainBox:
        def __class_getitem__(cls, _: Any) -> type:
            return cls

        def __init__(self, parts: Any) -> None:
            self.parts = parts

    def plain(function: Any, **options: Any) -> Any:
        return function

    box.KernelBox, jit._compiled = PlainBox, plain  # type: ignore[misc, assignment]


def _pytest(words: list[str], plugins: list[Any]) -> int:
    import pytest

    faulthandler.disable()
    return int(
        pytest.main(
            [*words, "-q", "-p", "no:cacheprovider", "-W", "ignore::pytest.PytestAssertRewriteWarning"], plugins=plugins
        )
    )


Known = dict[str, tuple[float, dict[str, list[int]]]]
"""Duration, and lines of each guarded module, of each test that passes."""


@cache
def lines_of(tests: str, *, plain: bool) -> Known:
    """Return what the tests of a folder or file take, with plain kernels or compiled ones."""
    with tempfile.TemporaryDirectory() as folder:
        kept = Path(folder) / "lines.json"

        def work() -> int:
            if plain:
                _plain_kernels()
            plugin = _Lines()
            code = _pytest([tests, "-m", SKIPPED, *UNTRACED], [plugin])
            kept.write_text(json.dumps(plugin.found))
            return code

        _forked(work, BASELINE_S)
        return json.loads(kept.read_text()) if kept.exists() else {}


def survives(path: Path, mutant: Mutant, tests: list[str], *, plain: bool) -> bool:
    """Return whether all of these tests pass with a mutant in the place of its module."""
    name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    name = name if name.startswith("surefoot.") else f"surefoot.{name}"

    def work() -> int:
        if plain:
            _plain_kernels()
        sys.meta_path.insert(0, _Mutated(name, path, mutant.code))
        return _pytest([*tests, "-x"], [])

    return _forked(work, LIMIT_S) == 0


MOST_TESTS = 40
"""Tests that a mutant runs at most: first those in which its check refuses, the quickest of each kind."""


def study(module: str, most: int | None, show: Callable[[str], None]) -> dict[str, Any]:
    """Remove each check of a module; return counts and survivors."""
    path = ROOT / module
    text = path.read_text(encoding="utf-8")
    found = list(mutants(text, str(path)))
    step = 1 if most is None else max(1, -(-len(found) // most))
    chosen, survivors = found[::step], list[str]()
    plain = "@kernel" in text
    known = {node: item for tests in GUARDS[module] for node, item in lines_of(tests, plain=plain).items()}
    taken = {node: (took, lines[module]) for node, (took, lines) in known.items() if module in lines}
    for mutant in chosen:
        nodes = sorted(
            (mutant.refusal not in lines, took, node) for node, (took, lines) in taken.items() if mutant.line in lines
        )
        nodes = nodes[:MOST_TESTS]
        if mutant.what.partition(" ")[2] in LIMITS:  # of a class: taken by no test but by the import of the module
            nodes = sorted((False, took, node) for node, (took, _) in known.items())
        if not nodes or survives(path, mutant, [node for *_, node in nodes], plain=plain):
            survivors.append(mutant.describe(text.splitlines()) + ("" if nodes else " (no test takes it)"))
            show(f"  {module}:{survivors[-1]}")
    return {"module": module, "checks": len(chosen), "killed": len(chosen) - len(survivors), "survivors": survivors}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("modules", nargs="*", metavar="MODULE", help="path of a module, or a part of it [all]")
    parser.add_argument("--most", type=int, help="checks of each module, evenly spread [all]")
    parser.add_argument("--results", type=Path, help="file to which the result of each module is appended, as JSON")
    arguments = parser.parse_args()
    os.chdir(ROOT)
    for heavy in ("numpy", "scipy.spatial", "pydantic", "numba", "mcap.reader", "pytest", "hypothesis", "yaml"):
        __import__(heavy)
    chosen = [name for name in GUARDS if not arguments.modules or any(word in name for word in arguments.modules)]
    if not chosen:
        parser.error(f"got {' '.join(arguments.modules)}, known are {', '.join(GUARDS)}")
    checks = killed = 0
    for module in chosen:
        began = time.monotonic()
        result = study(module, arguments.most, lambda text: print(text, flush=True))
        checks, killed = checks + result["checks"], killed + result["killed"]
        print(
            f"{module}: {result['killed']} of {result['checks']} noticed, {time.monotonic() - began:.0f} s", flush=True
        )
        if arguments.results is not None:
            with arguments.results.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(result) + "\n")
    print(f"{killed} of {checks} removed checks noticed ({100.0 * killed / max(1, checks):.1f} %)")


if __name__ == "__main__":
    main()
