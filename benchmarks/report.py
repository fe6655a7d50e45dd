"""Figures of the pages beside what their commands print now: `python -m benchmarks report --check`.

A table of README.md, docs/measured.md or docs/decisions with a column `command` states figures of that command; a cell
that is empty stands for the one above. A command in the last line before a table stands for its rows without one.
"""

import math
import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from subprocess import PIPE
from typing import NamedTuple

from benchmarks.bench import Bench, table
from tests.processes import GRACE_S, running

BENCH = Bench("report")
ROOT = Path(__file__).parents[1]
PAGES = ("docs/measured.md", "docs/bipeds.md", "docs/estimator.md", *sorted(
    str(path.relative_to(ROOT)) for path in (ROOT / "docs" / "decisions").glob("*.md")
))  # fmt: skip
BESIDE = ("goal", "seeds", "command")
"""Columns without figures."""
MACHINE = re.compile(
    r"^(make |starts|bus|core|lockstep|soak|flood|queries|peers|simulator|estimator |secure|view)"
    r"|^(footholds (times|ratios)|stability speed|foothold_walks speed)"
    r"|^navigator (environments|filters|decisions|training|routes)|^lost looks"
)
"""Commands whose figures are times: other machines have others."""
SCALES = {"%": 100.0, "mm": 1e3, "cm": 1e2, "mm/s": 1e3, "cm/s": 1e2, "ms": 1e3, "us": 1e6, "ns": 1e9, "mrad": 1e3}
"""What a number in the unit is times the one in SI units, in which a command may print it."""
NUMBER = re.compile(r"(?<![\w.])-?\d+(?: \d{3})*(?:\.\d+)?(?:e-?\d{1,2}(?!\d))?(?![\w]*/)")
UNIT = re.compile(r" ?(%|mm/s|cm/s|mm|cm|ms|us|ns|mrad)(?![\w])")


class Figure(NamedTuple):
    """A row of a page."""

    page: str
    what: str
    text: str
    """Cells with figures."""
    command: str


class Stated(NamedTuple):
    """A number as it stands on a page."""

    value: float
    half: float
    """Half of its last digit."""
    scale: float
    """Of its unit over the SI unit."""


@dataclass(frozen=True)
class Verdict:
    """A row beside what its command printed."""

    figure: Figure
    missing: tuple[str, ...]
    """Numbers that the command does not print."""


def figures(pages: Iterable[str] = PAGES, root: Path = ROOT) -> Iterator[Figure]:
    """Yield the rows of the tables of pages that have a command."""
    for page in pages:
        header: list[str] = []
        given = above = ""
        for line in (root / page).read_text(encoding="utf-8").splitlines():
            if not line.startswith("|"):
                header, above = [], ""
                if found := [each for each in re.findall(r"`([^`]+)`", line) if _is_command(each)]:
                    given = found[-1]
                elif line.startswith("#"):
                    given = ""
                continue
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            if not header:
                header = cells
            elif not set(line) <= set("|-: "):
                row = dict(zip(header, cells, strict=False))
                found = [each for each in re.findall(r"`([^`]+)`", row.get("command", "")) if _is_command(each)]
                above = found[0] if found else above
                shown = [cell for name, cell in list(row.items())[1:] if name not in BESIDE and cell]
                if (above or given) and shown:
                    yield Figure(page, cells[0], " | ".join(shown), above or given)


def _is_command(text: str) -> bool:
    return bool(re.match(r"(make|surefoot|SUREFOOT_\w+=\S*) |[a-z_]+( |$)", text)) and _argv(text) is not None


def _argv(command: str) -> list[str] | None:
    """Return the words of a command as a page states it, None if it is none."""
    from benchmarks.__main__ import NAMES

    words = shlex.split(command)
    if words[0] == "surefoot":
        return [sys.executable, "-m", "surefoot.lab.cli.main", *words[1:]]
    if words[0] == "make" or words[0].startswith("SUREFOOT_"):
        return ["env", *words]
    return [sys.executable, "-m", "benchmarks", *words] if words[0] in NAMES else None


def numbers(text: str) -> list[Stated]:
    """Return the numbers of a text with the half of their last digits and their units."""
    found: list[Stated] = []
    for match in NUMBER.finditer(text):
        digits = match[0].replace(" ", "")
        mantissa, _, exponent = digits.partition("e")
        places = len(mantissa.partition(".")[2]) - int(exponent or 0)
        unit = UNIT.match(text, match.end())
        scale = SCALES[unit[1]] if unit is not None else 1.0
        found.append(Stated(float(digits), 0.5 * 10.0**-places, scale))
    return found


def missing(stated: str, printed: str) -> tuple[str, ...]:
    """Return the numbers of a page's text that are in no line of an output, rounded as the page rounds them."""
    there = [(each.value, each.value / each.scale) for each in numbers(printed)]
    values = sorted({abs(value) for pair in there for value in pair})
    absent: list[str] = []
    for match, each in zip(NUMBER.finditer(stated), numbers(stated), strict=True):
        wanted = {abs(each.value): each.half, abs(each.value) / each.scale: each.half / each.scale}
        if not any(abs(value - x) <= half * 1.01 + 1e-12 for x, half in wanted.items() for value in values):
            absent.append(match[0])
    return tuple(absent)


def absent(printed: str) -> tuple[str, ...]:
    """Return the peers that a command left out because their packages are not installed."""
    return tuple(re.findall(r"^(.+?)(?:: absent \(| is )not installed", printed, re.MULTILINE))


def check(command: str, rows: Sequence[Figure], limit_s: float | None = None) -> tuple[list[Verdict], tuple[str, ...]]:
    """Run a command and compare the rows that state its figures; return also the peers that it left out.

    Raises:
        subprocess.CalledProcessError: it fails (exit code above 1, which a study with a missed goal may have).
        subprocess.TimeoutExpired: it takes longer than the limit.
    """
    words = _argv(command)
    assert words is not None
    with running(words, cwd=ROOT, stdout=PIPE, stderr=PIPE, text=True, start_new_session=True) as process:
        try:
            stdout, stderr = process.communicate(timeout=limit_s)
        except (subprocess.TimeoutExpired, KeyboardInterrupt):
            os.killpg(process.pid, signal.SIGINT)  # SIGTERM would leave the systems that it started
            with suppress(subprocess.TimeoutExpired):  # of a process that ignores it, or still writes
                process.communicate(timeout=GRACE_S)
            raise
    if process.returncode not in (0, 1):
        raise subprocess.CalledProcessError(process.returncode, words, stdout, stderr)
    printed = stdout + stderr
    return [Verdict(row, missing(row.text, printed)) for row in rows], absent(printed)


def obstacle(command: str) -> str:
    """Return why a command cannot be run by itself, empty when it can."""
    gap = re.search(r"(?<![\w.])(DIR|F|LOG|RUN|\w+\.jsonl?)(?![\w.])", command)
    return f"needs {gap[1]}" if gap is not None else ""


SHORT = ("surefoot evaluate navigator --params paper --seeds 0:2000 --json", "stability adaptive --count 400")
"""Commands of a few seconds whose figures are no times."""


@BENCH.part()
def report(*, check_: bool = False, only: str = "", every: bool = False, limit: float = math.inf) -> None:
    """Compare the figures of the pages with what their commands print, the short ones by default; exit code 1: some
    differ. Without --check list the commands.

    Times depend on the machine: their numbers are shown, not judged.

    Args:
        check_: run the commands.
        only: those that contain this text.
        every: long ones too, which takes hours.
        limit: leave a command that takes longer, s.
    """
    by_command: dict[str, list[Figure]] = {}
    for row in figures():
        by_command.setdefault(row.command, []).append(row)
    chosen = [name for name in by_command if only in name and (every or only or name in SHORT or not check_)]
    wrong, rows = 0, list[tuple[object, ...]]()
    for name in chosen:
        why = obstacle(name) or ("" if check_ else "short" if name in SHORT else "long")
        if not why:
            try:
                verdicts, gone = check(name, by_command[name], None if math.isinf(limit) else limit)
            except subprocess.TimeoutExpired:
                why = f"takes more than {limit:g} s"
            except subprocess.CalledProcessError as error:
                why, wrong = f"ends with {error.returncode}: {error.stderr.strip()[-120:]}", wrong + 1
            else:
                off = [verdict for verdict in verdicts if verdict.missing]
                machine = MACHINE.match(name) is not None
                wrong += 0 if machine else len(off)
                why = f"{len(verdicts) - len(off)} of {len(verdicts)} rows" + " (times)" * machine
                why += f"; not installed: {', '.join(gone)}" * bool(gone)
                for verdict in off:
                    print(f"  {verdict.figure.page}: {verdict.figure.what}: {verdict.figure.text}")
                    print(f"    not printed: {', '.join(verdict.missing)}", flush=True)
        rows.append((name, len(by_command[name]), why))
    table("command", ("", "rows", "as stated" if check_ else ""), rows)
    if wrong:
        raise SystemExit(1)
