"""Features of the floor, each tracked from image to image by place and descriptor."""

import math
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import SurefootError
from surefoot.services.vision.features import KINDS, Kind, distances, nothing
from surefoot.services.vision.recognise import RecogniseParams, consensus

from .turned import FloorLook

Index = NDArray[np.int64]

SAME = 0.03
"""Distance, m, up to which a sighting matches a feature's place; the drift of odometry in between is added."""
LOOK = 0.85
"""Descriptor distance, as a share of the kind's matching limit, up to which a sighting belongs to a feature."""
PASSAGES = (0.3, 2.0)
"""Path lengths without a sighting, m: above the first a feature counts as lost and, if seen again, as of the same
passage; above the second as of a later one, since a walking camera shows a point for less than 2 m."""
AGAIN = RecogniseParams(inlier=0.04)
"""Limits of the rigid motion that features seen again must agree on: a tilt of 1 deg moves them by 3 cm."""
LOOSE, FIRM = (6, 0.3), (12, 0.5)
"""`LOOSE`: least number and share of features seen again that must agree on a motion; `FIRM`: those required
instead if the tolerance of a place is above `AMBIGUOUS`, as a repeating floor then also agrees on a wrong motion."""
AMBIGUOUS = 0.15
"""Tolerance of a feature's place, m, above which `FIRM`, the larger numbers, must agree on a motion."""
RATIO, TURNED = 0.85, 0.3
"""`RATIO`: largest ratio of the descriptor distances of nearest and second match; `TURNED`: largest rotation of a
motion against the heading of the pose, rad."""
SEEN_BEFORE = 3
"""Least number of images in which a feature was seen before it can be recognised after a loss."""
RECENT = 10
"""Length, in sightings, of the running mean that is the place of a feature while poses drift."""


@dataclass
class Tracks:
    """Features of the floor, n of them, each tracked over the images that show it."""

    kind: Kind
    positions: Array
    """Positions of the features in the map, (n, 2) m: mean of all sightings, or of the latest where poses drift."""
    totals: Array
    """Sum of the descriptors of each feature, with each bit of ORB as a number, (n, k)."""
    looks: NDArray[Any]
    """Mean descriptor of each feature, (n, code): bytes by majority of bits for ORB, numbers for SIFT."""
    count: Index
    """Number of images in which each feature was seen, (n,)."""
    last: Index
    """Index of the image in which each feature was last seen, (n,)."""
    scatter: Array
    """Sum of the squared distances of each feature's sightings from their mean, (n,) m^2."""

    @staticmethod
    def none(kind: Kind) -> "Tracks":
        """Return an empty set of tracks for descriptors of a kind."""
        zero, code = np.zeros(0, dtype=np.int64), nothing(kind).descriptors
        return Tracks(kind, np.zeros((0, 2)), numbers(kind, code), code, zero, zero, np.zeros(0))

    def part(self, n: int | Index) -> "Tracks":
        """Return the first n tracks, or those of the indices n, (k,)."""
        which = slice(n) if isinstance(n, int) else n
        return Tracks(self.kind, *(getattr(self, each.name)[which] for each in fields(self)[1:]))

    def grown(self, room: int) -> "Tracks":
        """Return these tracks, extended by zeros to `room` tracks."""
        more: list[Any] = [getattr(self, each.name) for each in fields(self)[1:]]
        longer: list[Any] = [np.concatenate((a, np.zeros((room - len(a), *a.shape[1:]), a.dtype))) for a in more]
        return Tracks(self.kind, *longer)


def numbers(kind: Kind, descriptors: NDArray[Any]) -> Array:
    """Return descriptors as numbers (n, b), no unit, of which means can be taken: single bits of ORB, those of SIFT.

    `descriptors`: (n, d), bytes of ORB or numbers of SIFT; b = 8 d for ORB, else d.
    """
    return (np.unpackbits(descriptors, axis=1) if kind == "orb" else descriptors).astype(np.float64)


def track(looks: list[FloorLook], kind: Kind, drift: float, later: bool = True) -> tuple[Tracks, Index]:
    """Return the features of images, tracked over them, and the feature index of each sighting in order, (sightings,).

    Args:
        looks: features and poses of the images of a walk, in order.
        kind: kind of the descriptors.
        drift: share of the distance walked by which poses drift, one standard deviation; 0 = they are exact.
        later: True: features are also recognised in later passages; False: only in the same one.
    """
    kept, total = Tracks.none(kind), 0
    ways = np.cumsum([0.0, *(math.dist(a.pose[:2], b.pose[:2]) for a, b in pairwise(looks))])
    numbered: list[Index] = []
    for frame, look in enumerate(looks):
        x, y, heading = look.pose
        c, s = math.cos(heading), math.sin(heading)
        at = np.stack((x + c * look.places[:, 0] - s * look.places[:, 1],
                       y + s * look.places[:, 0] + c * look.places[:, 1]), axis=1)  # fmt: skip
        known = kept.part(total)
        since = ways[frame] - ways[known.last]
        slack = np.where((since > PASSAGES[1]) & (not later), -1.0, SAME + 3.0 * drift * since)
        mine = _assigned(at, look, known, slack, since if drift else None)
        new = np.flatnonzero(mine < 0)
        mine[new] = total + np.arange(len(new))
        total += len(new)
        if total > len(kept.count):
            kept = kept.grown(2 * total)
        before, gap = kept.count[mine], at - kept.positions[mine]
        # where poses drift the last passage counts: a mean of two would lie where neither sees the feature
        again = drift > 0.0 and ways[frame] - ways[kept.last[mine]] > PASSAGES[0]
        share = np.where((before == 0) | again, 1.0, 1.0 / (before.clip(1, RECENT if drift else None) + 1))
        kept.positions[mine] += gap * share[:, None]
        kept.scatter[mine] += np.where(before == 0, 0.0, (gap**2).sum(axis=1))
        kept.totals[mine] += numbers(kind, look.descriptors)
        kept.count[mine] += 1
        kept.last[mine] = frame
        mean = kept.totals[mine] / kept.count[mine][:, None]
        kept.looks[mine] = np.packbits(mean > 0.5, axis=1) if kind == "orb" else mean
        numbered.append(mine)
    return kept.part(total), np.concatenate(numbered) if numbered else np.zeros(0, dtype=np.int64)


def _assigned(at: Array, look: FloorLook, found: Tracks, slack: Array, since: Array | None) -> Index:
    """Return the track of each sighting, (n,), -1 = a new one; each track at most once.

    Args:
        at: places of the sightings in the map, (n, 2) m.
        look: features of the image, the n sightings.
        found: tracks so far.
        slack: largest distance of a sighting from each track, (tracks,) m.
        since: path since each track was seen, (tracks,) m; those that were out of sight for long count only where many
            of the same passage agree on one motion; None = each counts.
    """
    mine = np.full(len(at), -1, dtype=np.int64)
    if not len(found.count) or not len(at):
        return mine
    reach = float(slack.max())
    low, high = at.min(axis=0) - reach, at.max(axis=0) + reach
    inside = ((found.positions >= low) & (found.positions <= high)).all(axis=1)
    if since is not None:
        inside &= (since <= PASSAGES[0]) | (found.count >= SEEN_BEFORE)
    near = np.flatnonzero(inside)
    gap = at[:, None] - found.positions[near][None]
    apart = distances(found.kind, look.descriptors, found.looks[near])
    apart[np.hypot(gap[..., 0], gap[..., 1]) > slack[near][None]] = np.inf
    limit = LOOK * KINDS[found.kind].like
    if since is not None:
        passage = np.searchsorted(PASSAGES, since[near])
        for number in range(1, len(PASSAGES) + 1):
            again = passage == number
            wanted = FIRM if slack[near[again]].max(initial=0.0) > AMBIGUOUS else LOOSE
            apart = _of_one_motion(apart, limit, near, look, found, again, wanted)
    pairs = np.argwhere(apart <= limit)
    taken: set[int] = set()
    for i, j in pairs[np.argsort(apart[pairs[:, 0], pairs[:, 1]], kind="stable")].tolist():
        if mine[i] < 0 and j not in taken:
            mine[i] = near[j]
            taken.add(j)
    return mine


def _of_one_motion(
    apart: Array,
    limit: float,
    near: Index,
    look: FloorLook,
    found: Tracks,
    again: NDArray[np.bool_],
    wanted: tuple[int, float],
) -> Array:
    """Return descriptor distances, infinite for features seen again without a motion on which enough agree.

    Args:
        apart: descriptor distances of n sightings and m near tracks, (n, m).
        limit: largest distance of two descriptors of one feature.
        near: numbers of the tracks, (m,).
        look: of the sightings.
        found: all tracks.
        again: near tracks of one passage that were out of sight for long, (m,) bool.
        wanted: least number and share of the features that agree on the motion.

    Returns:
        Distances, (n, m): bits of ORB, Euclidean of SIFT.
    """
    old = np.flatnonzero(again)
    if not len(old):
        return apart
    seen = apart[:, old]
    first = seen.argmin(axis=1)
    best = seen[np.arange(len(seen)), first]
    seen[np.arange(len(seen)), first] = np.inf
    good = np.flatnonzero((best <= limit) & (best <= RATIO * seen.min(axis=1)))
    left = apart.copy()
    left[:, old] = np.inf
    fewest, share = wanted
    if len(good) >= fewest:
        here, there = look.places[good], found.positions[near[old[first[good]]]]
        agree, _ = consensus(here, there, AGAIN, (look.pose[2], TURNED))
        if agree.sum() >= max(fewest, share * len(good)):
            i, j = good[agree], old[first[good[agree]]]
            left[i, j] = apart[i, j]
    return left


def often_seen(found: Tracks, least: int) -> NDArray[np.int64]:
    """Return the indices of the features of `least` sightings or more, (k,).

    Raises:
        SurefootError: there are fewer than two.
    """
    kept = np.flatnonzero(found.count >= least)
    if len(kept) < 2:
        most = int(found.count.max(initial=0))
        raise SurefootError(
            "no_landmarks", f"no two features were seen {least} times, the most often seen {most} times"
        )
    return kept
