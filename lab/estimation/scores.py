"""Errors of a track against the truth of its log."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .log import Log
from .track import Track

Array = NDArray[np.float64]

WINDOW_S = 0.5
"""Time over which mean errors are compared, s: truth by motion capture is noisy row by row."""


@dataclass(frozen=True)
class Score:
    """Errors over the scored part of a log."""

    rmse: float  # m/s, length of the velocity error, rms over rows
    smooth: float  # m/s, the same of the error's mean over 0.5 s, world axes
    average: float  # error of the mean world velocity along the track, share of it (0.08 = 8 %)
    drift: float  # m/s, horizontal error of the mean world velocity
    nees: float  # of v, mean; 3 = ideal
    tilt_deg: float  # angle between estimated and true up, rms
    way: float  # m, net horizontal way of base_link
    odometry: float  # horizontal error of the displacement of base_link, share of the net way
    height: float  # m, error of the height difference, largest
    heading_deg: float  # error of the change of heading, at the end
    integral: float  # m, published velocity integrated against published position, share of the net way

    @property
    def percent(self) -> float:
        """Absolute error of the average, %."""
        return 100.0 * abs(self.average)


def score(log: Log, found: Track) -> Score:
    """Compare a track with the truth of its log."""
    truth, rows = log.known(), log.scored
    error = np.einsum("nij,nj->ni", truth.rot, found.v) - truth.v_world
    mean, v_mean = error[rows].mean(axis=0), truth.v_world[rows].mean(axis=0)
    way, gap, height, heading = _odometry(log, found)
    return Score(
        rmse=_rms(error[rows]),
        smooth=_rms(smoothed(error[rows], log)),
        average=float(mean @ v_mean / (v_mean @ v_mean)),
        drift=float(np.hypot(mean[0], mean[1])),
        nees=float(np.mean(nees(found.v[rows] - truth.v[rows], found.p[rows][:, 3:, 3:]))),
        tilt_deg=float(np.degrees(_rms1(tilt(log, found)[rows]))),
        way=way,
        odometry=gap / way,
        height=height,
        heading_deg=heading,
        integral=_integral(log, found) / way,
    )


def smoothed(error: Array, log: Log, seconds: float = WINDOW_S) -> Array:
    """Return the running mean of rows (n, 3) over so many seconds, where the window is whole."""
    rows = max(1, round(seconds / float(np.median(np.diff(log.seconds)))))
    if len(error) < rows:
        return error.mean(axis=0, keepdims=True)
    total = np.cumsum(np.vstack([np.zeros(3), error]), axis=0)
    return (total[rows:] - total[:-rows]) / rows


def nees(error: Array, p: Array) -> Array:
    """Return e^T P^-1 e of each row, (n,), of errors (n, 3) and covariances (n, 3, 3)."""
    return np.einsum("ni,ni->n", error, np.linalg.solve(p, error[..., None])[..., 0])


def tilt(log: Log, found: Track) -> Array:
    """Return the angle between estimated and true up, (n,) rad."""
    up, seen = log.up, found.g
    sine = np.linalg.norm(np.cross(up, seen), axis=1)
    return np.arctan2(sine, np.einsum("ni,ni->n", up, seen))


def base_pose(log: Log) -> tuple[Array, Array]:
    """Return true position (n, 3) m, world, and heading (n,) rad of base_link."""
    truth = log.known()
    base = np.einsum("nij,kj->nik", truth.rot, log.rot_base_from_imu)
    position = truth.position - np.einsum("nij,j->ni", base, log.imu_position)
    return position, np.unwrap(np.arctan2(base[:, 1, 0], base[:, 0, 0]))


def _span(log: Log) -> tuple[int, int]:
    rows = np.flatnonzero(log.scored)
    return int(rows[0]), int(rows[-1])


def _odometry(log: Log, found: Track) -> tuple[float, float, float, float]:
    """Return net way, horizontal error of the displacement, largest error of height, m, and of heading, deg."""
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
    """Return the gap between the integrated velocity and the odometry at the end, m."""
    first, last = _span(log)
    v, t = found.v_odom[first : last + 1], log.seconds[first : last + 1]
    way = np.sum(0.5 * (v[1:] + v[:-1]) * np.diff(t)[:, None], axis=0)
    gap = found.position[last] - found.position[first] - way
    return float(np.linalg.norm(gap))


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(x**2, axis=1))))


def _rms1(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))
