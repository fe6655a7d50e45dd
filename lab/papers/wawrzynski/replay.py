"""A whole log through the estimators, and what they score against truth."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surefoot.lab.estimation.log import Log
from surefoot.services.estimator.estimator import Estimator
from surefoot.services.estimator.inertial import GRAVITY

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Replay:
    """Every estimate at every IMU row (n)."""

    v: dict[str, Array]  # name -> (n, 3) m/s, IMU axes
    g: Array  # (n, 3) m/s^2, of `ekf`
    p: Array  # (n, 6, 6) covariance of (g, v), of `ekf`
    position: Array  # (n, 3) m, odometry
    yaw: Array  # (n,) rad, odometry
    covariance: Array  # (n, 4, 4) of x, y, z, yaw, odometry


def replay(log: Log, estimator: Estimator) -> Replay:
    """Feed a log in the order of its stamps: each foot sample after the first IMU row at or after it."""
    n, names = len(log.stamp_ns), list(estimator.filters)
    out = Replay(
        {name: np.zeros((n, 3)) for name in names},
        np.zeros((n, 3)),
        np.zeros((n, 6, 6)),
        np.zeros((n, 3)),
        np.zeros(n),
        np.zeros((n, 4, 4)),
    )
    waiting = iter(log.feet)
    feet = next(waiting, None)
    for k, stamp in enumerate(log.stamp_ns.tolist()):
        estimator.on_imu(stamp, log.w[k], log.q[k])
        while feet is not None and feet.stamp_ns <= stamp:
            estimator.on_feet(feet)
            feet = next(waiting, None)
        for name in names:
            out.v[name][k] = estimator.filters[name].v
        ekf, pose = estimator.estimate("ekf"), estimator.pose()
        out.g[k], out.p[k] = estimator.filters["ekf"].g, ekf.covariance
        out.position[k], out.yaw[k], out.covariance[k] = pose.position, pose.yaw, pose.covariance
    return out


@dataclass(frozen=True)
class Score:
    """One estimator against truth."""

    rmse: float  # m/s, length of the velocity error, rms
    average: float  # error of the mean world velocity along the track, share of it (0.08 = 8 %)
    drift: float  # m/s, horizontal error of the mean world velocity


def score(log: Log, v: Array, begin_s: float, end_s: float = 0.1) -> Score:
    """Score of v (n, 3) in IMU axes from `begin_s` after the start to `end_s` before the end."""
    t = 1e-9 * (log.stamp_ns - log.stamp_ns[0])
    rows = (t >= begin_s) & (t <= t[-1] - end_s)
    error = np.einsum("nij,nj->ni", log.rot[rows], v[rows]) - log.v_world[rows]
    mean, truth = error.mean(axis=0), log.v_world[rows].mean(axis=0)
    return Score(
        float(np.sqrt(np.mean(np.sum(error**2, axis=1)))),
        float(mean @ truth / (truth @ truth)),
        float(np.hypot(mean[0], mean[1])),
    )


def tilt_errors(log: Log, g: Array) -> Array:
    """Angle between estimated and true up, (n,) rad."""
    true, seen = log.up / GRAVITY, g / np.linalg.norm(g, axis=1)[:, None]
    return np.arcsin(np.clip(np.linalg.norm(np.cross(true, seen), axis=1), 0.0, 1.0))
