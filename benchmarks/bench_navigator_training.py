"""Twenty fresh trainings of Sarsa(lambda) as in the paper, normal and blurred, against its 35 deg controller.

Targets: >= 19 of 20 at 100 % success and >= 7 % faster in the mean, normal; >= 5 % blurred. Both controllers have the
four-state filter; the hand controller's entropy threshold is the best of six for its vision, on other episodes.

    python -m benchmarks.bench_navigator_training 2000:2020 --results trainings.jsonl

With ``--results`` every finished training is a line of that file and is not run again; begin a new file after a change.
"""

import argparse
import json
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.lab.train.evaluation import Seeds, episodes, paired, summary
from surefoot.lab.train.sarsa import Training
from surefoot.services.navigator.environment.episodes import SECONDS_TAKEN, run_episodes
from surefoot.services.navigator.policy.arrays import arrays
from surefoot.services.navigator.policy.params import load
from surefoot.services.navigator.policy.policies import hand

MODELS = ("paper", "paper-blur")
THRESHOLDS = (-4.0, -3.5, -3.0, -2.5, -2.0, -1.0)
TUNING = Seeds(0, 4000)
TUNING_STREAM = 1
TARGETS = {"paper": 7.0, "paper-blur": 5.0}


def baseline(name: str, evaluation: Seeds) -> tuple[float, Any]:
    """Return the 35 deg controller's best threshold on the tuning episodes and its results on the others."""
    world = arrays(load(name))
    times = {
        h: episodes(world, hand(world, stand_above=h), TUNING, stream=TUNING_STREAM)[:, SECONDS_TAKEN].mean()
        for h in THRESHOLDS
    }
    threshold = min(times, key=lambda h: times[h])
    return threshold, episodes(world, hand(world, stand_above=threshold), evaluation)


def train(name: str, seed: int, evaluation: Seeds, other: Any) -> dict[str, Any]:
    """Train once and return a line about it."""
    model = load(name)
    training = Training(model, seed)
    training.advance(training.schedule.episodes)
    results = run_episodes(arrays(model), training.policy(), 0, evaluation.first, evaluation.count)
    s, p = summary(results), paired(results, other)
    return {
        "model": name,
        "seed": seed,
        "mean_s": s["mean_s"],
        "sd_s": s["sd_s"],
        "success": s["success"],
        "percent": p["difference_percent"],
        "ci95_percent": p["difference_ci95_percent"],
    }


def kept(results: Path | None) -> list[dict[str, Any]]:
    """Return the lines of a results file; a torn last line is left out."""
    lines: list[dict[str, Any]] = []
    if results is not None and results.exists():
        for text in results.read_text(encoding="utf-8").splitlines():
            try:
                lines.append(json.loads(text))
            except ValueError:
                continue
    return lines


def main(arguments: list[str] | None = None) -> None:
    """Run what is missing and print the tables."""
    parser = argparse.ArgumentParser(prog="bench_navigator_training")
    parser.add_argument("seeds", nargs="?", default="2000:2020", help="trainings first:end")
    parser.add_argument("--episodes", default="20000:21000", help="of the evaluation, first:end")
    parser.add_argument("--results", type=Path)
    options = parser.parse_args(arguments)
    first, end = (int(part) for part in options.seeds.split(":"))
    evaluation = Seeds(*(int(part) for part in options.episodes.split(":")))
    for name in MODELS:
        threshold, other = baseline(name, evaluation)
        base = summary(other)
        print(f"{name}: 35 deg controller, h > {threshold}: {base['mean_s']:.2f} s, success {base['success']:.4f}")
        lines = [line for line in kept(options.results) if line["model"] == name]
        missing = [seed for seed in range(first, end) if seed not in {line["seed"] for line in lines}]

        def one(seed: int, name: str = name, other: Any = other) -> dict[str, Any]:
            return train(name, seed, evaluation, other)

        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            for line in pool.map(one, missing):
                lines.append(line)
                if options.results is not None:
                    with options.results.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(line) + "\n")
        report(name, [line for line in lines if first <= line["seed"] < end])


def report(name: str, lines: list[dict[str, Any]]) -> None:
    """Print the trainings of a model and what they say."""
    for line in lines:
        print(f"  seed {line['seed']}: {line['mean_s']:.2f} s, success {line['success']:.4f}, {line['percent']:+.2f} %")
    percent = np.array([line["percent"] for line in lines])
    full, target = sum(line["success"] == 1.0 for line in lines), TARGETS[name]
    half = 1.96 * percent.std(ddof=1) / np.sqrt(percent.size) if percent.size > 1 else float("nan")
    ok = percent.mean() <= -target and full >= 0.95 * len(lines)
    print(f"  mean {percent.mean():+.2f} +-{half:.2f} %, worst {percent.max():+.2f} %, {full} of {len(lines)} arrive;")
    print(f"  target -{target} % and 19 of 20: {'ok' if ok else 'MISSED'}")


if __name__ == "__main__":
    main()
