"""Walks under several rules over the same seeds: what they are named, where they are kept, how they compare."""

import json
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.lab.footholds.rules import GridMapRule, MinK2, model_rule, random_rule
from surefoot.lab.footholds.walks import Rule, Setting, walk
from surefoot.services.footholds.models.files import load, shipped
from surefoot.services.footholds.models.protocol import SlipModel
from surefoot.services.footholds.models.score import HandScore
from surefoot.services.footholds.select import SelectParams

Array = NDArray[np.float64]
Line = dict[str, Any]
Lines = dict[tuple[str, str, int], Line]

_EXACT = {
    "rough": Setting("rough", 0.9, 0.04, 0.5, profile="exact"),
    "mixed-0.4": Setting("mixed", 0.9, None, 0.4, profile="exact"),
    "mixed": Setting("mixed", 0.9, None, 0.5, profile="exact"),
    "elevation": Setting("elevation", 0.9, None, 0.5, profile="exact"),
}
TAUGHT = (*_EXACT, *(f"{name}-noise" for name in _EXACT))
"""Those whose mean ratio is the result: the four grounds with exact and with noisy maps."""
GROUNDS: dict[str, Setting] = {
    **_EXACT,
    **{f"{name}-noise": replace(setting, profile="noise") for name, setting in _EXACT.items()},
    "demo": Setting("demo", 0.9, profile="exact"),
    "flat": Setting("flat", 0.9, profile="exact"),
    **{f"{n}-at-{mu}": replace(_EXACT[n], friction=mu) for n in ("rough", "mixed") for mu in (0.35, 0.7)},
}
"""Grounds of the comparison by name: kind, way, height, friction, map."""
RESAMPLINGS = 4000
LEARNED = "learned"


class _Averaged(HandScore):
    """The hand-made score with the landing error of the learned model."""

    @property
    def landing_error(self) -> float:
        """Standard deviation of landings, m."""
        return 0.005


def rule_of(name: str, seed: int, model: str, robot: str) -> Rule | None:
    """Return the rule of a name, None for nominal landings.

    Args:
        name: learned, hand, nominal, random, min-k2:K, grid-map:K or averaged:K with K in 1/m; learned:K and hand:K
            walk with another k than their own. averaged is the hand-made score with the landing error of the model.
        seed: of random footholds.
        model: file of the learned model, or shipped.
        robot: whose shipped model it is.

    Raises:
        ValueError: another name, or no model is shipped for the robot.
    """
    kind, _, weight = name.partition(":")
    if kind == "nominal":
        return None
    if kind == "random":
        return random_rule(seed)
    if kind == LEARNED:
        path = shipped(robot) if model == "shipped" else Path(model)
        if path is None:
            raise ValueError(f"no model is shipped for {robot!r}")
        chosen: SlipModel = load(path)
    else:
        known: dict[str, SlipModel] = {
            "hand": HandScore(), "min-k2": MinK2(), "grid-map": GridMapRule(), "averaged": _Averaged()
        }  # fmt: skip
        if kind not in known:
            raise ValueError(f"got {name!r}, known are learned, nominal, random, {', '.join(known)}")
        chosen = known[kind]
    return model_rule(chosen, SelectParams(distance_weight=float(weight) if weight else None))


def _walked(job: tuple[str, str, int, str, str]) -> Line:
    ground, rule, seed, model, robot = job
    line: Line = {"ground": ground, "rule": rule, "seed": seed}
    try:
        done = walk(seed, replace(GROUNDS[ground], robot=robot), rule_of(rule, seed, model, robot))
    except Exception as error:  # a walk that ends in an error is a result of its own, not the end of a study
        return line | {"error": repr(error)}
    return line | {
        "sliding_mm": done.sliding_mm, "reached": done.reached, "fallen": done.fallen, "steps": done.steps,
        "reason": done.reason,
    }  # fmt: skip


def kept(path: Path | None) -> Lines:
    """Return the walks of a results file; a torn line is none."""
    lines: Lines = {}
    if path is not None and path.exists():
        for text in path.read_text(encoding="utf-8").splitlines():
            try:
                line = json.loads(text)
                lines[line["ground"], line["rule"], line["seed"]] = line
            except (ValueError, KeyError, TypeError):
                continue
    return lines


def walk_missing(
    lines: Lines, grounds: Sequence[str], rules: Sequence[str], seeds: Iterable[int], model: str, robot: str, jobs: int,
    results: Path | None,
) -> None:  # fmt: skip
    """Walk what `lines` lack, ground by ground and seed by seed, and append it to the results file."""
    wanted = list(seeds)
    missing = [
        (ground, rule, seed, model, robot)
        for ground in grounds for seed in wanted for rule in rules if (ground, rule, seed) not in lines
    ]  # fmt: skip
    with ProcessPoolExecutor(jobs) as pool:
        for line in pool.map(_walked, missing):
            lines[line["ground"], line["rule"], line["seed"]] = line
            if results is not None:
                with results.open("a", encoding="utf-8") as stream:
                    stream.write(f"{json.dumps(line)}\n")


def paired(lines: Lines, ground: str, one: str, other: str) -> tuple[Array, Array]:
    """Return the sliding of two rules on the seeds that both have walked, (n,) mm each."""
    seeds = sorted(seed for where, rule, seed in lines if where == ground and rule == one)
    pairs = [(lines[ground, one, seed], lines.get((ground, other, seed), {})) for seed in seeds]
    good = [(a["sliding_mm"], b["sliding_mm"]) for a, b in pairs if "sliding_mm" in a and "sliding_mm" in b]
    found = np.array(good, dtype=np.float64).reshape(-1, 2)
    return found[:, 0], found[:, 1]


def ratio(a: Array, b: Array, rng: np.random.Generator) -> tuple[float, float, float]:
    """Return the ratio of the means with its 95 % interval, resampled in pairs."""
    pick = rng.integers(0, len(a), (RESAMPLINGS, len(a)))
    low, high = np.percentile(a[pick].mean(axis=1) / b[pick].mean(axis=1), [2.5, 97.5])
    return float(a.mean() / b.mean()), float(low), float(high)


def mean_ratio(pairs: Sequence[tuple[Array, Array]], rng: np.random.Generator) -> tuple[float, float, float]:
    """Return the mean over grounds of the ratios with its 95 % interval, seeds resampled on each ground."""
    drawn = np.zeros(RESAMPLINGS)
    for a, b in pairs:
        pick = rng.integers(0, len(a), (RESAMPLINGS, len(a)))
        drawn += a[pick].mean(axis=1) / b[pick].mean(axis=1) / len(pairs)
    low, high = np.percentile(drawn, [2.5, 97.5])
    return float(np.mean([a.mean() / b.mean() for a, b in pairs])), float(low), float(high)


def table(lines: Lines, grounds: Sequence[str], rules: Sequence[str]) -> Iterable[str]:
    """Yield the lines of the comparison: each rule on each ground, and `LEARNED` over it on the seeds both walked."""
    rng = np.random.default_rng(0)
    taught: dict[str, list[tuple[Array, Array]]] = {}
    for ground in grounds:
        s = GROUNDS[ground]
        yield f"{ground}: {s.terrain}, friction {s.friction}, {s.profile} map"
        for rule in rules:
            of_rule = [line for (where, name, _), line in lines.items() if (where, name) == (ground, rule)]
            walked = [line for line in of_rule if "sliding_mm" in line]
            if not walked:
                continue
            mean = np.mean([line["sliding_mm"] for line in walked])
            ended = f"{sum(line['reached'] for line in walked)}/{len(of_rule)} reached"
            text = f"  {rule:<14}{mean:8.3f} mm   {ended}, {sum(line['fallen'] for line in walked)} fell"
            mine, other = paired(lines, ground, LEARNED, rule)
            if rule != LEARNED and len(mine) > 1:
                value, low, high = ratio(mine, other, rng)
                text += f"   learned / it {value:.3f} ({low:.3f} to {high:.3f}), {len(mine)} seeds"
                if ground in TAUGHT:
                    taught.setdefault(rule, []).append((mine, other))
            yield text
    for rule, pairs in taught.items():
        value, low, high = mean_ratio(pairs, rng)
        yield f"learned / {rule}, mean of {len(pairs)} grounds: {value:.3f} ({low:.3f} to {high:.3f})"
