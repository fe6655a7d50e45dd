"""Reproduction of Walas & Belter (2011), section 3: learning where to step, Figs. 7 to 12.

Walas & Belter state which method is better, not numbers: each order is checked over seeds, with 95 % intervals of
2000 resamplings.
"""

import itertools
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from surefoot.arrays import Array
from surefoot.lab.report.findings import Finding, Reproduction, fact, with_known
from surefoot.lab.statistics import resampled_mean
from surefoot.services.footholds.assess import assess, window_about
from surefoot.services.footholds.ground import build_ground
from surefoot.services.footholds.learning.fit import Candidate, LearnOptions, learn
from surefoot.services.footholds.learning.relearn import relearned
from surefoot.services.footholds.learning.samples import StanceSample, gather
from surefoot.services.footholds.masks import REASONS
from surefoot.services.footholds.models.lattice import filled, inputs
from surefoot.services.footholds.models.learned import LearnedModel
from surefoot.services.footholds.select import SelectParams
from surefoot.services.simulator.ground.terrain import make_terrain

from .finders import finder, keep
from .foothold_figures import draw
from .foothold_runs import FLAT, NOISE, Runs, WalkKey, WalkResult
from .foothold_study import FootholdStudy, predicted

TITLE = "Walas & Belter (2011), section 3: adaptive foothold selection"
SYSTEM = None
SEEDS = 10
SETS, COLLECTED, CASES = 2, 4, 11
"""`SETS`: number of sets of primitive trials; `COLLECTED`: number of walks that collect samples; `CASES`: number of
walks for each seed."""
COLLECTION, WALKS = 900, 950
"""`COLLECTION`: first seed of the walks that collect samples; `WALKS`: first seed of the walks that are compared."""
EDGE = 0.3
"""K2 / (8 cell), no unit, above which ground counts as an edge and is withheld from learning in Fig. 12 of Walas &
Belter."""
WEIGHT = 0.5
"""Weight k, 1/m, of the distance K4 in the cost Q = P + k K4 of the learned models, P the predicted slip."""
PRINTED_WEIGHT = 8.0
"""Weight k of the distance K4 as Walas & Belter print it, 1/m, with which one case of walks is done."""
TERMS = 12
EVALUATIONS = 1500
ELEMENTARY = Candidate(TERMS, 0.0, 1e-5, find=finder("elementary", TERMS, EVALUATIONS))
BLIND = Candidate(TERMS, 0.0, 1e-5, find=finder("elementary", TERMS, EVALUATIONS, blind=True))
GAUSSIANS = Candidate(TERMS, 0.0, 1e-5, find=finder("gaussian", TERMS, EVALUATIONS))
WALKED = Candidate(60, 0.1, 1e-4)
NOTES = (
    "Erratum, 3.2: points 'lie on the plane K2 = |K1| or K2 = 0' must read K2 = |K1| or K1 = 0: K2 = 0 is flat alone.",
    "Erratum, (15): the printed exponent has no minus sign; with 0 < lambda <= 1 the sum would grow without bound.",
    "Erratum, (6), (9): the sum runs over m + 1 terms, the matrix has m columns; (8) inverts V'V, which squares the "
    "condition number: weights here come from singular values, with a ridge.",
    "Erratum, 3.2: 'sum of distances' outside, least squares inside are two criteria; here both are the latter.",
    "(18): k = 8 has no unit in the paper. In metres it outweighs the slips of these walks (.01 to .05 per stroke).",
    "(5) leaves z out although the text names (x0, y0, z0). In (12) a is a phase, no centre; in (13) it only scales c.",
    "3.4 rejects what lies outside the learned bounds, yet in 3.5 the robot steps on edges it never learned: here "
    "re-learning widens the bounds, and a share of choices may explore.",
    "Fig. 6 is lost in the text: the seven primitives are flat, slope, step edge, hill, ridge, hole, groove.",
    "Primitives with the whole robot give another order than one foot alone (a rig of one sphere under 3.5 N, made for "
    "this project, slid .04 on flat, .09 on hills and .01 in holes per stroke): feet in equal holes hold no better "
    "than on flat ground.",
)

ALIKE = "with the whole robot feet in holes slide more than on flat ground, and on peaks no more (see the last note)"
NOISY = "noisy primitives show little of this ground; most slip is the load of a leg, which K1 to K4 do not know"
KNOWN = {
    "3.2, Fig. 8: primitives K1, K2: P of": ALIKE,
    "3.2, Fig. 9: Gaussian: P of": ALIKE,
    "3.4, Fig. 11: slip of Gaussian over": NOISY,
    "3.4, Fig. 11: slip of primitives K1..K3 over terrain": "walks on the terrain itself teach more than primitives do",
    "3.5, Fig. 12: slip without edges over random": "ground without edges teaches most of what edges need",
    "3.5, Fig. 12: slip of re-learned, c = 0.5": "the drop is within the spread of ten walks; little is left to learn",
}
"""Statements of Walas & Belter that this reproduction does not confirm, by the beginning of their rows, and why."""


def study(
    folder: Path,
    seeds: int,
    progress: Callable[[float, str], None] = lambda share, step: None,
    jobs: int | None = None,
) -> FootholdStudy:
    """Do the trials and walks that a folder lacks; return all data of the figures and findings."""
    steps = itertools.count(1)
    runs = Runs(folder, jobs, lambda step: progress(next(steps) / (SETS + COLLECTED + CASES * seeds), step))
    exact = runs.primitives([0], 0.0)
    noisy = runs.primitives(range(1, seeds + 1), NOISE)
    collected = runs.walks([WalkKey("random collection", COLLECTION + k) for k in range(COLLECTED)])
    walked = [s for each in collected for s in each.samples]
    models = {
        "terrain": _learned("terrain", walked, WALKED),
        "primitives K1, K2": _learned("primitives K1, K2", exact, BLIND),
        "primitives K1..K3": _learned("primitives K1..K3", exact, ELEMENTARY),
        # with those without noise: rough primitives alone put flat ground outside what was learned, and nothing is free
        "Gaussian": _learned("Gaussian", [*exact, *noisy], GAUSSIANS),
    }
    files = {name: keep(model, folder / f"{_plain(name)}.model") for name, model in models.items()}
    numbers = [WALKS + k for k in range(seeds)]
    keys = {
        "flat": [WalkKey("flat", k, FLAT) for k in numbers],
        "nominal": [WalkKey("nominal", k) for k in numbers],
        "random": [WalkKey("random", k) for k in numbers],
        **{name: [WalkKey(name, k, model=file, weight=WEIGHT) for k in numbers] for name, file in files.items()},
        "Gaussian, k = 8": [
            WalkKey("Gaussian, k = 8", k, model=files["Gaussian"], weight=PRINTED_WEIGHT) for k in numbers
        ],
    }
    walks = {name: runs.walks(some) for name, some in keys.items()}
    again = _relearning(runs, walked, numbers)
    return FootholdStudy(exact, noisy, models, walks, _window(models["Gaussian"]), again)


def _relearning(runs: Runs, walked: Sequence[StanceSample], numbers: Sequence[int]) -> dict[str, list[WalkResult]]:
    """Return the walks of Fig. 12 of Walas & Belter: without edges, re-learned with c = 1, and again with c = .5."""
    model = _learned("no edges", [s for s in walked if s.k2 / (8.0 * s.cell) < EDGE], WALKED)
    out: dict[str, list[WalkResult]] = {}
    for name, weight in (("without edges", None), ("re-learned, c = 1", 1.0), ("re-learned, c = 0.5", 0.5)):
        if weight is not None:
            outcomes = [s for each in list(out.values())[-1] for s in each.samples]
            model = relearned(model, outcomes, "paper", weight)
        file = keep(model, runs.folder / f"{_plain(name)}.model")
        out[name] = runs.walks([WalkKey(name, k, model=file, weight=WEIGHT) for k in numbers])
    return out


def _learned(title: str, samples: Sequence[StanceSample], candidate: Candidate) -> LearnedModel:
    options = LearnOptions(title=title, candidates=(candidate,), folds=3, distance_weight=WEIGHT, landing_error=0.0)
    return learn(gather(samples, relief=False), options)


def _plain(name: str) -> str:
    return "".join(c if c.isalnum() else "-" for c in name)


def _window(model: LearnedModel) -> tuple[Array, Array, Array]:
    """Return heights (m), cost Q and mask (0 = free) of a window of 15 x 15 cells as in Fig. 10 of Walas & Belter."""
    ground = build_ground(make_terrain("mixed", seed=WALKS).map, model.conditions.foot_radius)
    at = (0.45, 0.1)
    found = assess(
        ground, model, window_about(ground, *at, 15), at, (-0.025, 0.0, 0.0), ("z", "q", "mask"), SelectParams()
    )
    z, q, mask = (layer.astype(np.float64) for layer in found.layers)
    return z, q, mask


def findings(s: FootholdStudy) -> tuple[Finding, ...]:
    """Return a row for each claim of Walas & Belter (2011), section 3, in its order, with the result here."""
    rows = (*_figure_7(s), *_figures_8_9(s), *_figure_10(s), *_figure_11(s), *_figure_12(s))
    return with_known(rows, KNOWN)


def _figure_7(s: FootholdStudy) -> list[Finding]:
    found = gather(s.exact, relief=False)
    u = inputs(found.x)
    near = np.minimum(u[:, 1] - np.abs(u[:, 0]), np.abs(u[:, 0])) < 0.03
    bins = filled(next(iter(s.models.values())).lattice, found.x, found.r)
    inside = sum(each.m2 for each in bins.values()) / float(np.sum((found.r - found.r.mean()) ** 2))
    wedge = gather(s.noisy, relief=False)
    v = inputs(wedge.x)
    filled_in = np.minimum(v[:, 1] - np.abs(v[:, 0]), np.abs(v[:, 0])) >= 0.03
    return [
        fact("3.2, Fig. 7", "stances on primitives with K2 = |K1| or K1 = 0 (within .03), %", "all",
             f"{100 * near.mean():.0f}", bool(near.mean() > 0.9), ">= 90"),
        fact("3.1, Fig. 7", "variance of r within bins of equal K1, K2, K3, %", "ambiguous", f"{100 * inside:.0f}",
             bool(inside > 0.05), "> 5"),
        fact("3.2, Fig. 9", "the same with noise: stances between the lines, %", "wider variety",
             f"{100 * filled_in.mean():.0f}", bool(filled_in.mean() > 2 * (1 - near.mean())), "more than twice"),
    ]  # fmt: skip


def _figures_8_9(s: FootholdStudy) -> list[Finding]:
    rows: list[Finding] = []
    for figure, name in (("3.2, Fig. 8", "primitives K1, K2"), ("3.2, Fig. 9", "Gaussian")):
        model = s.models[name]
        flat, hole, deep = predicted(model, 0.0, 0.0), predicted(model, -0.3, 0.3), predicted(model, -0.8, 0.8)
        peak = predicted(model, 0.5, 0.5)
        rows += [
            fact(figure, f"{name}: P of hole / flat / peak", "hole < flat < peak",
                 f"{hole:.3f} / {flat:.3f} / {peak:.3f}", hole < flat < peak, "in this order"),
            fact(figure, f"{name}: P of a deep depression / a hole", "deep is worse", f"{deep:.3f} / {hole:.3f}",
                 deep > hole, "larger"),
        ]  # fmt: skip
    a, b = s.models["primitives K1, K2"], s.models["Gaussian"]
    grid = [(t * k, k) for k in np.linspace(0.05, 0.6, 12) for t in np.linspace(-1.0, 1.0, 9)]
    surfaces = np.array([[predicted(model, *at) for at in grid] for model in (a, b)])
    alike = float(np.corrcoef(surfaces)[0, 1])
    rows.append(
        fact("3.2, Figs 8, 9", "correlation of both surfaces over (K1, K2)", "similar", f"{alike:.2f}", alike > 0.5,
             "> .5")
    )  # fmt: skip
    same = [_learned("x", s.noisy, each).choice["error"] for each in (ELEMENTARY, GAUSSIANS)]
    rows.append(
        fact("3.2", f"error on held-back trials, {TERMS} terms, elementary / Gaussian", "Gaussian is better",
             f"{same[0]:.4f} / {same[1]:.4f}", same[1] < same[0], "smaller")
    )  # fmt: skip
    return rows


def _figure_10(s: FootholdStudy) -> list[Finding]:
    _, q, mask = s.window
    free = mask == 0
    counts = ", ".join(f"{name} {int(((mask.astype(np.int64) >> bit) & 1).sum())}" for bit, name in enumerate(REASONS))
    least = float(q[free].min()) if free.any() else float("nan")
    return [
        fact("3.3, Fig. 10", f"window of 225 cells: free {int(free.sum())}; {counts}", "some excluded", f"{least:.3f}",
             bool(0 < free.sum() < 225), "least Q of the rest"),
    ]  # fmt: skip


def _ratio(s: dict[str, list[WalkResult]], one: str, other: str) -> tuple[float, float, float]:
    """Return the geometric mean of paired ratios of accumulated slip S at the last common step, and its interval."""
    steps = min(each.steps for name in (one, other) for each in s[name])
    if steps == 0:
        return float("nan"), float("nan"), float("nan")
    logs = [
        float(np.log((a.accumulated(steps)[-1] + 1e-9) / (b.accumulated(steps)[-1] + 1e-9)))
        for a, b in zip(s[one], s[other], strict=True)
    ]
    mean, low, high = resampled_mean(logs)
    return float(np.exp(mean)), float(np.exp(low)), float(np.exp(high))


def _less(where: str, s: dict[str, list[WalkResult]], one: str, other: str, printed: str) -> Finding:
    ratio, low, high = _ratio(s, one, other)
    return fact(where, f"slip of {one} over {other} (95 %)", printed, f"{ratio:.2f} ({low:.2f} to {high:.2f})",
                high < 1.0, "interval < 1")  # fmt: skip


def _figure_11(s: FootholdStudy) -> list[Finding]:
    w = s.walks
    fell = sum(each.fell for some in w.values() for each in some)
    stood = sum(each.steps == 0 for some in w.values() for each in some)
    rows = [
        fact("3.4, Fig. 11", f"falls in {sum(map(len, w.values()))} walks", "none", f"{fell}", fell == 0, "0"),
        fact("3.4, Fig. 11", "walks that found nowhere to step", "none", f"{stood}", stood == 0, "0"),
    ]
    for name, some in w.items():
        steps = max(1, min(each.steps for each in some))
        mean, low, high = resampled_mean([each.accumulated(steps)[-1] / steps for each in some])
        d = float(np.mean([each.accumulated(steps, 2)[-1] / steps for each in some]))
        rows.append(
            fact("3.4, Fig. 11", f"{name}: S / step, sliding (95 %); d as printed", "", f"{mean:.3f} ({low:.3f} to "
                 f"{high:.3f}); {d:.3f}")
        )  # fmt: skip
    primitives = "primitives K1..K3"
    return [
        *rows,
        *(_less("3.4, Fig. 11", w, name, "random", "less") for name in s.models),
        _less("3.4, Fig. 11", w, primitives, "terrain", "less"),
        _less("3.4, Fig. 11", w, primitives, "primitives K1, K2", "slightly less"),
        _less("3.4, Fig. 11", w, "Gaussian", primitives, "less: the best"),
        _less("3.4, Fig. 11", w, "Gaussian, k = 8", "nominal", ""),
    ]


def _figure_12(s: FootholdStudy) -> list[Finding]:
    w = {**s.relearned, "random": s.walks["random"]}
    first, second, third = s.relearned
    ratio, low, high = _ratio(w, first, "random")
    return [
        fact("3.5, Fig. 12", f"slip {first} over random (95 %)", "no better", f"{ratio:.2f} ({low:.2f} to {high:.2f})",
             high >= 1.0, "interval holds 1 or more"),
        _less("3.5, Fig. 12", w, second, first, "big drop"),
        _less("3.5, Fig. 12", w, third, second, "slight drop"),
    ]  # fmt: skip


def reproduce(
    out: Path | None,
    progress: Callable[[float, str], None] = lambda share, step: None,
    seeds: int = SEEDS,
    jobs: int | None = None,
) -> Reproduction:
    """Reproduce the section of Walas & Belter on footholds: do all trials and walks, and check each claim.

    Args:
        out: folder that keeps the trials and walks, and gets the figures; None = nothing is kept.
        progress: gets the share that is done, and its step in words.
        seeds: number of walks of each case.
        jobs: processes; None = one for each core.
    """
    with tempfile.TemporaryDirectory() as temporary:
        done = study(out or Path(temporary), seeds, progress, jobs)
    return Reproduction(TITLE, findings(done), draw(done, out), NOTES)
