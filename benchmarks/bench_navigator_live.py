"""The Nao walks 5 m to a goal with every policy: the real services of a run in one process, no truth in the loop.

The hard world is `scenarios/nao-corridor.toml` (drift of 2 deg per 10 cm, the paper's camera, commands as control), the
easy one the same corridor with the robot's own camera, odometry and no drift. Runs of a seed are pairs: same floor,
same robot. Targets: four actions, planner >= 9 % faster than the 35 deg controller and the learner faster by a paired
t-test; arcs >= 15 %; every goal reached with a true error <= 0.2 m, no wall touched, no fall.

    python -m benchmarks.bench_navigator_live --seeds 100:120 --results live.jsonl
    python -m benchmarks.bench_navigator_live --seeds 100:104 --world easy

    python -m benchmarks.bench_navigator_live --seeds 31:33 --arms "planner,planner arcs" --record recordings

With ``--results`` every finished run is a line of that file, and runs it holds already are not made again. Results
belong to one state of the code: begin a new file after a change. ``--record`` keeps the recordings, for
``surefoot fit`` and ``bench_navigator_transfer``.
"""

import argparse
import json
import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import ttest_1samp

from benchmarks.bench_study import seeds_of
from surefoot.lab.runs.local import run_local
from surefoot.services.supervisor.scenarios.scenario import Scenario, find_scenario, load_scenario

ARMS = {
    "hand": ("hand", "four"),
    "tuned": ("tuned", "four"),
    "planner": ("planner", "four"),
    "sarsa": ("sarsa", "four"),
    "steer arcs": ("steer", "arcs"),
    "planner arcs": ("planner", "arcs"),
}
"""Name: policy and action set; the first is what the others are compared with."""
LONGEST_S = 600.0
"""Simulated time that a run may take: longer than any that arrives."""
SHOWN = ("goal_time_s", "goal_error_m", "pose_nees", "pose_error_m", "max_tilt_deg", "recoveries")


def scenario_of(arm: str, world: str) -> Scenario:
    """The corridor with one policy."""
    scenario = load_scenario(find_scenario("nao-corridor"))
    policy, actions = ARMS[arm]
    config: dict[str, Any] = {**scenario.config["navigator"], "policy": policy, "actions": actions}
    if world == "easy":
        config |= {"params": "nao", "control": "odometry"}
        easy = scenario.world.model_copy(update={"drift": 0.0, "camera": None, "landmarks": 60.0})
        scenario = replace(scenario, world=easy)
    return replace(scenario, max_duration_s=LONGEST_S, config={"navigator": config})


def one(arm: str, world: str, seed: int, record: Path | None = None) -> dict[str, Any]:
    """Runs one policy on one seed; `record` is the folder for its recording, None = there is none."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    scenario = scenario_of(arm, world)
    if record is None:
        verdict = run_local(scenario, seed, without=("recorder",)).verdict
    else:
        record.mkdir(parents=True, exist_ok=True)
        path = record / f"{world}-{arm.replace(' ', '-')}-{seed}.mcap"
        verdict = run_local(scenario, seed, recording=path).verdict
    return {
        "arm": arm,
        "world": world,
        "seed": seed,
        "problems": list(verdict.problems),
        "failed": [row.name for row in verdict.rows if row.ok is False],
        "values": {name: verdict.value(name) for name in (*SHOWN, "fell", "goals_missed")},
    }


def kept(results: Path | None) -> list[dict[str, Any]]:
    """The lines of a results file; a torn last line is left out."""
    lines: list[dict[str, Any]] = []
    if results is not None and results.exists():
        for text in results.read_text(encoding="utf-8").splitlines():
            try:
                lines.append(json.loads(text))
            except ValueError:
                continue
    return lines


def table(lines: list[dict[str, Any]], world: str, arms: list[str]) -> None:
    """Prints means over the seeds, and the paired difference of the times against the first arm."""
    by = {(line["arm"], line["seed"]): line for line in lines if line["world"] == world}
    print(f"{world} world" + " " * 8 + "n  reached  time s        error m  nees  recoveries  against hand 35 deg")
    for arm in arms:
        own = {seed: line for (name, seed), line in by.items() if name == arm}
        if not own:
            continue
        good = [line for line in own.values() if line["values"]["goal_time_s"] is not None and not line["problems"]]
        times = np.array([line["values"]["goal_time_s"] for line in good])
        worst = max((line["values"]["goal_error_m"] for line in good), default=float("nan"))
        nees = np.mean([line["values"]["pose_nees"] for line in own.values()])
        recoveries = np.mean([line["values"]["recoveries"] or 0.0 for line in own.values()])
        mean = times.mean() if len(times) else float("nan")
        text = f"{arm:16s} {len(own):4d} {len(good):8d}  {mean:6.1f} +- {spread(times):4.1f}"
        print(f"{text}  {worst:7.3f} {nees:5.2f} {recoveries:11.2f}  {against(by, arm, arms[0])}")


def spread(times: np.ndarray) -> float:
    """Standard deviation between seeds, s; nan of one run."""
    return float(times.std(ddof=1)) if len(times) > 1 else float("nan")


def against(by: dict[tuple[str, int], dict[str, Any]], arm: str, base: str) -> str:
    """The paired saving of an arm in per cent with its 95 % interval, and the p-value of a two-sided t-test."""
    pairs = [
        (line["values"]["goal_time_s"], by[base, seed]["values"]["goal_time_s"])
        for (name, seed), line in by.items()
        if name == arm and (base, seed) in by
    ]
    pairs = [(a, b) for a, b in pairs if a is not None and b is not None]
    if arm == base or len(pairs) < 2:
        return ""
    saved = np.array([100.0 * (b - a) / b for a, b in pairs])
    test = ttest_1samp(saved, 0.0)
    low, high = test.confidence_interval()
    return f"{saved.mean():+5.1f} % faster ({low:.1f} to {high:.1f}), p {test.pvalue:.1e}"


def main() -> None:
    """Runs what is missing and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="100:102", help="count, or first:end")
    parser.add_argument("--world", choices=("hard", "easy"), default="hard")
    parser.add_argument("--arms", default=",".join(ARMS), help="names, separated by commas")
    parser.add_argument("--results", type=Path, help="file that keeps finished runs")
    parser.add_argument("--record", type=Path, help="folder for the recordings; default: none are kept")
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    options = parser.parse_args()
    arms, lines = options.arms.split(","), kept(options.results)
    done = {(line["arm"], line["world"], line["seed"]) for line in lines}
    wanted = [(arm, options.world, seed) for seed in seeds_of(options.seeds) for arm in arms]
    with ProcessPoolExecutor(options.processes) as pool:
        for job in as_completed([pool.submit(one, *item, options.record) for item in wanted if item not in done]):
            line = job.result()
            lines.append(line)
            if line["problems"] or line["failed"]:
                print(f"  {line['arm']} seed {line['seed']}: {line['failed']} {line['problems']}", flush=True)
            if options.results is not None:
                with options.results.open("a", encoding="utf-8") as stream:
                    stream.write(f"\n{json.dumps(line)}\n")
    table(lines, options.world, arms)


if __name__ == "__main__":
    main()
