"""Figures of the pages beside what their commands print now: `python -m benchmarks report --check`.

A table of `PAGES` with a column `command` states figures of that command; a cell that is empty stands for the one
above. A command in the last line before a table, remarks below another table apart, stands for its rows without one.
A link with a title, `[0.59](docs/measured.md#estimator-over-logs "slip")`, repeats figures: each number of its text
must stand in the row `slip` of that section, and so has the command of the row. README.md states figures so.

Left out: prose, because no rule finds which of its numbers a command prints. That holds for docs/decisions, whose
figures, also those with a command, are the ones of the day on which something was decided; a table there is compared.
"""

import math
import os
import re
import shlex
import signal
import subprocess
import sys
import time
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from subprocess import PIPE
from tempfile import TemporaryDirectory
from typing import NamedTuple

from benchmarks.bench import Bench, children_s, table
from surefoot.lab.studies import finished, keep
from tests.processes import GRACE_S, running

BENCH = Bench("report")
ROOT = Path(__file__).parents[1]
PAGES = ("docs/measured.md", "docs/bipeds.md", "docs/estimator.md", *sorted(
    str(path.relative_to(ROOT)) for path in (ROOT / "docs" / "decisions").glob("*.md")
))  # fmt: skip
BESIDE = ("goal", "seeds", "command")
"""Names of table columns that hold no figures."""
MACHINE = re.compile(
    r"^(make |starts|bus|core|lockstep|soak|flood|queries|peers|simulator|estimator |secure|view)"
    r"|^(footholds (times|ratios)|stability speed|foothold_walks speed)"
    r"|^surefoot (render|run .*--view)"
    r"|^navigator (environments|filters|decisions|training|routes)|^lost looks"
)
"""Pattern of the commands whose figures are times, which differ from machine to machine."""
SCALES = {"%": 100.0, "mm": 1e3, "cm": 1e2, "mm/s": 1e3, "cm/s": 1e2, "ms": 1e3, "us": 1e6, "ns": 1e9, "mrad": 1e3}
"""Factor from the SI unit to each unit in which pages state figures; a command may print either."""
NUMBER = re.compile(r"(?<![\w.])-?\d+(?: \d{3})*(?:\.\d+)?(?:e-?\d{1,2}(?!\d))?(?![\w]*/)")
MADE = "--results F"
"""Option in a stated command that names its results file; the report replaces `F` by a file of its own."""
LONGEST_S = 1e6
"""Time limit of a command for which none is given, s."""
REPEATED = re.compile(r'\[([^\]]+)\]\(([\w./-]+\.md)#([\w-]+) "([^"]+)"\)')
"""Pattern of a link to a row of figures: text, page, anchor of the section, first cell of the row."""
REPEATING = ("README.md",)
"""Pages that repeat figures of `PAGES` by links."""
SHARE = re.compile(r"(?<![\w.])(\d+(?: \d{3})*) of (\d+(?: \d{3})*)(?![\w.])")
UNIT = re.compile(r" ?(%|mm/s|cm/s|mm|cm|ms|us|ns|mrad)(?![\w])")


class Figure(NamedTuple):
    """Row of a table on a page of the documentation: what, its text, and the command that prints it."""

    page: str
    what: str
    text: str
    """Text of the row's cells that hold figures."""
    command: str
    section: str = ""
    """Anchor of the section in which the table stands."""


class Repeat(NamedTuple):
    """Link of a page whose text repeats figures of a row of another page."""

    text: str
    page: str
    """Page that is linked, relative to the root of the tree."""
    section: str
    """Anchor of the linked section."""
    what: str
    """First cell of the row, the title of the link."""


class Stated(NamedTuple):
    """A number as a page of the documentation states it, with half of its last digit."""

    value: float
    half: float
    """Half of the unit of the last digit with which the number is stated, in the number's unit."""
    scale: float
    """Factor from the SI unit to the unit in which the number is stated."""


def figures(pages: Iterable[str] = PAGES, root: Path = ROOT) -> Iterator[Figure]:
    """Yield those rows of tables on pages of the documentation for which a command is stated."""
    for page in pages:
        header: list[str] = []
        given = above = section = ""
        for line in (root / page).read_text(encoding="utf-8").splitlines():
            if not line.startswith("|"):
                header, above = [], ""
                if found := _commands(line):
                    given = found[-1]
                elif line.strip() and not line.startswith("- "):  # prose between a command and a table parts them
                    given = ""
                section = anchor(line.lstrip("# ")) if line.startswith("#") else section
                continue
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            if not header:
                header = cells
            elif not set(line) <= set("|-: "):
                row = dict(zip(header, cells, strict=False))
                found = _commands(row.get("command", ""))
                above = found[0] if found else above
                shown = [cell for name, cell in list(row.items())[1:] if name not in BESIDE and cell]
                if (above or given) and shown:
                    yield Figure(page, cells[0], " | ".join(shown), above or given, section)


def anchor(heading: str) -> str:
    """Return the anchor of a heading of a page."""
    return re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-")


def repeats(page: str, root: Path = ROOT) -> list[Repeat]:
    """Return the links of a page that repeat figures of a row."""
    found = REPEATED.findall((root / page).read_text(encoding="utf-8"))
    return [Repeat(text, os.path.normpath(Path(page).parent / linked), *rest) for text, linked, *rest in found]


def astray(page: str, root: Path = ROOT) -> Iterator[tuple[Repeat, str]]:
    """Yield the links of a page whose row does not exist, or lacks a number of the link's text, with the reason."""
    for each in repeats(page, root):
        rows = [row for row in figures((each.page,), root) if (row.section, row.what) == (each.section, each.what)]
        gone = min((missing(each.text, row.text) for row in rows), key=len, default=("no such row with a command",))
        if gone:
            yield each, ", ".join(gone)


def _commands(text: str) -> list[str]:
    """Return the commands in a line of a page, without `python -m benchmarks`."""
    found = [each.removeprefix("python -m benchmarks ") for each in re.findall(r"`([^`]+)`", text)]
    return [each for each in found if _is_command(each)]


def _is_command(text: str) -> bool:
    form = r"(make|surefoot|SUREFOOT_\w+=\S*) |python -m tests\.|[a-z_]+( |$)"
    return bool(re.match(form, text)) and _argv(text) is not None


def _argv(command: str) -> list[str] | None:
    """Return the words of a command as a page states it, None if it is none."""
    from benchmarks.__main__ import NAMES

    words = shlex.split(command)
    if words[0] == "surefoot":
        return [sys.executable, "-m", "surefoot.lab.cli.main", *words[1:]]
    if words[0] == "make" or words[0].startswith("SUREFOOT_"):
        return ["env", *words]
    if words[:2] == ["python", "-m"] and words[2].startswith("tests."):
        return [sys.executable, *words[1:]]
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
    shares = {(_count(part), _count(whole)) for part, whole in SHARE.findall(printed)}
    for part, whole in SHARE.findall(stated):  # "50 of 50" is not printed where "49 of 50" is
        if _count(whole) in {each for _, each in shares} and (_count(part), _count(whole)) not in shares:
            absent.append(f"{part} of {whole}")
    return tuple(absent)


def _count(text: str) -> int:
    return int(text.replace(" ", ""))


def absent(printed: str) -> tuple[str, ...]:
    """Return the peers that a command left out because their packages are not installed."""
    return tuple(re.findall(r"^(.+?)(?:: absent \(| is )not installed", printed, re.MULTILINE))


def lacking(printed: str) -> tuple[str, ...]:
    """Return the logs that a command left out because their files are not on this machine."""
    return tuple(re.findall(r"^(.+?): skipped, (?:no file .+|.+: no such file)$", printed, re.MULTILINE))


def output_of(command: str, limit_s: float = math.inf, folder: Path | None = None) -> str:
    """Run a command and return what it prints; ``--results F`` names a file in the folder.

    Raises:
        subprocess.CalledProcessError: its exit code is neither 0 nor 1, which a study with a missed goal has.
        subprocess.TimeoutExpired: it takes longer than the limit.
    """
    words = _argv(command)
    assert words is not None
    if folder is not None and MADE in command:
        words[words.index("--results") + 1] = str(folder / f"{zlib.crc32(command.encode()):08x}.jsonl")
    with running(words, cwd=ROOT, stdout=PIPE, stderr=PIPE, text=True, start_new_session=True) as process:
        try:
            stdout, stderr = process.communicate(timeout=None if math.isinf(limit_s) else limit_s)
        except (subprocess.TimeoutExpired, KeyboardInterrupt):
            os.killpg(process.pid, signal.SIGINT)  # SIGTERM would leave the systems that it started
            with suppress(subprocess.TimeoutExpired):  # of a process that ignores it, or still writes
                process.communicate(timeout=GRACE_S)
            raise
    if process.returncode not in (0, 1):
        raise subprocess.CalledProcessError(process.returncode, words, stdout, stderr)
    return stdout + stderr


def obstacle(command: str) -> str:
    """Return the reason why a command cannot be run by itself; empty = it can."""
    gap = re.search(r"(?<![\w.])(DIR|F|LOG|RUN|\w+\.jsonl?)(?![\w.])", command.replace(MADE, ""))
    return f"needs {gap[1]}" if gap is not None else ""


SHORT = (
    "surefoot evaluate navigator --params paper --seeds 0:2000 --json",
    "surefoot evaluate navigator --params paper-blur --seeds 0:2000 --json",
    "surefoot evaluate navigator --params nao-paper --seeds 0:600 --json",
    "surefoot evaluate navigator --params nao --seeds 0:600 --json", "stability adaptive --count 400",
    "studies rough-terrain 0:1",
)  # fmt: skip
"""Commands of about a minute of processor time together whose figures are no times, so that they agree on every
machine."""
LONGER = (
    "surefoot run rough-terrain", "fuzz files --seed 25", "fuzz files --seed 27", "policies trainings 2000:2020",
    "fuzz decisions", "fuzz decisions --seed 1", "stability verdicts --sets 10000",
)  # fmt: skip
"""Commands of up to a minute of processor time each, of which the same holds."""


class Outputs:
    """Outputs of commands, kept as lines of a results file if one is given; a command in the file is not run again."""

    def __init__(self, results: Path | None, limit_s: float = math.inf, folder: Path | None = None) -> None:
        """Read the outputs that a results file already holds.

        Args:
            results: of lines with command, output, or the limit that it took longer than, s; None = nothing is kept.
            limit_s: time after which a command is ended and left out, s.
            folder: folder of the files that commands write; None = a command names its file itself.
        """
        self.results, self.limit_s, self.folder = results, limit_s, folder
        self.done = {line["command"]: line for line in finished(results)}

    def of(self, command: str) -> tuple[str | None, str]:
        """Return the output of a command, or None and the reason; one that failed is run again next time."""
        line = self.done.get(command)
        if line is None or (line["output"] is None and self.limit_s > line["limit"]):
            began, spent, output = time.monotonic(), children_s(), None
            try:
                output = output_of(command, self.limit_s, self.folder)
            except subprocess.TimeoutExpired:
                pass
            except subprocess.CalledProcessError as error:
                return None, f"ends with {error.returncode}: {error.stderr.strip()[-120:]}"
            limit, took = min(self.limit_s, LONGEST_S), round(time.monotonic() - began)
            line = {"command": command, "output": output, "limit": limit, "seconds": took}
            line["processor"] = round(children_s() - spent)
            self.done[command] = line
            keep(self.results, line)
        return line["output"], "" if line["output"] is not None else f"takes more than {line['limit']:g} s"

    def processor(self, command: str) -> float | None:
        """Return the processor time of the last run of a command, s; None if it was not run or ended too early."""
        return self.done.get(command, {}).get("processor")


@BENCH.part()
def report(
    *,
    check: bool = False,
    only: str = "",
    longer: bool = False,
    every: bool = False,
    limit: float = LONGEST_S,
    results: Path | None = None,
) -> None:
    """Compare the figures on pages of the documentation with what their commands print now; exit code 1: some differ.

    Without --check the commands are only listed, and figures that README.md repeats are compared with their rows.
    Times depend on the machine: they are shown, not compared.

    Args:
        check: run the commands, without other options those of about a minute together.
        only: text that the commands contain; empty = all.
        longer: run those of up to a minute each, too, together some five minutes of processor time.
        every: run all commands, which takes hours.
        limit: time after which a command is ended and left out, s.
        results: file to continue with, one line a command with its output; the pages as they are now are compared with
            what it holds, and only other commands are run.
    """
    by_command: dict[str, list[Figure]] = {}
    for row in figures():
        by_command.setdefault(row.command, []).append(row)
    tier = {**dict.fromkeys(LONGER, "longer"), **dict.fromkeys(SHORT, "short")}
    run = {"short", "longer"} if longer else {"short"}
    chosen = [name for name in by_command if only in name and (every or only or not check or tier.get(name) in run)]
    chosen.sort(key=lambda name: MACHINE.match(name) is not None)  # what is compared comes first
    wrong, rows = 0, list[tuple[object, ...]]()
    for each, why in (found for page in REPEATING for found in astray(page)):
        print(f"  {each.text!r} is not in {each.page}, {each.section}, {each.what}: {why}", flush=True)
        wrong += 1
    with TemporaryDirectory() as made:
        outputs = Outputs(results, limit, Path(made) if results is None else results.parent)
        for k, name in enumerate(chosen):
            why = obstacle(name) or ("" if check else tier.get(name, "long"))
            if not why:
                print(f"{k + 1} of {len(chosen)}: {name}", file=sys.stderr, flush=True)
                output, why = outputs.of(name)
                if output is not None:
                    why, off = _compared(name, by_command[name], output)
                    wrong += off
                elif why.startswith("ends"):
                    wrong += 1
            rows.append((name, len(by_command[name]), outputs.processor(name), why))
    table("command", ("", "rows", "processor s", "as stated" if check else ""), rows)
    if wrong:
        raise SystemExit(1)


def _compared(command: str, rows: Sequence[Figure], output: str) -> tuple[str, int]:
    """Print the rows whose numbers an output lacks; return a summary and their count.

    The count is 0 for a command of times, and where logs are absent: a row may be of one of them.
    """
    off = [(row, gone) for row in rows if (gone := missing(row.text, output))]
    for row, gone in off:
        print(f"  {row.page}: {row.what}: {row.text}\n    not printed: {', '.join(gone)}", flush=True)
    machine, left_out, logs = MACHINE.match(command) is not None, absent(output), lacking(output)
    why = f"{len(rows) - len(off)} of {len(rows)} rows" + " (times)" * machine
    why += f"; not installed: {', '.join(left_out)}" * bool(left_out) + f"; {len(logs)} logs are absent" * bool(logs)
    return why, 0 if machine or logs else len(off)
