"""Map of features from images of a walk, or from a photograph of the floor.

A feature is tracked from image to image by place and descriptor. With exact poses its place is the mean of its
sightings; with those of the estimator or the navigator all poses and places are improved together (`.build`), so that a
floor that is seen again closes the loop.
"""

import math
from collections.abc import Iterable
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
from surefoot.services.vision.feature_map import FeatureMap
from surefoot.services.vision.features import KINDS, Extractor, Kind
from surefoot.services.vision.motion import MotionHistory
from surefoot.services.vision.opencv import opencv
from surefoot.services.vision.view import Patch

from .loops import closed
from .tracks import often_seen, track
from .turned import ALL, TILTS, FloorLook, camera_error, effects, set_right

PER_M2 = 150.0
"""Largest density of features in a map, 1/m^2."""
MOST_OF_IMAGE, MOST_OF_TILE = 250, 4000
"""`MOST_OF_IMAGE`: largest number of features of a camera image; `MOST_OF_TILE`: of one tile of a photograph."""
AHEAD, SMALLEST = np.array([[0.75, 0.0], [0.75, 0.3]]), 1e-3
"""`AHEAD`: test points on the floor, heading axes of base_link, (2, 2) m; `SMALLEST`: displacement of any of them by
the estimated error of the camera, m, above which that error is corrected."""
TILE, OVERLAP = 1000, 60
"""`TILE`: edge of the square tiles of a photograph that are searched for features, px; `OVERLAP`: width that two
neighbouring tiles share, px."""


def map_of(
    looks: list[FloorLook], eye: Eye, camera: str, source: str, exact: bool, least: int = 3, per_m2: float = PER_M2
) -> FeatureMap:
    """Return the feature map of images, without the camera and floor errors that they all share, see `turned`.

    Args:
        looks: features and poses of the images, in order.
        eye: feature extractor and floor patch that found them.
        camera: the camera in words, kept in the map.
        source: origin of the images in words, kept in the map.
        exact: True: the poses are exact; False: they are improved together with the places.
        least: number of images that a feature was seen in, at least.
        per_m2: largest density of features, 1/m^2.

    Raises:
        SurefootError: no feature was seen often enough, or a camera is not above the floor.
    """
    kind = eye.extractor.kind
    drift = 0.0
    if not exact:
        looks, drift = closed(looks, kind, least)
    found, mine = track(looks, kind, 0.0)
    kept = often_seen(found, least)
    error = camera_error(looks, mine, ALL if exact else TILTS)
    if np.hypot(*(effects(looks[0]._replace(places=AHEAD)) @ error).T).max() > SMALLEST:
        looks = set_right(looks, error)
        found, _ = track(looks, kind, 0.0)
        kept = often_seen(found, least)
    sd = np.sqrt(0.5 * found.scatter / found.count) / np.sqrt(found.count)
    whole = FeatureMap(
        kind, found.positions, found.looks, found.count, np.maximum(sd, 1e-3), eye.patch.pixel, camera, 1, source,
        opencv().__version__, drift,
    )  # fmt: skip
    return whole.chosen(kept).pruned(least, per_m2)


def read_looks(path: Path, eye: Eye, source: str | None) -> tuple[list[FloorLook], str, str]:
    """Return features and poses of the images of a recording, the key of the poses, and the camera in words.

    Args:
        path: MCAP file with `hw/image`, `hw/joints` and `state/odometry`.
        eye: finds the features.
        source: key of the poses; None = state/pose where it is recorded, else state/odometry.

    Raises:
        SurefootError: the file cannot be read, lacks one of these topics or names no robot.
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
    """Return features and poses of the images among the messages of one run, in order.

    Images that `eye` rejects, or without odometry and joints close in time, are left out.

    Args:
        messages: key and message of each, in any order.
        eye: finds the features.
        source: key of the poses, which are interpolated at the stamp of an image.
        robot: its feet give the height of the camera over the floor.

    Raises:
        Refusal: a message holds no valid image, or its camera does not look at the floor.
    """
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
    """Return size and focal length, px, that the first image states of its camera, in words.

    `messages`: key and message of each; one of them is an image.
    """
    image = next(message for key, message in messages if key == HW_IMAGE.key)
    return f"{image.width} x {image.height} px, focal length {image.focal:.1f} px"


def map_of_photograph(
    path: Path, width: float, extractor: Extractor, patch: Patch, per_m2: float = PER_M2
) -> FeatureMap:
    """Return the map of a photograph of the floor from straight above; its lower left corner is the origin.

    Args:
        path: picture file.
        width: width of the floor that it shows, m.
        extractor: finds the features.
        patch: its pixel, m, is the scale at which features are detected.
        per_m2: largest density of features, 1/m^2.

    Raises:
        SurefootError: the picture cannot be read, or shows no features.
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
    """Return True if a file is a recording with images, else False."""
    try:
        return next(iter(read_recording(path, (HW_IMAGE.key,))), None) is not None
    except SurefootError:
        return False


def map_of_source(source: Path, features: str, poses: str | None, width: float | None, least: int) -> FeatureMap:
    """Return the map of a recording with images, or of a picture of the floor.

    Args:
        source: recording, or picture file.
        features: kind of the features, `orb` or `sift`.
        poses: key of the poses; None = state/pose where it is recorded, else state/odometry.
        width: width of the floor that the picture shows, m; None = the source is a recording.
        least: number of images that a feature was seen in, at least.

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
