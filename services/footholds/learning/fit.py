"""Fit of a slip model to samples: bins, terms fitted to their means, cross-validation of the fit's settings."""

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import SurefootError

from ..models.bases import Basis, Gaussians, Warp, warped
from ..models.lattice import Bins, Lattice, filled, inputs
from ..models.learned import Conditions, LearnedModel, Terms, rule_columns
from .quality import HeldOutFigures, compared, folds_of, slip_interval, spread
from .samples import SampleSet, StanceSample
from .solve import weights

Report = Callable[[float], bool]
"""Callback that receives the share of the work that is done, 0 to 1; it returns True to continue, False to cancel."""


class LearnError(SurefootError):
    """Error: no slip model can be learned from the samples, or the learning job was cancelled."""


IDENTITY = 12
"""Length of the identity of a trial, a hash, in hexadecimal digits."""
LEAST_SLIP = 0.01
"""Slip per stroke (no unit) below which relative errors are divided by this slip instead of the measured one."""
Finder = Callable[[Array, Array, Array, float, int], Basis]
"""Function that finds terms from inputs (n, 3), targets (n,), weights (n,), ridge and seed."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """Settings of one fit of a slip model that cross-validation tries."""

    terms: int
    """Number of Gaussian terms."""
    width: float
    """Rate lambda of the Gaussians, on inputs divided by their standard deviation, no unit."""
    ridge: float
    """Ridge rho of the least squares per sample, no unit."""
    warp: Warp = "identity"
    """Map that each input goes through before the Gaussians: identity, log or asinh."""
    enough: float = math.inf
    """Number of samples near a point at which terms and simple rule have equal weights; infinite: the rule alone."""
    find: Finder | None = None
    """Search for the terms; None: Gaussians about random bins. A model with terms of a search cannot be learned
    again."""


CANDIDATES = (
    Candidate(1, 0.1, 1e-6),
    Candidate(30, 0.1, 1e-5, enough=300.0),
    Candidate(30, 0.1, 1e-5, enough=30.0),
    Candidate(60, 0.1, 1e-4, "asinh", enough=100.0),
)
"""Settings that cross-validation compares: the simple rule alone, and Gaussian terms that give way to it where samples
are few."""


def candidates(terms: int | None = None) -> tuple[Candidate, ...]:
    """Return the settings that cross-validation compares, all with `terms` Gaussians; None = various numbers."""
    return CANDIDATES if terms is None else tuple(replace(each, terms=terms) for each in CANDIDATES[1:])


@dataclass(frozen=True, slots=True)
class LearnOptions:
    """Options of learning a slip model, and facts that are stored with it."""

    title: str = "learned"
    candidates: Sequence[Candidate] = CANDIDATES
    folds: int = 5
    """Number of folds of the cross-validation, made of whole terrains, or of whole trials if there is only one
    terrain."""
    seed: int = 0
    distance_weight: float = 2.0
    """Weight k, 1/m, of the distance K4 in the cost Q = P + k K4, P the slip; chosen by whole walks, not by the fit."""
    landing_error: float = 0.005
    """Standard deviation of the landing of a foot around the chosen cell, along each axis, m."""
    support: int = 0
    """Number of samples that a cell's bin needs for a prediction; 0: a cell only has to lie in the ranges of the
    inputs."""
    lattice: Lattice = field(default_factory=Lattice)
    relief: bool = True
    """True: ground coefficients of fitted planes, False: of 3 x 3 cells; `learn` takes this from the samples."""
    trials: tuple[str, ...] = ()
    """Identities (hashes of robot and trial) of the trials; `learn` takes them from the samples."""


def learn(samples: SampleSet, options: LearnOptions, report: Report = lambda share: True) -> LearnedModel:
    """Return the slip model of the candidate that ranks stances (steps of a foot) by slip best in cross-validation.

    Args:
        samples: stances of one robot, cell, filter and foot.
        options: candidates, folds and facts of the model.
        report: called with the share that is done; False cancels.

    Raises:
        LearnError: no samples, of different conditions, all alike, fewer trials than folds, or cancelled.
    """
    return learn_and_compare(samples, options, report)[0]


def learn_and_compare(
    samples: SampleSet, options: LearnOptions, report: Report = lambda share: True
) -> tuple[LearnedModel, HeldOutFigures]:
    """Return the slip model that ranks stances best in cross-validation, and its figures beside simple rules.

    Args:
        samples: stances of one robot, cell, filter and foot.
        options: candidates, folds and facts of the model.
        report: called between fits with the share that is done; False cancels.

    Raises:
        LearnError: no samples, samples of different conditions, all alike, fewer trials than folds, or cancelled.
    """
    conditions = _conditions(samples)
    if float(np.ptp(samples.x, axis=0).max()) == 0.0:
        raise LearnError("all_alike", f"all {len(samples)} samples have the same coefficients")
    found = np.unique(samples.trial).size
    if found < options.folds:
        raise LearnError("too_few_trials", f"{found} trials, at least one for each of {options.folds} folds is needed")
    fold, by = folds_of(samples, options.folds)
    options = replace(options, relief=samples.relief, trials=identities(samples))

    def made(candidate: Candidate, kept: NDArray[np.bool_], figures: Mapping[str, float]) -> LearnedModel:
        bins, u = filled(options.lattice, samples.x[kept], samples.r[kept]), inputs(samples.x[kept])
        ranges = tuple(zip(u.min(axis=0).tolist(), u.max(axis=0).tolist(), strict=True))
        return built(options, conditions, bins, ranges, candidate, figures, sources_of(samples))

    tried: list[HeldOutFigures] = []
    errors: list[float] = []
    for k, candidate in enumerate(options.candidates):
        p, within = np.empty(len(samples)), 0.0
        for f in np.unique(fold):
            if not report((k + f / options.folds) / (len(options.candidates) + 1)):
                raise LearnError("cancelled", "the job was cancelled")
            own = fold == f
            model = made(candidate, ~own, {})
            p[own] = np.minimum(model.exact(samples.x[own]), 1.0)
            low, high = slip_interval(p[own], spread(model, samples.x[own]))
            within += float(((samples.r[own] >= low) & (samples.r[own] <= high)).sum())
        tried.append(compared(samples, fold, p, within / len(samples), by))
        errors.append(float(np.sqrt(np.mean((p - np.minimum(samples.r, 1.0)) ** 2))))
    best = max(range(len(tried)), key=lambda k: tried[k].rows[0].rank)
    own = tried[best].rows[0]
    figures = {"error": errors[best], "r2": own.r2, "rank": own.rank, "auc": own.auc, "held": own.held}
    return made(options.candidates[best], np.ones(len(samples), dtype=np.bool_), figures), tried[best]


def identities(samples: SampleSet) -> tuple[str, ...]:
    """Return the identities of the trials of samples, sorted."""
    return tuple(sorted({identity(each) for each in samples.kept}))


def identity(sample: StanceSample) -> str:
    """Return the identity of a sample's trial: a hash of robot and trial, hexadecimal."""
    return hashlib.sha256(f"{sample.robot_hash}/{sample.trial}".encode()).hexdigest()[:IDENTITY]


def sources_of(samples: SampleSet) -> list[str]:
    """Return one line per source of samples: its name, numbers of samples and trials, the first and the last trial."""
    by_source: dict[str, list[str]] = {}
    for each in samples.kept:
        by_source.setdefault(f"{each.source}, friction {each.friction:g}", []).append(each.trial)
    listed = ((source, len(names), sorted(set(names))) for source, names in sorted(by_source.items()))
    return [f"{source}: {n} samples of {len(names)} trials, {names[0]} to {names[-1]}" for source, n, names in listed]


def built(
    options: LearnOptions, conditions: Conditions, bins: Bins, ranges: tuple[tuple[float, float], ...],
    candidate: Candidate, figures: Mapping[str, float], sources: Sequence[str],
) -> LearnedModel:  # fmt: skip
    """Return the slip model of binned samples, with terms fitted by the settings of one candidate.

    Args:
        options: facts of the model: title, lattice, weights, seed.
        conditions: cell, filter, foot and robot of the samples.
        bins: slips of the samples by index on the lattice.
        ranges: smallest and largest K1 / (8 cell), K2 / (8 cell), cos K3 of the samples.
        candidate: settings of the fit.
        figures: figures of the cross-validation, by name, kept with the model.
        sources: sources of the samples, one line each.
    """
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
        relief=options.relief,
        enough=candidate.enough,
        base=base_rule(options.lattice, bins) if options.relief else (),
        trials=options.trials,
        seed=options.seed,
        choice={
            "terms": float(candidate.terms), "width": candidate.width, "ridge": candidate.ridge,
            "asinh": float(candidate.warp == "asinh"), **figures,
        },
        provenance=tuple(sources),
    )  # fmt: skip


def base_rule(lattice: Lattice, bins: Bins) -> tuple[float, ...]:
    """Return the weights >= 0 of the simple rule: of 1 and of max(K2 / (8 cell) - knot, 0) for five knots.

    They are fitted to the mean slips of bins by least squares of relative errors.
    """
    from scipy.optimize import nnls

    columns = rule_columns(lattice.centres(bins)[:, 1])
    count = np.array([each.count for each in bins.values()])
    mean = np.array([each.mean for each in bins.values()])
    found, level = np.zeros(columns.shape[1]), np.full(len(mean), float(count @ mean) / float(count.sum()))
    for _ in range(3):
        w = np.sqrt(count) / (LEAST_SLIP + level)
        found = np.asarray(nnls(w[:, None] * columns, w * mean)[0], dtype=np.float64)
        level = (columns * found).sum(axis=1)
    return tuple(found.tolist())


def fit_terms(lattice: Lattice, bins: Bins, candidate: Candidate, seed: int) -> Terms:
    """Return the terms of a candidate, fitted to the mean slips of bins by least squares; a bin weighs as its count.

    `seed`: of the random bins about which terms are centred.
    """
    u = inputs(lattice.centres(bins))
    y = np.array([each.mean for each in bins.values()])
    count = np.array([each.count for each in bins.values()])
    deviation = u.std(axis=0)
    scales = np.where(deviation > 1e-9, deviation, 1.0)
    warps: tuple[Warp, ...] = (candidate.warp,) * 3
    v = warped(u, warps, scales)
    w, ridge = np.sqrt(count), candidate.ridge * float(count.sum())
    if candidate.find is not None:
        basis = candidate.find(v, y, w, ridge, seed)
    else:
        m = min(candidate.terms, len(v))
        centres = v[np.sort(np.random.default_rng(seed).choice(len(v), m, replace=False))]
        basis = Gaussians(centres, np.full((m, 3), candidate.width), constant=True)
    return Terms(basis, weights(basis.columns(v), y, w, ridge), warps, scales)


def _conditions(samples: SampleSet) -> Conditions:
    if not len(samples):
        raise LearnError("no_samples", f"there is no sample to learn from ({samples.why_refused})")
    found = {(s.cell, s.smooth, s.foot_radius, s.robot, s.robot_hash) for s in samples.kept}
    if len(found) > 1:
        described = " and ".join(f"{robot}, cell {cell:g} m" for cell, _, _, robot, _ in sorted(found)[:2])
        raise LearnError("mixed_conditions", f"samples of {len(found)} robots, cells, filters or feet: {described}")
    cell, smooth, foot_radius, robot, robot_hash = found.pop()
    return Conditions(cell, smooth, foot_radius, robot, robot_hash)
