"""Quality of slip models on stances not used for learning: ranking, warnings, intervals, beside simple rules."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array

from ..features import Features, window_features
from ..models.lattice import inputs
from ..models.learned import LearnedModel
from ..models.score import HandScore
from ..relief import patch_features
from ..select import landing_weights
from .samples import SampleSet, StanceSample, gather

FLAT = 0.05
"""Roughness K2 over 8 edges of a map cell, no unit, below which ground counts as flat."""
LEAST = 0.003
"""Least slip of a stance per stroke, no unit: contacts creep on flat ground, too. 99 % of 3363 stances (seeds 1100 to
1107) slid more."""
SHARE = 0.8
"""Share of the stances that an interval of predicted slip should hold, 0 to 1."""


@dataclass(frozen=True, slots=True)
class PredictionQuality:
    """Quality of one slip model on a set of stances (steps of a foot): rank correlation, warnings, intervals."""

    stances: int
    spearman: float
    """Rank correlation of predicted and measured slip, -1 to 1."""
    warned: float
    """Area under the ROC curve of the predicted slip, 0 to 1, for stances whose slip exceeds twice the mean on flat
    ground."""
    held: float
    """Share of measured slips inside the interval that should hold 80 % of them, 0 to 1."""
    ceiling: float
    """Rank correlation of slip and the mean slip of stances with equal inputs: the highest that any model of these
    inputs can reach on these stances; 1 where no two inputs are equal."""


def prediction_quality(model: LearnedModel, samples: Sequence[StanceSample]) -> PredictionQuality:
    """Return the quality of a model on stances of other trials than those it was made of."""
    from scipy.stats import spearmanr

    found = gather(samples, model.relief)
    p = expected(model, found)
    flat = found.r[found.x[:, 1] < FLAT]
    limit = 2.0 * float(flat.mean()) if len(flat) else 2.0 * float(np.quantile(found.r, 0.1))
    a, b = slip_interval(p, spread(model, found.x))
    inside = (found.r >= a) & (found.r <= b)
    rank = spearmanr(p, found.r).statistic  # pyright: ignore[reportAttributeAccessIssue] - scipy has no types
    _, place = np.unique(np.round(found.x, 3), axis=0, return_inverse=True)
    alike = (np.bincount(place, weights=found.r) / np.bincount(place))[place]
    most = spearmanr(alike, found.r).statistic  # pyright: ignore[reportAttributeAccessIssue] - scipy has no types
    return PredictionQuality(len(found), float(rank), auc(p, found.r > limit), float(inside.mean()), float(most))


def expected(model: LearnedModel, found: SampleSet) -> Array:
    """Return the slip per stroke, no unit, that the model expects of each stance, (n,).

    As in the choice of a foothold, it is the mean of the predicted slip P over the cells about the chosen one with the
    weights of the landing error; cells without P stay out. A stance without heights, or without any P, counts with P of
    its cell, brought into the ranges of the model. `found`: the n stances.
    """
    p = model.exact(found.x)
    for k, each in enumerate(found.kept):
        blur, z = landing_weights(model.landing_error, each.cell), each.around()
        border = blur.shape[0] // 2
        if z is None or border + (each.scale if model.relief else 1) > z.shape[0] // 2:
            continue
        if model.relief:
            inner = patch_features(z, each.scale, each.stroke, each.cell, border)
        else:
            corner, edge = z.shape[0] // 2 - border, 2 * border + 1
            inner = window_features(z, corner, corner, edge, edge, np.array(each.stroke), each.cell)
        near = model.predict(inner, each.cell)
        known = near >= 0.0
        if known.any():
            p[k] = float((blur[known] * np.minimum(near[known], 1.0)).sum() / blur[known].sum())
    return p


def spread(model: LearnedModel, x: Array) -> Array:
    """Return the standard deviation, no unit, of the slip of single steps at points of a model's lattice, (n,).

    `x`: points K1 / K2, K2 / (8 cell), cos K3, (n, 3), no unit.
    """
    cell = model.conditions.cell
    k = inputs(x) * np.array([8.0 * cell, 8.0 * cell, 1.0])
    return model.spread(Features(*(layer[None].astype(np.float32) for layer in k.T)), cell)[0].astype(np.float64)


def slip_interval(mean: Array, sd: Array, share: float = SHARE, least: float = LEAST) -> tuple[Array, Array]:
    """Return lower and upper ends, (n,) each, of the intervals that hold the middle `share` of the slips.

    Slips per stroke (no unit) are never negative, most are small and a few are large: gamma distributions above
    `least`.

    Args:
        mean: mean of the distributions, (n,), slip per stroke.
        sd: standard deviations of the distributions, (n,), slip per stroke.
        share: share of the slips in the interval, 0 to 1.
        least: smallest slip per stroke.
    """
    from scipy.special import gammaincinv

    mean, sd = np.maximum(mean - least, 1e-4), np.maximum(sd, 1e-4)
    shape = (mean / sd) ** 2
    scale = mean / shape
    low, high = (scale * gammaincinv(shape, 0.5 + side * 0.5 * share) for side in (-1.0, 1.0))
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


@dataclass(frozen=True, slots=True)
class PredictorFigures:
    """Quality of one predictor of slip on ground not used for its fit: variance explained, ranks, intervals."""

    name: str
    r2: float
    """Share of the variance of slips that the predictor explains; 0: no better than the mean slip of the other
    folds."""
    rank: float
    """Mean over trials of the rank correlation of predicted and measured slip, -1 to 1."""
    auc: float
    """Area under the ROC curve, 0 to 1, for stances whose slip exceeds twice the median of their trial."""
    held: float
    """Share of measured slips inside the predictor's 80 % interval, 0 to 1; NaN: the predictor has no interval."""


@dataclass(frozen=True, slots=True)
class HeldOutFigures:
    """Figures of a learned model, the hand-made score, the flattest cell and nominal landings, on ground held back."""

    rows: tuple[PredictorFigures, ...]
    """Figures of the learned model, the hand-made score, the rule of the flattest cell, and nominal landings, in this
    order."""
    by: str
    """Parts that folds were made of: `terrains`, or `trials` if there is only one terrain."""
    warning: str
    """Reason in words why the learned model is not better than the simple rules; empty = it is better."""


def folds_of(samples: SampleSet, count: int) -> tuple[NDArray[np.int64], str]:
    """Return the number of the fold of each sample, (n,), 0 to count - 1, and what folds are made of.

    Folds hold whole terrains (`terrains`), or whole trials (`trials`) where all samples are of one terrain.
    """
    terrains = sorted({_terrain(each) for each in samples.kept})
    if len(terrains) < 2:
        return samples.trial % count, "trials"
    number = {name: k % count for k, name in enumerate(terrains)}
    return np.array([number[_terrain(each)] for each in samples.kept], dtype=np.int64), "terrains"


def _terrain(sample: StanceSample) -> str:
    """Return the ground of a sample: its source without the last word, which names the errors of its map."""
    return sample.source.rpartition(" ")[0] or sample.source


def compared(samples: SampleSet, fold: NDArray[np.int64], p: Array, held: float, by: str) -> HeldOutFigures:
    """Return figures of a model's slip predictions and of three rules: hand-made score, flattest cell, nominal landing.

    Args:
        samples: all of them.
        fold: fold of each, (n,).
        p: slip per stroke predicted by the model that was fitted without the sample's fold, (n,), no unit.
        held: share of slips within the model's intervals.
        by: what folds are made of.
    """
    k = np.array([(each.k1, each.k2, each.cos_k3) for each in samples.kept], dtype=np.float32).T[:, None]
    cell = samples.kept[0].cell
    scores = {
        "hand-made": HandScore().predict(Features(*k), cell)[0].astype(np.float64),
        "min-K2": k[1, 0].astype(np.float64) / (8.0 * cell), "nominal": np.zeros(len(samples)),
    }  # fmt: skip
    rows = [_standing("learned", samples, fold, p, held)]
    rows += [_standing(name, samples, fold, _calibrated(v, samples.r, fold), np.nan) for name, v in scores.items()]
    own, others = rows[0], max(rows[1:], key=lambda each: each.rank)
    chance = 3.0 / np.sqrt(len(samples))
    warning = ""
    if own.r2 <= 0.0:
        warning = f"explains nothing: R2 {own.r2:.3f} on {by} held back, that of the mean is 0"
    elif own.rank <= chance:
        warning = (
            f"orders no better than chance: rank correlation {own.rank:.3f} on {by} held back, chance {chance:.3f}"
        )
    elif own.rank <= others.rank:
        warning = f"orders no better than {others.name}: rank correlation {own.rank:.3f} against {others.rank:.3f}"
    return HeldOutFigures(tuple(rows), by, warning)


def _calibrated(score: Array, r: Array, fold: NDArray[np.int64]) -> Array:
    """Return a + b score, b >= 0, (n,), with a and b fitted to the slips of the other folds.

    `score`: of each sample, (n,); `r`: slip per stroke, (n,); `fold`: number of each sample's fold, (n,).
    """
    out = np.empty(len(r))
    for f in np.unique(fold):
        rest, own = fold != f, fold == f
        away = score[rest] - score[rest].mean()
        rise = max(0.0, float(away @ r[rest]) / max(float(away @ away), 1e-12))
        out[own] = r[rest].mean() + rise * (score[own] - score[rest].mean())
    return out


def _standing(name: str, samples: SampleSet, fold: NDArray[np.int64], p: Array, held: float) -> PredictorFigures:
    from scipy.stats import spearmanr

    r, left, all_ = np.minimum(samples.r, 1.0), 0.0, 0.0
    for f in np.unique(fold):
        own = fold == f
        left += float(((r[own] - p[own]) ** 2).sum())
        all_ += float(((r[own] - r[~own].mean()) ** 2).sum())
    ranks, areas = list[float](), list[float]()
    for trial in np.unique(samples.trial):
        own = samples.trial == trial
        areas.append(auc(p[own], r[own] > 2.0 * np.median(r[own])))
        alike = np.ptp(p[own]) == 0.0 or np.ptp(r[own]) == 0.0
        ranks.append(0.0 if alike else float(spearmanr(p[own], r[own]).statistic))  # pyright: ignore
    known = [area for area in areas if area == area] or [0.5]  # no stance of a trial slides: as good as chance
    return PredictorFigures(name, 1.0 - left / max(all_, 1e-12), float(np.mean(ranks)), float(np.mean(known)), held)
