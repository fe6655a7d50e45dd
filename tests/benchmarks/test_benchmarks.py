"""Every benchmark is imported, lists its options, and its smallest run works."""

import importlib
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import benchmarks
from benchmarks import __main__ as command
from benchmarks.bench import Bench, goal, parser_of, table
from tests.browser import CHROMIUM, MISSING

FOLDER = Path(benchmarks.__file__).parent
HELPERS = {
    "__init__", "__main__", "branches", "core_system", "foreign_changes", "foreign_scores", "foreign_smooth",
    "foreign_tables", "lost_floor", "lost_robot", "machine", "own_slip", "bench", "rivals", "fuzz_files",
    "fuzz_inputs", "fuzz_live", "fuzz_models", "fuzz_bodies", "own_walks", "trotting",
}  # fmt: skip
"""Modules without parts."""
SLOW = {
    "biped walks", "estimator speed", "foothold_walks scores", "footholds times", "navigator filters",
    "policies trainings", "queries stability", "soak commands", "soak hours", "soak restarts", "soak stops",
    "flood floods", "stability adaptive", "studies scenarios", "walker actions", "walker held", "secure demo",
    "vision anywhere", "vision speed", "vision blur", "accidents causes", "accuracy fuzzed",
    "policies controllers", "view live",
    "storage cases", "own_map walks", "foreign tables", "foreign simulated", "policies courses", "secure round-trips",
    "studies planted", "lost looks", "lost put", "lost turns", "foothold_grounds families", "core ticks",
    "foothold_walks faults", "fuzz decisions", "foreign noise", "bus round-trips",
}  # fmt: skip
"""Smallest runs of more than 3 s (`fuzz decisions` takes 20 s, `foreign noise` a minute of processor time), and those
that start processes (`bus round-trips`): they are in no quick test."""


def bench(name: str) -> Bench:
    return importlib.import_module(f"benchmarks.{name}").BENCH


PARTS = [(name, part) for name in command.NAMES for part in bench(name).parts]
QUICK = [
    pytest.param(name, part, marks=[pytest.mark.slow] * (f"{name} {part}" in SLOW), id=f"{name} {part}")
    for name, part in PARTS if bench(name).parts[part].quick is not None
]  # fmt: skip


def test_every_module_is_listed() -> None:
    assert {path.stem for path in FOLDER.glob("*.py")} - HELPERS == set(command.NAMES)
    assert all(bench(name).name == name for name in command.NAMES)
    assert {f"{name} {part}" for name, part in PARTS} >= SLOW


def test_files_are_short() -> None:
    assert [path.name for path in FOLDER.glob("*.py") if len(path.read_text().splitlines()) > 400] == []


def test_a_list_of_names_without_importing_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main([]) == 0
    shown = capsys.readouterr().out
    assert all(f"\n{name} " in f"\n{shown}" for name in command.NAMES)
    assert command.main(["none"]) == 2
    assert "studies" in capsys.readouterr().err


@pytest.mark.parametrize(("name", "part"), PARTS)
def test_every_option_has_help(name: str, part: str) -> None:
    run = bench(name).parts[part].run
    parser, _ = parser_of(name, run)
    assert run.__doc__
    assert [action.dest for action in parser._actions if not action.help] == []
    parser.format_help()


PAGES = [*(FOLDER.parent / "docs").rglob("*.md"), FOLDER.parent / "README.md"]
STAND_ALONE = re.compile(rf"`({'|'.join(command.NAMES)})((?: [^`]*)?)`")
"""Commands of docs/measured.md without `python -m benchmarks`."""


def commands() -> set[tuple[str, str]]:
    found: set[tuple[str, str]] = set()
    for page in PAGES:
        text = page.read_text()
        found |= set(re.findall(r"python -m benchmarks (\w+)([^`\n#]*)", text))
        found |= set(STAND_ALONE.findall(text)) if page.name == "measured.md" else set()
    return {(name, words) for name, words in found if "..." not in words and name != "all"}


def test_pages_name_many_commands() -> None:
    assert len(commands()) > 50


@pytest.mark.parametrize(("name", "words"), sorted(commands()))
def test_commands_of_the_pages_are_understood(name: str, words: str) -> None:
    assert name in command.NAMES
    part, rest = bench(name).chosen(shlex.split(words))
    parser, _ = parser_of(name, bench(name).parts[part].run)
    parser.parse_args([word for word in rest if word != "--quick"])


FORKING = ("storage",)
"""Benchmarks that fork, which a process with the threads of other tests must not: a child may wait for their locks."""


@pytest.mark.parametrize(("name", "part"), QUICK)
def test_the_smallest_run_works(
    name: str, part: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    if name == "view" and CHROMIUM is None:
        pytest.skip(MISSING)
    monkeypatch.setenv("HOME", str(tmp_path))
    if name in FORKING:
        command = [sys.executable, "-m", "benchmarks", name, part, "--quick"]
        out = subprocess.run(
            command, cwd=FOLDER.parent, capture_output=True, text=True, check=True, timeout=250.0
        ).stdout
    else:
        bench(name).main([part, "--quick"])
        out = capsys.readouterr().out
    assert len(out.splitlines()) >= 1


def test_tables_and_goals(capsys: pytest.CaptureFixture[str]) -> None:
    table("walks", ("ground", "mm"), [("rough", 1.23456), ("flat", None)])
    goal("ratio", 0.5, "<=", 0.4)
    goal("speed", 2.0, ">=", 1.0, "m/s")
    assert capsys.readouterr().out.splitlines() == [
        "walks", "  ground     mm", "  rough   1.235", "  flat",
        f"{'ratio':52}          0.5    goal <= 0.4: MISSED", f"{'speed':52}            2 m/s   goal >= 1: met",
    ]  # fmt: skip


@pytest.mark.parametrize("text", ["nan", "inf", "-1e999", "eight"])
def test_options_take_finite_numbers_only(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parser_of("one", _with_degrees)[0].parse_args([f"--degrees={text}"])
    assert f"got '{text}', expected a finite number" in capsys.readouterr().err
    assert parser_of("one", _with_degrees)[0].parse_args(["--degrees=2"]).degrees == 2.0


def _with_degrees(*, degrees: float = 8.0) -> None:
    """Do nothing.

    Args:
        degrees: an angle.
    """


def test_an_argument_out_of_few_is_refused_by_their_names(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        bench("robots").main(["crawl", "swamp"])
    assert "invalid choice: 'swamp' (choose from 'flat', 'rough')" in capsys.readouterr().err
