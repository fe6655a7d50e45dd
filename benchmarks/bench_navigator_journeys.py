"""Journeys of simulated robots besides the straight corridor, with the shipped models and no truth in the loop.

`corner`, `lost` and `hexapod` are shipped scenarios; `lost-right` moves the robot to the other side, `behind` has its
goal behind the robot with odometry, `behind-hard` the same in the hard world, `dark` loses the camera half way, so that
odometry alone is left, and `dark-hard` loses it where there is no odometry: there the goal counts for nothing, but the
belief must grow with the error. Targets: goals reached within 0.2 m (0.25 m by odometry alone), NEES of the pose <= 2
per degree of freedom (4 for the mean of one run), no fall.

    python -m benchmarks.bench_navigator_journeys --seeds 0:3 --results journeys.jsonl
    python -m benchmarks.bench_navigator_journeys --seeds 0:1 --journeys corner,lost
"""

import argparse
import json
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bench_navigator_live import LONGEST_S, kept
from benchmarks.bench_study import seeds_of
from surefoot.lab.runs.local import run_local
from surefoot.schemas.navigation import GotoRequest
from surefoot.schemas.sim import FaultRequest, PlaceRequest
from surefoot.services.supervisor.scenarios.scenario import Scenario, Step, find_scenario, load_scenario

BEHIND = (-0.6, 0.3)
"""m, in the corridor that begins at x = -1."""
DARK_AFTER_S = 40.0
"""Of about 90."""
ASIDE = PlaceRequest(forward=0.3, left=-0.63, turn=-1.5708)
"""0.7 m."""


def shipped(name: str) -> Scenario:
    """A scenario that ships, with time to end."""
    return replace(load_scenario(find_scenario(name)), max_duration_s=LONGEST_S)


def corridor(*steps: Step, easy: bool) -> Scenario:
    """The corridor with other steps; easy: with the robot's own camera and odometry, and without drift."""
    scenario = shipped("nao-corridor")
    if easy:
        world = scenario.world.model_copy(update={"drift": 0.0, "camera": None, "landmarks": 60.0})
        scenario = replace(scenario, world=world, config={"navigator": {"params": "nao", "control": "odometry"}})
    return replace(scenario, steps=steps)


def to(x: float, y: float) -> Step:
    """A goal at the begin, m in the map."""
    return Step("goto", when="ready", request=GotoRequest(position=(x, y)))


def dark() -> Step:
    """The camera sees nothing from half way on."""
    fault = FaultRequest(kind="camera_dark", duration=LONGEST_S)
    return Step("fault", when="ready", after_s=DARK_AFTER_S, request=fault)


def moved_aside() -> Scenario:
    """The shipped displacement, to the other side."""
    scenario = shipped("nao-lost")
    steps = tuple(replace(step, request=ASIDE) if step.do == "place" else step for step in scenario.steps)
    return replace(scenario, steps=steps)


JOURNEYS: dict[str, Callable[[], Scenario]] = {
    "corner": lambda: shipped("nao-corner"),
    "lost": lambda: shipped("nao-lost"),
    "lost-right": moved_aside,
    "behind": lambda: corridor(to(*BEHIND), easy=True),
    "behind-hard": lambda: corridor(to(*BEHIND), easy=False),
    "dark": lambda: corridor(to(5.0, 0.0), dark(), easy=True),
    "dark-hard": lambda: corridor(to(5.0, 0.0), dark(), easy=False),
    "hexapod": lambda: shipped("ragno-goal"),
}
SHOWN = (
    "goal_time_s",
    "goal_error_m",
    "pose_nees",
    "pose_error_m",
    "max_tilt_deg",
    "recoveries",
    "goals_missed",
    "fell",
)


def one(name: str, seed: int) -> dict[str, Any]:
    """Runs one journey on one seed."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    verdict = run_local(JOURNEYS[name](), seed, without=("recorder",)).verdict
    values = {key: verdict.value(key) for key in SHOWN}
    failed = [row.name for row in verdict.rows if row.ok is False]
    return {"journey": name, "seed": seed, "problems": list(verdict.problems), "failed": failed, "values": values}


def table(lines: list[dict[str, Any]], names: list[str]) -> None:
    """Prints a row for each journey."""
    print("journey        n  reached  time s  error m  pose rms m  NEES mean (largest)  recoveries  fell  not met")
    for name in names:
        own = [line for line in lines if line["journey"] == name]
        if not own:
            continue
        found = {
            key: np.array([np.nan if line["values"][key] is None else line["values"][key] for line in own])
            for key in SHOWN
        }
        times, errors, rms, nees = (found[key] for key in ("goal_time_s", "goal_error_m", "pose_error_m", "pose_nees"))
        recoveries, fell = found["recoveries"], found["fell"]
        reached = sum(line["values"]["goals_missed"] == 0.0 and not line["problems"] for line in own)
        print(
            f"{name:12s} {len(own):3d} {reached:8d} {np.mean(times):7.1f} {np.max(errors):8.3f} {np.max(rms):11.3f}"
            f" {np.mean(nees):10.2f} ({np.max(nees):.2f}) {np.mean(recoveries):16.1f} {np.nansum(fell):5.0f}"
            f"  {sorted({failed for line in own for failed in line['failed']}) or 'none'}"
        )


def main() -> None:
    """Runs what is missing and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0:1", help="count, or first:end")
    parser.add_argument("--journeys", default=",".join(JOURNEYS), help="names, separated by commas")
    parser.add_argument("--results", type=Path, help="file that keeps finished runs")
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    options = parser.parse_args()
    names, lines = options.journeys.split(","), kept(options.results)
    done = {(line["journey"], line["seed"]) for line in lines}
    wanted = [(name, seed) for seed in seeds_of(options.seeds) for name in names if (name, seed) not in done]
    with ProcessPoolExecutor(options.processes) as pool:
        for job in as_completed([pool.submit(one, *item) for item in wanted]):
            line = job.result()
            lines.append(line)
            if options.results is not None:
                with options.results.open("a", encoding="utf-8") as stream:
                    stream.write(f"\n{json.dumps(line)}\n")
    table(lines, names)


if __name__ == "__main__":
    main()
