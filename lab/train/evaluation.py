"""Evaluation of navigation policies: simulated episodes on all cores, and their statistics."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from surefoot.arrays import Record
from surefoot.services.navigator.environment.episodes import (
    run_episodes,
)
from surefoot.services.navigator.policy.arrays import REACHED, Arrays
from surefoot.services.navigator.policy.decider import Policy

from .. import statistics
from ..pools import worker_threads

EVALUATION = 0
"""Index of the random stream of evaluations; training with seed k uses stream k + 1, so that no episode serves both."""
CHUNK = 100
"""NEES (normalised estimation error squared) of a pose x, y, yaw on the boundary of its 95 % confidence ellipsoid."""


@dataclass(frozen=True)
class Seeds:
    """Range of the episode seeds of a policy's evaluation, from `first` to `end` - 1."""

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
) -> Record:
    """Run a policy in simulated episodes on all cores; return a record RESULT of each episode, (count,).

    Args:
        world: arrays of the navigation model.
        policy: policy that chooses the actions.
        seeds: seeds of the episodes; equal seeds give equal floors, drifts and starts to any policy.
        knows: True: the policy gets true pose and drift; False: the estimates.
        stream: index of the stream of random numbers.
        progress: called with the share that is done, 0 to 1.
    """
    starts = range(seeds.first, seeds.end, CHUNK)

    def part(start: int) -> Record:
        return run_episodes(world, policy, stream, start, min(CHUNK, seeds.end - start), knows)

    with worker_threads() as pool:
        parts: list[Record] = []
        for found in pool.map(part, starts):
            parts.append(found)
            progress(len(parts) / len(starts))
    return np.concatenate(parts)


def summary(results: Record) -> dict[str, Any]:
    """Return statistics of episodes by name: times (s, failed episodes included), success, consistency (NEES).

    `results`: a record RESULT of each episode, (n,), as `run_episodes` returns them.
    """
    seconds, n = results["seconds"], results.shape[0]
    reached = int((results["ended"] == REACHED).sum())
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
        "stands": float(results["stands"].mean()),
        "turns": float(results["turns"].mean()),
        "nees": float(results["nees_sum"].sum() / results["decisions"].sum()),
        "nees_at_20": float(results["nees_at"].mean()),
        "nees_at_20_band95": (low, high),
        "inside_95_at_20": float((results["nees_at"] <= statistics.REGION_95).mean()),
    }


def paired(ours: Record, others: Record) -> dict[str, Any]:
    """Return statistics of the paired difference of times, ours - others, s: mean, 95 % interval, p values.

    `ours`, `others`: a record RESULT of each episode, (n,), with equal seeds at equal indices.
    """
    a, b = ours["seconds"], others["seconds"]
    found, base = statistics.paired(a, b), float(b.mean())
    return {
        "difference_s": found.mean,
        "difference_ci95_s": (found.low, found.high),
        "difference_percent": 100.0 * found.mean / base,
        "difference_ci95_percent": (100.0 * found.low / base, 100.0 * found.high / base),
        "p_paired_t": found.p_paired,
        "p_welch": found.p_welch,
    }
