"""How well a slip model predicts stances it was not made of: order, warnings, and how honest its spread is."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surefoot.lab.footholds.slip import auc
from surefoot.services.footholds.learning.samples import Sample, gather
from surefoot.services.footholds.models.lattice import inputs
from surefoot.services.footholds.models.learned import LearnedModel

Array = NDArray[np.float64]
FLAT = 0.05
"""K2 / (8 cell) below which ground counts as flat."""
SHARE = 0.8
"""Of the stances, that an interval should hold."""
BROAD = 10
"""Samples from which the spread of a bin alone is used; with fewer the spread of all bins of like P joins in."""


@dataclass(frozen=True, slots=True)
class Statistics:
    """Of one model on one set of stances."""

    stances: int
    spearman: float
    """Rank correlation of P and slip."""
    warned: float
    """AUC of P for slips of more than twice the mean on flat ground."""
    held: float
    """Share of slips within the interval that should hold `SHARE` of them."""


def judged(model: LearnedModel, samples: Sequence[Sample]) -> Statistics:
    """Compare a model with stances of other trials than those it was made of."""
    from scipy.stats import spearmanr

    found = gather(samples)
    u = inputs(found.x)
    low, high = np.array(model.ranges).T
    p = np.maximum(model.terms.values(np.clip(u, low, high)), 0.0)
    flat = found.r[found.x[:, 1] < FLAT]
    limit = 2.0 * float(flat.mean()) if len(flat) else 2.0 * float(np.quantile(found.r, 0.1))
    a, b = interval(p, spread(model, found.x, p))
    inside = (found.r >= a) & (found.r <= b)
    rank = spearmanr(p, found.r).statistic  # pyright: ignore[reportAttributeAccessIssue] - scipy has no types
    return Statistics(len(found), float(rank), auc(p, found.r > limit), float(inside.mean()))


def spread(model: LearnedModel, x: Array, p: Array) -> Array:
    """Standard deviation of single stances at points on the lattice's axes, (n,); few samples lean on like bins.

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


def interval(mean: Array, sd: Array, share: float = SHARE) -> tuple[Array, Array]:
    """Return the middle interval of gamma distributions with these means and deviations, (n,) each.

    Slips are never negative, most are small and a few are large: a normal distribution would be wrong on both sides.
    """
    from scipy.stats import gamma

    mean, sd = np.maximum(mean, 1e-4), np.maximum(sd, 1e-4)
    shape = (mean / sd) ** 2
    scale = mean / shape
    return gamma.ppf(0.5 - 0.5 * share, shape, scale=scale), gamma.ppf(0.5 + 0.5 * share, shape, scale=scale)
