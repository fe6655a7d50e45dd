"""Errors of a track against the truth of its log."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from surefoot.arrays import Array, Flags

from ..statistics import REGION_95, nees
from . import trajectory
from .log import Log
from .track import Track
from .truth import over_window

WINDOW_S = 0.5
"""Time over which mean errors are compared, s: truth by motion capture is noisy row by row."""
NO_WAY_M, NO_SPEED = 1e-3, 1e-4
"""`NO_WAY_M`: net displacement, m, and `NO_SPEED`: mean speed, m/s, below which no relative error is given."""


@dataclass(frozen=True)
class Score:
    """Errors of an estimate over the scored part of a log; NaN where the log is too short or the robot stands."""

    rmse: float  # m/s, length of the velocity error, rms over rows
    smooth: float  # m/s, the same of the error's mean over 0.5 s, world axes
    average: float  # error of the mean world velocity along the track, share of it (0.08 = 8 %)
    drift: float  # m/s, horizontal error of the mean world velocity
    nees: float  # of v, mean; 3 = ideal
    inside: float  # share of the rows with v inside the 95 % region of its covariance
    tilt_deg: float  # angle between estimated and true up, rms
    way: float  # m, net horizontal way of base_link
    odometry: float  # horizontal error of the displacement of base_link, share of the net way
    height: float  # m, error of the height difference, largest
    heading_deg: float  # error of the change of heading, at the end
    integral: float  # m, published velocity integrated against published position, share of the net way
    path: float  # m, true path of base_link
    rpe: float  # relative pose error over `rpe_m` of path, translation, rms, share of that length
    rpe_m: float  # m, the longest of 1, 0.5 and 0.1 m that the path holds
    rpe_1s: float  # m, relative pose error over 1 s, translation, rms
    ate: float  # m, position after alignment in heading and position, rms
    heading_deg_min: float  # deg/min, |error of the change of heading| at the end over the time
    heading_rms_deg: float  # error of heading after alignment, rms
    position_nees: float  # of the position since the beginning, mean; 3 = ideal; NaN: no covariance
    heading_nees: float  # of the heading since the beginning, mean; 1 = ideal
    climb: float  # m/m, error of the change of height over `rpe_m` of path, rms, per metre

    @property
    def percent(self) -> float:
        """Absolute error of the average velocity, % of the true average velocity."""
        return 100.0 * abs(self.average)


def score(log: Log, found: Track, lengths: Sequence[float] = trajectory.LENGTHS_M) -> Score:
    """Return the errors of a track against the truth of its log.

    Args:
        log: log with truth.
        found: estimates over the log.
        lengths: lengths of path for the relative pose error, m; the first that fits is taken.
    """
    truth, rows = log.known(), log.scored
    error = velocity_error(log, found)
    mean, v_mean = error[rows].mean(axis=0), truth.v_world[rows].mean(axis=0)
    way, gap, height, heading = _odometry(log, found)
    stated = rows & (np.einsum("nii->n", found.p[:, 3:, 3:]) > 0.0)  # not before the estimator started
    squares = nees(np.einsum("nji,nj->ni", truth.rot[stated], error[stated]), found.p[stated][:, 3:, 3:])
    return Score(
        rmse=_rms(error[rows]),
        smooth=_rms(smoothed(error[rows], log)),
        average=_share(float(mean @ v_mean), float(v_mean @ v_mean), NO_SPEED**2),
        drift=float(np.hypot(mean[0], mean[1])),
        nees=_mean(squares),
        inside=_mean(squares < REGION_95),
        tilt_deg=float(np.degrees(_rms1(tilt(log, found)[rows]))),
        way=way,
        odometry=_share(gap, way),
        height=height,
        heading_deg=heading,
        integral=_share(_integral(log, found), way),
        **_trajectory(log, found, heading, lengths),
    )


def velocity_error(log: Log, found: Track) -> Array:
    """Return the error of the velocity of a track, (n, 3) m/s, world axes, as mean over the window of the truth."""
    truth = log.known()
    return over_window(np.einsum("nij,nj->ni", truth.rot, found.v), log.seconds, truth.window_s) - truth.v_world


def _trajectory(log: Log, found: Track, heading: float, lengths: Sequence[float]) -> dict[str, float]:
    """Return the errors of the whole trajectory by name of the field of a score; `heading`: error at the end, deg."""
    rows = log.scored
    position, yaw = base_pose(log)
    true = trajectory.Poses(position[rows], log.rot[rows] @ log.rot_base_from_imu.T)
    seen = trajectory.Poses(found.position[rows], base_rot(log, found, rows))
    seconds = log.seconds[rows]
    way = trajectory.path_length(true.position, seconds)
    length, pairs = trajectory.pairs_by_path(way, lengths)
    off = np.asarray(found.yaw[rows]) - yaw[rows]
    return {
        "path": float(way[-1]),
        "rpe": _rms(trajectory.relative_error(true, seen, pairs)) / length,
        "rpe_m": length,
        "rpe_1s": _rms(trajectory.relative_error(true, seen, trajectory.pairs_by_time(seconds))),
        "ate": _rms(trajectory.laid_over(seen.position, true.position) - true.position),
        "heading_deg_min": 60.0 * abs(heading) / float(seconds[-1] - seconds[0]),
        "heading_rms_deg": float(np.degrees(np.std(off))),
        **_pose_nees(log, found, rows, off),
        "climb": _rms1(trajectory.height_error(true, seen, pairs)) / length,
    }


def _pose_nees(log: Log, found: Track, rows: Flags, off: Array) -> dict[str, float]:
    """Return NEES of position and heading since the first scored row by the published covariance of the pose.

    NEES is e^T P^-1 e of an error e with covariance P, as mean over rows.

    Args:
        log: log with truth.
        found: track over it.
        rows: those that are scored, (n,).
        off: estimated less true headings of those rows, rad, (k,).
    """
    unknown = {"position_nees": float("nan"), "heading_nees": float("nan")}
    if found.pose is None:
        return unknown
    stated = rows & found.flags["initialised"]
    if stated.sum() < 2:
        return unknown
    use = stated[rows]
    position = base_pose(log)[0][stated]
    seen, turn = np.asarray(found.position)[stated], off[use][0]
    c, s = np.cos(turn), np.sin(turn)
    true = (position - position[0]) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])  # odom axes
    error, pose = seen - seen[0] - true, np.asarray(found.pose[stated])
    heading = (off[use] - turn)[1:] ** 2 / pose[1:, 5, 5]
    return {"position_nees": _mean(nees(error[1:], pose[1:, :3, :3])), "heading_nees": _mean(heading)}


def smoothed(error: Array, log: Log, seconds: float = WINDOW_S) -> Array:
    """Return the running mean of rows (n, 3), any unit, over w rows or `seconds` s, where whole, (n - w + 1, 3)."""
    rows = max(1, round(seconds / float(np.median(np.diff(log.seconds)))))
    if len(error) < rows:
        return error.mean(axis=0, keepdims=True)
    total = np.cumsum(np.vstack([np.zeros(3), error]), axis=0)
    return (total[rows:] - total[:-rows]) / rows


def tilt(log: Log, found: Track) -> Array:
    """Return the angle between estimated and true up, (n,) rad."""
    up, seen = log.up, found.g
    sine = np.linalg.norm(np.cross(up, seen), axis=1)
    return np.arctan2(sine, np.einsum("ni,ni->n", up, seen))


def base_pose(log: Log) -> tuple[Array, Array]:
    """Return true position (n, 3) m, world, and true heading (n,) rad of base_link at each inertial row of a log."""
    truth = log.known()
    base = np.einsum("nij,kj->nik", truth.rot, log.rot_base_from_imu)
    position = truth.position - np.einsum("nij,j->ni", base, log.imu_position)
    return position, np.unwrap(np.arctan2(base[:, 1, 0], base[:, 0, 0]))


def base_rot(log: Log, found: Track, rows: Flags | slice) -> Array:
    """Return the rotation from base_link to odom at some rows of a track, (k, 3, 3), by its heading and gravity.

    `rows`: k rows, by flag (n,) or slice.
    """
    x, y, z = (found.g[rows] @ log.rot_base_from_imu.T).T
    angles = np.stack([np.asarray(found.yaw[rows]), np.arctan2(-x, np.hypot(y, z)), np.arctan2(y, z)], axis=1)
    return Rotation.from_euler("ZYX", angles).as_matrix()


def _span(log: Log) -> tuple[int, int]:
    rows = np.flatnonzero(log.scored)
    return int(rows[0]), int(rows[-1])


def _odometry(log: Log, found: Track) -> tuple[float, float, float, float]:
    """Return net displacement, m, its horizontal error, m, largest height error, m, and heading error, deg."""
    first, last = _span(log)
    position, yaw = base_pose(log)
    true = position[last] - position[first]
    seen = found.position[last] - found.position[first]
    turn = yaw[first] - found.yaw[first]  # odom is laid over the world where scoring begins
    c, s = np.cos(turn), np.sin(turn)
    gap = np.hypot(c * seen[0] - s * seen[1] - true[0], s * seen[0] + c * seen[1] - true[1])
    rise = found.position[first : last + 1, 2] - position[first : last + 1, 2]
    heading = np.degrees((found.yaw[last] - found.yaw[first]) - (yaw[last] - yaw[first]))
    return float(np.hypot(true[0], true[1])), float(gap), float(np.abs(rise - rise[0]).max()), float(heading)


def _integral(log: Log, found: Track) -> float:
    """Return the distance at the end between the integral of the published velocity and the published position, m."""
    first, last = _span(log)
    v, t = found.v_odom[first : last + 1], log.seconds[first : last + 1]
    way = np.sum(0.5 * (v[1:] + v[:-1]) * np.diff(t)[:, None], axis=0)
    gap = found.position[last] - found.position[first] - way
    return float(np.linalg.norm(gap))


def _share(part: float, whole: float, least: float = NO_WAY_M) -> float:
    return part / whole if whole > least else float("nan")


def _mean(x: Array | Flags) -> float:
    return float(np.mean(x)) if len(x) else float("nan")


def _rms(x: Array) -> float:
    return _rms1(np.linalg.norm(x, axis=1))


def _rms1(x: Array) -> float:
    return float(np.sqrt(_mean(x**2)))
