"""Delay of the stamps of the feet, from the motion of the feet compared with that of the inertial unit.

The joints show the velocity p = v + R (w x y) of the trunk beside its own turning, odom axes, y the foot seen from the
IMU. Stamped late by t, they show it as it was, so that the velocity u of the trunk by a standing foot is off by
-t dp/dt, where the inertial unit shows v and w in time. With both forgotten in T since the foot landed,

    e = exp(-d/T) e + (u - v)_k - (u - v)_(k-1),   h = exp(-d/T) h + (dp/dt)_k - (dp/dt)_(k-1)
    t = -S(e h) / S(h h),   share of e that it explains = S(e h)^2 / (S(e e) S(h h))

with sums S over all feet and the last second or so. Level axes count more than the vertical, along which feet land.
"""

import math

from surefoot.arrays import Array
from surefoot.kernels.jit import kernel

from .layout import L, S
from .noise import FIXED


@kernel
def lift_delay(row: Array, share: float) -> None:
    """Scale down the sums that show late stamps of a foot while it is off the ground, in place.

    Args:
        row: numbers of the sensors of this foot, one row of `BestState.sensors`, (38,); changed.
        share: factor of the sums, 0 to 1.
    """
    row[S.delay + L.stood] = 0.0
    for i in range(4):
        row[S.delay + L.sums + i] *= share


@kernel
def learn_delay(row: Array, trunk: Array, gained: Array, swung: Array, dt: float, share: float) -> None:
    """Learn the delay of the stamps from two successive samples of one standing foot, in place.

    Samples count from the third in a row on. All velocities are in odom axes.

    Args:
        row: numbers of the sensors of this foot, one row of `BestState.sensors`, (38,); changed.
        trunk: velocity u of the trunk by the foot, from the change of its place, (3,) m/s.
        gained: change of the trunk's velocity between the samples by the inertial unit, (3,) m/s.
        swung: R (w x y), velocity of the foot y by the turn w of the trunk, R its attitude, (3,) m/s.
        dt: time between the samples, s.
        share: factor by which older sums fade in this step, 0 to 1.
    """
    own, fade = row[S.delay :], math.exp(-dt / FIXED.delay_forget_s)
    sums, own[L.stood] = own[L.sums : L.sums + 4], own[L.stood] + 1.0
    for i in range(4):
        sums[i] *= share
    for i in range(3):
        off, way = trunk[i] - 0.5 * gained[i], swung[i] + 0.5 * gained[i]
        change, rate = off - own[L.shown + i], (way - own[L.moved + i]) / dt
        own[L.shown + i], own[L.moved + i] = off + gained[i], way - gained[i]
        own[L.strange + i] = fade * own[L.strange + i] + change
        own[L.due + i] = fade * own[L.due + i] + rate - own[L.rate + i]
        own[L.rate + i] = rate
        if own[L.stood] < 3.0 or not abs(change) < FIXED.most_strange:
            own[L.strange + i] = own[L.due + i] = 0.0
    if own[L.stood] >= 3.0:
        for i in range(3):
            weight, e, h = FIXED.delay_vertical if i == 2 else 1.0, own[L.strange + i], own[L.due + i]
            sums[0] += weight * dt * e * h
            sums[1] += weight * dt * h * h
            sums[2] += weight * dt * e * e
        sums[3] += dt


@kernel
def delay_of(sensors: Array) -> float:
    """Return the time by which the stamps of all feet are late, s, 0 if not certain; below 0: they are early.

    Args:
        sensors: numbers of the sensors of each foot, (K, 38), mixed units, columns as in `SensorLayout`.
    """
    along = square = strange = stood = 0.0
    for f in range(sensors.shape[0]):
        sums = sensors[f, S.delay + L.sums : S.delay + L.sums + 4]
        along, square, strange, stood = along + sums[0], square + sums[1], strange + sums[2], stood + sums[3]
    if stood < FIXED.delay_least_s or along * along <= FIXED.delay_share * square * strange:
        return 0.0
    late = -along / square
    if late * late * square < FIXED.delay_speed**2 * stood or not FIXED.least_delay_s < abs(late) < FIXED.most_delay_s:
        return 0.0
    return late


@kernel
def forget_delay(sensors: Array) -> None:
    """Forget what the feet have shown of late stamps, in place.

    Args:
        sensors: numbers of the sensors of each foot, (..., K, 38), columns as in `SensorLayout`; changed.
    """
    sensors[..., S.delay + L.sums : S.delay + L.sums + 4] = 0.0
