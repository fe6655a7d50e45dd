"""Velocity error of dead reckoning by the inertial unit alone: the bound of an estimate whose feet come late."""

import numpy as np

from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.rotations import matrix_from_rotvec, rotvec_from_matrix

from .log import Log

STARTS = 200
"""Number of inertial rows, evenly spread over a log, from each of which a dead reckoning starts; rounding adds up to as
many again."""


def blind_error(log: Log, seconds: float) -> float:
    """Return the rms error of the velocity after dead reckoning by the inertial unit for `seconds` s, m/s.

    Each stretch begins with the true attitude and velocity, and the mean error of the samples is removed, so that only
    their noise is left. An estimate that lacks the feet of the last `seconds` s cannot add less error than this.
    """
    truth, t = log.known(), log.seconds
    up = np.array([0.0, 0.0, GRAVITY])
    step = np.diff(t)[:, None]
    turn = np.stack([rotvec_from_matrix(a.T @ b) for a, b in zip(truth.rot[:-1], truth.rot[1:], strict=True)])
    middle = np.stack([a @ matrix_from_rotvec(0.5 * b) for a, b in zip(truth.rot[:-1], turn, strict=True)])
    force = np.einsum("nji,nj->ni", middle, np.diff(truth.v_world, axis=0) / step + up)
    w = log.w[1:] - (log.w[1:] - turn / step).mean(axis=0)
    q = log.q[1:] - (log.q[1:] - force).mean(axis=0)
    scored = np.flatnonzero(log.scored)
    scored = scored[t[scored] + seconds < t[scored[-1]]]
    errors: list[float] = []
    for first in scored[:: max(1, len(scored) // STARTS)].tolist():
        last = int(np.searchsorted(t, t[first] + seconds - 1e-6))
        rot, v = truth.rot[first], truth.v_world[first]
        for k in range(first, last):
            d = float(step[k, 0])
            v = v + d * (rot @ matrix_from_rotvec(0.5 * d * w[k]) @ q[k] - up)
            rot = rot @ matrix_from_rotvec(d * w[k])
        errors.append(float(np.sum((v - truth.v_world[last]) ** 2)))
    return float(np.sqrt(np.mean(errors)))
