"""Detections of landmarks in a recording, and the estimated poses of the robot at which they were made."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import SurefootError
from surefoot.record.recording import read_recording
from surefoot.schemas.topics import HW_LANDMARKS, STATE_ODOMETRY, STATE_POSE

SURE_KEYS = (HW_LANDMARKS.key, STATE_POSE.key)
"""Keys of a recording from which changes of a map are found."""


@dataclass(frozen=True, eq=False)
class Sightings:
    """Detections of landmarks in a run, with the poses of the robot at which they were made; n frames, m detections."""

    poses: Array
    """Pose of base_link, x, y in m and heading in rad (not wrapped), frame odom or map, (n, 3)."""
    frame: NDArray[np.int64]
    """Index of the pose in `poses` at which each detection was made, (m,)."""
    ranges: Array
    """Distance of each detection from base_link along the floor, m, (m,)."""
    bearings: Array
    """Direction of each detection against the heading of base_link, rad, left positive, (m,)."""
    looks: Array
    """Descriptor of each detection, k numbers, (m, k)."""
    source: str
    """Key of the topic that the poses come from."""
    bends: Array = field(default_factory=lambda: np.zeros((0, 2, 0)))
    """Effect of k errors that all detections share on range, m, and bearing, rad, per unit of each error, (m, 2, k)."""

    def straightened(self, errors: Array, sway: Array) -> "Sightings":
        """Return the detections corrected for errors that all share, and for those that each frame's detections share.

        Args:
            errors: errors that all share, (k,), one for each column of `bends`; (0,) = no correction.
            sway: errors that the detections of each frame share, (n, s), s <= k, for the first s columns of `bends`.
        """
        if not len(errors):
            return self
        off = self.bends @ errors
        if sway.shape[1]:
            off += np.einsum("mik,mk->mi", self.bends[:, :, : sway.shape[1]], sway[self.frame])
        return replace(self, ranges=self.ranges - off[:, 0], bearings=self.bearings - off[:, 1])


@dataclass(frozen=True, eq=False)
class SureSightings:
    """Detections of landmarks from poses in a map that were certain; n frames, m detections."""

    poses: Array
    """Pose of base_link at each frame, x, y in m and heading in rad, frame map, (n, 3)."""
    covs: Array
    """Covariance of each pose, m and rad, (n, 3, 3)."""
    look: NDArray[np.int64]
    """Number of the second in which each frame was made, from 0 on over all recordings, (n,)."""
    frame: NDArray[np.int64]
    """Index of the frame of each detection, (m,)."""
    ranges: Array
    """Distance of each detection from base_link along the floor, m, (m,)."""
    bearings: Array
    """Direction of each detection against the heading of base_link, rad, left positive, (m,)."""
    looks: Array
    """Descriptor of each detection, k numbers, (m, k)."""

    @property
    def points(self) -> Array:
        """Place of each detection by the pose of its frame, (m, 2) m, frame map."""
        x, y, heading = self.poses[self.frame].T
        angle = heading + self.bearings
        return np.stack((x + self.ranges * np.cos(angle), y + self.ranges * np.sin(angle)), axis=1)

    @property
    def plain(self) -> Sightings:
        """The detections without covariances."""
        return Sightings(self.poses, self.frame, self.ranges, self.bearings, self.looks, STATE_POSE.key)


def read_sure(paths: list[Path], place_sd: float, progress: Callable[[float], None] | None = None) -> SureSightings:
    """Return the detections of recordings from the poses of the navigator where these were certain.

    Poses between two messages of `state/pose` are interpolated. Of each recording the last epoch counts.

    Args:
        paths: MCAP files.
        place_sd: largest standard deviation of a pose along any direction, m, for its frame to count.
        progress: gets the share that is read.

    Raises:
        SurefootError: a file cannot be read, or none holds detections from certain poses, or descriptors differ in
            length.
    """
    poses, covs, seconds = list[Array](), list[Array](), list[int]()
    number, marks, first = list[int](), list[Any](), 0
    for done, path in enumerate(paths):
        part = None if progress is None else lambda share, done=done: progress((done + share) / len(paths))
        items: list[tuple[int, str, Any]] = [
            (item.stamp_ns, item.key, item.message()) for item in read_recording(path, SURE_KEYS, part)
        ]
        epoch = max((message.epoch for _, _, message in items), default=0)
        items = [item for item in items if item[2].epoch == epoch]
        believed = [(stamp, m) for stamp, key, m in items if key == STATE_POSE.key and m.initialised]
        if not believed:
            continue
        stamps = np.array([stamp for stamp, _ in believed])
        where = np.array([message.pose for _, message in believed])
        where[:, 2] = np.unwrap(where[:, 2])
        for stamp, key, message in items:
            at = int(np.searchsorted(stamps, stamp, side="right")) - 1
            if key != HW_LANDMARKS.key or at < 0 or believed[at][1].lost:
                continue
            cov = np.array(believed[at][1].covariance).reshape(3, 3)
            if float(np.linalg.eigvalsh(cov[:2, :2])[-1]) > place_sd**2:
                continue
            number += [len(poses)] * len(message.landmarks)
            marks += message.landmarks
            poses.append(np.array([np.interp(stamp, stamps, where[:, i]) for i in range(3)]))
            covs.append(cov)
            seconds.append(first + int((stamp - stamps[0]) // 1_000_000_000))
        first = 1 + max(seconds, default=-1)
    lengths = {len(mark.descriptor) for mark in marks}
    if len(lengths) != 1 or lengths == {0}:
        problem = f"descriptors of {sorted(lengths)} numbers" if marks else "no detections from certain poses"
        text = f"{', '.join(map(str, paths))}: {problem}; {STATE_POSE.key} and {HW_LANDMARKS.key} are needed"
        raise SurefootError("no_landmarks", text)
    return SureSightings(
        np.array(poses), np.array(covs), np.array(seconds, dtype=np.int64), np.array(number, dtype=np.int64),
        np.array([mark.range for mark in marks]), np.array([mark.bearing for mark in marks]),
        np.array([mark.descriptor for mark in marks]),
    )  # fmt: skip


def read_sightings(path: Path, progress: Callable[[float], None] | None = None) -> Sightings:
    """Return the detections of a recording, with poses from `state/pose` where recorded, else from `state/odometry`.

    A frame belongs to the last pose at or before its stamp. Only the last epoch (after the last reset) counts. Frames
    without detections and frames before the pose is initialised are left out. Truth is not read.

    Args:
        path: MCAP file.
        progress: gets the share that is read.

    Raises:
        SurefootError: the file cannot be read, or holds no detections, no poses, or descriptors of several lengths.
    """
    frames: list[tuple[int, Any]] = []
    poses: dict[str, list[tuple[int, tuple[float, float, float]]]] = {STATE_POSE.key: [], STATE_ODOMETRY.key: []}
    epoch = -1
    for item in read_recording(path, (HW_LANDMARKS.key, STATE_ODOMETRY.key, STATE_POSE.key), progress):
        message: Any = item.message()
        if message.epoch < epoch:
            continue
        if message.epoch > epoch:
            epoch = message.epoch
            frames.clear()
            for each in poses.values():
                each.clear()
        if item.key == HW_LANDMARKS.key:
            frames.append((item.stamp_ns, message))
        elif message.initialised:
            x, y, yaw = message.pose if item.key == STATE_POSE.key else (*message.position[:2], message.yaw)
            poses[item.key].append((item.stamp_ns, (x, y, yaw)))
    source = STATE_POSE.key if poses[STATE_POSE.key] else STATE_ODOMETRY.key
    if not frames:
        raise SurefootError("no_landmarks", f"{path} holds no {HW_LANDMARKS.key}: nothing to make a map of")
    if not poses[source]:
        raise SurefootError("no_poses", f"{path} holds no {STATE_ODOMETRY.key} or {STATE_POSE.key} that is initialised")
    return _joined(frames, poses[source], source, path)


def _joined(
    frames: list[tuple[int, Any]], poses: list[tuple[int, tuple[float, float, float]]], source: str, path: Path
) -> Sightings:
    """Return the sightings of frames, each with the last pose at or before its stamp.

    Args:
        frames: stamp (ns) and message of each.
        poses: stamp (ns) and x, y (m), heading (rad) of each, by time.
        source: key of the poses.
        path: of the recording, for the message of an error.

    Raises:
        SurefootError: no detection with a pose and a descriptor, or descriptors of several lengths.
    """
    stamps = np.array([stamp for stamp, _ in poses])
    taken, number, ranges, bearings = list[tuple[float, float, float]](), list[int](), list[float](), list[float]()
    looks: list[tuple[float, ...]] = []
    for stamp, message in frames:
        at = int(np.searchsorted(stamps, stamp, side="right")) - 1
        if at < 0 or not message.landmarks:
            continue
        for each in message.landmarks:
            number.append(len(taken))
            ranges.append(each.range)
            bearings.append(each.bearing)
            looks.append(each.descriptor)
        taken.append(poses[at][1])
    lengths = {len(look) for look in looks}
    if len(lengths) > 1:
        text = f"{path} holds descriptors of {sorted(lengths)} numbers, one length is allowed"
        raise SurefootError("bad_descriptor", text)
    if not taken or lengths == {0}:
        raise SurefootError("no_landmarks", f"{path} holds no detection with a descriptor and a pose")
    where = np.array(taken)
    where[:, 2] = np.unwrap(where[:, 2])
    return Sightings(
        where, np.array(number, dtype=np.int64), np.array(ranges), np.array(bearings), np.array(looks), source
    )
