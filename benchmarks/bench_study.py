"""A hundred seeds of each walking scenario: the real services of a seed in one process, on the in-memory bus.

Targets: rough-terrain 95 of 100 reach the end without a fall; flat 100 of 100 with contact sliding <= 0.5 mm mean per
stance (gate 0.5 N). The 8.7 cm terrain is reported without a target. Fewer seeds, or a study in several sittings:

    python -m benchmarks.bench_study rough-terrain 10
    python -m benchmarks.bench_study rough-terrain 20:40 --results study.jsonl

With ``--results`` every finished seed is a line of that file; seeds it holds already are not run again, and the table
is of all of them. Results belong to one state of the code: begin a new file after a change.
"""

import argparse
import json
import math
import statistics
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from surefoot.lab.runs.local import LocalRun, study
from surefoot.services.supervisor.scenarios.scenario import find_scenario

SCENARIOS = ("rough-terrain", "flat", "rough-terrain-high")
SHOWN = (
    "distance_m",
    "max_tilt_deg",
    "mean_slip_mm",
    "velocity_rmse_mps",
    "odometry_error_percent",
    "min_margin_m",
    "duration_s",
)


def wilson(k: int, n: int) -> tuple[float, float]:
    """95 % interval of a rate (Wilson 1927)."""
    z, p = 1.96, k / n
    centre, half = p + z * z / (2 * n), z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return (centre - half) / (1 + z * z / n), (centre + half) / (1 + z * z / n)


def scenario_file(name: str, folder: Path) -> str:
    """Path or name of a scenario; the high one is made from the demo's by its terrain's amplitude."""
    if name != "rough-terrain-high":
        return name
    text = find_scenario("rough-terrain").read_text().replace("[world]", "[world]\namplitude = 0.087")
    path = folder / "rough-terrain-high.toml"
    path.write_text(text)
    return str(path)


def seeds_of(text: str) -> range:
    """``count`` or ``first:end``."""
    first, colon, end = text.partition(":")
    return range(int(first), int(end)) if colon else range(int(first))


def line_of(name: str, run: LocalRun) -> dict[str, Any]:
    """A run as it is kept."""
    return {
        "scenario": name,
        "seed": run.seed,
        "ok": run.verdict.ok,
        "failed": [row.name for row in run.verdict.rows if row.ok is False],
        "problems": list(run.verdict.problems),
        "values": {row.name: float(row.value) for row in run.verdict.rows if row.value is not None},
    }


def kept(results: Path | None, name: str) -> list[dict[str, Any]]:
    """The lines of a scenario in a results file; a torn last line is left out."""
    lines: list[dict[str, Any]] = []
    if results is not None and results.exists():
        for text in results.read_text(encoding="utf-8").splitlines():
            try:
                line = json.loads(text)
            except ValueError:
                continue
            if line["scenario"] == name:
                lines.append(line)
    return lines


def run(name: str, seeds: Iterable[int], results: Path | None = None, processes: int | None = None) -> None:
    """Runs what is missing and prints the table of a scenario."""
    lines = kept(results, name)
    done = {line["seed"] for line in lines}
    with tempfile.TemporaryDirectory() as folder:
        missing = [seed for seed in seeds if seed not in done]
        for one in study(scenario_file(name, Path(folder)), missing, processes=processes) if missing else ():
            line = line_of(name, one)
            lines.append(line)
            if not line["ok"]:
                print(f"  {name} seed {one.seed}: failed {line['failed']} {line['problems']}", flush=True)
            if results is not None:
                with results.open("a", encoding="utf-8") as stream:
                    stream.write(f"\n{json.dumps(line)}\n")  # the line before may be torn
    if lines:
        print(table(name, lines), flush=True)


def table(name: str, lines: list[dict[str, Any]]) -> str:
    """The figures of a scenario."""
    good = sum(line["ok"] for line in lines)
    low, high = wilson(good, len(lines))
    rows = [f"{name}: {good} of {len(lines)} passed (95 % interval {100 * low:.0f}-{100 * high:.0f} %)"]
    for key in SHOWN:
        v = sorted((line["values"][key], line["seed"]) for line in lines if key in line["values"])
        if v:
            worst = f"{v[0][0]:9.4f} (seed {v[0][1]}) .. {v[-1][0]:9.4f} (seed {v[-1][1]})"
            rows.append(f"  {key:<24} median {statistics.median(value for value, _ in v):9.4f}   {worst}")
    return "\n".join(rows)


def main(arguments: list[str] | None = None) -> None:
    """Command line; without arguments a hundred seeds of every scenario."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", nargs="?", help=f"name or path; default: {', '.join(SCENARIOS)}")
    parser.add_argument("seeds", nargs="?", default="100", help="count, or first:end")
    parser.add_argument("--results", type=Path, help="file to go on with, one line a seed")
    parser.add_argument("--processes", type=int, help="seeds at a time, default one a core")
    args = parser.parse_args(arguments)
    for name in SCENARIOS if args.scenario is None else (args.scenario,):
        run(name, seeds_of(args.seeds), args.results, args.processes)


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
