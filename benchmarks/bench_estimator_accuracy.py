"""Accuracy of the estimators against truth, beside referees whose noise is tuned for each set of logs.

    python -m benchmarks.bench_estimator_accuracy [--synthetic] [--walks] [--logs] [--all] [--consistency] [--ablation]
        [--faults] [--closed-loop] [--seeds 0:10] [--sets NAME ...] [--estimators NAME ...] [--references NAME ...]
        [--json FILE]

rmse = rms length of the velocity error, cm/s; 0.5 s = the same of errors averaged over half a second; avg = error of
the mean velocity along the track, %; NEES of v (3 = ideal); odo = error of the displacement per net metre, %; int = gap
between the integrated velocity and the odometry, % of the way. +- is the 95 % interval of the mean over the seeds.
Referees are tuned on seeds that are not scored (on the log itself where there is only one, which favours them).
"""

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.lab.estimation.scores import Score
from surefoot.lab.estimation.track import PEERS, names
from surefoot.lab.statistics import interval
from surefoot.papers.wawrzynski.compare import (
    Comparison,
    ablation,
    closed_loop,
    compare,
    consistency,
    fault_ratios,
    ratio,
    start_ratios,
)  # fmt: skip
from surefoot.papers.wawrzynski.sets import REFERENCES, LogSet, humanoid_sets, synthetic_sets, walk_sets

COLUMNS = ("rmse", "+-", "0.5 s", "+-", "|avg|", "worst", "drift", "NEES", "tilt", "odo", "worst", "z mm", "yaw", "int")
PARTS = ("synthetic", "walks", "logs", "all", "consistency", "ablation", "faults", "closed-loop")


def half(values: Sequence[float]) -> float:
    """Half width of the 95 % interval of the mean; NaN for one value."""
    if len(values) < 2:
        return math.nan
    low, high = interval(np.array(values))
    return 0.5 * (high - low)


def line(scores: Sequence[Score]) -> str:
    """One row of a table."""

    def mean(name: str) -> float:
        return float(np.mean([getattr(s, name) for s in scores]))

    def most(name: str) -> float:
        return max(getattr(s, name) for s in scores)

    numbers = (
        100 * mean("rmse"), 100 * half([s.rmse for s in scores]), 100 * mean("smooth"),
        100 * half([s.smooth for s in scores]), mean("percent"), most("percent"), 100 * mean("drift"), mean("nees"),
        mean("tilt_deg"), 100 * mean("odometry"), 100 * most("odometry"), 1e3 * mean("height"),
        float(np.mean([abs(s.heading_deg) for s in scores])), 100 * mean("integral"),
    )  # fmt: skip
    return "".join(f"{x:8.3f}" if i == 6 else f"{x:8.2f}" for i, x in enumerate(numbers))


def show(found: Comparison, subjects: Sequence[str]) -> None:
    """Print the scores of one set, the noise of the referees, and ratios to the best of them."""
    count = len(next(iter(found.scores.values())))
    print(f"\n{found.name}, {count} log{'s' if count > 1 else ''}, referees tuned for {found.measure}")
    print(f"{'':18}" + "".join(f"{name:>8}" for name in COLUMNS))
    for name, scores in found.scores.items():
        print(f"{name:18}{line(scores)}")
    for name, noise in found.noise.items():
        if noise:
            print(f"  {name}: " + ", ".join(f"{k} {v:.3g}" for k, v in noise.items()))
    for name in subjects:
        for measure in ("rmse", "smooth"):
            best = found.best_reference(measure)
            if best is not None and name not in found.noise:
                value, plus = ratio(found.scores[name], found.scores[best], measure)
                print(f"  {name} / {best} by {measure}: {value:.3f} +- {plus:.3f}")


def seeds_of(text: str) -> range:
    """`a:b`, or `n` for 0:n."""
    first, _, end = text.rpartition(":")
    return range(int(first or 0), int(end))


def chosen_sets(parts: Sequence[str], only: Sequence[str]) -> list[LogSet]:
    """Sets of the parts that were asked for."""
    every = "all" in parts
    sets: list[LogSet] = []
    if every or "synthetic" in parts:
        sets += synthetic_sets()
    if every or "walks" in parts:
        sets += walk_sets()
    if every or "logs" in parts:
        sets += humanoid_sets()
    return [one for one in sets if not only or one.name in only]


def main(arguments: list[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for part in PARTS:
        parser.add_argument(f"--{part}", action="store_true")
    parser.add_argument("--seeds", type=seeds_of, default=range(10))
    known = (*names(), *PEERS)
    parser.add_argument(
        "--sets", nargs="+", metavar="NAME", choices=[one.name for one in chosen_sets(["all"], [])], default=[]
    )
    parser.add_argument("--estimators", nargs="+", metavar="NAME", choices=known, default=["best", "ekf"])
    parser.add_argument("--references", nargs="*", metavar="NAME", choices=known, default=list(REFERENCES))
    parser.add_argument("--retune", action="store_true", help="search the noise of the referees again")
    parser.add_argument("--json", type=Path, help="write the scores as well")
    args = parser.parse_args(arguments)
    parts = [part for part in PARTS if getattr(args, part.replace("-", "_"))] or ["synthetic", "logs"]
    kept: dict[str, Any] = {}
    shares: dict[str, list[float]] = {name: [] for name in args.estimators}
    for chosen in chosen_sets(parts, args.sets):
        measure = "smooth" if "all" in parts else "rmse"
        found = compare(chosen, args.estimators, args.references, args.seeds, measure, args.retune)
        show(found, args.estimators)
        kept[chosen.name] = {name: [asdict(s) for s in scores] for name, scores in found.scores.items()}
        best = found.best_reference("smooth")
        for name in args.estimators if best is not None else ():
            shares[name].append(ratio(found.scores[name], found.scores[str(best)], "smooth")[0])
    if "all" in parts:
        print("\nerror over 0.5 s against the best referee of each set (goal: worst <= 1.25, mean <= 1.00)")
        for name, values in shares.items():
            if values:
                print(f"{name:18} mean {np.mean(values):.3f}  worst {max(values):.3f}")
    subject = args.estimators[0]
    if "closed-loop" in parts:
        print("\npublished in the walk itself")
        print(f"{'':18}" + "".join(f"{name:>8}" for name in COLUMNS))
        for chosen in walk_sets():
            if not args.sets or chosen.name in args.sets:
                scores, ok = closed_loop(chosen.name, args.seeds)
                kept[f"closed loop {chosen.name}"] = [asdict(s) for s in scores]
                print(f"{chosen.name:18}{line(scores)}   {ok} of {len(scores)} verdicts good")
    if "consistency" in parts:
        print("\none sample of each of 50 walks: mean NEES of v (3) and of the tilt (2), and the 95 % bands")
        for name in args.estimators:
            for kind in ("twist", "slip"):
                v, tilt = consistency(name, kind, range(1000, 1050))
                print(f"{name:18}{kind:8} v {v:6.2f} [2.36, 3.72]   tilt {tilt:6.2f} [1.48, 2.59]")
    if "ablation" in parts:
        print("\nhypotheses off / on, rmse ratio (goal: no set worse by more than 3 % with them)")
        for chosen in chosen_sets(["all"], args.sets):
            for name, value in ablation(subject, chosen, args.seeds).items():
                print(f"{chosen.name:18}{name:12} on / off {value:.3f}")
    if "faults" in parts:
        print(f"\n{subject}: rmse with a fault / without (odometry likewise), mean over the seeds")
        for chosen in [
            one
            for one in (*synthetic_sets(["twist"]), *walk_sets(["bioloid"]))
            if not args.sets or one.name in args.sets
        ]:
            for fault in (*fault_ratios(subject, chosen, args.seeds), *start_ratios(subject, chosen, args.seeds)):
                print(f"{chosen.name:10}{fault.name:22} v {fault.v:6.3f}  odometry {fault.odometry:7.3f}  {fault.note}")
    if args.json:
        args.json.write_text(json.dumps(kept, indent=1))


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
