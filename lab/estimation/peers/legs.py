"""Kinematics and gyro without a filter: a referee (estimator to compare with) without noise or standstill.

Velocity of the IMU by each foot that stands in two samples in a row, y its position in IMU axes, and their mean:

    v = -(y' + w x y)          (y' by differences, w the mean gyro in between)

Attitude by the gyro, kept upright by the accelerometer; heading is that of the gyro. The path is the integral of v.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY

from ..log import Log
from .inekf import PeerTrack, at_rest
from .linear import LinearNoise, linear

SIGMA = 0.05  # m/s, stated error of the velocity: what the paper's kinematics state
TILT = 0.02  # rad, stated error of the attitude


def path(log: Log, v: Array, rot: Array) -> Array:
    """Return the path of the IMU at each row, (n, 3) m, world: the integral of its velocity.

    v: (n, 3) m/s, IMU axes; rot: rotation from IMU to world, (n, 3, 3).
    """
    steps = np.diff(log.seconds, prepend=log.seconds[0])
    return np.cumsum(np.einsum("nij,nj->ni", rot, v) * steps[:, None], axis=0)


def attitude(log: Log) -> Array:
    """Return the rotation from IMU to world at each inertial row, (n, 3, 3), by gyro and accelerometer of the log."""
    return linear(log, LinearNoise()).rot


def foot_velocities(log: Log) -> Array:
    """Return the velocity of the IMU by the standing feet, (m, 3) m/s, IMU axes; NaN where none stands."""
    stamps = 1e-9 * (log.foot_ns - log.stamp_ns[0])
    rest, _, _ = at_rest(log)
    w = log.w - (0.0 if rest is None else rest)
    turned = np.vstack([np.zeros(3), np.cumsum(w[1:] * np.diff(log.seconds)[:, None], axis=0)])
    at = np.stack([np.interp(stamps, log.seconds, turned[:, i]) for i in range(3)], axis=1)
    d = np.maximum(np.diff(stamps), 1e-9)[:, None, None]
    y, before = log.foot_position[1:], log.foot_position[:-1]
    v = -((y - before) + np.cross(np.diff(at, axis=0)[:, None], 0.5 * (y + before))) / d
    stands = log.contact[1:] & log.contact[:-1] & np.isfinite(v).all(axis=2)
    count = stands.sum(axis=1)[:, None]
    out = np.full((len(stamps), 3), np.nan)
    total = np.where(stands[..., None], v, 0.0).sum(axis=1)
    out[1:] = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return out


def legs(log: Log) -> PeerTrack:
    """Return the track of a log by its standing feet, without a filter; the velocity is held between foot samples."""
    n, known = len(log.stamp_ns), foot_velocities(log)
    good = np.flatnonzero(np.isfinite(known).all(axis=1))
    rot = attitude(log)
    v = np.zeros((n, 3))
    last = np.searchsorted(log.foot_ns[good], log.stamp_ns, side="right") - 1
    v[last >= 0] = known[good[last[last >= 0]]]
    p = np.repeat(np.diag([(TILT * GRAVITY) ** 2] * 3 + [SIGMA**2] * 3)[None], n, axis=0)
    return PeerTrack(v, GRAVITY * rot[:, 2, :], p, path(log, v, rot), rot)


def gyro_attitude(log: Log, first: int = 0) -> Array:
    """Return the rotation from IMU to world at inertial rows from `first` on, (n - first, 3, 3), by the gyro alone.

    It begins with the true attitude of row `first`, or without truth with that of gravity. The gyro's bias is the mean
    of the standstill where there is one; the tilt is not corrected.
    """
    rest, _, _ = at_rest(log)
    steps = np.diff(log.seconds, prepend=log.seconds[0])[:, None]
    turns = Rotation.from_rotvec((log.w - (0.0 if rest is None else rest)) * steps)
    now = Rotation.from_matrix(attitude(log)[first] if log.truth is None else log.truth.rot[first])
    out = [now.as_matrix()]
    for k in range(first + 1, len(steps)):
        now = now * turns[k]
        out.append(now.as_matrix())
    return np.array(out)


def inertial_velocity(log: Log, first: int) -> Array:
    """Return the velocity of the IMU at rows from `first` on, (n - first, 3) m/s, world, by inertial samples alone.

    The integral begins with the true velocity of row `first`. Biases are the means of the standstill at the beginning.
    """
    truth, up = log.known(), np.array([0.0, 0.0, GRAVITY])
    rest, force, _ = at_rest(log)
    bias = np.zeros(3) if rest is None else force - truth.rot[0].T @ up
    push = np.einsum("nij,nj->ni", gyro_attitude(log, first), log.q[first:] - bias) - up
    steps = np.diff(log.seconds[first:], prepend=log.seconds[first])[:, None]
    return truth.v_world[first] + np.cumsum(push * steps, axis=0)
