"""Logs of a trunk on four point feet whose motion a test writes as functions of time: no gait, no simulator."""

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from surefoot.geometry.constants import GRAVITY
from surefoot.lab.estimation.log import Log

CORNERS = np.array([(0.2, 0.15, 0.0), (0.2, -0.15, 0.0), (-0.2, 0.15, 0.0), (-0.2, -0.15, 0.0)])
HEIGHT = 0.3
PERIOD_S, EVERY = 0.005, 2

Motion = Callable[[np.ndarray], np.ndarray]
"""Function of times (n,) s that returns rows (n, 3): positions, m, or rotation vectors, rad."""


def smooth(x: np.ndarray) -> np.ndarray:
    """A step from 0 to 1 over x = 0..1, with zero rates and accelerations at both ends."""
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


def columns(*parts: np.ndarray | float) -> np.ndarray:
    """Rows (n, k) from columns (n,) or numbers."""
    return np.stack(np.broadcast_arrays(*parts), axis=1).astype(float)


def logged(
    seconds: float, position: Motion, turn: Motion, feet: Motion, contact: Motion, *, foot_sd: float = 4e-4,
    period_s: float = PERIOD_S,
) -> Log:  # fmt: skip
    """The log of such a motion, by exact means over each interval, with the noise of usual sensors.

    Args:
        seconds: duration.
        position: of the inertial unit in the world, m.
        turn: rotation vector of the inertial unit, rad.
        feet: of each time (m,), positions in the world (m, 4, 3), m; NaN: the place under the trunk, turned with it.
        contact: of each time (m,), flags (m, 4).
        foot_sd: noise of a foot's position, m.
        period_s: time between samples of the inertial unit, s; every second one has a sample of the feet.
    """
    t, rng = period_s * np.arange(round(seconds / period_s) + 1), np.random.default_rng(0)
    rot, place = Rotation.from_rotvec(turn(t)), position(t)
    w = (rot[:-1].inv() * rot[1:]).as_rotvec() / period_s
    h = 1e-4
    velocity = (position(t + h) - position(t - h)) / (2.0 * h)
    force = np.diff(velocity, axis=0) / period_s + np.array([0.0, 0.0, GRAVITY])
    q = Rotation.from_rotvec(turn(t[1:] - 0.5 * period_s)).inv().apply(force)
    at = np.arange(EVERY, len(t), EVERY)
    world, below = feet(t[at]), CORNERS - np.array([0.0, 0.0, HEIGHT])
    seen = np.stack([rot[at].inv().apply(world[:, f] - place[at]) for f in range(4)], axis=1)
    seen = np.where(np.isnan(seen), below, seen)
    ns = np.round(1e9 * t).astype(np.int64)
    return Log(
        "rigid", ns[1:], w + 0.005 * rng.standard_normal(w.shape) + np.array([0.01, -0.006, 0.004]),
        q + 0.05 * rng.standard_normal(q.shape), ns[at], seen + foot_sd * rng.standard_normal(seen.shape),
        np.broadcast_to(np.eye(3), (len(at), 4, 3, 3)).copy(), contact(t[at]).astype(bool),
    )  # fmt: skip


def standing(t: np.ndarray) -> np.ndarray:
    """Places of four feet that stand on level ground."""
    return np.broadcast_to(CORNERS, (len(t), 4, 3))


def all_closed(t: np.ndarray) -> np.ndarray:
    """Contacts of four feet that stand."""
    return np.ones((len(t), 4), dtype=bool)
