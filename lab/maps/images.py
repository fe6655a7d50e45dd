"""Map of features from images of a walk, or from a photograph of the floor.

A feature is tracked from image to image by place and look. With exact poses its place is the mean of its sightings;
with those of the estimator or the navigator all poses and places are improved together (`.build`), so that a floor that
is seen again closes the loop.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import SurefootError
from surefoot.geometry.linear import product
from surefoot.record.recording import open_readable, read_recording
from surefoot.record.robots import robot_of
from surefoot.robot.description import Robot
from surefoot.schemas.topics import HW_IMAGE, HW_JOINTS, SIM_TRUTH, STATE_ODOMETRY, STATE_POSE
from surefoot.services.vision.eye import Eye
from surefoot.services.vision.feature_map import CODE, FeatureMap
from surefoot.services.vision.features import KINDS, Extractor, Kind, distances
from surefoot.services.vision.motion import MotionHistory
from surefoot.services.vision.opencv import opencv
from surefoot.services.vision.view import Patch

from .build import BuildOptions, build_map
from .sightings import Sightings
from .turned import ALL, TILTS, FloorLook, camera_error, effects, set_right

SAME = 0.03
"""Distance within which two sightings of a feature lie, beside what odometry drifts in between, m."""
LOOK = 0.85
"""Part of the largest distance of two looks within which a sighting belongs to a feature."""
PER_M2 = 150.0
"""Largest density of a map, features per m^2."""
MOST_OF_IMAGE, MOST_OF_TILE = 250, 4000
"""Features of an image and of a part of a photograph, at most."""
AHEAD, SMALLEST = np.array([[0.75, 0.0], [0.75, 0.3]]), 1e-3
"""Points of the floor and least way by which an error of the camera moves them that is taken off, m."""
PASSAGE = 0.3
"""m walked without a sight of a feature, after which the next one is of another passage."""
TILE, OVERLAP = 1000, 60
"""px, parts of a photograph."""


@dataclass
class Tracks:
    """Features of the floor, each tracked over the images that show it.

    Of n features `positions` are mean places, (n, 2) m, frame map, and `count` is the number of images that show each,
    (n,).
    """

    kind: Kind
    positions: Array
    totals: Array
    """Sums of the descriptors, bits of ORB each as a number, (n, k)."""
    count: NDArray[np.int64]
    last: NDArray[np.int64]
    """Image that each was seen in last."""
    scatter: Array
    """Sum of the squares of the distances from the mean, m^2."""

    def descriptors(self) -> NDArray[Any]:
        """Return the mean descriptor of each feature, (n, code): uint8 by majority of bits for ORB, else float32."""
        mean = self.totals / self.count[:, None]
        return np.packbits(mean > 0.5, axis=1) if self.kind == "orb" else mean.astype(np.float32)


def numbers(kind: Kind, descriptors: NDArray[Any]) -> Array:
    """Return descriptors as numbers (n, b) whose mean has a meaning, no unit: single bits (orb), else as they are.

    `descriptors`: (n, d), bytes of ORB or numbers of SIFT; b = 8 d for ORB, else d.
    """
    return (np.unpackbits(descriptors, axis=1) if kind == "orb" else descriptors).astype(np.float64)


def track(looks: list[FloorLook], kind: Kind, options: BuildOptions | None) -> tuple[Tracks, NDArray[np.int64]]:
    """Return the features of images, and the index of the feature of each sighting in order, (n,).

    Args:
        looks: features and poses of the images, in order.
        kind: of the features.
        options: noise of the odometry; None = poses are exact.
    """
    width = KINDS[kind].length * (8 if kind == "orb" else 1)
    none = np.zeros(0, dtype=np.int64)
    found = Tracks(kind, np.zeros((0, 2)), np.zeros((0, width)), none, none, np.zeros(0))
    ways = np.cumsum([0.0, *(math.dist(a.pose[:2], b.pose[:2]) for a, b in pairwise(looks))])
    numbered: list[NDArray[np.int64]] = []
    for frame, look in enumerate(looks):
        x, y, heading = look.pose
        c, s = math.cos(heading), math.sin(heading)
        at = np.stack((x + c * look.places[:, 0] - s * look.places[:, 1],
                       y + s * look.places[:, 0] + c * look.places[:, 1]), axis=1)  # fmt: skip
        since = ways[frame] - ways[found.last]
        slack = SAME + (0.0 if options is None else 3.0 * options.walk_share) * since
        mine = _assigned(at, look.descriptors, found, slack)
        new = np.flatnonzero(mine < 0)
        mine[new] = len(found.count) + np.arange(len(new))
        _grow(found, len(new))
        known = found.count[mine].clip(1, None if options is None else 10)[:, None]
        gap = at - found.positions[mine]
        first = found.count[mine] == 0
        found.positions[mine] += np.where(first[:, None], gap, gap / (known + 1))
        found.scatter[mine] += np.where(first, 0.0, (gap**2).sum(axis=1))
        found.totals[mine] += numbers(kind, look.descriptors)
        found.count[mine] += 1
        found.last[mine] = frame
        numbered.append(mine)
    return found, np.concatenate(numbered) if numbered else none


def _grow(found: Tracks, more: int) -> None:
    found.positions = np.vstack((found.positions, np.zeros((more, 2))))
    found.totals = np.vstack((found.totals, np.zeros((more, found.totals.shape[1]))))
    found.count = np.concatenate((found.count, np.zeros(more, dtype=np.int64)))
    found.last = np.concatenate((found.last, np.zeros(more, dtype=np.int64)))
    found.scatter = np.concatenate((found.scatter, np.zeros(more)))


def _assigned(at: Array, descriptors: NDArray[Any], found: Tracks, slack: Array) -> NDArray[np.int64]:
    """Return the track of each sighting, -1 = a new one; each track at most once.

    Args:
        at: places of the sightings in the map, (n, 2) m.
        descriptors: of the sightings, (n, d).
        found: tracks so far.
        slack: largest distance of a sighting from each track, (tracks,) m.
    """
    mine = np.full(len(at), -1, dtype=np.int64)
    if not len(found.count) or not len(at):
        return mine
    reach = float(slack.max())
    low, high = at.min(axis=0) - reach, at.max(axis=0) + reach
    near = np.flatnonzero(((found.positions >= low) & (found.positions <= high)).all(axis=1))
    part = Tracks(found.kind, found.positions[near], found.totals[near], found.count[near], near, np.zeros(len(near)))
    gap = at[:, None] - part.positions[None]
    look = distances(found.kind, descriptors, part.descriptors())
    look[np.hypot(gap[..., 0], gap[..., 1]) > slack[near][None]] = np.inf
    limit = LOOK * KINDS[found.kind].like
    pairs = np.argwhere(look <= limit)
    taken: set[int] = set()
    for i, j in pairs[np.argsort(look[pairs[:, 0], pairs[:, 1]], kind="stable")].tolist():
        if mine[i] < 0 and j not in taken:
            mine[i] = near[j]
            taken.add(j)
    return mine


def map_of(
    looks: list[FloorLook], eye: Eye, camera: str, source: str, exact: bool, least: int = 3, per_m2: float = PER_M2
) -> FeatureMap:
    """Return the map of images; what all images of the walk have wrong in common is taken off first, see `turned`.

    Args:
        looks: features and poses of the images, in order.
        eye: its extractor and patch found them.
        camera: in words.
        source: in words.
        exact: the poses are; else they are improved with the places.
        least: images that a feature was seen in.
        per_m2: largest density.

    Raises:
        SurefootError: no feature was seen often enough, or a camera is not above the floor.
    """
    kind = eye.extractor.kind
    options = (
        None
        if exact
        else BuildOptions(range_share=0.01, range_sd=0.012, bearing_sd=math.radians(1.2), look_sd=1e-3, least=least)
    )
    found, mine = track(looks, kind, options)
    kept = _often_seen(found, least)
    error = camera_error(looks, mine if exact else passages(looks, mine), ALL if exact else TILTS)
    if np.hypot(*(effects(looks[0]._replace(places=AHEAD)) @ error).T).max() > SMALLEST:
        looks = set_right(looks, error)
        found, mine = track(looks, kind, options)
        kept = _often_seen(found, least)
    positions, sd = found.positions.copy(), np.sqrt(0.5 * found.scatter / found.count) / np.sqrt(found.count)
    if options is not None:
        kept, positions[kept], sd[kept] = _improved(looks, found, mine, kept, options, source)
    whole = FeatureMap(
        kind, positions, found.descriptors(), found.count, np.maximum(sd, 1e-3), eye.patch.pixel, camera, 1, source,
        opencv().__version__,
    )  # fmt: skip
    return whole.chosen(kept).pruned(least, per_m2)


def _often_seen(found: Tracks, least: int) -> NDArray[np.int64]:
    """Return the indices of the features of `least` sightings or more (raises SurefootError: there are no two)."""
    kept = np.flatnonzero(found.count >= least)
    if len(kept) < 2:
        most = int(found.count.max(initial=0))
        raise SurefootError(
            "no_landmarks", f"no two features were seen {least} times, the most often seen {most} times"
        )
    return kept


def passages(looks: list[FloorLook], tracks: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return a number for each sighting, (n,): equal for those of one feature in one passage of the robot.

    In a passage the way between two sightings is so short that the poses hold together. `tracks`: index of the feature
    of each sighting, (n,).
    """
    ways = np.cumsum([0.0, *(math.dist(a.pose[:2], b.pose[:2]) for a, b in pairwise(looks))])
    way = np.repeat(ways, [len(look.places) for look in looks])
    order = np.lexsort((np.arange(len(tracks)), tracks))
    begins = (np.diff(tracks[order]) > 0) | (np.diff(way[order]) > PASSAGE)
    found = np.empty(len(tracks), dtype=np.int64)
    found[order] = np.cumsum(np.concatenate(([False], begins)))
    return found


def _improved(
    looks: list[FloorLook], found: Tracks, mine: NDArray[np.int64], kept: NDArray[np.int64], options: BuildOptions,
    source: str,
) -> tuple[NDArray[np.int64], Array, Array]:  # fmt: skip
    """Return the features that a common fit of poses and places keeps, (k,), their places (k, 2) m and deviations, m.

    `mine`: feature of each sighting; `kept`: features that may stay.
    """
    codes = np.random.default_rng(0).standard_normal((len(found.count), CODE))
    used = np.isin(mine, kept)
    places = np.concatenate([look.places for look in looks])[used]
    frame = np.repeat(np.arange(len(looks)), [len(look.places) for look in looks])[used]
    poses = np.array([look.pose for look in looks])
    poses[:, 2] = np.unwrap(poses[:, 2])
    seen = Sightings(
        poses, frame, np.hypot(places[:, 0], places[:, 1]), np.arctan2(places[:, 1], places[:, 0]), codes[mine[used]],
        source,
    )  # fmt: skip
    made = build_map(seen, options, source)
    gap = ((made.world.descriptors[:, None] - codes[kept][None]) ** 2).sum(axis=2)
    return kept[gap.argmin(axis=1)], made.world.positions, made.sd


def read_looks(path: Path, eye: Eye, source: str | None) -> tuple[list[FloorLook], str, str]:
    """Return features and poses of the images of a recording, the key of the poses, and the camera in words.

    Args:
        path: MCAP file with `hw/image`, `hw/joints` and `state/odometry`.
        eye: finds the features.
        source: key of the poses; None = state/pose where it is recorded, else state/odometry.

    Raises:
        SurefootError: the file cannot be read, lacks one of them or names no robot.
    """
    keys = (HW_IMAGE.key, HW_JOINTS.key, STATE_ODOMETRY.key, STATE_POSE.key, SIM_TRUTH.key)
    items = [(item.key, item.message()) for item in read_recording(path, keys)]
    have = {key for key, _ in items}
    chosen = source or (STATE_POSE.key if STATE_POSE.key in have else STATE_ODOMETRY.key)
    for key in (HW_IMAGE.key, HW_JOINTS.key, STATE_ODOMETRY.key, chosen):
        if key not in have:
            raise SurefootError("invalid", f"{path} has no {key}; a map of images needs it", key)
    epoch = max(message.epoch for _, message in items)
    messages = [(key, message) for key, message in items if message.epoch == epoch]
    return looks_of(messages, eye, chosen, robot_of(open_readable(path))), chosen, camera_words(messages)


def looks_of(messages: Iterable[tuple[str, Any]], eye: Eye, source: str, robot: Robot) -> list[FloorLook]:
    """Return features and poses of images among messages, by key, of one run."""
    rank = {HW_IMAGE.key: 1}
    order = sorted(messages, key=lambda item: (item[1].tick, rank.get(item[0], 0)))
    motion, looks = MotionHistory(robot), list[FloorLook]()
    stamps, poses = list[int](), list[tuple[float, float, float]]()
    for key, message in order:
        if key == source and getattr(message, "initialised", True):
            stamps.append(message.stamp_ns)
            poses.append(_pose_of(key, message))
    heading = np.unwrap([pose[2] for pose in poses]) if poses else np.zeros(0)
    for key, message in order:
        if key == HW_JOINTS.key:
            motion.bent(message)
        elif key == STATE_ODOMETRY.key:
            motion.moved(message)
        elif key == HW_IMAGE.key and (here := motion.at(message.stamp_ns)) is not None and poses:
            found, flags = eye.features(message, here[1])
            if not flags:
                x, y = (float(np.interp(message.stamp_ns, stamps, [pose[i] for pose in poses])) for i in (0, 1))
                turn = float(np.interp(message.stamp_ns, stamps, heading))
                at = product(here[1].rot, np.array(message.position))
                camera = (float(at[0]), float(at[1]), here[1].height + float(at[2]))
                looks.append(FloorLook((x, y, turn), eye.patch.place(found.pixels), found.descriptors, camera))
    return looks


def _pose_of(key: str, message: Any) -> tuple[float, float, float]:
    if key == STATE_POSE.key:
        return message.pose
    if key == STATE_ODOMETRY.key:
        return (*message.position[:2], message.yaw)
    w, x, y, z = message.quat_wxyz
    return (*message.position[:2], math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def camera_words(messages: Iterable[tuple[str, Any]]) -> str:
    """Return what the first image states of its camera, in words."""
    image = next(message for key, message in messages if key == HW_IMAGE.key)
    return f"{image.width} x {image.height} px, focal length {image.focal:.1f} px"


def map_of_photograph(
    path: Path, width: float, extractor: Extractor, patch: Patch, per_m2: float = PER_M2
) -> FeatureMap:
    """Return the map of a photograph of the floor from straight above; its lower left corner is the origin.

    Args:
        path: picture file.
        width: of what it shows, m.
        patch: its pixel is the scale at which features are looked for.
        per_m2: largest density.

    Raises:
        SurefootError: the picture cannot be read, or shows nothing.
    """
    cv2 = opencv()
    data = path.read_bytes() if path.is_file() else b""
    grey = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_GRAYSCALE) if data else None
    if grey is None:
        raise SurefootError("invalid", f"{path} is no picture that can be read", "picture")
    size = round(width / patch.pixel), max(1, round(width / patch.pixel * grey.shape[0] / grey.shape[1]))
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA if size[0] < grey.shape[1] else cv2.INTER_LINEAR)
    pixels, looks = list[Array](), list[NDArray[Any]]()
    for row in range(0, small.shape[0], TILE - OVERLAP):
        for col in range(0, small.shape[1], TILE - OVERLAP):
            part = np.ascontiguousarray(small[row : row + TILE, col : col + TILE])
            found = extractor.find(part, np.full(part.shape, 255, np.uint8))
            pixels.append(found.pixels + np.array([col, row]))
            looks.append(found.descriptors)
    at = np.concatenate(pixels)
    if len(at) < 2:
        raise SurefootError("no_landmarks", f"{path} shows no features")
    places = patch.pixel * np.stack((at[:, 0] + 0.5, small.shape[0] - at[:, 1] - 0.5), axis=1)
    count = np.ones(len(at), dtype=np.int64)
    whole = FeatureMap(
        extractor.kind, places, np.concatenate(looks), count, np.full(len(at), patch.pixel), patch.pixel,
        "photograph", 1, f"{path.name}, {width:g} m wide", cv2.__version__,
    )  # fmt: skip
    return whole.pruned(1, per_m2)


def holds_images(path: Path) -> bool:
    """Return whether a recording has images; False for what is no recording."""
    try:
        return next(iter(read_recording(path, (HW_IMAGE.key,))), None) is not None
    except SurefootError:
        return False


def map_of_source(source: Path, features: str, poses: str | None, width: float | None, least: int) -> FeatureMap:
    """Return the map of a recording with images, or of a picture `width` m wide.

    Raises:
        SurefootError: names the option that is wrong, or what the source lacks.
    """
    if features not in KINDS:
        raise SurefootError("invalid", f"got {features!r}, allowed are {', '.join(KINDS)}", "features")
    kind: Kind = "orb" if features == "orb" else "sift"
    if width is not None:
        return map_of_photograph(source, width, Extractor(kind, MOST_OF_TILE), Patch())
    allowed = (STATE_POSE.key, STATE_ODOMETRY.key, SIM_TRUTH.key)
    if poses is not None and poses not in allowed:
        raise SurefootError("invalid", f"got {poses!r}, allowed are {', '.join(allowed)}", "poses")
    eye = Eye(Extractor(kind, MOST_OF_IMAGE), None)
    looks, chosen, camera = read_looks(source, eye, poses)
    return map_of(looks, eye, camera, f"{source.name}, {chosen}", exact=chosen == SIM_TRUTH.key, least=least)
