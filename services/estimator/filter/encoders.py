"""Encoders of the legs: which of them jump, stand still or are swapped with another foot's.

Jump: a foot follows a smooth path, so that of the three steps between four samples at equal times the middle one is the
mean of the others, unless an encoder jumps. A sudden motion of the trunk looks alike at a standing foot, so the motion
of the trunk by the inertial unit is subtracted there. Swap: each of two feet jumps to where the other was. Still: a
foot on the ground repeats one sample to the bit while the robot turns and other feet do not repeat theirs; or all feet
repeat theirs for longer than slow encoders do, while the rate of the robot also differs from its mean of the last
second (as its bias may be wrong).
"""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.linear_kernels import times, turned
from surefoot.kernels.jit import kernel

from .layout import S
from .noise import FIXED
from .samples import ROW_Q, ROW_W, SampleStore, after
from .state import turn_matrix


@kernel
def _apart(feet: Array, row: int, f: int, before: int, g: int) -> float:
    """Return the squared distance, m^2, of foot f in row `row` of feet (N, L, 3) m from foot g in row `before`."""
    square = 0.0
    for i in range(3):
        square += (feet[row, f, i] - feet[before, g, i]) ** 2
    return square


@kernel
def unknown(feet: Array, row: int, f: int) -> bool:
    """Return True if foot f in a row of feet (N, L, 3) m is all zeros, which marks a position that was not finite."""
    return bool(feet[row, f, 0] == 0.0 and feet[row, f, 1] == 0.0 and feet[row, f, 2] == 0.0)


@kernel
def exchanged(feet: Array, row: int, f: int) -> int:
    """Return the foot with which foot f changed places between rows `row` - 1 and `row`, or -1 if it did not.

    `feet`: positions, (N, L, 3) m, IMU axes.
    """
    if row < 1 or unknown(feet, row, f) or unknown(feet, row - 1, f):
        return -1
    way = _apart(feet, row, f, row - 1, f)
    if way < 4.0 * FIXED.jump**2:
        return -1
    for g in range(feet.shape[1]):
        if unknown(feet, row, g) or unknown(feet, row - 1, g):
            continue
        crossed = _apart(feet, row, f, row - 1, g) + _apart(feet, row, g, row - 1, f)
        if g != f and crossed < FIXED.crossed * (way + _apart(feet, row, g, row - 1, g)):
            return g
    return -1


@kernel
def _bend(samples: SampleStore, row: int, f: int) -> float:
    """Return how far the middle one of the last three steps of a foot that stands is from the mean of the others, m.

    The motion of the trunk is subtracted. Let D be the path of the IMU by its accelerations, as if from rest and
    without gravity, and C its turn, both since the first of four samples k at the times t_k. The places D_k + C_k y_k
    of a foot that stands, y_k as seen from the IMU, lie on a parabola of the time, by its velocity and gravity. Their
    third divided difference is zero, and 3 h^3 times it is the distance for three steps of length h.

    Args:
        samples: stored samples, filled rows only.
        row: index of the sample of the feet, the last of the four.
        f: index of the foot.
    """
    stamps, now = samples.imu_stamps, samples.feet_stamps[row - 3]
    at, size = after(stamps, now), stamps.size
    if size == 0:
        return math.inf
    turn, vel, way, places, t = np.eye(3), np.zeros(3), np.zeros(3), np.empty((4, 3)), np.zeros(4)
    for k in range(4):
        end = samples.feet_stamps[row - 3 + k]
        t[k] = 1e-9 * (end - samples.feet_stamps[row - 3])
        while now < end:
            held = min(at, size - 1)  # the mean up to its stamp; the last one goes on
            until = min(end, stamps[at]) if at < size else end
            dt = 1e-9 * (until - now)
            push = turned(turn, samples.imu[held, ROW_Q : ROW_Q + 3])
            way += dt * (vel + 0.5 * dt * push)
            vel += dt * push
            turn = times(turn, turn_matrix(dt * samples.imu[held, ROW_W : ROW_W + 3]))
            now, at = until, at + (until == stamps[held])
        places[k] = way + turned(turn, samples.feet[row - 3 + k, f])
    for order in range(1, 4):
        for k in range(3, order - 1, -1):
            places[k] = (places[k] - places[k - 1]) / (t[k] - t[k - order])
    return 3.0 * (t[3] / 3.0) ** 3 * math.sqrt(places[3, 0] ** 2 + places[3, 1] ** 2 + places[3, 2] ** 2)


@kernel
def jumped(samples: SampleStore, row: int, f: int, point: int, leap: float) -> float:
    """Return by how far the encoders of foot f jumped between rows `row` - 2 and `row` - 1, m; 0: they did not.

    A jump is found only among samples at equal steps, and in slow samples only of feet that stand, for a foot that
    lands may be thrown. A value below 0: the switch changed in that step, as where a model of a leg lands its foot.

    Args:
        samples: stored samples, filled rows only.
        row: index of the sample of the feet.
        f: index of the foot.
        point: index of one of its contact points.
        leap: distance by which the foot usually jumps as its switch changes, m. If that is far, only the step of the
            jump is examined, and not those beside it.
    """
    stamps, feet, contact, off = samples.feet_stamps, samples.feet, samples.contact, 0.0
    if row < 3 or unknown(feet, row - 1, f) or unknown(feet, row - 2, f):
        return 0.0
    for i in range(3):
        a, b, c, d = feet[row - 3, f, i], feet[row - 2, f, i], feet[row - 1, f, i], feet[row, f, i]
        off += (c - b - 0.5 * (b - a + d - c)) ** 2
    if not off > FIXED.jump**2:
        return 0.0
    least, most = stamps[row] - stamps[row - 1], stamps[row] - stamps[row - 1]
    stands, flies, beside = True, True, 0.0
    for i in range(row - 3, row):
        if exchanged(feet, i + 1, f) >= 0:
            return 0.0
        least, most = min(least, stamps[i + 1] - stamps[i]), max(most, stamps[i + 1] - stamps[i])
        beside = max(beside, _apart(feet, i + 1, f, i, f))
    for i in range(row - 3, row + 1):
        stands, flies = stands and contact[i, point] >= 0.5, flies and not contact[i, point] >= 0.5
    even, fast = 2 * most <= 3 * least, 1e-9 * most <= FIXED.fly_step
    lands = (contact[row - 2, point] >= 0.5) != (contact[row - 1, point] >= 0.5)
    alone = beside < 4.0 * _apart(feet, row - 1, f, row - 2, f)
    if even and fast and lands and alone:
        return -math.sqrt(off)
    shown = 1e-9 * most <= FIXED.stand_step if stands else fast and (flies or alone)
    if lands or not even or not shown:
        return 0.0
    if (leap > 2.0 * FIXED.jump and not alone) or (stands and not _bend(samples, row, f) > FIXED.jump):
        return 0.0
    return math.sqrt(off)


@kernel
def learn_repeats(sensors: Array, samples: SampleStore, row: int, contact: Array, turn: float, beside: float) -> None:
    """Update for how long each foot has repeated one sample, and how far the IMU turned meanwhile, in place.

    Args:
        sensors: numbers of the sensors of each foot, (K, 38), columns as in `SensorLayout`; changed.
        samples: stored samples, filled rows only.
        row: index of the sample of the feet, 1 at least.
        contact: probability that each foot touches the ground, (L,).
        turn: rate of the IMU without its bias, rad/s.
        beside: difference of the rate of the IMU from its mean of the last second, rad/s.
    """
    count, together = samples.feet.shape[1], True
    step = min(1e-9 * (samples.feet_stamps[row] - samples.feet_stamps[row - 1]), FIXED.longest_repeat)
    for f in range(count):
        if unknown(samples.feet, row, f) or _apart(samples.feet, row, f, row - 1, f) > 0.0:
            together = False
            sensors[f, S.held] = sensors[f, S.repeated] = 0.0
        else:
            sensors[f, S.held] += step
    turn = min(turn, beside) if together else turn  # the bias may be wrong where nothing moves
    for f in range(count):
        if sensors[f, S.held] > 0.0 and turn > FIXED.turning and (together or contact[f] >= 0.5):
            sensors[f, S.repeated] += turn * step
        if sensors[f, S.repeated] > FIXED.most_repeated and not (together and sensors[f, S.held] < FIXED.longest_held):
            sensors[f, S.still] = 1.0
