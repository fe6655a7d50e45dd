"""Footholds compared from one state: how much of what could be gained each selector gains.

    python -m benchmarks.bench_pairs --seeds 300:310 --results pairs.jsonl --samples pairs-samples.jsonl
    python -m benchmarks.bench_pairs --report --results pairs.jsonl

From every third question of a walk with nominal footholds, each selector and `--draws` random footholds take the same
step (`surefoot.lab.footholds.pairs`), for one leg (`--legs one`) or for all that land together (`--legs all`). Printed
is the share of the gap (random - chosen) / (random - best tried) of the sliding in the next stance, by the mean and by
the mean without 5 % at each end, with 95 % intervals of 4000 resamplings of the walks. Walks in the results file are
not walked again. The stances also become samples to learn from.
"""

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.walk_rules import GROUNDS, RESAMPLINGS, rule_of
from surefoot.lab.footholds.campaign import append, sample_of
from surefoot.lab.footholds.pairs import PairedState, gap_share, paired_steps, trimmed
from surefoot.lab.footholds.rules import nominal_rule, random_rule
from surefoot.lab.footholds.walks import Rule
from surefoot.services.footholds.learning.samples import StanceSample

Array = NDArray[np.float64]
RANDOM = "random-"
BRANCHES = 1000
"""Samples of one walk are told apart by their step: that of the question times this plus the number of the arm."""
Job = tuple[str, int, tuple[str, ...], int, int, str, str, str]


def pairs_of(job: Job) -> tuple[Job, list[dict[str, Any]], list[StanceSample]]:
    """Return the states of one walk, a line each, and their samples."""
    ground, seed, names, draws, every, legs, model, robot = job
    setting = replace(GROUNDS[ground], robot=robot)
    rules: dict[str, Rule] = {name: rule_of(name, seed, model, robot) or nominal_rule() for name in names}
    rules |= {f"{RANDOM}{k}": random_rule((seed + 1) * 1000 + k) for k in range(draws)}
    joined, states = paired_steps(seed, setting, nominal_rule(), rules, every, legs == "one")
    trial = f"pairs-{legs}-{robot}-{ground}-{seed}"
    lines = [_line(ground, seed, legs, state) for state in states]
    samples = [
        replace(
            sample_of(stance, joined.selector.ground, trial), step=state.step * BRANCHES + number,
            friction=setting.friction, robot=robot, robot_hash=joined.robot.hash, source=f"pairs {ground}",
        )
        for state in states for number, arm in enumerate(state.arms) for stance in arm.stances
    ]  # fmt: skip
    return job, lines, samples


def _line(ground: str, seed: int, legs: str, state: PairedState) -> dict[str, Any]:
    return {
        "ground": ground, "seed": seed, "legs": legs, "step": state.step, "in_question": state.legs,
        "arms": {arm.name: round(state.sliding(arm), 4) for arm in state.arms},
        "fallen": sum(arm.fallen for arm in state.arms),
    }  # fmt: skip


def kept(path: Path) -> list[dict[str, Any]]:
    """Return the lines of a results file; a torn line is none."""
    lines: list[dict[str, Any]] = []
    for text in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        try:
            lines.append(json.loads(text))
        except ValueError:
            continue
    return lines


def complete(lines: list[dict[str, Any]], names: tuple[str, ...]) -> list[dict[str, Any]]:
    """Return the states in which every selector and at least two random footholds have an outcome."""
    return [
        line for line in lines
        if "arms" in line and all(np.isfinite(line["arms"].get(name, np.nan)) for name in names)
        and len(_drawn(line)) >= 2
    ]  # fmt: skip


def _drawn(line: dict[str, Any]) -> Array:
    values = [value for name, value in line["arms"].items() if name.startswith(RANDOM)]
    found = np.array(values, dtype=np.float64)
    return found[np.isfinite(found)]


def shares(lines: list[dict[str, Any]], name: str) -> tuple[float, float]:
    """Return the share of the gap of a selector by the mean and by the trimmed mean."""
    drawn = [_drawn(line) for line in lines]
    best = np.array([np.nanmin(list(line["arms"].values())) for line in lines])
    chosen = np.array([line["arms"][name] for line in lines])
    return gap_share(drawn, chosen, best), gap_share(drawn, chosen, best, trimmed)


def interval(lines: list[dict[str, Any]], name: str) -> tuple[float, float]:
    """Return the 95 % interval of the share by the mean, whole walks resampled."""
    rng, walks = np.random.default_rng(0), sorted({line["seed"] for line in lines})
    drawn = np.array([[_drawn(line).mean(), line["arms"][name], np.nanmin(list(line["arms"].values()))]
                      for line in lines])  # fmt: skip
    sums = np.array([drawn[[line["seed"] == walk for line in lines]].sum(axis=0) for walk in walks])
    total = sums[rng.integers(0, len(walks), (RESAMPLINGS, len(walks)))].sum(axis=1)
    low, high = np.percentile((total[:, 0] - total[:, 1]) / (total[:, 0] - total[:, 2]), [2.5, 97.5])
    return float(low), float(high)


def report(lines: list[dict[str, Any]], names: tuple[str, ...]) -> None:
    """Print the shares for each ground and kind of state."""
    kinds = sorted({(line["ground"], line["legs"]) for line in lines if "arms" in line})
    for ground, legs in kinds:
        found = complete([line for line in lines if (line["ground"], line["legs"]) == (ground, legs)], names)
        if len(found) < 2:
            continue
        drawn = np.mean([_drawn(line).mean() for line in found])
        best = np.mean([np.nanmin(list(line["arms"].values())) for line in found])
        print(
            f"{ground}, {legs} leg{'s' * (legs == 'all')}: {len(found)} states, random {drawn:.3f} mm, best {best:.3f}"
        )
        for name in names:
            mean, cut = shares(found, name)
            low, high = interval(found, name)
            slid = np.mean([line["arms"][name] for line in found])
            print(f"  {name:<14}{slid:8.3f} mm   {100 * mean:4.0f} % ({100 * low:.0f} to {100 * high:.0f}), "
                  f"trimmed {100 * cut:4.0f} %")  # fmt: skip


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grounds", default="rough,mixed-0.4,elevation", help=f"of {', '.join(GROUNDS)}")
    parser.add_argument("--seeds", default="300:304", help="first:end")
    parser.add_argument("--rules", default="nominal,hand,learned", help="selectors; see walk_rules.rule_of")
    parser.add_argument("--draws", type=int, default=5, help="random footholds from each state")
    parser.add_argument("--every", type=int, default=3, help="a state at every n-th step; odd: both tripods")
    parser.add_argument("--legs", choices=("one", "all"), default="one")
    parser.add_argument("--model", default="shipped", help="a model file, or shipped")
    parser.add_argument("--robot", default="ragno")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--results", type=Path, required=True, help="file to go on with, one line a state")
    parser.add_argument("--samples", type=Path, help="file that the stances are appended to")
    parser.add_argument("--report", action="store_true", help="walk nothing, print what is there")
    args = parser.parse_args()
    first, end = (int(value) for value in args.seeds.split(":"))
    names = tuple(args.rules.split(","))
    lines = kept(args.results)
    done = {(line["ground"], line["seed"], line["legs"]) for line in lines if "end" in line}
    jobs: list[Job] = [
        (ground, seed, names, args.draws, args.every, args.legs, args.model, args.robot)
        for seed in range(first, end) for ground in args.grounds.split(",")
        if not args.report and (ground, seed, args.legs) not in done
    ]  # fmt: skip
    with ProcessPoolExecutor(args.jobs) as pool:
        for job, states, samples in pool.map(pairs_of, jobs):
            ended = {"ground": job[0], "seed": job[1], "legs": job[5], "end": len(states)}
            with args.results.open("a", encoding="utf-8") as stream:
                stream.write("".join(f"{json.dumps(line)}\n" for line in [*states, ended]))
            lines += states
            if args.samples is not None and samples:
                append(args.samples, samples[0].trial, samples)
    report(lines, names)


if __name__ == "__main__":
    main()
