"""A hundred seeds of each walking scenario: the real services of a seed in one process, on the in-memory bus.

Targets: rough-terrain 95 of 100 reach the end without a fall; flat 100 of 100 with contact sliding <= 0.5 mm mean per
stance (gate 0.5 N). The 8.7 cm terrain is reported without a target. Fewer:
``python -m benchmarks.bench_study rough-terrain 10``.
"""

import math
import statistics
import sys
import tempfile
from pathlib import Path

from services.supervisor.scenario import find_scenario
from services.supervisor.study import LocalRun, study

SCENARIOS = ("rough-terrain", "flat", "rough-terrain-high")


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


def main(names: tuple[str, ...] = SCENARIOS, count: int = 100) -> None:
    """Prints one row per scenario."""
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            runs: list[LocalRun] = []

            def show(run: LocalRun, name: str = name) -> None:
                if not run.verdict.ok:
                    failed = [row.name for row in run.verdict.rows if row.ok is False]
                    print(f"  {name} seed {run.seed}: failed {failed} {run.verdict.problems}", flush=True)

            for run in study(scenario_file(name, Path(folder)), range(count), show=show):
                runs.append(run)
            _print(name, runs)


def _print(name: str, runs: list[LocalRun]) -> None:
    good = sum(run.verdict.ok for run in runs)
    low, high = wilson(good, len(runs))
    print(f"{name}: {good} of {len(runs)} passed (95 % interval {100 * low:.0f}-{100 * high:.0f} %)")
    values: dict[str, list[float]] = {}
    for run in runs:
        for row in run.verdict.rows:
            if row.value is not None:
                values.setdefault(row.name, []).append(float(row.value))
    for key in (
        "distance_m",
        "max_tilt_deg",
        "mean_slip_mm",
        "velocity_rmse_mps",
        "odometry_error_percent",
        "min_margin_m",
    ):
        if key in values:
            v = sorted(values[key])
            print(f"  {key:<24} median {statistics.median(v):9.4f}   worst {v[0]:9.4f} .. {v[-1]:9.4f}")


if __name__ == "__main__":
    chosen = tuple(sys.argv[1:2]) or SCENARIOS
    main(chosen, int(sys.argv[2]) if len(sys.argv) > 2 else 100)
