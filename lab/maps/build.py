"""Landmark map from a recording: association by look, then all places and poses at once.

Unknown are the poses x_f = (t_f, theta_f) of the frames and the places l_j of the landmarks. The sum of the squares of

    (r - |l_j - t_f|)/sigma_r,  wrap(phi - atan2(l_j - t_f) + theta_f)/sigma_phi                     of every detection,
    (R(theta_f)^T (t_f+1 - t_f) - that by odometry)/sigma_t,  (theta_f+1 - theta_f - that)/sigma_theta   between frames

is made least by the method of Gauss and Newton, weights of large residuals reduced (Huber, 1964); the first pose is
held. Detections that do not fit in the end are left out, and landmarks with too few.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve

from surefoot.arrays import Array
from surefoot.errors import SurefootError
from surefoot.services.navigator.belief.landmarks import FloorLandmarks

from .sightings import Sightings

Index = NDArray[np.int64]

HUBER = 2.0
"""Standard deviations from which a residual counts linearly."""
OUTLIER = 9.21
"""Squared residual of a detection that is left out in the end, chi^2_2(.99)."""


@dataclass(frozen=True)
class BuildOptions:
    """Noise of the sensors, and conditions for keeping a landmark."""

    range_share: float = 0.03
    """Standard deviation of a range as a share of the range."""
    range_sd: float = 0.005
    """Standard deviation of a range beside the share that grows with it, m."""
    bearing_sd: float = math.radians(1.5)
    """Standard deviation of a bearing, rad."""
    walk_share: float = 0.02
    """Error of odometry, part of the way walked."""
    turn_share: float = 0.05
    """Error of odometry's heading, part of the turn."""
    turn_per_m: float = math.radians(1.0)
    """Error of odometry's heading by the way walked, rad/m."""
    still_m: float = 0.0005
    """Error of odometry from frame to frame of a robot that stands, m."""
    still_rad: float = 0.0005
    """Error of the heading from frame to frame of a robot that stands, rad."""
    look_sd: float | None = None
    """Noise of each number of a descriptor; None = estimated from the recording."""
    least: int = 3
    """Least number of detections of a landmark that is kept."""
    rounds: int = 12
    """Largest number of steps of least squares."""
    scale_sd: float = 0.0
    """Standard deviation of a part by which all ways of odometry are too long, 0 = there is no such error."""
    bend_sds: tuple[float, ...] = ()
    """Standard deviations of the b errors that all detections share, one for each column of `Sightings.bends`."""
    sway_sds: tuple[float, ...] = ()
    """Standard deviations of the s errors that the detections of one frame share, s <= b, for the first columns of
    `Sightings.bends`."""


@dataclass(frozen=True, eq=False)
class BuiltMap:
    """Map with the residuals of its fit."""

    world: FloorLandmarks
    """The landmarks, in the frame of the poses."""
    seen: Index
    """Number of detections of each landmark, (n,)."""
    sd: Array
    """Standard deviation of each place along one axis by its detections, for known poses, (n,) m."""
    poses: Array
    """Corrected poses of the frames, x, y (m) and heading (rad), (f, 3)."""
    shift: float
    """Largest correction of a pose, m."""
    range_rms: float
    """Root mean square of the ranges' residuals, parts of the range."""
    bearing_rms: float
    """Root mean square of the bearings' residuals, rad."""
    look_sd: float
    """Noise of the descriptors, given or estimated."""
    common: Array
    """Errors that all detections share, one for each of b columns of `Sightings.bends`, the part by which all ways are
    too long, and the s errors of the detections of each frame, (b + 1 + f s,)."""
    detections: int
    """Detections in the recording."""
    used: int
    """Detections of the landmarks that were kept."""
    dropped: int
    """Landmarks seen too seldom."""


def build_map(seen: Sightings, options: BuildOptions | None = None, source: str = "") -> BuiltMap:
    """Return a map of the landmarks of a recording.

    Args:
        seen: detections and odometry.
        options: None = the defaults of `BuildOptions`.
        source: named in the map.

    Raises:
        SurefootError: no landmark was seen often enough, or, without `look_sd`, none in two frames in a row.
    """
    options = options or BuildOptions()
    look_sd = options.look_sd or estimated_look_noise(seen)
    return fitted(seen, associate(seen, look_sd, options), look_sd, options, source)


def fitted(
    seen: Sightings, track: Index, look_sd: float, options: BuildOptions, source: str, start: Array | None = None
) -> BuiltMap:  # fmt: skip
    """Return the map of detections whose landmarks are known.

    Args:
        seen: detections and odometry.
        track: landmark of each detection, (m,).
        look_sd: noise of the descriptors, kept in the result.
        options: noise, and which errors are common to all detections.
        source: named in the map.
        start: poses to begin with, (f, 3) m and rad; None = those of the odometry.

    Raises:
        SurefootError: no landmark was seen often enough.
    """
    poses = (seen.poses if start is None else start).copy()
    places = _first_places(replace(seen, poses=poses), track)
    common = np.zeros(len(options.bend_sds) + 1 + len(poses) * len(options.sway_sds))
    for _ in range(options.rounds):
        if _improve(seen, track, poses, places, common, options) < 1e-5:
            break
    seen = seen.straightened(*_errors(common, options))
    residual = _residuals(seen, track, poses, places, options)
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
    scale = np.stack((_relative(options, seen.ranges[used]), np.full(int(used.sum()), options.bearing_sd)))
    range_rms, bearing_rms = (float(v) for v in np.sqrt(np.mean((residual[used].T * scale) ** 2, axis=1)))
    shift = float(np.hypot(*(poses - seen.poses)[:, :2].T).max())
    sd = _place_sd(seen, track, used, new, poses, places, options)
    return BuiltMap(
        world, count[kept], sd, poses, shift, range_rms, bearing_rms, look_sd, common, len(track), int(used.sum()),
        len(places) - len(kept),
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
    """Return the landmark of each of m detections, numbered in the order of their first sight, (m,).

    A detection is the landmark that looks alike within noise and lies where it should by odometry; the slack grows with
    the way since the landmark was seen last.

    Args:
        seen: detections and odometry.
        look_sd: noise of each element of a descriptor.
        options: noise of sight and odometry.
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


def _relative(options: BuildOptions, ranges: Array) -> Array:
    """Return the standard deviations of ranges (n,) m, as parts of them."""
    return np.hypot(options.range_share, options.range_sd / ranges)


def _wrapped(angle: Array) -> Array:
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def _geometry(seen: Sightings, track: Index, poses: Array, places: Array) -> tuple[Array, Array, Array]:
    """Return offsets of the landmarks, map, (m, 2) m, their length (m,) m, and residuals of range and bearing (m, 2).

    `track` (m,): landmark of each detection; `poses` (f, 3): x, y (m), heading (rad); `places` (k, 2) m, map. Residuals
    are in m and rad.
    """
    d = places[track] - poses[seen.frame, :2]
    q = np.maximum(np.hypot(d[:, 0], d[:, 1]), 1e-6)
    bearing = _wrapped(seen.bearings - np.arctan2(d[:, 1], d[:, 0]) + poses[seen.frame, 2])
    return d, q, np.stack((seen.ranges - q, bearing), axis=1)


def _residuals(seen: Sightings, track: Index, poses: Array, places: Array, options: BuildOptions) -> Array:
    """Return the residuals of range and bearing in standard deviations, (m, 2).

    `track` (m,): landmark of each detection; `poses` (f, 3): x, y (m), heading (rad); `places` (k, 2) m, map.
    """
    _, q, nu = _geometry(seen, track, poses, places)
    return nu / np.stack((_relative(options, q) * q, np.full(len(q), options.bearing_sd)), axis=1)


def _improve(
    seen: Sightings, track: Index, poses: Array, places: Array, common: Array, options: BuildOptions
) -> float:  # fmt: skip
    """Move poses (f, 3) m, rad, places (k, 2) m and common errors in place; return the largest move of a place, m."""
    m, f, n = len(track), len(poses), len(places)
    d, q, nu = _geometry(seen.straightened(*_errors(common, options)), track, poses, places)
    sd_r, sd_b = _relative(options, q) * q, np.full(m, options.bearing_sd)
    u = d / q[:, None]
    size = np.sqrt((nu[:, 0] / sd_r) ** 2 + (nu[:, 1] / sd_b) ** 2)
    weight = np.sqrt(np.minimum(1.0, HUBER / np.maximum(size, 1e-9)))
    rows, p, at_place = np.arange(m), 3 * seen.frame, 3 * f + 2 * track
    wr, wb = weight / sd_r, weight / sd_b
    entries = [
        (rows, p, -u[:, 0] * wr), (rows, p + 1, -u[:, 1] * wr),
        (rows, at_place, u[:, 0] * wr), (rows, at_place + 1, u[:, 1] * wr),
        (rows + m, p, u[:, 1] / q * wb), (rows + m, p + 1, -u[:, 0] / q * wb), (rows + m, p + 2, -wb),
        (rows + m, at_place, -u[:, 1] / q * wb), (rows + m, at_place + 1, u[:, 0] / q * wb),
    ]  # fmt: skip
    right = [nu[:, 0] * wr, nu[:, 1] * wb]
    shared, bends, sways = 3 * f + 2 * n, len(options.bend_sds), len(options.sway_sds)
    scale = shared + bends
    columns = [(k, np.full(m, shared + k)) for k in range(bends)]
    columns += [(k, scale + 1 + sways * seen.frame + k) for k in range(sways)]
    for k, column in columns:
        entries += [(rows, column, seen.bends[:, 0, k] * wr), (rows + m, column, seen.bends[:, 1, k] * wb)]
    start = 2 * m
    before, odometry = _between(poses), _between(seen.poses)
    way, turn = np.hypot(odometry[:, 0], odometry[:, 1]), np.abs(odometry[:, 2])
    sd_t = np.hypot(options.still_m, options.walk_share * way)
    sd_a = np.sqrt(options.still_rad**2 + (options.turn_share * turn) ** 2 + (options.turn_per_m * way) ** 2)
    c, s = np.cos(poses[:-1, 2]), np.sin(poses[:-1, 2])
    steps, a = np.arange(f - 1), 3 * np.arange(f - 1)
    for i, (ex, ey, et) in enumerate(((c, s, before[:, 1]), (-s, c, -before[:, 0]))):
        at = start + i * (f - 1) + steps
        entries += [
            (at, a, -ex / sd_t), (at, a + 1, -ey / sd_t), (at, a + 2, et / sd_t),
            (at, a + 3, ex / sd_t), (at, a + 4, ey / sd_t),
            (at, np.full(f - 1, scale), odometry[:, i] / sd_t),
        ]  # fmt: skip
        right.append(((1.0 - common[bends]) * odometry[:, i] - before[:, i]) / sd_t)
    at = start + 2 * (f - 1) + steps
    entries += [(at, a + 2, -1.0 / sd_a), (at, a + 5, 1.0 / sd_a)]
    right.append((odometry[:, 2] - before[:, 2]) / sd_a)
    held = start + 3 * (f - 1) + np.arange(3)
    entries.append((held, np.arange(3), np.full(3, 1e6)))
    right.append(1e6 * (seen.poses[0] - poses[0]))
    likely = 1.0 / np.maximum(1e-9, np.array([*options.bend_sds, options.scale_sd, *options.sway_sds * f]))
    entries.append((held[-1] + 1 + np.arange(len(common)), shared + np.arange(len(common)), likely))
    right.append(-likely * common)
    i, j, v = (np.concatenate([entry[x] for entry in entries]) for x in range(3))
    jacobian = sparse.csc_matrix((v, (i, j)), shape=(start + 3 * f + len(common), shared + len(common)))
    normal = (jacobian.T @ jacobian).tocsc()
    step: Array = np.asarray(spsolve(normal, jacobian.T @ np.concatenate(right)))
    poses += step[: 3 * f].reshape(f, 3)
    moved = step[3 * f : shared].reshape(n, 2)
    places += moved
    common += step[shared:]
    return float(np.abs(moved).max())


def _errors(common: Array, options: BuildOptions) -> tuple[Array, Array]:
    """Return the errors of all detections, (b,), and of those of each of f frames, (f, s).

    `common` (b + 1 + f s,): these errors in a row, with that of the ways between.
    """
    bends, sways = len(options.bend_sds), len(options.sway_sds)
    return common[:bends], common[bends + 1 :].reshape(-1, max(1, sways))[:, :sways]


def _between(poses: Array) -> Array:
    """Return the motion from each pose to the next in the axes of the first, m, m, rad, (f - 1, 3).

    `poses`: x, y (m), heading (rad), (f, 3).
    """
    d = np.diff(poses, axis=0)
    c, s = np.cos(poses[:-1, 2]), np.sin(poses[:-1, 2])
    return np.stack((c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0], d[:, 2]), axis=1)


def _place_sd(
    seen: Sightings,
    track: Index,
    used: NDArray[np.bool_],
    new: Index,
    poses: Array,
    places: Array,
    options: BuildOptions,
) -> Array:
    """Return the standard deviation of the kept places by their detections alone, (k,) m.

    Args:
        seen: m detections.
        track: landmark of each, (m,).
        used: detections of landmarks that were kept, (m,).
        new: number of each landmark among the k kept ones, -1 = not kept, (n,).
        poses: x, y (m), heading (rad) of the frames, (f, 3).
        places: of the landmarks, (n, 2) m.
        options: noise.
    """
    d, q, _ = _geometry(seen, track, poses, places)
    u = d / q[:, None]
    along, across = 1.0 / (_relative(options, q) * q) ** 2, 1.0 / (options.bearing_sd * q) ** 2
    information = along[:, None, None] * u[:, :, None] * u[:, None, :]
    v = np.stack((-u[:, 1], u[:, 0]), axis=1)
    information += across[:, None, None] * v[:, :, None] * v[:, None, :]
    total = np.zeros((int(new.max()) + 1, 2, 2))
    np.add.at(total, new[track[used]], information[used])
    return np.sqrt(0.5 * np.trace(np.linalg.inv(total), axis1=1, axis2=2))
