"""Measures of runs as in Osswald et al., section VI, computed from episodes."""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from surefoot.arrays import Array
from surefoot.services.navigator.policy.arrays import STAND, Arrays

from .episode import Episode

WINDOW = 100  # episodes of a moving mean
SETTLED = 0.05  # share of the mean that the moving mean stays within once it has converged
NEAR, FAR = 1.0, 2.5  # m, from where on the goal counts as near, or far


def moving_mean(values: Array, window: int = WINDOW) -> Array:
    """Return the means of each `window` successive values, (n - window + 1,), of values (n,), in their unit."""
    return np.convolve(values, np.full(window, 1.0 / window), "valid")


def converged(seconds: Array) -> int:
    """Return the index of the first episode from which the moving mean stays within SETTLED of the mean at the end.

    The moving mean at an episode is that of the times of it and the WINDOW - 1 episodes after it.

    Args:
        seconds: time of each training episode, (n,) s; the end is the last third of it.
    """
    end = float(seconds[-seconds.size // 3 :].mean())
    outside = np.flatnonzero(np.abs(moving_mean(seconds) - end) > SETTLED * end)
    return int(outside[-1]) + 1 if outside.size else 0


def first_near_the_end(seconds: Array) -> int:
    """Return the index of the first episode whose moving mean is within SETTLED (a share) of the mean at the end.

    The moving mean at an episode is that of the times of it and the WINDOW - 1 episodes after it; later ones may be
    farther off. `seconds`: time of each training episode, (n,) s; the end is the last third of it.
    """
    end = float(seconds[-seconds.size // 3 :].mean())
    return int(np.argmax(np.abs(moving_mean(seconds) - end) <= SETTLED * end))


def stops(e: Episode) -> NDArray[np.int64]:
    """Return the indices of the actions at which the robot stops, (s,): consecutive stands count as one stop."""
    return np.flatnonzero(e.stands & ~np.concatenate(([False], e.stands[:-1])))


def spread_of_intervals(episodes: Iterable[Episode]) -> float:
    """Return standard deviation over mean of the times between stops: 0 = regular, 1 = random; NaN: no intervals."""
    gaps = np.concatenate([np.diff(e.time[stops(e)]) for e in episodes])
    return float(gaps.std() / gaps.mean()) if gaps.size > 1 else math.nan


def entropy_by_distance(episodes: Iterable[Episode]) -> tuple[float, float]:
    """Return the mean entropy (nats) at decisions farther than FAR and nearer than NEAR to the goal."""
    all_ = np.concatenate([e.features[:-1] for e in episodes])
    return float(all_[all_[:, 0] > FAR, 2].mean()), float(all_[all_[:, 0] < NEAR, 2].mean())


def stand_rates(episodes: Iterable[Episode]) -> tuple[float, float]:
    """Return the share of decisions that are stands, farther than FAR from the goal and nearer than NEAR to it."""
    listed = list(episodes)
    d = np.concatenate([e.features[:-1, 0] for e in listed])
    stands = np.concatenate([e.stands for e in listed])
    return float(stands[d > FAR].mean()), float(stands[d < NEAR].mean())


def matches_expected(world: Arrays, episodes: Iterable[Episode]) -> float:
    """Return the mean number of landmarks recognised in the frame at the end of an action that moves.

    It is counted from the floor and the true poses: landmarks in view times the probability of a match.
    """
    counts: list[float] = []
    for e in episodes:
        for pose, index in zip(e.truth[1:], e.actions, strict=True):
            action = world.tables.actions[index]
            if action.kind == STAND:
                continue
            to = e.marks - pose[:2]
            r = np.hypot(to[:, 0], to[:, 1])
            ahead = to @ np.array([math.cos(pose[2]), math.sin(pose[2])]) >= action.cos_half * r
            counts.append(action.match * float((ahead & (r >= action.range_min) & (r <= action.range_max)).sum()))
    return float(np.mean(counts))


def turns_against_drift(episodes: Iterable[Episode]) -> float:
    """Return the share of the turns on the spot that are opposite to the drift of their episode."""
    signs = np.concatenate([e.turns[e.turns != 0] * np.sign(e.drift) for e in episodes])
    return float((signs < 0.0).mean())


def reversals(e: Episode) -> int:
    """Return the number of turns on the spot that follow a turn to the other side, at most one action between them."""
    at = np.flatnonzero(e.turns)
    return int(((np.diff(e.turns[at]) != 0) & (np.diff(at) <= 2)).sum())


def typical(episodes: Sequence[Episode]) -> Episode:
    """Return the episode whose time and number of stands are nearest to the means over all, in standard deviations."""
    rows = np.array([(e.seconds, e.stands.sum()) for e in episodes])
    spread = rows.std(axis=0)
    off = np.abs(rows - rows.mean(axis=0)) / np.where(spread > 0.0, spread, 1.0)
    return episodes[int(np.argmin(off.sum(axis=1)))]


def difference(a: Array, b: Array) -> tuple[float, float, float]:
    """Return the difference of the means of a and b, a - b, and its 95 % interval by Welch, in per cent of b's mean.

    a, b: samples, (n,) and (m,), same unit.
    """
    test: Any = stats.ttest_ind(a, b, equal_var=False)
    low, high = test.confidence_interval(0.95)
    base = 100.0 / float(b.mean())
    return base * float(a.mean() - b.mean()), base * float(low), base * float(high)


def welch_of(mean_a: float, sd_a: float, mean_b: float, sd_b: float, n: int) -> float:
    """Return p of Welch's two-sided t-test for printed means and standard deviations of n values each."""
    test: Any = stats.ttest_ind_from_stats(mean_a, sd_a, n, mean_b, sd_b, n, equal_var=False)
    return float(test.pvalue)
