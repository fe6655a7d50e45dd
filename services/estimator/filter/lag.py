"""Samples of the feet that come with late stamps, by their motion beside that of the inertial unit.

The joints show the velocity p = v + R (w x y) of the trunk beside its own turning, odom axes, y the foot seen from the
IMU. Stamped late by t, they show it as it was, so that the velocity u of the trunk by a standing foot is off by
-t dp/dt, where the inertial unit shows v and w in time. With both forgotten in T since the foot landed,

    e = exp(-d/T) e + (u - v)_k - (u - v)_(k-1),   h = exp(-d/T) h + (dp/dt)_k - (dp/dt)_(k-1)
    t = -S(e h) / S(h h),   share of e that it explains = S(e h)^2 / (S(e e) S(h h))

with sums S over all feet and some time, level axes before the vertical, in which feet land.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import kernel

from .layout import S
from .noise import FIXED

Array = NDArray[np.float64]


class LagLayout(NamedTuple):
    """Columns of a foot's row of `BestState.sensors` from `SensorLayout.ahead` on."""

    shown: int = 0
    """u at the middle of the last step and what the inertial unit gained since, (3,) m/s."""
    moved: int = 3
    """R (w x y) there less that, (3,) m/s."""
    rate: int = 6
    """dp/dt, (3,) m/s^2."""
    strange: int = 9
    """e, (3,) m/s."""
    due: int = 12
    """h, (3,) m/s^2."""
    sums: int = 15
    """Integrals of e h, h h, e e and 1 over the time that the foot stood, faded, (4,)."""
    stood: int = 19
    """Samples in a row at which it stood."""


L = LagLayout()


@kernel
def lift_lag(row: Array, share: float) -> None:
    """Fade by `share` what one foot has shown that does not stand any more, in place; see `learn_lag`."""
    row[S.ahead + L.stood] = 0.0
    for i in range(4):
        row[S.ahead + L.sums + i] *= share


@kernel
def learn_lag(row: Array, trunk: Array, gained: Array, swung: Array, dt: float, share: float) -> None:
    """Learn from two samples of one foot that stands, in place; from the third in a row on they are compared.

    Args:
        row: of the foot in `BestState.sensors`.
        trunk: velocity of the trunk, u, (3,) m/s.
        gained: its change between them by the inertial unit, (3,) m/s.
        swung: R (w x y), (3,) m/s.
        dt: time between them, s.
        share: exp(-dt / `lag_s`).
    """
    lag, fade = row[S.ahead :], math.exp(-dt / FIXED.lag_forget_s)
    sums, lag[L.stood] = lag[L.sums : L.sums + 4], lag[L.stood] + 1.0
    for i in range(4):
        sums[i] *= share
    for i in range(3):
        off, way = trunk[i] - 0.5 * gained[i], swung[i] + 0.5 * gained[i]
        change, rate = off - lag[L.shown + i], (way - lag[L.moved + i]) / dt
        lag[L.shown + i], lag[L.moved + i] = off + gained[i], way - gained[i]
        lag[L.strange + i] = fade * lag[L.strange + i] + change
        lag[L.due + i] = fade * lag[L.due + i] + rate - lag[L.rate + i]
        lag[L.rate + i] = rate
        if lag[L.stood] < 3.0 or not abs(change) < FIXED.most_strange:
            lag[L.strange + i] = lag[L.due + i] = 0.0
    if lag[L.stood] >= 3.0:
        for i in range(3):
            weight, e, h = FIXED.lag_vertical if i == 2 else 1.0, lag[L.strange + i], lag[L.due + i]
            sums[0] += weight * dt * e * h
            sums[1] += weight * dt * h * h
            sums[2] += weight * dt * e * e
        sums[3] += dt


@kernel
def lag_of(sensors: Array) -> float:
    """Return the time by which the stamps of all feet are late, s, 0 where it is not sure; below 0: they are early.

    Args:
        sensors: of each foot, see `SensorLayout`.
    """
    along = square = strange = stood = 0.0
    for f in range(sensors.shape[0]):
        sums = sensors[f, S.ahead + L.sums : S.ahead + L.sums + 4]
        along, square, strange, stood = along + sums[0], square + sums[1], strange + sums[2], stood + sums[3]
    if stood < FIXED.lag_least_s or along * along <= FIXED.lag_share * square * strange:
        return 0.0
    late = -along / square
    if late * late * square < FIXED.lag_speed**2 * stood or not FIXED.least_lag < abs(late) < FIXED.most_lag_s:
        return 0.0
    return late


@kernel
def forget_lag(sensors: Array) -> None:
    """Forget what the feet have shown of late stamps, in place; `sensors` as in `BestState`, (..., K, columns)."""
    sensors[..., S.ahead + L.sums : S.ahead + L.sums + 4] = 0.0
