"""Changes of a floor since its landmark map was made, from recordings of a robot that knew where it was.

Detections are placed in the map by the pose of their frame. One that looks like a landmark near by is a sight of it;
the others are grouped by place and look. A look is all frames of one second: a landmark in view is recognised in it
with P = 1 - product over its frames of (1 - q p), p of its place in the picture times how much the frame shows, both
counted over all landmarks, q of its own: 1, 1/2 or 1/4, whose shares w(q) fit the map. With these,

    odds that it is not there = prior * product of .02 or .98 / sum over q of w(q) product of P or 1 - P

where the first are of looks that show it, the second of those that do not. The same odds, inverted, are those of a new
landmark. A landmark that is not there and whose look is found at another place has moved.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.spatial import KDTree

from surefoot.arrays import Array, Flags
from surefoot.errors import SurefootError
from surefoot.services.navigator.belief.landmarks import FloorLandmarks
from surefoot.services.navigator.belief.matching import MatchLimits, SightNoise

from .build import estimated_look_noise
from .equations import Index, wrapped
from .sightings import SureSightings

WIDEST = 0.3
"""Largest distance, m, of a detection from a landmark that it may be a sight of, and within which detections group."""
SDS = 4.0
"""Residual, in standard deviations, up to which a detection that looks like a landmark is a sight of it."""
CHANCE = 0.02
"""Probability that a look shows a landmark that is not there."""
SHARES, WEIGHTS = np.array([1.0, 0.5, 0.25]), np.array([0.7, 0.2, 0.1])
"""Recognition of a landmark as a share of the others, and the probability of each share before any look."""
FIRM, STEPS = 5.0, 20
"""`FIRM`: number of landmarks as which `WEIGHTS` count beside those of the map; `STEPS`: of their improvement."""
RARE, ELSEWHERE = 0.02, 0.9
"""Prior probability that a landmark is not there; of one whose look is found at another place."""
CERTAIN = 0.99
"""Probability from which on a change is listed."""
LEAST = 3
"""Number of looks that a change needs at least."""
BINS = 8
"""Number of parts of the picture along and across in which landmarks are counted."""
ROUNDS = 3
"""Number of times that landmarks are counted without those that are not there."""

Kind = Literal["vanished", "moved", "new"]
KINDS: tuple[Kind, ...] = ("vanished", "moved", "new")


@dataclass(frozen=True)
class MapChange:
    """Landmark that is not where the map has it, or that the map does not have."""

    kind: Kind
    """vanished: no longer there; moved: at another place; new: not in the map."""
    landmark: int | None
    """Index of the landmark in the map; None = it is new."""
    place: tuple[float, float]
    """Where it is, for a vanished one where it was, x, y in m, frame map."""
    covariance: tuple[float, float, float, float] | None
    """Covariance of that place, row-major 2 x 2, m^2; None = it has vanished."""
    looks: int
    """Number of looks at the place in the map, of a new one at its own, that could show it."""
    seen: int
    """Number of looks that showed it at its place of now; 0 if it has vanished."""
    probability: float
    """Probability of the change, 0 to 1."""


@dataclass(frozen=True, eq=False)
class MapUpdate:
    """Changes of a landmark map, and the map with them."""

    changes: tuple[MapChange, ...]
    """Changes: vanished, moved and new ones, each by probability."""
    world: FloorLandmarks
    """Map without landmarks that vanished, with moved ones at their new places, and with new ones."""
    looked_at: int
    """Number of landmarks of the old map that were in view in as many looks as a change needs."""


@dataclass(frozen=True, eq=False)
class _Odds:
    """Evidence on places of n landmarks, and how well landmarks are recognised."""

    absent: Array
    """Logarithm of the likelihood that no landmark is there, (n,)."""
    there: Array
    """Logarithm of the likelihood of one that is recognised by each of `SHARES`, (q, n)."""
    looks: Index
    """Number of looks that could show a landmark there, (n,)."""
    weights: Array
    """Share of the landmarks of the map that are recognised by each of `SHARES`, (q,)."""

    def gone(self, prior: float) -> Array:
        """Return the probability that no landmark is there, (n,); `prior`: that before any look."""
        high = np.maximum(self.there.max(axis=0), self.absent)
        there = (1.0 - prior) * (self.weights @ np.exp(self.there - high))
        absent = prior * np.exp(self.absent - high)
        return absent / (absent + there)

    def weighed(self) -> "_Odds":
        """Return the evidence with the shares that fit these landmarks, by expectation maximisation."""
        weights, looked_at = WEIGHTS, self.looks > 0
        there = self.there[:, looked_at]
        for _ in range(STEPS):
            here = 1.0 - replace(self, weights=weights).gone(RARE)[looked_at]
            each = weights[:, None] * np.exp(there - there.max(axis=0))
            total = (here * each / each.sum(axis=0)).sum(axis=1) + FIRM * WEIGHTS
            weights = total / total.sum()
        return replace(self, weights=weights)


def changes_of(world: FloorLandmarks, seen: SureSightings, source: str = "", certain: float = CERTAIN) -> MapUpdate:
    """Return the changes of a map by detections from known poses.

    Args:
        world: the map.
        seen: detections, and the poses of the robot in the frame of the map.
        source: origin of the detections, kept in the new map.
        certain: probability from which on a change is listed.

    Raises:
        SurefootError: descriptors of another length than those of the map, or no sight of any of its landmarks.
    """
    if seen.looks.shape[1] != world.descriptor_length:
        text = f"detections have descriptors of {seen.looks.shape[1]} numbers, the map of {world.descriptor_length}"
        raise SurefootError("bad_descriptor", text)
    noise = SightNoise(look_sd=estimated_look_noise(seen.plain))
    limit = MatchLimits().look(noise, world.descriptor_length)
    owner, sds = _sights(world, seen, limit)
    view = _Seeing(seen, world.positions, owner)
    view.count(np.ones(len(world), dtype=bool))
    odds = view.odds(world.positions, owner, WEIGHTS).weighed()
    for _ in range(ROUNDS - 1):
        view.count(odds.gone(RARE) < 0.5)
        odds = view.odds(world.positions, owner, WEIGHTS).weighed()
    group, places, looks = _groups(seen, owner < 0, limit)
    others = view.odds(places, group, odds.weights)
    return _listed(world, seen, (odds, others), (group, places, looks), (sds, limit), certain, source)


def _sights(world: FloorLandmarks, seen: SureSightings, limit: float) -> tuple[Index, tuple[float, float]]:
    """Return the landmark that each detection is a sight of, -1 = none, and the noise of sights from the poses.

    Args:
        world: the map.
        seen: detections and poses.
        limit: largest distance of alike descriptors.

    Returns:
        Landmark of each detection, (m,); standard deviation of ranges, as a share of these, and of bearings, rad.
    """
    points, tree = seen.points, KDTree(world.positions)
    owner, gap = np.full(len(points), -1), np.full(len(points), limit)
    for d, near in enumerate(tree.query_ball_point(points, WIDEST)):
        if near:
            gaps = np.linalg.norm(world.descriptors[near] - seen.looks[d], axis=1)
            if gaps.min() < gap[d]:
                owner[d] = near[int(gaps.argmin())]
    found = np.flatnonzero(owner >= 0)
    if len(found) < 2:
        raise SurefootError("no_landmarks", "the recordings show no landmark of the map where the map has it")
    away = world.positions[owner[found]] - seen.poses[seen.frame[found], :2]
    longer = seen.ranges[found] / np.hypot(*away.T) - 1.0
    aside = wrapped(seen.bearings[found] + seen.poses[seen.frame[found], 2] - np.arctan2(away[:, 1], away[:, 0]))
    sds = max(0.01, 1.4826 * float(np.median(np.abs(longer)))), max(0.01, 1.4826 * float(np.median(np.abs(aside))))
    owner[found[(longer / sds[0]) ** 2 + (aside / sds[1]) ** 2 > SDS**2]] = -1
    return owner, sds


class _Seeing:
    """Share of the landmarks in each part of the picture that the frames of a recording show.

    Args:
        seen: detections and poses.
        places: positions of the landmarks of the map, (n, 2) m.
        owner: landmark of each detection, -1 = none, (m,).
    """

    def __init__(self, seen: SureSightings, places: Array, owner: Index) -> None:
        self.seen, low = seen, np.quantile(seen.ranges, 0.005)
        self.edges = np.linspace(low, np.quantile(seen.ranges, 0.995), BINS + 1)
        self.half = float(np.quantile(np.abs(seen.bearings), 0.995))
        self.tree = KDTree(seen.poses[:, :2])
        self.frame, self.landmark, self.part = self._pairs(places)
        shown = set(zip(seen.frame.tolist(), owner.tolist(), strict=True))
        pairs = zip(self.frame.tolist(), self.landmark.tolist(), strict=True)
        self.shown: Flags = np.array([pair in shown for pair in pairs], dtype=bool)
        self.share, self.much = np.zeros(BINS * BINS), np.ones(len(seen.poses))

    def _pairs(self, places: Array) -> tuple[Index, Index, Index]:
        """Return frame, place and part of the picture of each sight of a place that a frame may have, (p,) each."""
        near = self.tree.query_ball_point(places, float(self.edges[-1]))
        place = np.repeat(np.arange(len(places)), [len(each) for each in near])
        frame = np.concatenate([np.array(each, dtype=np.int64) for each in near]) if len(near) else place
        away = places[place] - self.seen.poses[frame, :2]
        aside = wrapped(np.arctan2(away[:, 1], away[:, 0]) - self.seen.poses[frame, 2])
        row = np.searchsorted(self.edges, np.hypot(*away.T)) - 1
        col = np.floor((aside / self.half + 1.0) * 0.5 * BINS).astype(np.int64)
        on = (row >= 0) & (row < BINS) & (col >= 0) & (col < BINS)
        return frame[on], place[on], row[on] * BINS + col[on]

    def count(self, there: Flags) -> None:
        """Count which share of the landmarks is seen in each part of the picture, and how much each frame shows.

        `there`: landmarks that count, (n,).
        """
        on = there[self.landmark]
        frame, part, shown = self.frame[on], self.part[on], self.shown[on].astype(float)
        total = np.bincount(part, minlength=BINS * BINS)
        self.share = np.bincount(part, shown, BINS * BINS) / np.maximum(total, 1.0)
        expected = np.bincount(frame, self.share[part], len(self.much))
        self.much = (1.0 + np.bincount(frame, shown, len(self.much))) / (1.0 + expected)

    def odds(self, places: Array, owner: Index, weights: Array) -> _Odds:
        """Return the evidence on landmarks at places, (n, 2) m, by the detections that show them.

        `owner`: place that each detection shows, -1 = none, (m,); `weights`: share of the landmarks that are recognised
        by each of `SHARES`, (q,).
        """
        frame, place, part = self._pairs(places)
        one = np.clip(self.much[frame] * self.share[part], 0.0, 0.95)
        look, number = np.unique(self.seen.look[frame] + place * (1 + int(self.seen.look.max())), return_inverse=True)
        at = (look // (1 + int(self.seen.look.max()))).astype(np.int64)
        missed = np.stack([np.bincount(number, np.log1p(-q * one), len(look)) for q in SHARES])
        chance = 1.0 - np.exp(missed)  # (q, looks)
        key = owner[owner >= 0] * (1 + int(self.seen.look.max())) + self.seen.look[self.seen.frame[owner >= 0]]
        shown = np.isin(look, key)
        each = np.where(shown, np.log(np.clip(chance, 5.0 * CHANCE, 1.0)), np.log1p(-np.minimum(chance, 0.9)))
        there = np.stack([np.bincount(at, row, len(places)) for row in each]).astype(np.float64)
        absent = np.where(shown, np.log(CHANCE), np.log1p(-CHANCE))
        absent = np.bincount(at, absent, len(places)).astype(np.float64)
        able = chance[0] >= 0.1
        return _Odds(absent, there, np.bincount(at[able], minlength=len(places)), weights)


def _groups(seen: SureSightings, others: Flags, limit: float) -> tuple[Index, Array, Array]:
    """Return groups of detections of the same look at the same place that are sights of no landmark.

    Args:
        seen: detections and poses.
        others: detections that are to be grouped, (m,).
        limit: largest distance of alike descriptors.

    Returns:
        Group of each detection, -1 = none, (m,); mean place of each group, (g, 2) m; its mean descriptor, (g, k).
    """
    points, group = seen.points, np.full(len(seen.frame), -1)
    places, looks, count = np.empty((0, 2)), np.empty((0, seen.looks.shape[1])), np.zeros(0)
    for d in np.flatnonzero(others).tolist():
        best = _alike(points[d], seen.looks[d], places, looks, limit)
        if best < 0:
            places, looks = np.vstack((places, points[d])), np.vstack((looks, seen.looks[d]))
            count, best = np.append(count, 0.0), len(places) - 1
        count[best] += 1.0
        places[best] += (points[d] - places[best]) / count[best]
        looks[best] += (seen.looks[d] - looks[best]) / count[best]
        group[d] = best
    order, kept = np.argsort(-count, kind="stable"), list[int]()
    for g in order.tolist():  # groups that began with unlike detections of one landmark are one
        best = _alike(places[g], looks[g], places[kept], looks[kept], limit)
        if best < 0:
            kept.append(g)
        else:
            group[group == g] = kept[best]
    number = np.full(len(places) + 1, -1)
    number[kept] = np.arange(len(kept))
    return number[group], places[kept], looks[kept]


def _alike(place: Array, look: Array, places: Array, looks: Array, limit: float) -> int:
    """Return the index of the group that looks most like a detection near by, -1 = none does.

    Args:
        place: of the detection, (2,) m.
        look: its descriptor, (k,).
        places: of the groups, (g, 2) m.
        looks: their descriptors, (g, k).
        limit: largest distance of alike descriptors.
    """
    if not len(places):
        return -1
    gap = np.where(np.hypot(*(places - place).T) > WIDEST, np.inf, np.linalg.norm(looks - look, axis=1))
    best = int(gap.argmin())
    return best if gap[best] < limit else -1


def _listed(
    world: FloorLandmarks, seen: SureSightings, odds: tuple[_Odds, _Odds], groups: tuple[Index, Array, Array],
    noise: tuple[tuple[float, float], float], certain: float, source: str,
) -> MapUpdate:  # fmt: skip
    """Return the changes that are certain, and the map with them.

    Args:
        world: the map.
        seen: detections and poses.
        odds: evidence on landmarks of the map, and on groups.
        groups: group of each detection, places and descriptors of the groups.
        noise: that of sights from the poses, as of `_sights`, and largest distance of alike descriptors.
        certain: probability from which on a change is listed.
        source: origin of the detections.
    """
    (own, others), (group, places, looks), (sds, limit) = odds, groups, noise
    shown = [np.unique(seen.look[seen.frame[group == g]]).size for g in range(len(places))]
    found: dict[int, int] = {}
    """Group at which each landmark that has moved is seen."""
    changes = list[tuple[MapChange, Array]]()
    away = own.gone(ELSEWHERE)
    real = 1.0 - others.gone(1.0 - RARE)
    for g in np.argsort(-real, kind="stable").tolist():
        if real[g] < certain or shown[g] < LEAST:
            continue
        gaps = np.linalg.norm(world.descriptors - looks[g], axis=1)
        gaps[list(found)] = np.inf
        gaps[away < 0.5] = np.inf  # those are where they were, this one only looks the same
        one = int(gaps.argmin())
        moved = bool(gaps[one] < limit)
        if moved and (away[one] < certain or own.looks[one] < LEAST):
            continue  # it may have moved
        if moved:
            found[one] = g
        place, cov = _placed(seen, np.flatnonzero(group == g), sds)
        p = float(min(real[g], away[one]) if moved else real[g])
        n = int(own.looks[one] if moved else others.looks[g])
        change = MapChange("moved" if moved else "new", one if moved else None, place, cov, n, shown[g], p)
        changes.append((change, world.descriptors[one] if moved else looks[g]))
    gone = own.gone(RARE)
    for i in np.flatnonzero((gone >= certain) & (own.looks >= LEAST)).tolist():
        if i not in found:
            x, y = world.positions[i].tolist()
            change = MapChange("vanished", i, (x, y), None, int(own.looks[i]), 0, float(gone[i]))
            changes.append((change, world.descriptors[i]))
    changes.sort(key=lambda each: (KINDS.index(each[0].kind), -each[0].probability))
    sorted_ones = tuple(change for change, _ in changes)
    return MapUpdate(sorted_ones, _with(world, changes, source), int((own.looks >= LEAST).sum()))


def _placed(
    seen: SureSightings, mine: Index, sds: tuple[float, float]
) -> tuple[tuple[float, float], tuple[float, float, float, float]]:
    """Return the place that detections of one landmark show, and its covariance.

    Poses err alike in all frames at worst, so their mean covariance is added to that of the weighted mean of sights.

    Args:
        seen: detections and poses.
        mine: indices of the detections.
        sds: noise of sights from the poses, as of `_sights`.
    """
    frame, points = seen.frame[mine], seen.points[mine]
    r, a = seen.ranges[mine], seen.poses[frame, 2] + seen.bearings[mine]
    c, s, along, across = np.cos(a), np.sin(a), (r * sds[0]) ** 2, (r * sds[1]) ** 2
    weight = np.linalg.inv(
        np.stack((c * c * along + s * s * across, c * s * (along - across), c * s * (along - across),
                  s * s * along + c * c * across), axis=1).reshape(-1, 2, 2)
    )  # fmt: skip
    mean_cov = np.linalg.inv(weight.sum(axis=0))
    x, y = (mean_cov @ np.einsum("mij,mj->i", weight, points)).tolist()
    turn = np.stack((-np.sin(a) * r, np.cos(a) * r), axis=1)  # of the place by a turn of the pose
    effect = np.concatenate((np.broadcast_to(np.eye(2), (len(mine), 2, 2)), turn[:, :, None]), axis=2)
    pose = np.einsum("mij,mjk,mlk->il", effect, seen.covs[frame], effect) / len(mine)
    xx, xy, yx, yy = (mean_cov + pose).ravel().tolist()
    return (x, y), (xx, xy, yx, yy)


def _with(world: FloorLandmarks, changes: list[tuple[MapChange, Array]], source: str) -> FloorLandmarks:
    """Return a map with changes, each with the descriptor of its landmark, (k,); without any the map itself."""
    if not changes:
        return world
    gone = {change.landmark for change, _ in changes}
    kept = [i for i in range(len(world)) if i not in gone]
    there = [(change, look) for change, look in changes if change.covariance is not None]
    sd = [np.sqrt(0.5 * (c.covariance[0] + c.covariance[3])) for c, _ in there if c.covariance is not None]
    return replace(
        world,
        positions=np.vstack((world.positions[kept], *(np.array([change.place]) for change, _ in there))),
        descriptors=np.vstack((world.descriptors[kept], *(look[None] for _, look in there))),
        version=world.version + 1, source=source or world.source, sd=np.concatenate((world.sd[kept], sd)),
    )  # fmt: skip
