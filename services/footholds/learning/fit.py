"""From samples to a slip model: bins, terms fitted to their means, and the choice of size by folds of whole trials."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from surefoot.errors import SurefootError
from surefoot.services.footholds.learning.samples import SampleSet
from surefoot.services.footholds.learning.solve import weights
from surefoot.services.footholds.learning.varpro import Bounds, refine
from surefoot.services.footholds.models.bases import Gaussians, Warp, warped
from surefoot.services.footholds.models.lattice import Bins, Lattice, filled, inputs
from surefoot.services.footholds.models.learned import Conditions, LearnedModel, Terms

Array = NDArray[np.float64]
Report = Callable[[float], bool]
"""Takes the share that is done; returns whether to go on."""


class LearnError(SurefootError):
    """Samples that no model can be learned from, or a job that was cancelled."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """One size of a fit."""

    terms: int
    """Gaussians."""
    width: float
    """lambda of all of them, on inputs divided by their deviation."""
    ridge: float
    """rho per sample."""
    warp: Warp = "identity"
    """Of the inputs."""
    refined: int = 0
    """Evaluations of variable projection after the start; 0 = centres and widths stay as drawn."""


CANDIDATES = (
    Candidate(15, 0.1, 1e-6),
    Candidate(15, 0.1, 1e-6, "asinh"),
    Candidate(30, 0.1, 1e-5),
    Candidate(60, 0.1, 1e-4),
    Candidate(60, 0.1, 1e-5),
    Candidate(60, 0.3, 1e-5),
    Candidate(60, 0.3, 1e-4, "asinh"),
)


@dataclass(frozen=True, slots=True)
class LearnOptions:
    """How a model is learned."""

    title: str = "learned"
    candidates: Sequence[Candidate] = CANDIDATES
    folds: int = 5
    seed: int = 0
    distance_weight: float = 2.0
    """k, 1/m; chosen by whole walks, not by the fit."""
    landing_error: float = 0.005
    """m."""
    support: int = 0
    lattice: Lattice = field(default_factory=Lattice)


def learn(samples: SampleSet, options: LearnOptions, report: Report = lambda share: True) -> LearnedModel:
    """Return the model that fits best on trials that it was not fitted to, fitted to all.

    Args:
        samples: of one robot, cell, filter and foot.
        options: what is tried.
        report: asked between fits whether to go on.

    Raises:
        LearnError: no samples, samples of different conditions, all alike, fewer trials than folds, or cancelled.
    """
    conditions = _conditions(samples)
    if float(np.ptp(samples.x, axis=0).max()) == 0.0:
        raise LearnError("all_alike", f"all {len(samples)} samples have the same coefficients")
    found = np.unique(samples.trial).size
    if found < options.folds:
        raise LearnError("too_few_trials", f"{found} trials, at least one for each of {options.folds} folds is needed")
    fold = samples.trial % options.folds
    errors: list[float] = []
    for k, candidate in enumerate(options.candidates):
        rest, total = 0.0, 0
        for f in range(options.folds):
            if not report((k + f / options.folds) / (len(options.candidates) + 1)):
                raise LearnError("cancelled", "the job was cancelled")
            held = fold == f
            bins = filled(options.lattice, samples.x[~held], samples.r[~held])
            terms = fit_terms(options.lattice, bins, candidate, options.seed)
            away = np.clip(terms.values(inputs(samples.x[held])), 0.0, 1.0) - np.minimum(samples.r[held], 1.0)
            rest, total = rest + float(away @ away), total + int(held.sum())
        errors.append(math.sqrt(rest / total))
    best = int(np.argmin(errors))
    bins = filled(options.lattice, samples.x, samples.r)
    u = inputs(samples.x)
    sources = sources_of(samples)
    low, high = u.min(axis=0).tolist(), u.max(axis=0).tolist()
    return built(options, conditions, bins, low, high, options.candidates[best], errors[best], sources)


def sources_of(samples: SampleSet) -> list[str]:
    """Return one line per source: what it is, samples, trials, the first and the last of them."""
    by_source: dict[str, list[str]] = {}
    for each in samples.kept:
        by_source.setdefault(f"{each.source}, friction {each.friction:g}", []).append(each.trial)
    listed = ((source, len(names), sorted(set(names))) for source, names in sorted(by_source.items()))
    return [f"{source}: {n} samples of {len(names)} trials, {names[0]} to {names[-1]}" for source, n, names in listed]


def built(
    options: LearnOptions, conditions: Conditions, bins: Bins, low: Sequence[float], high: Sequence[float],
    candidate: Candidate, error: float, sources: Sequence[str],
) -> LearnedModel:  # fmt: skip
    """Return the model of bins with one candidate's terms."""
    return LearnedModel(
        title=options.title,
        conditions=conditions,
        terms=fit_terms(options.lattice, bins, candidate, options.seed),
        lattice=options.lattice,
        bins=dict(bins),
        ranges=tuple((float(a), float(b)) for a, b in zip(low, high, strict=True)),
        distance_weight=options.distance_weight,
        landing_error=options.landing_error,
        support=options.support,
        seed=options.seed,
        choice={
            "terms": float(candidate.terms), "width": candidate.width, "ridge": candidate.ridge,
            "asinh": float(candidate.warp == "asinh"), "refined": float(candidate.refined), "error": error,
        },
        provenance=tuple(sources),
    )  # fmt: skip


def fit_terms(lattice: Lattice, bins: Bins, candidate: Candidate, seed: int) -> Terms:
    """Return Gaussians about some of the bins, their weights by least squares over all, each as heavy as its count."""
    u = inputs(lattice.centres(bins))
    y = np.array([each.mean for each in bins.values()])
    count = np.array([each.count for each in bins.values()])
    deviation = u.std(axis=0)
    scales = np.where(deviation > 1e-9, deviation, 1.0)
    warps: tuple[Warp, ...] = (candidate.warp,) * 3
    v = warped(u, warps, scales)
    rng = np.random.default_rng(seed)
    m = min(candidate.terms, len(v))
    centres = v[np.sort(rng.choice(len(v), m, replace=False))]
    basis = Gaussians(centres, np.full((m, 3), candidate.width), constant=True)
    w, ridge = np.sqrt(count), candidate.ridge * float(count.sum())
    if candidate.refined:
        bounds = Bounds(low=float(v.min()) - 1.0, high=float(v.max()) + 1.0, width=3.0)
        found = refine(basis, v, y, w, bounds, ridge, candidate.refined)
        return Terms(found.basis, found.weights, warps, scales)
    return Terms(basis, weights(basis.columns(v), y, w, ridge), warps, scales)


def _conditions(samples: SampleSet) -> Conditions:
    if not len(samples):
        refused = ", ".join(f"{name} {n}" for name, n in sorted(samples.refused.items())) or "none came"
        raise LearnError("no_samples", f"there is no sample to learn from ({refused})")
    found = {(s.cell, s.smooth, s.foot_radius, s.robot, s.robot_hash) for s in samples.kept}
    if len(found) > 1:
        described = " and ".join(f"{robot}, cell {cell:g} m" for cell, _, _, robot, _ in sorted(found)[:2])
        raise LearnError("mixed_conditions", f"samples of {len(found)} robots, cells, filters or feet: {described}")
    cell, smooth, foot_radius, robot, robot_hash = found.pop()
    return Conditions(cell, smooth, foot_radius, robot, robot_hash)
