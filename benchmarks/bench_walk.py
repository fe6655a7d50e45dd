"""Walks over many seeds: how often the hexapod reaches the end, how far its feet slide, what the walker costs.

One process per seed: world, estimator and walker joined by function calls, in the order of a control tick and with
the one-tick actuation delay of bus servos. Truth is read by the judge only.

    python -m benchmarks.bench_walk demo --seeds 0:100
    python -m benchmarks.bench_walk flat --distance 2 --seeds 0:100
    python -m benchmarks.bench_walk --model shipped --seeds 0:20 --results walks.jsonl

With ``--model`` the learned model walks beside the hand-made score and the rules of ``--rules`` on the grounds of
``--grounds``: ratios of mean contact sliding per stance, paired over seeds, with 95 % intervals of 4000 resamplings of
the seeds. Walks in the results file are not walked again; a results file belongs to one state of the code.
"""

import argparse
import json
import math
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.joined import costs_us
from surefoot.lab.footholds.rules import GridMapRule, MinK2, model_rule, random_rule
from surefoot.lab.footholds.walks import Rule, Setting, Walk, walk
from surefoot.services.footholds.models.files import load, shipped
from surefoot.services.footholds.models.score import HandScore
from surefoot.services.footholds.select import SelectParams

__all__ = ["Setting", "foothold_walk", "walk"]

GROUNDS: dict[str, Setting] = {
    "rough": Setting("rough", 0.9, 0.04, 0.5, profile="exact"),
    "rough-noise": Setting("rough", 0.9, 0.04, 0.5, profile="noise"),
    "mixed": Setting("mixed", 0.9, None, 0.5, profile="exact"),
    "mixed-noise": Setting("mixed", 0.9, None, 0.5, profile="noise"),
    "mixed-0.4": Setting("mixed", 0.9, None, 0.4, profile="exact"),
    "elevation": Setting("elevation", 0.9, None, 0.5, profile="exact"),
    "elevation-noise": Setting("elevation", 0.9, None, 0.5, profile="noise"),
    "demo": Setting("demo", 0.9, profile="exact"),
    "flat": Setting("flat", 0.9, profile="exact"),
    "rough-0.35": Setting("rough", 0.9, 0.04, 0.35, profile="exact"),
    "rough-0.7": Setting("rough", 0.9, 0.04, 0.7, profile="exact"),
}
"""Grounds of the comparison by name: kind, way, height, friction, map."""
TAUGHT = ("rough", "rough-noise", "mixed", "mixed-noise", "mixed-0.4", "elevation", "elevation-noise")
"""Those whose mean ratio is the result; the others stand beside them."""
RESAMPLINGS = 4000


def rule_of(name: str, seed: int, model: str, robot: str) -> Rule | None:
    """The rule of a name: learned, hand, nominal, random, min-k2:K, grid-map:K or averaged:K, with K in 1/m.

    averaged:K is the hand-made score with the average over landings of the learned model and a k of its own.
    """
    kind, _, weight = name.partition(":")
    params = SelectParams(distance_weight=float(weight) if weight else None)
    match kind:
        case "nominal":
            return None
        case "random":
            return random_rule(seed)
        case "hand":
            return model_rule(HandScore(), params)
        case "min-k2":
            return model_rule(MinK2(), params)
        case "grid-map":
            return model_rule(GridMapRule(), params)
        case "averaged":
            return model_rule(_Averaged(), params)
        case "learned":
            path = shipped(robot) if model == "shipped" else Path(model)
            if path is None:
                raise ValueError(f"no model is shipped for {robot!r}")
            return model_rule(load(path), params)
    raise ValueError(f"got {name!r}, known are learned, hand, nominal, random, min-k2:K, grid-map:K, averaged:K")


class _Averaged(HandScore):
    """The hand-made score with the landing error of the learned model."""

    @property
    def landing_error(self) -> float:
        """Standard deviation of landings, m."""
        return 0.005


def foothold_walk(seed: int, setting: Setting, footholds: bool = True) -> Walk:
    """A walk with the hand-made score, or on nominal landings."""
    return walk(seed, setting, model_rule(HandScore(), SelectParams()) if footholds else None)


def _compared(job: tuple[str, str, int, str, str]) -> dict[str, Any]:
    ground, rule, seed, model, robot = job
    setting = replace(GROUNDS[ground], robot=robot)
    try:
        done = walk(seed, setting, rule_of(rule, seed, model, robot))
    except Exception as error:  # a walk that ends in an error is a result of its own, not the end of a study
        return {"ground": ground, "rule": rule, "seed": seed, "error": repr(error)}
    return {
        "ground": ground, "rule": rule, "seed": seed, "sliding_mm": done.sliding_mm, "reached": done.reached,
        "fallen": done.fallen, "steps": done.steps, "reason": done.reason,
    }  # fmt: skip


def kept(path: Path | None) -> dict[tuple[str, str, int], dict[str, Any]]:
    """Walks of a results file."""
    lines: dict[tuple[str, str, int], dict[str, Any]] = {}
    if path is not None and path.exists():
        for text in path.read_text(encoding="utf-8").splitlines():
            try:
                line = json.loads(text)
                lines[line["ground"], line["rule"], line["seed"]] = line
            except (ValueError, KeyError):
                continue  # a torn line
    return lines


def ratio(a: np.ndarray, b: np.ndarray, rng: np.random.Generator) -> tuple[float, float, float]:
    """Ratio of means with its 95 % interval, paired over seeds."""
    pick = rng.integers(0, len(a), (RESAMPLINGS, len(a)))
    low, high = np.percentile(a[pick].mean(axis=1) / b[pick].mean(axis=1), [2.5, 97.5])
    return float(a.mean() / b.mean()), float(low), float(high)


def compare(
    model: str, grounds: list[str], rules: list[str], seeds: Iterable[int], robot: str, jobs: int, results: Path | None
) -> None:
    """Walk what is missing and print the table."""
    lines, wanted = kept(results), list(seeds)
    missing = [
        (ground, rule, seed, model, robot)
        for ground in grounds for seed in wanted for rule in rules if (ground, rule, seed) not in lines
    ]  # fmt: skip
    with ProcessPoolExecutor(jobs) as pool:
        for line in pool.map(_compared, missing):
            lines[line["ground"], line["rule"], line["seed"]] = line
            if results is not None:
                with results.open("a", encoding="utf-8") as stream:
                    stream.write(f"{json.dumps(line)}\n")
    rng = np.random.default_rng(0)
    ratios: list[float] = []
    print(f"{robot}, model {model}, seeds {wanted[0]} to {wanted[-1]}: contact sliding per stance, mm")
    for ground in grounds:
        print(
            f"{ground}: {GROUNDS[ground].terrain}, friction {GROUNDS[ground].friction}, {GROUNDS[ground].profile} map"
        )
        for rule in rules:
            pairs = [(lines[ground, "learned", seed], lines[ground, rule, seed]) for seed in wanted]
            good = [(a, b) for a, b in pairs if "sliding_mm" in a and "sliding_mm" in b]
            mine, other = (np.array([pair[k]["sliding_mm"] for pair in good]) for k in (0, 1))
            ended = (
                f"{sum(b['reached'] for _, b in good)}/{len(wanted)} reached, {sum(b['fallen'] for _, b in good)} fell"
            )
            text = f"  {rule:<14}{other.mean():8.3f}   {ended}"
            if rule != "learned":
                value, low, high = ratio(mine, other, rng)
                text += f"   learned / it {value:.3f} ({low:.3f} to {high:.3f})"
                if rule == "hand" and ground in TAUGHT:
                    ratios.append(value)
            print(text, flush=True)
    if ratios:
        print(f"mean ratio of learned to hand-made over {len(ratios)} grounds: {np.mean(ratios):.3f}")


def summary(walks: list[Walk]) -> str:
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
    parser.add_argument("--rules", default="learned,hand", help="with --model; see rule_of")
    parser.add_argument("--results", type=Path, help="with --model: file to go on with, one line a walk")
    args = parser.parse_args()
    first, end = (int(value) for value in args.seeds.split(":"))
    if args.model:
        rules = list(dict.fromkeys(["learned", *args.rules.split(",")]))
        compare(args.model, args.grounds.split(","), rules, range(first, end), args.robot, args.jobs, args.results)
        return
    params = tuple((name, float(value)) for name, _, value in (item.partition("=") for item in args.set))
    setting = Setting(
        terrain=args.terrain, distance=args.distance, amplitude=args.amplitude, friction=args.friction,
        robot=args.robot, profile=args.profile, params=params,
    )  # fmt: skip
    walks: list[Walk] = []
    with ProcessPoolExecutor(args.jobs) as pool:
        for one in pool.map(partial(foothold_walk, setting=setting, footholds=not args.nominal), range(first, end)):
            walks.append(one)
            if args.json or not one.reached:
                kept = {k: v for k, v in asdict(one).items() if k not in ("costs_us", "slides_mm")}
                print(json.dumps(kept), flush=True)
    print(f"{args.terrain} {args.distance} m, seeds {args.seeds}: {summary(walks)}")


if __name__ == "__main__":
    main()
