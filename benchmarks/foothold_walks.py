"""Walks of a hexapod under rules that choose its footholds: sliding, targets, the slip that the robot measures itself.

World, estimator and walker are joined by function calls, in the order of a control tick and with the one-tick actuation
delay of bus servos; truth is read for the figures only. With ``--results FILE`` each finished run is a line of that
file, and runs that it holds are not repeated; a file belongs to one robot, one model and one state of the code.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bench import Bench, microseconds, table, words_of
from benchmarks.own_slip import FAULTS, SlipFollower, closed, explored, faulty_walk, rms, rough, start
from benchmarks.rivals import GridMapRule, MinK2
from surefoot.arrays import Array
from surefoot.lab.footholds.campaign import read
from surefoot.lab.footholds.rules import model_rule, random_rule
from surefoot.lab.footholds.walks import JoinedWalk, Rule, Setting, walk
from surefoot.lab.statistics import Ranged, mean_ratio, ratio, resampled
from surefoot.lab.studies import Line, finished, seeds_of, study
from surefoot.services.footholds.learning.merge import candidate_of
from surefoot.services.footholds.learning.quality import auc
from surefoot.services.footholds.learning.relearn import Form, relearned
from surefoot.services.footholds.models.files import load, shipped
from surefoot.services.footholds.models.learned import LearnedModel
from surefoot.services.footholds.models.protocol import SlipModel
from surefoot.services.footholds.models.score import HandScore
from surefoot.services.footholds.select import SelectParams

BENCH = Bench("foothold_walks")

Pair = tuple[Array, Array]
Lines = dict[tuple[str, str, int], Line]
"""Results of walks by ground, rule of footholds and seed."""

_EXACT = {
    "rough": Setting("rough", 0.9, 0.04, 0.5, profile="exact"),
    "mixed-0.4": Setting("mixed", 0.9, None, 0.4, profile="exact"),
    "mixed": Setting("mixed", 0.9, None, 0.5, profile="exact"),
    "elevation": Setting("elevation", 0.9, None, 0.5, profile="exact"),
}
TAUGHT = (*_EXACT, *(f"{name}-noise" for name in _EXACT))
"""Grounds whose mean ratio of sliding is the result: four, each with exact and with noisy maps."""
GROUNDS: dict[str, Setting] = {
    **_EXACT,
    **{f"{name}-noise": replace(setting, profile="noise") for name, setting in _EXACT.items()},
    "demo": Setting("demo", 0.9, profile="exact"),
    "flat": Setting("flat", 0.9, profile="exact"),
    **{f"{n}-at-{mu}": replace(_EXACT[n], friction=mu) for n in ("rough", "mixed") for mu in (0.35, 0.7)},
}
"""Conditions of the grounds of the comparison by name: kind, distance (m), height (m), friction, map."""
LEARNED = "learned"
MEAN_OVER_HAND, EASY_OVER_HAND = 0.70, 1.05
EASY = ("demo", "flat")
OVER_RANDOM = {"rough": 0.15, "mixed-0.4": 0.33, "elevation": 0.33}
RIVALS = ("nominal", "min-k2", "grid-map")
SEEDS = 20
"""Number of seeds on a ground below which a target is printed together with its number of seeds."""


class Averaged(HandScore):
    """Hand-made slip score whose slip is averaged over the landing error of the learned model, 5 mm."""

    @property
    def landing_error(self) -> float:
        """Standard deviation of landings around the chosen cell, m."""
        return 0.005


def rule_of(name: str, seed: int, model: str, robot: str) -> Rule | None:
    """Return the rule of a name, None for nominal landings.

    Args:
        name: learned, hand, nominal, random, min-k2:K, grid-map:K or averaged:K with K in 1/m; learned:K and hand:K
            walk with another k than their own. averaged is the hand-made score with the landing error of the model.
        seed: seed of random footholds.
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
            "hand": HandScore(), "min-k2": MinK2(), "grid-map": GridMapRule(), "averaged": Averaged()
        }  # fmt: skip
        if kind not in known:
            raise ValueError(f"got {name!r}, known are learned, nominal, random, {', '.join(known)}")
        chosen = known[kind]
    return model_rule(chosen, SelectParams(distance_weight=float(weight) if weight else None))


def walked(ground: str, rule: str, seed: int, model: str, robot: str) -> Line:
    """Walk over a ground under a rule; return its figures, or the error that ended it, which is a result of its own."""
    try:
        done = walk(seed, replace(GROUNDS[ground], robot=robot), rule_of(rule, seed, model, robot))
    except Exception as error:
        return {"error": repr(error)}
    return {
        "sliding_mm": done.sliding_mm, "reached": done.reached, "fallen": done.fallen, "steps": done.steps,
        "reason": done.reason,
    }  # fmt: skip


def paired(lines: Lines, ground: str, one: str, other: str) -> Pair:
    """Return the sliding of two rules on the seeds that both have walked, (n,) mm each."""
    seeds = sorted(seed for where, rule, seed in lines if where == ground and rule == one)
    pairs = [(lines[ground, one, seed], lines.get((ground, other, seed), {})) for seed in seeds]
    good = [(a["sliding_mm"], b["sliding_mm"]) for a, b in pairs if "sliding_mm" in a and "sliding_mm" in b]
    found = np.array(good, dtype=np.float64).reshape(-1, 2)
    return found[:, 0], found[:, 1]


def sliding(lines: Lines, ground: str, rule: str) -> list[float]:
    """Return the mean contact sliding per stance under a rule on a ground, mm, for each seed."""
    return [line["sliding_mm"] for (where, name, _), line in lines.items()
            if (where, name) == (ground, rule) and "sliding_mm" in line]  # fmt: skip


def comparison(lines: Lines, grounds: Sequence[str], rules: Sequence[str]) -> Iterator[tuple[object, ...]]:
    """Yield a row for each rule on each ground, and the mean over grounds of `LEARNED` over it, on common seeds."""
    rng = np.random.default_rng(0)
    taught: dict[str, list[Pair]] = {}
    for ground in grounds:
        s = GROUNDS[ground]
        for rule in rules:
            every = [line for (where, name, _), line in lines.items() if (where, name) == (ground, rule)]
            done = [line for line in every if "sliding_mm" in line]
            if not done:
                continue
            mine, other = paired(lines, ground, LEARNED, rule)
            over: tuple[object, ...] = ()
            if rule != LEARNED and len(mine) > 1:
                over = (*ratio(mine, other, rng), len(mine))
                if ground in TAUGHT:
                    taught.setdefault(rule, []).append((mine, other))
            mean, ended = float(np.mean(sliding(lines, ground, rule))), f"{sum(line['reached'] for line in done)}"
            fell = sum(line["fallen"] for line in done)
            where = f"{ground} ({s.terrain}, {s.friction}, {s.profile} map)"
            yield where, rule, mean, f"{ended}/{len(every)}", fell, *over
    for rule, pairs in taught.items():
        yield f"mean of {len(pairs)} grounds", rule, None, None, None, *mean_ratio(pairs, rng)


@dataclass(frozen=True)
class Verdict:
    """One target of the comparison of foothold rules, and whether it was met."""

    what: str
    value: float
    goal: str
    met: bool | None
    """True if the target was met, False if missed; None = not all grounds have results yet."""
    pairs: int
    """Number of paired seeds on the ground that has the fewest."""

    def row(self) -> tuple[object, ...]:
        """Return the row of the table of targets: what, value, goal, state, and `pairs` if below `SEEDS`."""
        seeds = f"{self.pairs} seeds of {SEEDS}" if self.pairs < SEEDS else ""
        return self.what, f"{self.value:.3f}", self.goal, {True: "met", False: "missed", None: "open"}[self.met], seeds


def verdicts(lines: Lines) -> Iterator[Verdict]:
    """Yield every target for which a ground has at least two paired walks."""
    rng = np.random.default_rng(0)
    found = {ground: paired(lines, ground, LEARNED, "hand") for ground in TAUGHT}
    found = {ground: pair for ground, pair in found.items() if len(pair[0]) > 1}
    if found:
        least = min(len(pair[0]) for pair in found.values())
        mean = mean_ratio(list(found.values()), rng)[0]
        what = f"learned / hand, mean of {len(found)} of {len(TAUGHT)} grounds"
        met = mean <= MEAN_OVER_HAND if len(found) == len(TAUGHT) else None
        yield Verdict(what, mean, f"<= {MEAN_OVER_HAND}", met, least)
        highs = {ground: ratio(*pair, rng).high for ground, pair in found.items()}
        worst = max(highs, key=lambda ground: highs[ground])
        yield Verdict(f"upper end of the worst interval, {worst}", highs[worst], "< 1", highs[worst] < 1.0, least)
    bounds = [(ground, "hand", EASY_OVER_HAND) for ground in EASY]
    bounds += [(ground, "random", bound) for ground, bound in OVER_RANDOM.items()]
    for ground, rule, bound in bounds:
        a, b = paired(lines, ground, LEARNED, rule)
        if len(a) > 1:
            value = float(a.mean() / b.mean())
            yield Verdict(f"learned / {rule} on {ground}", value, f"<= {bound}", value <= bound, len(a))
    for rival in sorted({rule for _, rule, _ in lines if rule.partition(":")[0] in RIVALS}):
        pairs = [pair for ground in TAUGHT if len((pair := paired(lines, ground, LEARNED, rival))[0]) > 1]
        if pairs:
            value, _, high = mean_ratio(pairs, rng)
            what = f"learned / {rival}, mean of {len(pairs)} grounds (to {high:.3f})"
            yield Verdict(what, value, "interval < 1", high < 1.0, min(len(pair[0]) for pair in pairs))
    both = [(line, lines[ground, "nominal", seed]) for (ground, rule, seed), line in lines.items()
            if rule == LEARNED and (ground, "nominal", seed) in lines]  # fmt: skip
    if both:
        mine, other = (sum(bool(pair[k].get("fallen")) for pair in both) for k in (0, 1))
        yield Verdict(f"falls in {len(both)} walks", mine, f"<= {other} of nominal", mine <= other, len(both))


def over_flat(lines: Lines) -> list[tuple[object, ...]]:
    """Return a row per ground: name, and the sliding of learned footholds on it over that on flat ground, no unit."""
    flat, mine = sliding(lines, "flat", LEARNED), {ground: sliding(lines, ground, LEARNED) for ground in TAUGHT}
    return [(ground, float(np.mean(found) / np.mean(flat))) for ground, found in mine.items() if flat and found]


@BENCH.part()
def rules(
    *, rules: str = "learned,hand", grounds: str = ",".join(TAUGHT), seeds: str = "0:10", model: str = "shipped",
    robot: str = "ragno", results: Path | None = None, processes: int = 2, report: bool = False,
) -> None:  # fmt: skip
    """Compare learned footholds with other rules: ratios of mean sliding per stance, paired over seeds, and targets.

    Intervals are 95 % of 4000 resamplings of the seeds. ``--rules learned:0.3,learned:0.8`` compares two
    weights k of the distance to the nominal foothold, 1/m; give seeds that no other study uses.

    Args:
        rules: names of rules, comma-separated, see `rule_of`.
        grounds: names of grounds, comma-separated, see `GROUNDS`.
        model: a model file, or shipped.
        robot: name of the robot.
        report: walk nothing, print what the results file holds.
    """
    names, places = words_of(rules), words_of(grounds)
    jobs = [{"ground": ground, "rule": rule, "seed": seed}
            for ground in places for seed in seeds_of(seeds) for rule in names]  # fmt: skip
    function = partial(walked, model=model, robot=robot)
    done = [] if report else study(function, jobs, results, processes=processes)
    found = finished(results) if results is not None else done
    lines = {(line["ground"], line["rule"], line["seed"]): line for line in found}
    header = ("ground", "rule", "sliding mm", "reached", "fell", "learned / it", "from", "to", "seeds")
    table(f"{robot}, model {model}: contact sliding per stance", header, comparison(lines, places, names))
    table("learned footholds over those on flat ground", ("ground", "ratio"), over_flat(lines))
    table("targets", ("target", "value", "goal", "", ""), [each.row() for each in verdicts(lines)])


@dataclass(frozen=True)
class Course:
    """Conditions of walks with the hand-made score.

    Attributes:
        distance: length of the walk, m.
        amplitude: height of the ground, m; default: that of the kind.
        friction: friction coefficient of the ground.
        robot: name of the robot.
        profile: profile of the map, `noise` or `exact`.
        set: values of WalkerParams as name=number, comma-separated.
        nominal: land on nominal footholds.
    """

    distance: float = 1.5
    amplitude: float | None = None
    friction: float = Setting().friction
    robot: str = "ragno"
    profile: str = "noise"
    set: str = ""
    nominal: bool = False

    def on(self, terrain: str) -> Setting:
        """Return the setting of a walk over a kind of ground."""
        params = tuple((name, float(value)) for name, _, value in (word.partition("=") for word in words_of(self.set)))
        return Setting(terrain, self.distance, self.amplitude, self.friction, self.robot, self.profile, params=params)


def scored(seed: int, terrain: str, course: Course) -> Line:
    """Simulate a walk on `terrain`, footholds by the hand-made score or nominal; return its line of results."""
    rule = None if course.nominal else model_rule(HandScore(), SelectParams())
    return dict(vars(walk(seed, course.on(terrain), rule)))


@BENCH.part("flat --seeds 0:1 --distance 0.1")
def scores(terrain: str = "demo", /, *, course: Course, seeds: str = "0:10", processes: int = 2) -> None:
    """Simulate walks with the hand-made score: print arrivals, falls, sliding of feet, processor time of the walker.

    Args:
        terrain: kind of ground.
        course: conditions of the walks.
    """
    jobs = [{"seed": seed} for seed in seeds_of(seeds)]
    lines = study(partial(scored, terrain=terrain, course=course), jobs, processes=processes)
    good = [line for line in lines if line["reached"]]
    means = ("sliding_mm", "displacement_mm", "odometry_mm", "time_s", "unreachable")
    median, worst = microseconds([cost * 1e-6 for line in lines for cost in line["costs_us"]])
    rows = [
        ("reached", f"{len(good)} of {len(lines)}"),
        ("fell", sum(line["fallen"] for line in lines)),
        ("largest tilt, deg", max(line["tilt_deg"] for line in lines)),
        ("least margin, mm", min(line["margin_mm"] for line in lines)),
        *((f"mean {name}", float(np.mean([line[name] for line in good])) if good else math.nan) for name in means),
        ("walker, us a tick, median", median),
        ("walker, us a tick, 99th percentile", worst),
    ]
    table(f"{terrain} {course.distance:g} m, seeds {seeds}", ("what", "figure"), rows)


SLIP = Setting("rough", 0.9, 0.04, 0.5, profile="noise")
FAR_MM = 2.0


def measured(seed: int, rule: str) -> Line:
    """Walk under a rule; return each stance's slip, mm: by the robot, and true by both definitions of `slip`."""
    chosen = random_rule(seed) if rule == "random" else model_rule(HandScore(), SelectParams())
    joined = JoinedWalk(seed, SLIP, chosen)
    follower = SlipFollower(joined)
    while joined.tick():
        follower.look()
    return {"stances": [[round(1e3 * v, 4) for v in (s.own, s.inside, s.whole)] for s in follower.found]}


def of_slip(walks: list[Array], column: int) -> tuple[Ranged, Ranged, Ranged]:
    """Return AUC of slips over 2 mm, RMSE and bias (mm) of column 0 (own slip) of walks (n, 3) mm against `column`."""

    def over(statistic: Any) -> Ranged:
        def of(chosen: Sequence[Array]) -> float:
            rows = np.concatenate(chosen)
            return statistic(rows[:, 0], rows[:, column])

        return resampled(walks, of)

    return (
        over(lambda own, true: auc(own, true > FAR_MM)), over(lambda own, true: rms(own - true)),
        over(lambda own, true: float(np.mean(own - true))),
    )  # fmt: skip


@BENCH.part("--seeds 0:1")
def faults(*, seeds: str = "0:10", processes: int = 2) -> None:
    """Count stances that would be learned from, of a leg with a faulty sensor and of sound legs; walks as in `slip`."""
    jobs = [{"fault": fault, "seed": seed} for fault in FAULTS for seed in seeds_of(seeds)]
    lines = study(partial(faulty_walk, setting=SLIP, rule=None), jobs, processes=processes)
    counts = ("soon", "later", "others", "sound")
    rows = [(fault, *(sum(e[name] for e in lines if e["fault"] == fault) for name in counts)) for fault in FAULTS]
    table("healthy stances", ("fault", "within 0.5 s", "later", "other legs: stances", "healthy"), rows)


@BENCH.part()
def slip(*, seeds: str = "0:12", processes: int = 2, results: Path | None = None, relearn: Path | None = None) -> None:
    """Compare the slip that the robot measures with the true one, over hundreds of stances on rough ground.

    Walks of 0.9 m over rough ground of 4 cm at friction 0.5 with a noisy map, half of them with random footholds, half
    with those of the hand-made score. The robot measures by encoders of 0.29 deg at 30 Hz, foot switches and the
    estimator's odometry. `inside`: truth between the first and the last sample with contact of the stance; `whole`:
    truth since the stance before, with what a foot too light to close its switch has slid. The constants of the measure
    were set on seeds 700 to 705.

    Args:
        relearn: file of samples (`surefoot footholds collect`); report instead what two rounds of re-learning close of
            the gap to a model of all data.
    """
    if relearn is not None:
        show_relearning(relearn, seeds_of(seeds))
        return
    jobs = [{"seed": seed, "rule": rule} for seed in seeds_of(seeds) for rule in ("random", "hand")]
    lines = study(measured, jobs, results, processes=processes)
    walks = [np.array(line["stances"]).reshape(-1, 3) for line in lines if line["stances"]]
    stances = np.concatenate(walks)
    rows: list[tuple[object, ...]] = []
    for column, name in ((1, "inside"), (2, "whole")):
        area, error, bias = of_slip(walks, column)
        rows += [(f"{name}, AUC of slips over {FAR_MM:g} mm", *area), (f"{name}, RMSE, mm", *error)]
        rows += [(f"{name}, bias, mm", *bias), (f"{name}, mean of the truth, mm", float(stances[:, column].mean()))]
    far = 100 * float(np.mean(stances[:, 2] > FAR_MM))
    what = f"{len(walks)} walks, {len(stances)} stances, {far:.0f} % of them slid over {FAR_MM:g} mm"
    table(what, ("truth", "figure", "from", "to"), rows)


def show_relearning(path: Path, seeds: Sequence[int], share: float = 0.5) -> None:
    """Print how much of the gap between a first model and one of all data two rounds of re-learning close.

    The first model is made without rough ground. It chooses footholds in walks of half of the seeds, the model learned
    from these in walks of the other half, except for the random choices, a `share` of all. Models are learned from own
    and from true slip, in the counted form (weight 1) and in that of Walas & Belter (weight 1, then 0.5); the counted
    one of own slip chooses. `path`: file of the samples.
    """
    begin = start(read(path)[0], candidate_of(load(shipped("ragno") or "")))
    forms: tuple[Form, ...] = ("counted", "paper")
    models: dict[tuple[Form, str], LearnedModel] = {(f, slip): begin.first for f in forms for slip in ("own", "truth")}
    for number, part in enumerate((seeds[: len(seeds) // 2], seeds[len(seeds) // 2 :])):
        found = [explored(seed, SLIP, models["counted", "own"], share) for seed in part]
        batches = {"own": [s for own, _ in found for s in own], "truth": [s for _, true in found for s in true]}
        rows: list[tuple[object, ...]] = []
        for form, slip in models:
            weight = 1.0 if form == "counted" or number == 0 else 0.5
            models[form, slip] = relearned(models[form, slip], batches[slip], form, weight)
            gap, old = closed(models[form, slip], begin)
            rows.append((form, slip, f"{100 * gap:.0f} %", f"x {old:.3f}"))
        new = sum(map(rough, batches["own"]))
        what = f"round {number + 1}: {len(part)} walks, {len(batches['own'])} stances, {new} on withheld ground"
        table(what, ("form", "slip", "gap closed", "error on old ground"), rows)
