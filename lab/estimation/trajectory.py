"""Measures of whole trajectories that are usual in the field: relative pose error, absolute trajectory error, path.

A pair of rows i, j has the relative pose error E = (Q_i^-1 Q_j)^-1 (P_i^-1 P_j) of true poses Q and estimated ones P
(Sturm et al., IROS 2012; equal to `evo_rpe`); its length is that of the translation in E.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Ints

KNOT_S = 0.25
"""Averaging time of true positions before the path length is summed, s: motion capture is noisy row by row."""
LENGTHS_M = (1.0, 0.5, 0.1)
"""Lengths of path over which the relative pose error is measured, m: the first that fits into the log."""
STARTS = 20  # pairs of rows that begin within one such length
MOST_PAIRS = 5000  # of rows one second apart


class Poses(NamedTuple):
    """Poses of base_link at n rows."""

    position: Array  # (n, 3) m, world
    rot: Array  # (n, 3, 3) rot_world_from_base


class Pairs(NamedTuple):
    """Pairs of rows between which relative poses are compared, as indices of first and last row."""

    first: Ints  # (k,)
    last: Ints  # (k,)


def path_length(position: Array, seconds: Array) -> Array:
    """Return the path length from the start to each row, (n,) m, of positions (n, 3) m, without their row-to-row noise.

    `seconds`: times of the rows, (n,) s.
    """
    at = ((seconds - seconds[0]) / KNOT_S).astype(np.int64)
    count = np.bincount(at)
    full = count > 0
    columns = [np.bincount(at, x)[full] / count[full] for x in (seconds, *position.T)]
    knots = np.vstack([[seconds[0], *position[0]], np.column_stack(columns), [seconds[-1], *position[-1]]])
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(knots[:, 1:], axis=0), axis=1))])
    return np.interp(seconds, knots[:, 0], way)


def pairs_by_path(way: Array, lengths: Sequence[float] = LENGTHS_M) -> tuple[float, Pairs]:
    """Return the first of `lengths`, m, that fits into a path, NaN if none does, and pairs of rows that length apart.

    `way`: path length from the start to each row, (n,) m.
    """
    total = float(way[-1])
    length = next((length for length in lengths if length <= total), float("nan"))
    begins = np.arange(0.0, total - length + 1e-9, length / STARTS) if length <= total else np.empty(0)
    first, last = np.searchsorted(way, begins), np.searchsorted(way, begins + length)
    return length, Pairs(first, np.minimum(last, len(way) - 1))


def pairs_by_time(seconds: Array, apart: float = 1.0) -> Pairs:
    """Return pairs of rows `apart` s apart in time; none if the times (n,) s span less."""
    first = np.arange(0, len(seconds), max(1, len(seconds) // MOST_PAIRS))
    half = 0.5 * float(np.median(np.diff(seconds)))
    last = np.searchsorted(seconds, seconds[first] + apart - half)
    return Pairs(first[last < len(seconds)], last[last < len(seconds)])


def relative_error(true: Poses, seen: Poses, pairs: Pairs) -> Array:
    """Return translations of the relative pose errors, (k, 3) m, axes of the true pose at the end of each pair."""
    i, j = pairs

    def step(poses: Poses) -> Array:
        return np.einsum("kji,kj->ki", poses.rot[i], poses.position[j] - poses.position[i])

    turn = np.einsum("kji,kjl->kil", true.rot[i], true.rot[j])
    return np.einsum("kji,kj->ki", turn, step(seen) - step(true))


def height_error(true: Poses, seen: Poses, pairs: Pairs) -> Array:
    """Return errors of the estimated change of height between the rows of each pair, (k,) m."""
    rise = seen.position[:, 2] - true.position[:, 2]
    return rise[pairs.last] - rise[pairs.first]


def laid_over(position: Array, true: Array) -> Array:
    """Return positions (n, 3) m turned about the vertical and moved to fit `true` (n, 3) m by least squares."""
    a, b = position - position.mean(axis=0), true - true.mean(axis=0)
    angle = np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a[:, :2] * b[:, :2]))
    c, s = np.cos(angle), np.sin(angle)
    return a @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + true.mean(axis=0)
