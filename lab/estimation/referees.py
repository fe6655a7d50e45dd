"""Referees (estimators of others, for comparison) on logs: invariant and linear filter, legs alone, those of GTSAM."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from surefoot.arrays import Array
from surefoot.errors import SurefootError

from .contacts import without_rolling
from .log import Log
from .peers.legged import KINDS, LeggedNoise, installed, legged
from .peers.legs import gyro_attitude, legs
from .track import PEERS, Track, names, of_world, track

KNOWN = (*names(), *PEERS, "legs", *KINDS)
"""Names of all estimators that `run` knows."""
UNTUNED = ("inekf", "linear", "kinematics", "kinematics_gyro", "legs", *KINDS)
"""Names of the referees whose noise is not tuned for a log."""


def available(chosen: tuple[str, ...]) -> tuple[str, ...]:
    """Return those of the names `chosen` whose estimators are installed."""
    return tuple(name for name in chosen if name not in KINDS or installed())


def run(name: str, log: Log, options: Mapping[str, Any] | None = None) -> Track:
    """Return the track of one estimator over a log.

    Referees, estimators of others that ours is compared with, get round feet as points that rest.

    Args:
        name: an estimator of the service or a referee, one of `KNOWN`.
        log: what to run over.
        options: changes of parameters of the estimator or noises of the referee, by name; `legs` has none.

    Raises:
        SurefootError: there is no such estimator, or its package is not installed.
    """
    if name not in KNOWN:
        raise SurefootError("invalid", f"got {name!r}; known are {', '.join(KNOWN)}", "estimator")
    if name in KINDS and not installed():
        raise SurefootError("invalid", f"{name} needs GTSAM: pip install gtsam", "estimator")
    more = dict(options or {})
    if name in PEERS:
        return track(name, without_rolling(log), **more)
    if name == "legs":
        return of_world(name, log, legs(without_rolling(log)))
    if name in KINDS:
        return of_world(name, log, legged(name, without_rolling(log), LeggedNoise(**more)))
    return track(name, log, **more)


def gyro_yaw(log: Log) -> Array:
    """Return the heading of base_link by the gyro alone, (n,) rad."""
    base = np.einsum("nij,kj->nik", gyro_attitude(log), log.rot_base_from_imu)
    return np.unwrap(np.arctan2(base[:, 1, 0], base[:, 0, 0]))
