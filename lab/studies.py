"""Studies: a function or a scenario over many jobs, in processes, with finished runs kept in a file.

A job is a mapping of JSON values that identifies a run, for example ``{"scenario": "flat", "seed": 3}``. Its line is
the job together with what the function returns; a results file has one line of JSON a run. Runs that the file holds
are not repeated, and a torn line, as an interrupted study leaves it, is skipped. A file belongs to one state of the
code: begin a new one after a change.
"""

import json
import statistics as middle
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import as_completed
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from surefoot.errors import ConfigError
from surefoot.lockstep.launch import spare_collector
from surefoot.services.supervisor.scenarios.scenario import Scenario, find_scenario, load_scenario

from .pools import worker_processes
from .report.judge import RunVerdict
from .runs.local import run_local
from .statistics import wilson

Job = Mapping[str, Any]
Line = dict[str, Any]


class MetricSummary(NamedTuple):
    """Median and extremes of one metric over the seeds of a study."""

    name: str
    median: float
    low: float
    """Smallest value of the metric in the study."""
    low_seed: int
    high: float
    """Largest value of the metric in the study."""
    high_seed: int


class Passed(NamedTuple):
    """Share of runs of a study with a good verdict, with its 95 % interval."""

    good: int
    runs: int
    low: float
    """Lower end of the 95 % interval of the share of good runs, 0 to 1."""
    high: float
    """Upper end of the 95 % interval of the share of good runs, 0 to 1."""


def seeds_of(text: str) -> range:
    """Return the seeds of ``count`` or ``first:end``; the end is not included.

    Raises:
        ConfigError: the text is neither, or the end lies before the first seed.
    """
    first, colon, end = text.partition(":")
    try:
        low, high = (int(first), int(end)) if colon else (0, int(first))
    except ValueError:
        low, high = 0, -1
    if not 0 <= low <= high:
        raise ConfigError("invalid", f"got {text!r}, must be a count, or first:end with 0 <= first <= end", "seeds")
    return range(low, high)


def finished(results: Path | None, **wanted: Any) -> list[Line]:
    """Return the lines of a results file that have the wanted values; none if the file does not exist.

    Raises:
        ConfigError: the file exists and cannot be read, for example a folder.
    """
    lines: list[Line] = []
    if results is not None and results.exists():
        try:
            content = results.read_text(encoding="utf-8", errors="replace")
        except OSError as error:
            raise ConfigError("invalid", f"got {str(results)!r}, must be a file: {error.strerror}", "results") from None
        for text in content.splitlines():
            try:
                line = json.loads(text)
            except ValueError:
                continue
            if isinstance(line, dict) and wanted.items() <= line.items():
                lines.append(line)
    return lines


def keep(results: Path | None, line: Line) -> None:
    """Append a line to a results file (None = nothing is kept), on a new line even if the last one is incomplete."""
    if results is not None:
        with results.open("a", encoding="utf-8") as stream:
            stream.write(f"\n{json.dumps(line)}\n")


def study(
    function: Callable[..., Line],
    jobs: Iterable[Job],
    results: Path | None = None,
    *,
    processes: int | None = None,
    show: Callable[[Line], object] = lambda line: None,
) -> list[Line]:
    """Run the jobs that the results file lacks; return the lines of all jobs, in the order of the jobs.

    Args:
        function: called with the fields of a job as keyword arguments, returns the rest of its line; a function of a
            module, so that processes can import it.
        jobs: what to run.
        results: file to continue with; None = nothing is kept.
        processes: number of processes at a time; None = one for each core.
        show: called with each new line as it is finished.

    Raises:
        KeyboardInterrupt: which states what was kept; within 1 s of Ctrl-C.
    """
    jobs = [dict(job) for job in jobs]
    fields = {field for job in jobs for field in job}
    done = {_key(line, fields): line for line in finished(results)}
    missing = [job for job in jobs if _key(job, fields) not in done]
    try:
        with worker_processes(processes, spare_collector) as pool:
            running = {pool.submit(partial(function, **job)): job for job in missing}
            for future in as_completed(running):
                line = running[future] | future.result()
                done[_key(line, fields)] = line
                keep(results, line)
                show(line)
    except KeyboardInterrupt:
        count = sum(_key(job, fields) in done for job in jobs)
        where = "nothing is kept" if results is None else f"{count} of {len(jobs)} runs are kept in {results}"
        raise KeyboardInterrupt(where) from None
    return [done[_key(job, fields)] for job in jobs]


def _key(line: Job, fields: Iterable[str]) -> str:
    return json.dumps({field: line.get(field) for field in fields}, sort_keys=True)


def verdict_line(verdict: RunVerdict, names: Iterable[str] = ()) -> Line:
    """Return the result line of a verdict: failed limits, problems, values; values of `names` even if they are None."""
    values = {row.name: float(row.value) for row in verdict.rows if row.value is not None}
    return {
        "ok": verdict.ok,
        "failed": [row.name for row in verdict.rows if row.ok is False],
        "problems": list(verdict.problems),
        "values": values | {name: verdict.value(name) for name in names},
    }


def run_scenario(scenario: str | Scenario, seed: int, names: Iterable[str] = ()) -> Line:
    """Run a scenario on one seed, all services in one process and nothing recorded; return its line."""
    found = load_scenario(find_scenario(scenario)) if isinstance(scenario, str) else scenario
    return verdict_line(run_local(found, seed, without=("recorder",)).verdict, names)


def passed(lines: Sequence[Line]) -> Passed:
    """Return the share of runs with a good verdict among lines of a study, with its 95 % interval."""
    good = sum(line["ok"] for line in lines)
    if not lines:
        raise ConfigError("missing", "there are no runs: name at least one seed", "seeds")
    return Passed(good, len(lines), *wilson(good, len(lines)))


def metrics(lines: Sequence[Line], names: Iterable[str]) -> list[MetricSummary]:
    """Return median and extremes, with their seeds, of each metric that any line has a value of."""
    found: list[MetricSummary] = []
    for name in names:
        values = sorted((line["values"][name], line["seed"]) for line in lines if line["values"].get(name) is not None)
        if values:
            median = middle.median(value for value, _ in values)
            found.append(MetricSummary(name, median, *values[0], *values[-1]))
    return found
