"""Kernels of data association: the detections of one frame against a map."""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import row_kernel

from .consensus_kernel import consensus
from .gate_kernel import (
    DOUBLED,
    INVALID,
    LONGEST,
    MATCHED,
    MOST,
    OUTLIER,
    SHORTEST,
    SURPLUS,
    nearest_look,
)

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@row_kernel
def sort_by(chosen: Index, keys: Array, ties: Index) -> None:
    """Sort indices (n,) in place by their keys, equal keys by tie."""
    for i in range(1, chosen.size):  # by insertion: n is a few dozen
        this, j = chosen[i], i
        while j > 0:
            before = chosen[j - 1]
            if keys[before] < keys[this] or (keys[before] == keys[this] and ties[before] <= ties[this]):
                break
            chosen[j] = before
            j -= 1
        chosen[j] = this


@row_kernel
def match(
    mean: Array,
    cov: Array,
    ranges: Array,
    bearings: Array,
    looks: Array,
    positions: Array,
    map_looks: Array,
    grid: Array,
    starts: Index,
    members: Index,
    noise: Array,
    limits: Array,
    seed: int,
) -> tuple[Index, Index, Array, Array, Index]:
    """Associate the detections of one frame with landmarks.

    Args:
        mean: believed x, y (m, frame map) and heading (rad), (3,) or longer.
        cov: its covariance, (3, 3) or larger.
        ranges: m, (m,).
        bearings: rad, (m,).
        looks: descriptors of the detections, (m, k).
        positions: of the landmarks, (n, 2) m, frame map.
        map_looks: descriptors of the landmarks, (n, k).
        grid: of the index of places, (5,), see `landmarks.Buckets`.
        starts: of the index.
        members: of the index.
        noise: see the indices in `gate_kernel`, (5,).
        limits: likewise, (8,).
        seed: of the random pairs.

    Returns:
        Landmark of each detection or -1, what became of each (MATCHED ...), normalised innovation squared, square of
        the distance of the descriptors, all (m,), and the matched detections, those first that look most alike.
    """
    m = ranges.size
    landmark, fate = np.full(m, -1), np.full(m, INVALID)
    nis, gap = np.zeros(m), np.zeros(m)
    chosen, kept = np.empty(m, dtype=np.int64), 0
    for d in range(m):
        finite = math.isfinite(ranges[d]) and math.isfinite(bearings[d])
        for i in range(looks.shape[1]):
            finite = finite and math.isfinite(looks[d, i])
        if finite and limits[SHORTEST] <= ranges[d] <= limits[LONGEST]:
            landmark[d], fate[d], nis[d], gap[d] = nearest_look(
                mean, cov, ranges[d], bearings[d], looks[d], positions, map_looks, grid, starts, members, noise, limits
            )
            if fate[d] == MATCHED:
                chosen[kept] = d
                kept += 1
    chosen = chosen[:kept]
    sort_by(chosen, gap, landmark)
    kept = 0
    for a in range(chosen.size):  # of several detections of one landmark the one that looks most like it
        d = chosen[a]
        for b in range(kept):
            if landmark[chosen[b]] == landmark[d]:
                fate[d] = DOUBLED
        if fate[d] == MATCHED:
            chosen[kept] = d
            kept += 1
    chosen = chosen[:kept]
    inlier = consensus(mean, cov, chosen, landmark, ranges, bearings, positions, noise, limits, seed)
    most, kept = int(limits[MOST]), 0
    for a in range(chosen.size):
        d = chosen[a]
        if not inlier[a]:
            fate[d] = OUTLIER
        elif kept >= most:
            fate[d] = SURPLUS
        else:
            chosen[kept] = d
            kept += 1
    for d in range(m):
        if fate[d] != MATCHED:
            landmark[d] = -1
    return landmark, fate, nis, gap, chosen[:kept]


@row_kernel
def likeness(look: Array, columns: Array, out: Array) -> None:
    """Square of the distance of a descriptor (k,) to each of a map (k, n) into out (n,), every sum in index order."""
    for i in range(out.size):
        out[i] = 0.0
    for j in range(look.size):
        for i in range(out.size):
            d = columns[j, i] - look[j]
            out[i] += d * d


@row_kernel
def known_anywhere(looks: Array, wanted: Index, columns: Array, look: float) -> int:
    """Count of wanted detections that look like some landmark of the map.

    Args:
        looks: descriptors of the detections, (m, k).
        wanted: detections to look up, (w,).
        columns: descriptors of the landmarks, (k, n).
        look: largest distance of two descriptors of one landmark.
    """
    found, gap = 0, np.empty(columns.shape[1])
    for w in wanted:
        likeness(looks[w], columns, gap)
        for i in range(gap.size):
            if gap[i] < look * look:
                found += 1
                break
    return found


@row_kernel
def in_view(
    positions: Array, x: float, y: float, heading: float, nearest: float, farthest: float, half_angle: float
) -> int:
    """Count of landmarks (n, 2) between two distances (m) and within an angle (rad) of a heading from (x, y)."""
    c, s, limit, count = math.cos(heading), math.sin(heading), math.cos(half_angle), 0
    for i in range(positions.shape[0]):
        dx, dy = positions[i, 0] - x, positions[i, 1] - y
        q2 = dx * dx + dy * dy
        if nearest * nearest <= q2 <= farthest * farthest and c * dx + s * dy >= limit * math.sqrt(q2):
            count += 1
    return count
