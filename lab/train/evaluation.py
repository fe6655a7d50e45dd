"""Evaluation of policies: whole episodes on all cores, and their statistics."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from surefoot.arrays import Array
from surefoot.services.navigator.environment.episodes import (
    DECISIONS,
    ENDED_AS,
    NEES_AT,
    NEES_SUM,
    SECONDS_TAKEN,
    STANDS_MADE,
    TURNS_MADE,
    run_episodes,
)
from surefoot.services.navigator.policy.arrays import REACHED, Arrays
from surefoot.services.navigator.policy.policies import Policy

from .. import statistics
from ..pools import worker_threads

EVALUATION = 0
"""Random stream of evaluations; training run k uses stream k + 1, so no episode serves both."""
CHUNK = 100
ELLIPSE_95 = float(stats.chi2.ppf(0.95, 3))
"""NEES on the edge of the ellipsoid that holds 95 % of a pose."""


@dataclass(frozen=True)
class Seeds:
    """Range of episodes of a policy's evaluation, from `first` to `end` - 1."""

    first: int
    end: int

    @property
    def count(self) -> int:
        """Number of episodes in the range."""
        return self.end - self.first


def episodes(
    world: Arrays,
    policy: Policy,
    seeds: Seeds,
    *,
    knows: bool = False,
    stream: int = EVALUATION,
    progress: Callable[[float], None] = lambda share: None,
) -> Array:
    """Return the results (count, RESULTS) of a policy, computed on all cores.

    Args:
        world: the model's arrays.
        seeds: of the episodes; two policies with the same seeds get the same floors, drifts and starts.
        knows: true pose and drift are given to the policy.
        stream: which stream of random numbers.
        progress: gets the share that is done.
    """
    starts = range(seeds.first, seeds.end, CHUNK)

    def part(start: int) -> Array:
        return run_episodes(world, policy, stream, start, min(CHUNK, seeds.end - start), knows)

    with worker_threads() as pool:
        parts: list[Array] = []
        for found in pool.map(part, starts):
            parts.append(found)
            progress(len(parts) / len(starts))
    return np.concatenate(parts)


def summary(results: Array) -> dict[str, Any]:
    """Return mean, spread, success and consistency of episodes, times in s; times of failed episodes count as they are.

    `results`: a row for each episode, columns as this module names them.
    """
    seconds, n = results[:, SECONDS_TAKEN], results.shape[0]
    reached = int((results[:, ENDED_AS] == REACHED).sum())
    low, high = statistics.chi_band(n)
    return {
        "episodes": n,
        "mean_s": float(seconds.mean()),
        "mean_ci95_s": statistics.interval(seconds),
        "sd_s": float(seconds.std(ddof=1)),
        "median_s": float(np.median(seconds)),
        "p95_s": float(np.quantile(seconds, 0.95)),
        "worst_s": float(seconds.max()),
        "success": reached / n,
        "success_at_least": statistics.success_bound(reached, n),
        "stands": float(results[:, STANDS_MADE].mean()),
        "turns": float(results[:, TURNS_MADE].mean()),
        "nees": float(results[:, NEES_SUM].sum() / results[:, DECISIONS].sum()),
        "nees_at_20": float(results[:, NEES_AT].mean()),
        "nees_at_20_band95": (low, high),
        "inside_95_at_20": float((results[:, NEES_AT] <= ELLIPSE_95).mean()),
    }


def paired(ours: Array, others: Array) -> dict[str, Any]:
    """Return the mean difference of times, ours - others, s, of the same seeds, with its 95 % interval and p-value.

    ours, others: results of episodes, (episodes, columns), the time in s first, rows of the same seed.
    """
    a, b = ours[:, SECONDS_TAKEN], others[:, SECONDS_TAKEN]
    found, base = statistics.paired(a, b), float(b.mean())
    return {
        "difference_s": found.mean,
        "difference_ci95_s": (found.low, found.high),
        "difference_percent": 100.0 * found.mean / base,
        "difference_ci95_percent": (100.0 * found.low / base, 100.0 * found.high / base),
        "p_paired_t": found.p_paired,
        "p_welch": found.p_welch,
    }
