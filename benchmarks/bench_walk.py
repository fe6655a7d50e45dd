"""Walks over many seeds: how often the hexapod reaches the end, how far its feet slide, what the walker costs.

One process per seed: world, estimator and walker joined by function calls, in the order of a control tick and with
the one-tick actuation delay of bus servos. Truth is read by the judge only.

    python -m benchmarks.bench_walk demo --seeds 0:100
    python -m benchmarks.bench_walk flat --distance 2 --seeds 0:100
    python -m benchmarks.bench_walk --model shipped --seeds 0:20 --results walks.jsonl

With ``--model`` the learned model walks beside the hand-made score and the rules of ``--rules`` on the grounds of
``--grounds``: ratios of mean contact sliding per stance, paired over seeds, with 95 % intervals of 4000 resamplings of
the seeds. Walks in the results file are not walked again; a results file belongs to one robot, one model and one state
of the code. ``--rules learned:0.3,learned:0.8`` compares weights of the distance, on seeds that judge nothing else.
"""

import argparse
import json
import math
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.joined import costs_us
from benchmarks.walk_rules import GROUNDS, TAUGHT, kept, table, walk_missing
from benchmarks.walk_targets import over_flat, verdicts
from surefoot.lab.footholds.rules import model_rule
from surefoot.lab.footholds.walks import Setting, WalkVerdict, walk
from surefoot.services.footholds.models.score import HandScore
from surefoot.services.footholds.select import SelectParams

__all__ = ["Setting", "foothold_walk", "walk"]


def foothold_walk(seed: int, setting: Setting, footholds: bool = True) -> WalkVerdict:
    """A walk with the hand-made score, or on nominal landings."""
    return walk(seed, setting, model_rule(HandScore(), SelectParams()) if footholds else None)


def summary(walks: list[WalkVerdict]) -> str:
    """One line for a table."""
    good = [w for w in walks if w.reached]

    def mean(name: str) -> float:
        return float(np.mean([getattr(w, name) for w in good])) if good else math.nan

    median, worst = costs_us([cost * 1e-6 for w in walks for cost in w.costs_us])
    return ", ".join(
        (
            f"{len(good)}/{len(walks)} reached",
            f"{sum(w.fallen for w in walks)} fell",
            f"tilt <= {max(w.tilt_deg for w in walks):.1f} deg",
            f"sliding {mean('sliding_mm'):.3f}, displacement {mean('displacement_mm'):.2f} mm per stance",
            f"odometry {mean('odometry_mm'):.1f} mm",
            f"margin >= {min(w.margin_mm for w in walks):.0f} mm",
            f"{mean('time_s'):.1f} s",
            f"unreachable {mean('unreachable'):.1f}",
            f"walker {median:.0f} us (p99 {worst:.0f})",
        )
    )


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("terrain", nargs="?", default="demo")
    parser.add_argument("--distance", type=float, default=1.5)
    parser.add_argument("--seeds", default="0:10", help="first:end")
    parser.add_argument("--amplitude", type=float)
    parser.add_argument("--friction", type=float, default=Setting().friction)
    parser.add_argument("--robot", default="ragno")
    parser.add_argument("--profile", default="noise")
    parser.add_argument("--nominal", action="store_true", help="land on nominal footholds")
    parser.add_argument("--set", action="append", default=[], metavar="FIELD=NUMBER", help="of WalkerParams")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--model", help="compare: a model file, or shipped")
    parser.add_argument("--grounds", default=",".join(TAUGHT), help=f"with --model, of {', '.join(GROUNDS)}")
    parser.add_argument("--rules", default="learned,hand", help="with --model; see walk_rules.rule_of")
    parser.add_argument("--report", action="store_true", help="with --results: walk nothing, print what is there")
    parser.add_argument("--results", type=Path, help="with --model: file to go on with, one line a walk")
    args = parser.parse_args()
    first, end = (int(value) for value in args.seeds.split(":"))
    if args.model:
        rules, grounds = args.rules.split(","), args.grounds.split(",")
        lines = kept(args.results)
        if not args.report:
            walk_missing(lines, grounds, rules, range(first, end), args.model, args.robot, args.jobs, args.results)
        print(f"{args.robot}, model {args.model}: contact sliding per stance")
        for text in (*table(lines, grounds, rules), *over_flat(lines), *verdicts(lines)):
            print(text)
        return
    params = tuple((name, float(value)) for name, _, value in (item.partition("=") for item in args.set))
    setting = Setting(
        terrain=args.terrain, distance=args.distance, amplitude=args.amplitude, friction=args.friction,
        robot=args.robot, profile=args.profile, params=params,
    )  # fmt: skip
    walks: list[WalkVerdict] = []
    with ProcessPoolExecutor(args.jobs) as pool:
        for one in pool.map(partial(foothold_walk, setting=setting, footholds=not args.nominal), range(first, end)):
            walks.append(one)
            if args.json or not one.reached:
                facts = {k: v for k, v in asdict(one).items() if k not in ("costs_us", "slides_mm")}
                print(json.dumps(facts), flush=True)
    print(f"{args.terrain} {args.distance} m, seeds {args.seeds}: {summary(walks)}")


if __name__ == "__main__":
    main()
