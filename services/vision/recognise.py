"""Recognition of map features in a picture: by descriptor, by place, and by a motion common to the matches.

1. Gate: with a believed pose only map features within sqrt(chi2 (v + r^2 sigma_theta^2)) + slack of a feature's place
   at distance r are candidates, v the largest variance of the position; without a belief all are.
2. Ratio test: the candidate of nearest descriptor is at most `ratio` as far as the second (one beside the first, which
   is the same feature found twice, does not count).
3. One rigid motion robot -> map explains the matches (RANSAC, Fischler & Bolles 1981, of pairs of matches).
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import Refusal

from .feature_map import FeatureMap
from .features import KINDS, distances

Index = NDArray[np.int64]


FEWEST_AGREE = 3
"""Least number of matches that must agree on a motion; two always do."""
PLACE, PITCHED = 0.005, 0.03
"""Standard deviations for the estimate of the floor's scale. `PLACE`: of a feature's position, m; `PITCHED`: of the
stretch across the heading, no unit, as by a camera pitch of 1 deg."""


@dataclass(frozen=True)
class RecogniseParams:
    """Limits within which the floor of an image is recognised on the map."""

    chi2: float = 9.21
    """Squared normalised distance, chi^2_2(.99), within which a map feature is a candidate."""
    slack: float = 0.04
    """Radius of the gate around a feature's place if the pose is exact, m: noise of places and tilt."""
    ratio: float = 0.85
    """Descriptor distance to the nearest candidate over that to the second above which a match is rejected."""
    beside: float = 0.02
    """Distance below which two map features count as one in the ratio test, m."""
    alone: float = 0.8
    """Largest descriptor distance of a match without a second candidate, as a part of the usual limit, 0 to 1."""
    apart: float = 0.1
    """Least distance between the two features of a pair from which a motion is computed, m."""
    turn: float = 0.15
    """Largest deviation of a motion's heading from that of an exact pose, rad: features close together determine it
    poorly."""
    inlier: float = 0.025
    """Largest residual of a match that agrees with the common motion, m."""
    pairs: int = 300
    """Number of pairs of matches from which a motion is computed and tested."""
    fewest_anywhere: int = 8
    """Least number of matches that agree on a motion found without a belief."""
    share_compared: float = 0.08
    """Least share of the compared features that agree on a motion found without a believed pose.

    The middle of an image upside down brings 0.044."""
    share_here: float = 0.02
    """Least share of the compared features that agree on a motion at the believed place; chance brings 0.008."""
    share_alone: float = 0.05
    """Share of matched among compared features from which on all matches count although too few agree; chance brings
    0.04."""
    share_anywhere: float = 0.3
    """Least share of the matches that agree on a motion found without a belief."""
    most: int = 20
    """Largest number of landmarks reported for one image; those with the most similar descriptors are kept."""


class Believed(NamedTuple):
    """Believed pose of the robot at the time of an image."""

    pose: Array
    """x, y (m) and heading (rad) of base_link, frame map, (3,)."""
    covariance: Array
    """Covariance of the believed pose x, y, yaw, (3, 3) in m and rad."""


class Recognised(NamedTuple):
    """Map features found in one picture."""

    features: Index
    """Indices of the recognised features of the picture, most similar to the map's first, (k,)."""
    landmarks: Index
    """Index in the map of the landmark that each recognised feature shows, (k,)."""
    anywhere: bool
    """True if the whole map was searched, False if a believed pose restricted the search."""
    agreed: int
    """Number of map features found; `features` holds those with the most similar descriptors."""
    compared: int
    """Number of features of the picture that had a candidate in the map."""
    scale: float
    """Scale of the picture by the motion that explains the matches best, 1 = correct; also 1 for fewer than three
    matches."""


def recognise(
    places: Array, descriptors: NDArray[Any], world: FeatureMap, belief: Believed | None, params: RecogniseParams
) -> Recognised:
    """Return the map features that are recognised in a picture.

    Args:
        places: places of the picture's n features, forward and left of base_link, (n, 2) m.
        descriptors: descriptors of these features, (n, 32) uint8 of ORB, (n, 128) float32 of SIFT.
        world: map of features.
        belief: None = lost: all of the map is compared, and only a motion that many agree on counts.
        params: limits.

    Raises:
        Refusal: descriptors of another kind than the map's, or too many features.
    """
    if descriptors.dtype != world.descriptors.dtype or descriptors.shape[1] != world.descriptors.shape[1]:
        text = f"the map has {world.kind} features, the picture others of {descriptors.shape[1]} numbers"
        raise Refusal("bad_descriptor", text, "features")
    gate, near = _gate(places, world, belief, params)
    found, mark, far = _likest(distances(world.kind, descriptors, world.descriptors[near]), gate, near, world, params)
    compared = int(gate.any(axis=1).sum())
    if len(found) == 0:
        return Recognised(found, mark, belief is None, 0, compared, 1.0)
    here, there = places[found], world.positions[mark]
    bend = None if belief is None else (float(belief.pose[2]), params.turn + 3.0 * math.sqrt(belief.covariance[2, 2]))
    agree, scale = consensus(here, there, params, bend)
    if belief is None:
        few = max(params.fewest_anywhere, params.share_anywhere * len(found), params.share_compared * compared)
        agree &= agree.sum() >= few
    elif agree.sum() < max(FEWEST_AGREE, params.share_here * compared):
        # too few to agree: gate and look decide, if there are more than chance puts into the gates of so many features
        agree = np.full(len(found), len(found) >= params.share_alone * compared)
    order = np.flatnonzero(agree)[np.argsort(far[agree], kind="stable")][: params.most]
    return Recognised(found[order], mark[order], belief is None, int(agree.sum()), compared, scale)


def seen_from(positions: Array, pose: Array) -> Array:
    """Return map positions, (n, 2) m, forward and left of a pose x, y (m), heading (rad), (3,), as (n, 2) m."""
    away, c, s = positions - pose[:2], math.cos(pose[2]), math.sin(pose[2])
    return np.stack((c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]), axis=1)


def gate_radius(places: Array, p: Array, params: RecogniseParams) -> Array:
    """Return the distance from each place within which map features are candidates for it, (n,) m.

    Args:
        places: places of features, forward and left of base_link, (n, 2) m.
        p: covariance of the believed pose x, y (m), heading (rad), (3, 3).
        params: width of the gate.
    """
    half, bend = 0.5 * (p[0, 0] + p[1, 1]), math.hypot(0.5 * (p[0, 0] - p[1, 1]), p[0, 1])
    away = np.hypot(places[:, 0], places[:, 1])
    return params.slack + math.sqrt(params.chi2) * np.sqrt(half + bend + away**2 * p[2, 2])


def _gate(
    places: Array, world: FeatureMap, belief: Believed | None, params: RecogniseParams
) -> tuple[NDArray[np.bool_], Index]:
    """Return the map features that each feature of the picture may show by its position.

    Args:
        places: places of the picture's n features, forward and left of base_link, (n, 2) m.
        world: map of features.
        belief: believed pose; None = none: every map feature is a candidate.
        params: width of the gate.

    Returns:
        True for pairs that may match, (n, m), and indices of the m map features near the picture, (m,).
    """
    if belief is None:
        return np.ones((len(places), len(world)), dtype=np.bool_), np.arange(len(world))
    x, y, heading = belief.pose
    c, s = math.cos(heading), math.sin(heading)
    at = np.stack((x + c * places[:, 0] - s * places[:, 1], y + s * places[:, 0] + c * places[:, 1]), axis=1)
    reach = gate_radius(places, belief.covariance, params)
    if len(at) == 0:
        return np.zeros((0, 0), dtype=np.bool_), np.zeros(0, dtype=np.int64)
    low, high = (at - reach[:, None]).min(axis=0), (at + reach[:, None]).max(axis=0)
    near = np.flatnonzero(((world.positions >= low) & (world.positions <= high)).all(axis=1))
    gap = world.positions[near][None] - at[:, None]
    return np.hypot(gap[..., 0], gap[..., 1]) <= reach[:, None], near


def _likest(
    apart: Array, gate: NDArray[np.bool_], near: Index, world: FeatureMap, params: RecogniseParams
) -> tuple[Index, Index, Array]:
    """Return the k matches that pass the ratio test, each map feature once, the most similar first.

    Args:
        apart: distance of the descriptors of each feature and each map feature near the picture, (n, m).
        gate: True for pairs that may match by their place, (n, m).
        near: indices in the map of the m features, (m,).
        world: map of features.
        params: limits of a match.

    Returns:
        Indices of features of the picture, of the map, and distances of their descriptors, (k,) each.
    """
    none = np.zeros(0, dtype=np.int64)
    if apart.size == 0:
        return none, none, np.zeros(0)
    look = np.where(gate, apart, np.inf)
    rows = np.arange(len(look))
    first = look.argmin(axis=1)
    best = look[rows, first]
    gap = world.positions[near][None] - world.positions[near[first]][:, None]
    look[np.hypot(gap[..., 0], gap[..., 1]) <= params.beside] = np.inf
    second = look.min(axis=1)
    like = KINDS[world.kind].like
    with np.errstate(invalid="ignore"):
        good = (best <= like) & (best <= params.ratio * second)
    good &= np.isfinite(second) | (best <= params.alone * like)
    kept = np.flatnonzero(good)
    kept = kept[np.argsort(best[kept], kind="stable")]
    mark, at = near[first[kept]], best[kept]
    _, once = np.unique(mark, return_index=True)
    once.sort()
    return kept[once], mark[once], at[once]


def consensus(
    here: Array, there: Array, params: RecogniseParams, bend: tuple[float, float] | None = None
) -> tuple[NDArray[np.bool_], float]:
    """Return the matches that one rigid motion explains, (n,), and the scale, map over picture, that fits them.

    Args:
        here: places of the matched features in the picture, forward and left of base_link, (n, 2) m.
        there: their places in the map, (n, 2) m.
        params: limits.
        bend: heading that the motion has, and its largest deviation, rad; None = any.
    """
    n = len(here)
    i, j = np.triu_indices(n, 1)
    way = here[j] - here[i]
    long = np.hypot(way[:, 0], way[:, 1])
    turned = there[j] - there[i]
    fits = (long >= params.apart) & (np.abs(np.hypot(turned[:, 0], turned[:, 1]) - long) <= 2.0 * params.inlier)
    pairs = np.flatnonzero(fits)
    if len(pairs) > params.pairs:
        pairs = pairs[np.linspace(0, len(pairs) - 1, params.pairs).astype(np.int64)]
    if len(pairs) == 0:
        return np.zeros(n, dtype=np.bool_), 1.0
    a, b = way[pairs], turned[pairs]
    size = np.hypot(a[:, 0], a[:, 1]) * np.hypot(b[:, 0], b[:, 1])
    c, s = (a * b).sum(axis=1) / size, (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / size
    if bend is not None and bend[1] < math.pi:
        right = c * math.cos(bend[0]) + s * math.sin(bend[0]) >= math.cos(bend[1])
        pairs, c, s = pairs[right], c[right], s[right]
        if len(pairs) == 0:
            return np.zeros(n, dtype=np.bool_), 1.0
    middle, goal = 0.5 * (here[i[pairs]] + here[j[pairs]]), 0.5 * (there[i[pairs]] + there[j[pairs]])
    agree = np.hypot(*_moved(here, c, s, middle, goal, there)) <= params.inlier  # (pairs, n)
    best = agree[int(agree.sum(axis=1).argmax())]
    c0, s0, scale = _fit(here[best], there[best])
    ends = here[best].mean(axis=0)[None], there[best].mean(axis=0)[None]
    left = np.hypot(*_moved(here, np.array([c0]), np.array([s0]), *ends, there))[0]
    agree = left <= params.inlier
    return (agree if agree.sum() >= best.sum() else best), scale


def _moved(here: Array, c: Array, s: Array, middle: Array, goal: Array, there: Array) -> tuple[Array, Array]:
    """Return the residuals x and y, (k, n) m, of n points under k motions, each a turn that maps `middle` to `goal`.

    Args:
        here: points before the motion, (n, 2) m.
        c: cosines of the turns, (k,).
        s: sines of the turns, (k,).
        middle: points about which each motion turns, (k, 2) m.
        goal: where these points go, (k, 2) m.
        there: where the points should go, (n, 2) m.
    """
    x, y = here[None, :, 0] - middle[:, None, 0], here[None, :, 1] - middle[:, None, 1]
    dx = c[:, None] * x - s[:, None] * y + goal[:, None, 0] - there[None, :, 0]
    return dx, s[:, None] * x + c[:, None] * y + goal[:, None, 1] - there[None, :, 1]


def _fit(here: Array, there: Array) -> tuple[float, float, float]:
    """Return cosine and sine of the least-squares turn from `here` onto `there`, (n, 2) m, and the scale (1 for n < 3).

    A camera at height h, pitched by p rad too far, stretches the floor about the distance x ahead by 2 x p / h along
    the heading and by x p / h across it. Such a stretch is found beside the scale, so that a robot whose tilt is
    believed wrong is not taken for one whose focal length is.
    """
    a, b = here - here.mean(axis=0), there - there.mean(axis=0)
    c, s = float((a * b).sum()), float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())
    size, spread = math.hypot(c, s), (a * a).sum(axis=0)
    if len(here) < 3 or not spread.min() > 0.0:
        return c / size, s / size, 1.0
    back = np.stack((c * b[:, 0] + s * b[:, 1], c * b[:, 1] - s * b[:, 0]), axis=1) / size
    along, across = ((a * back).sum(axis=0) / spread - 1.0).tolist()
    x, y = spread.tolist()
    # least squares of stretches 1 + e + 2 k along x and 1 + e + k along y, weights x, y, and w for k = 0
    w = (PLACE / PITCHED) ** 2
    normal = (x + y, 2.0 * x + y, 4.0 * x + y + w)
    right = (x * along + y * across, 2.0 * x * along + y * across)
    scale = (normal[2] * right[0] - normal[1] * right[1]) / (normal[0] * normal[2] - normal[1] ** 2)
    return c / size, s / size, 1.0 + scale
