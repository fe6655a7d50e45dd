"""Equations of a landmark map: residuals of detections, odometry and common errors, and their derivative.

The unknowns are, in this order, the poses x_f = (t_f, theta_f) of the frames, the places l_j of the landmarks, and
the errors that detections, or distances by odometry, share.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from surefoot.arrays import Array

from .sightings import Sightings

Index = NDArray[np.int64]
Entry = tuple[Index, Index, Array]
"""Entries of a sparse block of the Jacobian: rows, columns and values, (n,) each."""

HUBER = 2.0
"""Length of a residual, in standard deviations, above which its cost grows linearly (Huber loss)."""


@dataclass(frozen=True)
class BuildOptions:
    """Settings of map building: noise of the sensors, and conditions for keeping a landmark."""

    range_share: float = 0.03
    """Standard deviation of a range as a share of the range."""
    range_sd: float = 0.005
    """Constant part of the standard deviation of a range, m; `range_share` adds the part that grows with the range."""
    bearing_sd: float = math.radians(1.5)
    """Standard deviation of a bearing, rad."""
    walk_share: float = 0.02
    """Standard deviation of odometry's position, as a share of the path length."""
    turn_share: float = 0.05
    """Standard deviation of odometry's heading, as a share of the turned angle."""
    turn_per_m: float = math.radians(1.0)
    """Standard deviation of odometry's heading per path length, rad/m."""
    still_m: float = 0.0005
    """Standard deviation of odometry's position from frame to frame while the robot stands, m."""
    still_rad: float = 0.0005
    """Standard deviation of odometry's heading from frame to frame while the robot stands, rad."""
    look_sd: float | None = None
    """Standard deviation of the noise of each element of a descriptor; None = estimate it from the recording."""
    least: int = 3
    """Least number of detections of a landmark; those detected fewer times are left out of the map."""
    rounds: int = 12
    """Largest number of iterations of the least-squares fit."""
    scale_sd: float = 0.0
    """Standard deviation of the relative scale error of odometry's path length; 0 = no such error is estimated."""
    bend_sds: tuple[float, ...] = ()
    """Standard deviations of the b errors that all detections share, one for each column of `Sightings.bends`."""
    sway_sds: tuple[float, ...] = ()
    """Standard deviations of the s errors that the detections of one frame share, s <= b, for the first columns of
    `Sightings.bends`."""


def relative(options: BuildOptions, ranges: Array) -> Array:
    """Return the standard deviations of ranges (n,) m, as shares of the ranges, (n,), no unit."""
    return np.hypot(options.range_share, options.range_sd / ranges)


def wrapped(angle: Array) -> Array:
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def geometry(seen: Sightings, track: Index, poses: Array, places: Array) -> tuple[Array, Array, Array]:
    """Return offsets of the landmarks, map, (m, 2) m, their length (m,) m, and residuals of range and bearing (m, 2).

    `track` (m,): landmark of each detection; `poses` (f, 3): x, y (m), heading (rad); `places` (k, 2) m, map. Residuals
    are in m and rad.
    """
    d = places[track] - poses[seen.frame, :2]
    q = np.maximum(np.hypot(d[:, 0], d[:, 1]), 1e-6)
    bearing = wrapped(seen.bearings - np.arctan2(d[:, 1], d[:, 0]) + poses[seen.frame, 2])
    return d, q, np.stack((seen.ranges - q, bearing), axis=1)


def residuals(seen: Sightings, track: Index, poses: Array, places: Array, options: BuildOptions) -> Array:
    """Return the residuals of range and bearing, in multiples of their standard deviations, (m, 2).

    `track` (m,): landmark of each detection; `poses` (f, 3): x, y (m), heading (rad); `places` (k, 2) m, map.
    """
    _, q, nu = geometry(seen, track, poses, places)
    return nu / np.stack((relative(options, q) * q, np.full(len(q), options.bearing_sd)), axis=1)


def system(
    seen: Sightings, track: Index, poses: Array, places: Array, common: Array, options: BuildOptions
) -> tuple[sparse.csc_matrix, Array]:
    """Return the derivative of all residuals by all unknowns, and the residuals, in standard deviations.

    The first pose is fixed, and the common errors have a prior about 0.

    Args:
        seen: detections and odometry.
        track: landmark of each of m detections, (m,).
        poses: x, y (m), heading (rad) of f frames, (f, 3).
        places: places of k landmarks, (k, 2) m.
        common: errors that all detections share, share by which distances by odometry are too long, and the errors of
            the detections of each frame, (c,).
        options: noise.

    Returns:
        Derivative, (r, 3 f + 2 k + c), and residuals, (r,).
    """
    shared = poses.size + places.size
    entries, right = _detected(seen, track, poses, places, common, options)
    between, walked = _walked(seen.poses, poses, common[len(options.bend_sds)], options, shared + len(options.bend_sds))
    start = 2 * len(track)
    entries += [(start + row, column, value) for row, column, value in between]
    held = start + 3 * (len(poses) - 1) + np.arange(3)
    entries.append((held, np.arange(3), np.full(3, 1e6)))
    sds = np.array([*options.bend_sds, options.scale_sd, *options.sway_sds * len(poses)])
    likely = 1.0 / np.maximum(1e-9, sds)
    entries.append((held[-1] + 1 + np.arange(len(common)), shared + np.arange(len(common)), likely))
    right += [*walked, 1e6 * (seen.poses[0] - poses[0]), -likely * common]
    i, j, v = (np.concatenate([entry[x] for entry in entries]) for x in range(3))
    size = int(held[-1]) + 1 + len(common), shared + len(common)
    return sparse.csc_matrix((v, (i, j)), shape=size), np.concatenate(right)


def _detected(
    seen: Sightings, track: Index, poses: Array, places: Array, common: Array, options: BuildOptions
) -> tuple[list[Entry], list[Array]]:
    """Return derivative and residuals of m detections: ranges in rows 0 to m - 1, bearings in m to 2 m - 1.

    The arguments are those of `system`.
    """
    m, f, n = len(track), len(poses), len(places)
    d, q, nu = geometry(seen.straightened(*errors_of(common, options)), track, poses, places)
    sd_r, sd_b = relative(options, q) * q, np.full(m, options.bearing_sd)
    u = d / q[:, None]
    size = np.sqrt((nu[:, 0] / sd_r) ** 2 + (nu[:, 1] / sd_b) ** 2)
    weight = np.sqrt(np.minimum(1.0, HUBER / np.maximum(size, 1e-9)))
    rows, p, at_place = np.arange(m), 3 * seen.frame, 3 * f + 2 * track
    wr, wb = weight / sd_r, weight / sd_b
    entries: list[Entry] = [
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
    return entries, right


def _walked(
    stated: Array, poses: Array, longer: float, options: BuildOptions, scale: int
) -> tuple[list[Entry], list[Array]]:
    """Return derivative and residuals of the motions between frames, 3 (f - 1) rows.

    Args:
        stated: poses by odometry, x, y (m), heading (rad), (f, 3).
        poses: present estimates, x, y (m), heading (rad), (f, 3).
        longer: share by which all path lengths by odometry are too long.
        options: noise.
        scale: column of `longer` in the Jacobian.
    """
    f = len(poses)
    before, odometry = _between(poses), _between(stated)
    way, turn = np.hypot(odometry[:, 0], odometry[:, 1]), np.abs(odometry[:, 2])
    sd_t = np.hypot(options.still_m, options.walk_share * way)
    sd_a = np.sqrt(options.still_rad**2 + (options.turn_share * turn) ** 2 + (options.turn_per_m * way) ** 2)
    c, s = np.cos(poses[:-1, 2]), np.sin(poses[:-1, 2])
    steps, a = np.arange(f - 1), 3 * np.arange(f - 1)
    entries, right = list[Entry](), list[Array]()
    for i, (ex, ey, et) in enumerate(((c, s, before[:, 1]), (-s, c, -before[:, 0]))):
        at = i * (f - 1) + steps
        entries += [
            (at, a, -ex / sd_t), (at, a + 1, -ey / sd_t), (at, a + 2, et / sd_t),
            (at, a + 3, ex / sd_t), (at, a + 4, ey / sd_t),
            (at, np.full(f - 1, scale), odometry[:, i] / sd_t),
        ]  # fmt: skip
        right.append(((1.0 - longer) * odometry[:, i] - before[:, i]) / sd_t)
    at = 2 * (f - 1) + steps
    entries += [(at, a + 2, -1.0 / sd_a), (at, a + 5, 1.0 / sd_a)]
    right.append((odometry[:, 2] - before[:, 2]) / sd_a)
    return entries, right


def errors_of(common: Array, options: BuildOptions) -> tuple[Array, Array]:
    """Return the errors that all detections share, (b,), and those that the detections of each frame share, (f, s).

    `common` (b + 1 + f s,): these errors in a row, with the scale error of odometry between them.
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
