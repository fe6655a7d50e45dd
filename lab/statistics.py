"""Statistics of repeated runs: means, rates, paired differences and ratios, each with its 95 % interval.

Deterministic: resampling draws from a generator that the caller gives, or from one with a fixed seed.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from surefoot.arrays import Array

REGION_95 = 7.815
"""Bound of the NEES, 3 dimensions, below which 95 % of the errors of a consistent estimate are (chi^2)."""
Z95 = 1.959964
"""Half width of the 95 % interval of a normal distribution, in standard deviations."""
RESAMPLINGS = 4000
"""Number of bootstrap samples from which the interval of a ratio is computed."""


class Ranged(NamedTuple):
    """Value of a statistic with the ends of its 95 % interval."""

    value: float
    low: float
    high: float


class Difference(NamedTuple):
    """Mean difference of two measurements on equal seeds, with its interval and the p-values of two t-tests."""

    mean: float
    """Mean of ours - theirs, in the unit of the values."""
    low: float
    """Lower end of the 95 % interval of the mean."""
    high: float
    """Upper end of the 95 % interval of the mean."""
    p_paired: float
    """p-value of the paired two-sided t-test."""
    p_welch: float
    """p-value of Welch's two-sided t-test, which ignores the pairs."""


def interval(values: ArrayLike) -> tuple[float, float]:
    """Return the 95 % interval of a mean by Student's t: mean -+ t(0.975, n - 1) s / sqrt(n).

    Args:
        values: at least two numbers, (n,).
    """
    from scipy import stats

    x = np.asarray(values, dtype=np.float64)
    half = float(stats.t.ppf(0.975, x.size - 1) * x.std(ddof=1) / math.sqrt(x.size))
    mean = float(x.mean())
    return mean - half, mean + half


def half_width(values: ArrayLike) -> float:
    """Return half the width of the 95 % interval of the mean of values (n,); NaN for fewer than two."""
    if np.size(values) < 2:
        return math.nan
    low, high = interval(values)
    return 0.5 * (high - low)


def deviation(values: ArrayLike) -> float:
    """Return the standard deviation of a sample (n,), with n - 1; NaN for fewer than two values."""
    x = np.asarray(values, dtype=np.float64)
    return float(x.std(ddof=1)) if x.size > 1 else math.nan


def middle_and_ends(values: ArrayLike, digits: int = 3, unit: str = "") -> str:
    """Return the median and the extremes of values (n,) as text with `unit`, `median 1.234 (1.100 to 1.300)`.

    `digits`: number of decimals.
    """
    x = np.asarray(values, dtype=np.float64)
    return f"median {np.median(x):.{digits}f}{unit} ({x.min():.{digits}f} to {x.max():.{digits}f})"


def wilson(k: int, n: int) -> tuple[float, float]:
    """Return the 95 % interval of a rate by k successes in n runs (Wilson 1927).

    (p + z^2 / 2n -+ z sqrt(p (1 - p) / n + z^2 / 4n^2)) / (1 + z^2 / n),   p = k / n,   z = 1.96
    """
    z, p = 1.96, k / n
    centre, half = p + z * z / (2 * n), z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return (centre - half) / (1 + z * z / n), (centre + half) / (1 + z * z / n)


def success_bound(successes: int, n: int) -> float:
    """Return the success rate exceeded with 95 % confidence, by `successes` of n runs (Clopper and Pearson 1934)."""
    from scipy import stats

    return float(stats.beta.ppf(0.05, successes, n - successes + 1)) if successes else 0.0


def chi_band(n: int, freedom: int = 3) -> tuple[float, float]:
    """Return the 95 % band of the mean of n NEES values of a consistent estimate: chi^2 with n `freedom`, over n.

    NEES is e^T P^-1 e of an error e with covariance P; `freedom`: its number of dimensions.
    """
    from scipy import stats

    return float(stats.chi2.ppf(0.025, freedom * n) / n), float(stats.chi2.ppf(0.975, freedom * n) / n)


def nees(error: Array, cov: Array) -> Array:
    """Return the normalised error squared e^T S^-1 e, (n,), no unit, of errors (n, 3) with covariances (n, 3, 3)."""
    return np.einsum("ni,ni->n", error, np.linalg.solve(cov, error[..., None])[..., 0])


def paired(ours: ArrayLike, others: ArrayLike) -> Difference:
    """Return the mean difference ours - others over equal seeds, with its 95 % interval and p-values.

    Args:
        ours: values by seed, (n,).
        others: values of these seeds, (n,), in the unit of `ours`.
    """
    from scipy import stats

    a, b = np.asarray(ours, dtype=np.float64), np.asarray(others, dtype=np.float64)
    low, high = interval(a - b)
    differ = bool((a != b).any())
    p_paired = _p(stats.ttest_rel(a, b)) if differ else 1.0
    return Difference(float((a - b).mean()), low, high, p_paired, welch(a, b) if differ else 1.0)


def welch(a: ArrayLike, b: ArrayLike) -> float:
    """Return the p-value of Welch's two-sided t-test for equal means of a and b, (n,) and (m,) (Welch 1947)."""
    from scipy import stats

    return _p(stats.ttest_ind(a, b, equal_var=False))


def p_of_mean(values: ArrayLike) -> float:
    """Return the p-value of the two-sided t-test for a mean of zero, of values (n,)."""
    from scipy import stats

    return _p(stats.ttest_1samp(values, 0.0))


def _p(result: Any) -> float:
    return float(result.pvalue)


def ratio(a: Array, b: Array, rng: np.random.Generator | None = None) -> Ranged:
    """Return the ratio of the means of paired values, mean(a) / mean(b), no unit, with its 95 % bootstrap interval.

    Pairs are resampled together (Efron 1979, percentile method).

    Args:
        a: numerator by seed, (n,), any unit.
        b: denominator of these seeds, (n,), in the unit of a.
        rng: source of the resampling; None = a generator with seed 0.
    """
    return mean_ratio([(a, b)], rng)


def mean_ratio(pairs: Sequence[tuple[Array, Array]], rng: np.random.Generator | None = None) -> Ranged:
    """Return the mean over groups of the ratios of means, no unit, with its 95 % bootstrap interval.

    Seeds are resampled inside each group.

    Args:
        pairs: numerators and denominators of each group by seed, (n,) each, in one unit.
        rng: source of the resampling; None = a generator with seed 0.
    """
    rng = np.random.default_rng(0) if rng is None else rng
    drawn = np.zeros(RESAMPLINGS)
    for a, b in pairs:
        pick = rng.integers(0, len(a), (RESAMPLINGS, len(a)))
        drawn += a[pick].mean(axis=1) / b[pick].mean(axis=1) / len(pairs)
    low, high = np.percentile(drawn, [2.5, 97.5])
    return Ranged(float(np.mean([a.mean() / b.mean() for a, b in pairs])), float(low), float(high))


def resampled(groups: Sequence[Any], statistic: Callable[[Sequence[Any]], float], count: int = 2000) -> Ranged:
    """Return a statistic of groups with its 95 % bootstrap interval; whole groups are resampled, from seed 0.

    Args:
        groups: for example the stances of each walk.
        statistic: function that returns the figure of a selection of groups.
        count: number of bootstrap samples; those that give NaN are left out.
    """
    rng = np.random.default_rng(0)
    many = [statistic([groups[k] for k in rng.integers(0, len(groups), len(groups))]) for _ in range(count)]
    low, high = np.nanpercentile(many, [2.5, 97.5])
    return Ranged(statistic(groups), float(low), float(high))


def resampled_mean(values: ArrayLike, count: int = 2000) -> Ranged:
    """Return the mean of values (n,) and its 95 % interval by `count` bootstrap samples, drawn from seed 0."""
    x = np.asarray(values, dtype=np.float64)
    means = x[np.random.default_rng(0).integers(0, len(x), (count, len(x)))].mean(axis=1)
    return Ranged(float(x.mean()), float(np.percentile(means, 2.5)), float(np.percentile(means, 97.5)))
