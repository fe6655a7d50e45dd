"""Poses of a walk that drift, and the camera's common errors, from the features that its images show again.

Features are tracked by the poses as they are; a floor that comes into view again closes the loop where many features
agree on one motion. Poses, places, the tilt of the camera, the lean of the floor and the part by which all paths are
too long are then found together (`.build`): the tilt moves features by T(d) = h I + d d^T / h (`.turned`), which grows
with the square of the distance d, and a wrong path length with d itself, so that one walk separates them.
"""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from surefoot.services.vision.feature_map import spread
from surefoot.services.vision.features import Kind

from .build import fitted
from .equations import BuildOptions
from .sightings import Sightings
from .tracks import often_seen, track
from .turned import LIKELY, TILTS, FloorLook, check_cameras, effects, set_right

DRIFT = BuildOptions(
    range_share=0.002, range_sd=0.003, bearing_sd=math.radians(0.35), still_m=0.0025, still_rad=0.003, look_sd=1e-3,
    scale_sd=0.03, bend_sds=LIKELY[:TILTS], sway_sds=(math.radians(0.2), math.radians(0.2)),
)  # fmt: skip
"""Options of a fit to images of a walking Nao: noise of floor features, of odometry between images, and of the tilt in
one image; distances in m, angles in rad."""
DRIFT_FACTOR = 2.0
"""Ratio of the real error of poses to the standard deviation by the fit, which assumes independent noise: two walks
by images alone, on parquet and carpet, have 1.9 and 1.6."""
USED_PER_M2 = 150.0
"""Density of the features that are used to improve poses, 1/m^2."""


def sightings_of(looks: list[FloorLook], tracks: NDArray[np.int64], used: NDArray[np.bool_]) -> Sightings:
    """Return some of the features of images as m detections by range and bearing.

    Args:
        looks: features and poses of the images of a walk, n sightings in all.
        tracks: index of the feature of each sighting, (n,).
        used: True for the m sightings to take, (n,) bool.
    """
    places = np.concatenate([look.places for look in looks])[used]
    moved = np.concatenate([effects(look, TILTS) for look in looks])[used][:, :, :TILTS]
    frame = np.repeat(np.arange(len(looks)), [len(look.places) for look in looks])[used]
    poses = np.array([look.pose for look in looks])
    poses[:, 2] = np.unwrap(poses[:, 2])
    far = np.maximum(np.hypot(places[:, 0], places[:, 1]), 1e-6)
    ray = places / far[:, None]
    across = np.stack((-ray[:, 1], ray[:, 0]), axis=1) / far[:, None]
    bends = np.stack((np.einsum("ni,nik->nk", ray, moved), np.einsum("ni,nik->nk", across, moved)), axis=1)
    return Sightings(
        poses, frame, far, np.arctan2(places[:, 1], places[:, 0]), tracks[used][:, None].astype(np.float64), "images",
        bends,
    )  # fmt: skip


def closed(looks: list[FloorLook], kind: Kind, least: int, rounds: int = 3) -> tuple[list[FloorLook], float]:
    """Return the features of images with corrected poses (closed loops) and without camera tilt, and the drift left.

    First the images alone improve the odometry; then a floor that is seen again is recognised within the remaining
    drift, so that a repetitive floor is not taken for its neighbour.

    Args:
        looks: features and poses of the images of a walk, in order.
        kind: kind of the descriptors.
        least: number of images that a feature was seen in, at least.
        rounds: number of times that features are tracked and poses improved.

    Returns:
        Features with poses, and the largest standard deviation of a pose, m, the first one being fixed.

    Raises:
        SurefootError: no feature was seen often enough, or a camera is not above the floor.
    """
    check_cameras(looks)
    now, share, start, drift = looks, DRIFT.walk_share, None, 0.0
    way = sum(math.dist(a.pose[:2], b.pose[:2]) for a, b in pairwise(looks))
    for number_of_round in range(rounds):
        found, tracks = track(now, kind, share, later=number_of_round > 0)
        kept = often_seen(found, least)
        kept = kept[spread(found.positions[kept], found.count[kept], USED_PER_M2)]
        number = np.full(len(found.count), -1)
        number[kept] = np.arange(len(kept))
        used = number[tracks] >= 0
        seen = sightings_of(looks, number[tracks], used)  # the odometry stays that of the walk
        made = fitted(seen, number[tracks[used]], 1e-3, replace(DRIFT, least=least), "images", start)
        start, error = made.poses, np.concatenate((made.common[:TILTS], np.zeros(len(LIKELY) - TILTS)))
        poses = [(float(x), float(y), float(turn)) for x, y, turn in made.poses]
        now = set_right([look._replace(pose=pose) for look, pose in zip(looks, poses, strict=True)], error)
        drift = DRIFT_FACTOR * made.drift
        share = drift / max(way, 1e-9)
    return now, drift
