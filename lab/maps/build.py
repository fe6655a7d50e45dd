"""Landmark map from a recording: detections are associated by descriptor, then all places and poses are fitted.

Unknown are the poses x_f = (t_f, theta_f) of the frames and the places l_j of the landmarks. The sum of the squares of

    (r - |l_j - t_f|)/sigma_r,  wrap(phi - atan2(l_j - t_f) + theta_f)/sigma_phi                     of every detection,
    (R(theta_f)^T (t_f+1 - t_f) - that by odometry)/sigma_t,  (theta_f+1 - theta_f - that)/sigma_theta   between frames

is made least by the method of Gauss and Newton, weights of large residuals reduced (Huber, 1964); the first pose is
fixed. Detections that do not fit in the end are left out, and landmarks with too few.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import SuperLU, splu

from surefoot.arrays import Array
from surefoot.errors import SurefootError
from surefoot.services.navigator.belief.landmarks import FloorLandmarks

from .equations import BuildOptions, Index, errors_of, geometry, relative, residuals, system
from .sightings import Sightings

OUTLIER = 9.21
"""Squared normalised residual from which on a detection is left out of the map: 99 % quantile of chi^2 with 2 dof."""
LOOKED_AT = 25
"""Number of poses, evenly spread over the recording, whose covariance is computed to find the drift of the map."""


@dataclass(frozen=True, eq=False)
class BuiltMap:
    """Landmark map that was built from a recording, with the residuals of its fit."""

    world: FloorLandmarks
    """Landmarks of the map, positions in the frame of the poses (odom or map)."""
    seen: Index
    """Number of detections of each landmark, without outliers, (n,)."""
    sd: Array
    """Standard deviation of each landmark's position along one axis if the poses were exact, (n,) m."""
    poses: Array
    """Corrected poses of the frames in odom or map, x, y (m) and heading (rad), (f, 3)."""
    shift: float
    """Largest distance by which the fit moved a pose, m."""
    drift: float
    """Largest standard deviation of a pose's position, with the first pose held fixed, m. It grows with the path length
    until a floor is seen again; the noise of detections is assumed to be independent."""
    range_rms: float
    """Root mean square of the range residuals, as a share of the range."""
    bearing_rms: float
    """Root mean square of the bearing residuals, rad."""
    look_sd: float
    """Standard deviation of the noise of each element of a descriptor, stated or estimated."""
    common: Array
    """Errors that all detections share, one for each of b columns of `Sightings.bends`, the part by which all paths are
    too long, and the s errors of the detections of each frame, (b + 1 + f s,)."""
    detections: int
    """Number of detections in the recording."""
    used: int
    """Number of detections that the map consists of: those of kept landmarks, without outliers."""
    dropped: int
    """Number of landmarks left out because they were detected fewer than `BuildOptions.least` times."""


def build_map(seen: Sightings, options: BuildOptions | None = None, source: str = "") -> BuiltMap:
    """Return a map of the landmarks of a recording.

    Args:
        seen: detections and odometry.
        options: None = the defaults of `BuildOptions`.
        source: name of the source, kept in the map.

    Raises:
        SurefootError: no landmark was seen often enough, or, without `look_sd`, none in two frames in a row.
    """
    options = options or BuildOptions()
    look_sd = options.look_sd or estimated_look_noise(seen)
    return fitted(seen, associate(seen, look_sd, options), look_sd, options, source)


def fitted(
    seen: Sightings, track: Index, look_sd: float, options: BuildOptions, source: str, start: Array | None = None
) -> BuiltMap:  # fmt: skip
    """Return the landmark map fitted to detections, each of which belongs to a known landmark.

    Args:
        seen: detections and odometry.
        track: landmark of each detection, (m,).
        look_sd: noise of the descriptors, kept in the result.
        options: noise, and which errors are common to all detections.
        source: name of the source, kept in the map.
        start: poses to begin with, (f, 3) m and rad; None = those of the odometry.

    Raises:
        SurefootError: no landmark was seen often enough.
    """
    poses = (seen.poses if start is None else start).copy()
    places = _first_places(replace(seen, poses=poses), track)
    common = np.zeros(len(options.bend_sds) + 1 + len(poses) * len(options.sway_sds))
    move, factor = _improve(seen, track, poses, places, common, options)
    for _ in range(options.rounds - 1):
        if move < 1e-5:
            break
        move, factor = _improve(seen, track, poses, places, common, options)
    drift = drift_of(factor, len(poses))
    seen = seen.straightened(*errors_of(common, options))
    residual = residuals(seen, track, poses, places, options)
    good = (residual**2).sum(axis=1) < OUTLIER
    count = np.bincount(track[good], minlength=len(places))
    kept = np.flatnonzero(count >= options.least)
    if len(kept) < 2:
        most = int(count.max()) if count.size else 0
        text = f"no two landmarks were seen {options.least} times; of {len(places)} the most often seen {most} times"
        raise SurefootError("no_landmarks", text)
    used = good & np.isin(track, kept)
    new = np.full(len(places), -1)
    new[kept] = np.arange(len(kept))
    looks = np.zeros((len(kept), seen.looks.shape[1]))
    np.add.at(looks, new[track[used]], seen.looks[used])
    looks /= count[kept][:, None]
    world = FloorLandmarks(places[kept], looks, 1, source)
    scale = np.stack((relative(options, seen.ranges[used]), np.full(int(used.sum()), options.bearing_sd)))
    range_rms, bearing_rms = (float(v) for v in np.sqrt(np.mean((residual[used].T * scale) ** 2, axis=1)))
    shift = float(np.hypot(*(poses - seen.poses)[:, :2].T).max())
    sd = _place_sd(seen, track, used, new, poses, places, options)
    return BuiltMap(
        world, count[kept], sd, poses, shift, drift, range_rms, bearing_rms, look_sd, common, len(track),
        int(used.sum()), len(places) - len(kept),
    )  # fmt: skip


def estimated_look_noise(seen: Sightings) -> float:
    """Return the standard deviation of a descriptor's elements, from alike detections in frames that follow each other.

    Raises:
        SurefootError: no landmark was seen in two frames that follow each other.
    """
    frames = np.split(np.arange(len(seen.frame)), np.flatnonzero(np.diff(seen.frame)) + 1)
    near: list[Array] = []
    for a, b in pairwise(frames):
        gap = np.sqrt(((seen.looks[a][:, None] - seen.looks[b][None]) ** 2).sum(axis=2))
        near.append(gap.ravel())
    gaps = np.concatenate(near) if near else np.zeros(0)
    alike = gaps[gaps < 0.35 * np.median(gaps)] if gaps.size else gaps
    if not alike.size:
        raise SurefootError("no_landmarks", "no landmark was seen in two frames that follow each other")
    noise = math.sqrt(float(np.mean(alike**2)) / (2 * seen.looks.shape[1]))
    return max(noise, 1e-6)


def associate(seen: Sightings, look_sd: float, options: BuildOptions) -> Index:
    """Return the landmark index of each of m detections, (m,), in the order in which landmarks are first detected.

    A detection belongs to the landmark whose descriptor is equal within noise and whose place agrees by odometry; the
    tolerance grows with the distance walked since that landmark was last seen.

    Args:
        seen: detections and odometry.
        look_sd: noise of each element of a descriptor.
        options: noise of detections and odometry.
    """
    limit = 2.0 * look_sd * math.sqrt(2.0 * seen.looks.shape[1])
    way = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(seen.poses[:, :2], axis=0).T))))
    turn = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(seen.poses[:, 2])))))
    x, y, heading = seen.poses[seen.frame].T
    points = np.stack(
        (x + seen.ranges * np.cos(heading + seen.bearings), y + seen.ranges * np.sin(heading + seen.bearings)), axis=1
    )
    n, k = seen.looks.shape
    looks, places = np.empty((n, k)), np.empty((n, 2))
    count, last, total = np.zeros(n), np.zeros(n, dtype=np.int64), 0
    track = np.empty(n, dtype=np.int64)
    for d in range(n):
        f = seen.frame[d]
        gap = np.sqrt(((looks[:total] - seen.looks[d]) ** 2).sum(axis=1))
        far = np.hypot(*(places[:total] - points[d]).T)
        noise = 4.0 * seen.ranges[d] * math.hypot(options.range_share, options.bearing_sd) + 4.0 * options.range_sd
        since, turned = way[f] - way[last[:total]], turn[f] - turn[last[:total]]
        bend = options.turn_per_m * since + options.turn_share * turned
        slack = noise + 4.0 * (options.walk_share * since + bend * (seen.ranges[d] + since))
        alike = np.flatnonzero((gap < limit) & (far < slack))
        if alike.size:
            j = int(alike[np.argmin(gap[alike])])
        else:
            j = total
            looks[j], places[j], count[j] = 0.0, 0.0, 0
            total += 1
        count[j] += 1
        looks[j] += (seen.looks[d] - looks[j]) / count[j]
        places[j] += (points[d] - places[j]) / min(count[j], 10.0)  # of late: odometry drifts
        last[j], track[d] = f, j
    return track


def _first_places(seen: Sightings, track: Index) -> Array:
    x, y, heading = seen.poses[seen.frame].T
    points = np.stack(
        (x + seen.ranges * np.cos(heading + seen.bearings), y + seen.ranges * np.sin(heading + seen.bearings)), axis=1
    )
    places = np.zeros((int(track.max()) + 1, 2))
    np.add.at(places, track, points)
    return places / np.bincount(track)[:, None]


def _improve(
    seen: Sightings, track: Index, poses: Array, places: Array, common: Array, options: BuildOptions
) -> tuple[float, SuperLU]:  # fmt: skip
    """Do one least-squares step: update poses (f, 3) m, rad, places (k, 2) m and common errors in place.

    Returns:
        Largest move of a place, m, and the factors of the normal matrix, whose inverse is the covariance.
    """
    jacobian, right = system(seen, track, poses, places, common, options)
    factor = splu((jacobian.T @ jacobian).tocsc())
    step: Array = np.asarray(factor.solve(jacobian.T @ right))
    shared = poses.size + places.size
    poses += step[: poses.size].reshape(poses.shape)
    moved = step[poses.size : shared].reshape(places.shape)
    places += moved
    common += step[shared:]
    return float(np.abs(moved).max()), factor


def drift_of(factor: SuperLU, frames: int) -> float:
    """Return the largest standard deviation of a pose's position, m, the first pose being fixed.

    Args:
        factor: factorised normal matrix, poses first.
        frames: number of poses; `LOOKED_AT` of them are evaluated.
    """
    largest = 0.0
    for frame in np.unique(np.linspace(0, frames - 1, LOOKED_AT).astype(np.int64)).tolist():
        unit = np.zeros((factor.shape[0], 2))
        unit[3 * frame, 0] = unit[3 * frame + 1, 1] = 1.0
        found = factor.solve(unit)
        largest = max(largest, float(found[3 * frame, 0] + found[3 * frame + 1, 1]))
    return math.sqrt(largest)


def _place_sd(
    seen: Sightings,
    track: Index,
    used: NDArray[np.bool_],
    new: Index,
    poses: Array,
    places: Array,
    options: BuildOptions,
) -> Array:
    """Return the standard deviation along one axis of the kept places by their detections alone, (k,) m.

    Args:
        seen: m detections.
        track: landmark of each, (m,).
        used: detections of landmarks that were kept, (m,).
        new: index of each landmark among the k kept ones, -1 = not kept, (n,).
        poses: x, y (m), heading (rad) of the frames, (f, 3).
        places: of the landmarks, (n, 2) m.
        options: noise.
    """
    d, q, _ = geometry(seen, track, poses, places)
    u = d / q[:, None]
    along, across = 1.0 / (relative(options, q) * q) ** 2, 1.0 / (options.bearing_sd * q) ** 2
    information = along[:, None, None] * u[:, :, None] * u[:, None, :]
    v = np.stack((-u[:, 1], u[:, 0]), axis=1)
    information += across[:, None, None] * v[:, :, None] * v[:, None, :]
    total = np.zeros((int(new.max()) + 1, 2, 2))
    np.add.at(total, new[track[used]], information[used])
    return np.sqrt(0.5 * np.trace(np.linalg.inv(total), axis1=1, axis2=2))
