"""Association of the detections of one frame with the landmarks of a map; kernels on arrays."""

import math
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Ints
from surefoot.kernels.jit import row_kernel

from .consensus import consensus, matched_of
from .gate import (
    DOUBLED,
    INVALID,
    MATCHED,
    OUTLIER,
    SURPLUS,
    FrameTables,
    MapTables,
    MatchLimits,
    SightNoise,
    nearest_look,
)


class Fates(NamedTuple):
    """Results of matching the m detections of a frame with landmarks, one element per detection."""

    landmark: Ints
    """Index in the map of the landmark of each detection, -1 = none, (m,)."""
    fate: Ints
    """Fate of each detection, (m,): 0 matched, 1 impossible range or bearing, 2 no landmark in the gate, 3 none in the
    gate is similar, 4 two in the gate are similar, 5 landmark matched by another detection, 6 outlier to the rigid
    motion that the other matches agree on, 7 beyond the maximum per frame."""
    nis: Array
    """Normalised innovation squared of each detection against its most similar landmark, 2 degrees of freedom, (m,)."""
    gap: Array
    """Squared distance between the descriptors of each detection and its landmark, no unit, (m,)."""


@row_kernel
def sort_by(chosen: Ints, keys: Array, ties: Ints) -> None:
    """Sort the indices `chosen` in place by ascending keys of the elements they point at, ties by ascending `ties`.

    Args:
        chosen: indices into `keys` and `ties`, (n,), reordered.
        keys: keys of all elements, (m,), any unit.
        ties: ties of all elements, (m,), no unit.
    """
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
def _nearest(
    mean: Array, cov: Array, frame: FrameTables, world: MapTables, noise: SightNoise, limits: MatchLimits, fates: Fates
) -> Ints:
    """Write landmark and fate of each detection by itself; return the indices of those that match a landmark, (k,).

    Args:
        mean: believed x, y (m), heading (rad), frame map, (3,) or longer.
        cov: covariance of `mean`, (3, 3) or larger.
        frame: the m detections: ranges, bearings, descriptors.
        world: landmarks of the map.
        noise: standard deviations of a detection.
        limits: limits of gate, likeness and range.
        fates: fates of the m detections, written; those out of the limits of range or not finite keep what they had.
    """
    m, (ranges, bearings, looks) = frame.ranges.size, frame
    chosen, kept = np.empty(m, dtype=np.int64), 0
    for d in range(m):
        finite = math.isfinite(ranges[d]) and math.isfinite(bearings[d])
        for i in range(looks.shape[1]):
            finite = finite and math.isfinite(looks[d, i])
        if finite and limits.shortest <= ranges[d] <= limits.longest:
            fates.landmark[d], fates.fate[d], fates.nis[d], fates.gap[d] = nearest_look(
                mean, cov, ranges[d], bearings[d], looks[d], world, noise, limits
            )
            if fates.fate[d] == MATCHED:
                chosen[kept] = d
                kept += 1
    return chosen[:kept]


@row_kernel
def _one_each(chosen: Ints, fates: Fates) -> Ints:
    """Return the detections left, (j,), if each landmark keeps only the one most like it; the most similar comes first.

    Args:
        chosen: indices of detections that match a landmark, (k,), reordered in place.
        fates: fates of all m detections; the fate of those that lose their landmark becomes DOUBLED (5).
    """
    sort_by(chosen, fates.gap, fates.landmark)
    kept = 0
    for a in range(chosen.size):
        d = chosen[a]
        for b in range(kept):
            if fates.landmark[chosen[b]] == fates.landmark[d]:
                fates.fate[d] = DOUBLED
        if fates.fate[d] == MATCHED:
            chosen[kept] = d
            kept += 1
    return chosen[:kept]


@row_kernel
def match(
    mean: Array, cov: Array, frame: FrameTables, world: MapTables, noise: SightNoise, limits: MatchLimits, seed: int
) -> tuple[Fates, Ints]:
    """Associate the detections of one frame with landmarks.

    Args:
        mean: believed x, y (m, frame map) and heading (rad), (3,) or longer.
        cov: covariance of `mean`, (3, 3) or larger.
        frame: the m detections: ranges, bearings, descriptors.
        world: landmarks of the map.
        noise: standard deviations of range, bearing and descriptor of a detection.
        limits: limits of gate, likeness, range, spread, pairs and matches.
        seed: seed of the random pairs of matches from which rigid motions are tried.

    Returns:
        Fates of all detections, and indices of the matched ones, (k,), those first that look most like their landmark.
    """
    m = frame.ranges.size
    fates = Fates(np.full(m, -1), np.full(m, INVALID), np.zeros(m), np.zeros(m))
    chosen = _one_each(_nearest(mean, cov, frame, world, noise, limits, fates), fates)
    found = matched_of(chosen, fates.landmark, frame, world.positions)
    inlier = consensus(mean, cov, found, noise, limits, seed)
    kept = 0
    for a in range(chosen.size):
        d = chosen[a]
        if not inlier[a]:
            fates.fate[d] = OUTLIER
        elif kept >= limits.most:
            fates.fate[d] = SURPLUS
        else:
            chosen[kept] = d
            kept += 1
    for d in range(m):
        if fates.fate[d] != MATCHED:
            fates.landmark[d] = -1
    return fates, chosen[:kept]


@row_kernel
def likeness(look: Array, columns: Array, out: Array) -> None:
    """Write the squared distances between a descriptor and those of n landmarks to `out`, summed in index order.

    Args:
        look: descriptor, (k,), no unit.
        columns: descriptors of n landmarks, a column each, (k, n), no unit.
        out: result, (n,), overwritten.
    """
    for i in range(out.size):
        out[i] = 0.0
    for j in range(look.size):
        for i in range(out.size):
            d = columns[j, i] - look[j]
            out[i] += d * d


@row_kernel
def look_alikes(looks: Array, columns: Array, look: float) -> Ints:
    """Return the number of landmarks of similar descriptor for each detection, (m,).

    Args:
        looks: descriptors of the detections, (m, k), no unit.
        columns: descriptors of n landmarks, a column each, (k, n), no unit.
        look: largest distance of two descriptors of one landmark, no unit.
    """
    found, gap = np.zeros(looks.shape[0], dtype=np.int64), np.empty(columns.shape[1])
    for d in range(looks.shape[0]):
        likeness(looks[d], columns, gap)
        for i in range(gap.size):
            found[d] += gap[i] < look * look
    return found


@row_kernel
def in_view(
    positions: Array, x: float, y: float, heading: float, nearest: float, farthest: float, half_angle: float
) -> int:
    """Return the number of landmarks between two distances and within an angle of a heading.

    Args:
        positions: landmarks, (n, 2) m, frame map.
        x: x of base_link, m, frame map.
        y: y of base_link, m, frame map.
        heading: heading of base_link, rad, frame map.
        nearest: least distance, m.
        farthest: largest distance, m.
        half_angle: largest angle to either side, rad.
    """
    c, s, limit, count = math.cos(heading), math.sin(heading), math.cos(half_angle), 0
    for i in range(positions.shape[0]):
        dx, dy = positions[i, 0] - x, positions[i, 1] - y
        q2 = dx * dx + dy * dy
        if nearest * nearest <= q2 <= farthest * farthest and c * dx + s * dy >= limit * math.sqrt(q2):
            count += 1
    return count
