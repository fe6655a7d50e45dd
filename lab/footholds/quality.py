"""Quality of a slip model on stances it was not made of: order, warnings, and share within its intervals."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surefoot.services.footholds.features import window_features
from surefoot.services.footholds.learning.samples import PATCH, SampleSet, StanceSample, gather
from surefoot.services.footholds.models.lattice import inputs
from surefoot.services.footholds.models.learned import LearnedModel
from surefoot.services.footholds.outcomes import UNKNOWN_UM
from surefoot.services.footholds.select import landing_weights

Array = NDArray[np.float64]
FLAT = 0.05
"""K2 / (8 cell) below which ground counts as flat."""
LEAST = 0.003
"""Least slip of a stance per stroke: contacts creep on flat ground, too. 99 % of 3363 stances (seeds 1100 to 1107)
slid more."""
SHARE = 0.8
"""Share of the stances that an interval should hold."""
BROAD = 10
"""Weight, in samples, of the spread of all bins beside that of one bin."""


@dataclass(frozen=True, slots=True)
class PredictionQuality:
    """Figures of one model on one set of stances."""

    stances: int
    spearman: float
    """Rank correlation of P and slip."""
    warned: float
    """AUC of P for slips of more than twice the mean on flat ground."""
    held: float
    """Share of slips within the interval that should hold `SHARE` of them."""
    ceiling: float
    """Rank correlation of slip and the mean slip of stances with equal inputs: the best that any model of these inputs
    can reach on these stances; 1 where no two inputs are equal."""


def prediction_quality(model: LearnedModel, samples: Sequence[StanceSample]) -> PredictionQuality:
    """Return the quality of a model on stances of other trials than those it was made of."""
    from scipy.stats import spearmanr

    found = gather(samples)
    p = expected(model, found)
    flat = found.r[found.x[:, 1] < FLAT]
    limit = 2.0 * float(flat.mean()) if len(flat) else 2.0 * float(np.quantile(found.r, 0.1))
    a, b = slip_interval(p, spread(model, found.x, p))
    inside = (found.r >= a) & (found.r <= b)
    rank = spearmanr(p, found.r).statistic  # pyright: ignore[reportAttributeAccessIssue] - scipy has no types
    _, place = np.unique(np.round(found.x, 3), axis=0, return_inverse=True)
    alike = (np.bincount(place, weights=found.r) / np.bincount(place))[place]
    most = spearmanr(alike, found.r).statistic  # pyright: ignore[reportAttributeAccessIssue] - scipy has no types
    return PredictionQuality(len(found), float(rank), auc(p, found.r > limit), float(inside.mean()), float(most))


def expected(model: LearnedModel, found: SampleSet) -> Array:
    """Return the slip that the model expects of each stance, (n,): the mean of P over where the foot may land.

    As in the choice of a foothold, the cells about the chosen one have the weights of the landing error, and cells
    without P stay out; a stance without heights, or without any P, counts with P of its cell, brought into the ranges.
    """
    low, high = np.array(model.ranges).T
    p = np.maximum(model.terms.values(np.clip(inputs(found.x), low, high)), 0.0)
    for k, each in enumerate(found.kept):
        blur = landing_weights(model.landing_error, each.cell)
        border, middle = blur.shape[0] // 2, PATCH // 2
        if len(each.heights_um) != PATCH * PATCH or border >= middle:
            continue
        rise = np.array(each.heights_um, dtype=np.float64).reshape(PATCH, PATCH)
        z = np.where(rise == UNKNOWN_UM, np.nan, 1e-6 * rise).astype(np.float32)
        corner, edge = middle - border, 2 * border + 1
        inner = window_features(z, corner, corner, edge, edge, np.array(each.stroke), each.cell)
        near = model.predict(inner, each.cell)
        known = near >= 0.0
        if known.any():
            p[k] = float((blur[known] * np.minimum(near[known], 1.0)).sum() / blur[known].sum())
    return p


def spread(model: LearnedModel, x: Array, p: Array) -> Array:
    """Return the standard deviation of single stances at points on the lattice's axes, (n,).

    Bins with few samples lean on the spread of all bins:

    sd^2 = (M2 + m (c P)^2) / (n - 1 + m),   m = `BROAD`,   c^2 = sum M2 / sum (n - 1) mean^2 over all bins
    """
    bins = list(model.bins.values())
    freedom = sum((each.count - 1.0) * each.mean**2 for each in bins if each.count > 1.0)
    c2 = sum(each.m2 for each in bins) / max(1e-12, freedom)
    out = np.empty(len(p))
    for k, key in enumerate(model.lattice.keys(x).tolist()):
        found = model.bins.get((key[0], key[1], key[2]))
        n, m2 = (1.0, 0.0) if found is None else (max(1.0, found.count), found.m2)
        out[k] = np.sqrt((m2 + BROAD * c2 * p[k] ** 2) / (n - 1.0 + BROAD))
    return out


def slip_interval(mean: Array, sd: Array, share: float = SHARE, least: float = LEAST) -> tuple[Array, Array]:
    """Return the middle interval of gamma distributions above `least` with these means and deviations, (n,) each.

    Slips are never negative, most are small and a few are large: a normal distribution would be wrong on both sides.
    """
    from scipy.stats import gamma

    mean, sd = np.maximum(mean - least, 1e-4), np.maximum(sd, 1e-4)
    shape = (mean / sd) ** 2
    scale = mean / shape
    low, high = (gamma.ppf(0.5 + side * 0.5 * share, shape, scale=scale) for side in (-1.0, 1.0))
    return least + low, least + high


def auc(score: Array, positive: NDArray[np.bool_]) -> float:
    """Return the area under the receiver operating curve: share of pairs in which the positive scores higher.

    Ties count half.

    Args:
        score: value of each item, (n,).
        positive: class of each item, (n,); NaN is returned if all or none are positive.
    """
    from scipy.stats import rankdata

    n = int(positive.sum())
    if n in (0, len(positive)):
        return float("nan")
    ranks = rankdata(score)
    return float((ranks[positive].sum() - n * (n + 1) / 2) / (n * (len(positive) - n)))
