"""From samples to a slip model: bins, terms fitted to their means, and the choice of size by folds of whole trials."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from surefoot.errors import SurefootError

from ..models.bases import POWER, Basis, Elementary, Gaussians, Warp, warped
from ..models.lattice import Bins, Lattice, filled, inputs
from ..models.learned import Conditions, LearnedModel, Terms
from .evolution import evolve
from .samples import SampleSet
from .solve import cost, weights
from .swarm import swarm
from .varpro import Bounds, refine

Array = NDArray[np.float64]
Report = Callable[[float], bool]
"""Receives the share of the work that is done; returns whether to continue."""


class LearnError(SurefootError):
    """No model can be learned from the samples, or the job was cancelled."""


Family = Literal["gaussian", "elementary"]
Search = Literal["drawn", "swarm", "evolution"]
FAMILIES: tuple[Family, ...] = ("gaussian", "elementary")
SEARCHES: tuple[Search, ...] = ("drawn", "swarm", "evolution")
WIDEST = 3.0
"""Largest lambda of a search, on inputs divided by their deviation."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """Size and search of one fit."""

    terms: int
    """Number of terms of the sum."""
    width: float
    """Rate lambda of Gaussians that are drawn, on inputs divided by their deviation."""
    ridge: float
    """Ridge rho per sample."""
    warp: Warp = "identity"
    """Map of the inputs."""
    refined: int = 0
    """Number of evaluations of variable projection after the start (Gaussians); 0 = none."""
    family: Family = "gaussian"
    search: Search = "drawn"
    """Origin of the terms: Gaussians about bins drawn at random, a swarm (Gaussians), or the evolution."""
    evaluations: int = 0
    """Budget of swarm and evolution, computed costs."""
    blind: bool = False
    """True leaves cos K3 out, as in Fig. 8 of Walas & Belter."""

    def __post_init__(self) -> None:
        if self.family == "elementary" and (self.search != "evolution" or self.refined):
            raise LearnError("invalid", "elementary terms are found by evolution alone", "search")
        if self.search != "drawn" and self.evaluations < 1:
            raise LearnError("invalid", f"search {self.search!r} needs a budget, got {self.evaluations}", "evaluations")


CANDIDATES = (
    Candidate(15, 0.1, 1e-6),
    Candidate(15, 0.1, 1e-6, "asinh"),
    Candidate(30, 0.1, 1e-5),
    Candidate(60, 0.1, 1e-4),
    Candidate(60, 0.1, 1e-5),
    Candidate(60, 0.3, 1e-5),
    Candidate(60, 0.3, 1e-4, "asinh"),
)


def candidates(
    family: Family = "gaussian", search: Search = "drawn", terms: int | None = None, evaluations: int = 2000,
    refined: int = 0,
) -> tuple[Candidate, ...]:  # fmt: skip
    """Return the candidates of a family and a search; the folds choose among them.

    Args:
        family: family of the terms.
        search: origin of the terms, see `Candidate`.
        terms: number of terms; None = several sizes.
        evaluations: budget of swarm and evolution, for each fit.
        refined: evaluations of variable projection after the search.

    Raises:
        LearnError: family and search do not go together.
    """
    if search == "drawn" and family == "gaussian":
        found = CANDIDATES if terms is None else tuple(replace(each, terms=terms) for each in CANDIDATES)
        return tuple(dict.fromkeys(replace(each, refined=refined) for each in found))
    sizes = (8, 15) if terms is None else (terms,)
    budget = 0 if search == "drawn" else evaluations
    return tuple(
        Candidate(m, 0.0, 1e-5, warp, refined, family, search, budget) for m in sizes for warp in ("identity", "asinh")
    )


@dataclass(frozen=True, slots=True)
class LearnOptions:
    """Options of learning, and facts that the model keeps."""

    title: str = "learned"
    candidates: Sequence[Candidate] = CANDIDATES
    folds: int = 5
    """Number of folds, of whole trials each."""
    seed: int = 0
    distance_weight: float = 2.0
    """Weight k of Q = P + k K4, 1/m; chosen by whole walks, not by the fit."""
    landing_error: float = 0.005
    """Standard deviation of landings, m."""
    support: int = 0
    """Number of samples that a cell's bin needs; 0: only the ranges count."""
    lattice: Lattice = field(default_factory=Lattice)


def learn(samples: SampleSet, options: LearnOptions, report: Report = lambda share: True) -> LearnedModel:
    """Return the model of the candidate that fits best on trials held back, fitted to all samples.

    Args:
        samples: samples of one robot, cell, filter and foot.
        options: candidates, folds and facts of the model.
        report: called between fits; False cancels.

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
    ranges = tuple(zip(u.min(axis=0).tolist(), u.max(axis=0).tolist(), strict=True))
    return built(options, conditions, bins, ranges, options.candidates[best], errors[best], sources_of(samples))


def sources_of(samples: SampleSet) -> list[str]:
    """Return one line per source: its name, numbers of samples and trials, the first and the last trial."""
    by_source: dict[str, list[str]] = {}
    for each in samples.kept:
        by_source.setdefault(f"{each.source}, friction {each.friction:g}", []).append(each.trial)
    listed = ((source, len(names), sorted(set(names))) for source, names in sorted(by_source.items()))
    return [f"{source}: {n} samples of {len(names)} trials, {names[0]} to {names[-1]}" for source, n, names in listed]


def built(
    options: LearnOptions, conditions: Conditions, bins: Bins, ranges: tuple[tuple[float, float], ...],
    candidate: Candidate, error: float, sources: Sequence[str],
) -> LearnedModel:  # fmt: skip
    """Return the model of bins with the terms of one candidate."""
    return LearnedModel(
        title=options.title,
        conditions=conditions,
        terms=fit_terms(options.lattice, bins, candidate, options.seed),
        lattice=options.lattice,
        bins=dict(bins),
        ranges=ranges,
        distance_weight=options.distance_weight,
        landing_error=options.landing_error,
        support=options.support,
        seed=options.seed,
        choice={
            "terms": float(candidate.terms), "width": candidate.width, "ridge": candidate.ridge,
            "asinh": float(candidate.warp == "asinh"), "refined": float(candidate.refined), "error": error,
            **searched_by(candidate),
        },
        provenance=tuple(sources),
    )  # fmt: skip


def searched_by(candidate: Candidate) -> dict[str, float]:
    """Return family, search and budget as the numbers a model keeps; nothing for Gaussians that were drawn."""
    numbers = {
        "family": float(FAMILIES.index(candidate.family)), "search": float(SEARCHES.index(candidate.search)),
        "evaluations": float(candidate.evaluations), "blind": float(candidate.blind),
    }  # fmt: skip
    return {name: value for name, value in numbers.items() if value}


def fit_terms(lattice: Lattice, bins: Bins, candidate: Candidate, seed: int) -> Terms:
    """Return the terms of a candidate, fitted to bins by least squares; a bin weighs as much as its count."""
    u = inputs(lattice.centres(bins))
    y = np.array([each.mean for each in bins.values()])
    count = np.array([each.count for each in bins.values()])
    deviation = u.std(axis=0)
    scales = np.where(deviation > 1e-9, deviation, 1.0)
    warps: tuple[Warp, ...] = (candidate.warp,) * 3
    v = warped(u, warps, scales)
    w, ridge = np.sqrt(count), candidate.ridge * float(count.sum())
    basis = _searched(candidate, v, y, w, ridge, seed)
    if candidate.refined and isinstance(basis, Gaussians):
        bounds = Bounds(low=float(v.min()) - 1.0, high=float(v.max()) + 1.0, width=3.0)
        found = refine(basis, v, y, w, bounds, ridge, candidate.refined)
        return Terms(found.basis, found.weights, warps, scales)
    return Terms(basis, weights(basis.columns(v), y, w, ridge), warps, scales)


def _searched(candidate: Candidate, v: Array, y: Array, w: Array, ridge: float, seed: int) -> Basis:
    """Return the terms at the end of a candidate's search, before variable projection."""

    def seen(basis: Basis) -> Basis:
        return _blind(basis) if candidate.blind else basis

    m, spans = min(candidate.terms, len(v)), (float(v.min()), float(v.max()))
    if candidate.search == "drawn":
        centres = v[np.sort(np.random.default_rng(seed).choice(len(v), m, replace=False))]
        return seen(Gaussians(centres, np.full((m, 3), candidate.width), constant=True))

    def of(basis: Basis) -> float:
        return cost(seen(basis).columns(v), y, w, ridge)

    if candidate.search == "swarm":
        return seen(swarm(of, m, 3, spans, (0.0, WIDEST), candidate.evaluations, seed).basis)
    return seen(evolve(of, candidate.family, m, 3, spans, (0.0, WIDEST), candidate.evaluations, seed).basis)


def _blind(basis: Basis) -> Basis:
    """Return the terms without their third input."""
    if isinstance(basis, Gaussians):
        return replace(basis, widths=basis.widths * np.array([1.0, 1.0, 0.0]))
    assert isinstance(basis, Elementary)
    kinds, rates = basis.kinds.copy(), basis.rates.copy()
    kinds[:, 2], rates[:, 2] = POWER, 0.0
    return replace(basis, kinds=kinds, rates=rates)


def _conditions(samples: SampleSet) -> Conditions:
    if not len(samples):
        raise LearnError("no_samples", f"there is no sample to learn from ({samples.why_refused})")
    found = {(s.cell, s.smooth, s.foot_radius, s.robot, s.robot_hash) for s in samples.kept}
    if len(found) > 1:
        described = " and ".join(f"{robot}, cell {cell:g} m" for cell, _, _, robot, _ in sorted(found)[:2])
        raise LearnError("mixed_conditions", f"samples of {len(found)} robots, cells, filters or feet: {described}")
    cell, smooth, foot_radius, robot, robot_hash = found.pop()
    return Conditions(cell, smooth, foot_radius, robot, robot_hash)
