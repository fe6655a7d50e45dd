"""Footsteps of a biped, the ZMP reference through them, and the path of the swinging foot. Frame: odom, z up.

A foot is (x, y, yaw) of the point under its ankle. A step lasts T; in its first part d T both feet stand and the ZMP
moves from the foot that will swing to the other, then it rests there while the foot swings.
"""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.kernels.jit import kernel

LEFT, RIGHT = 0, 1


def placed(body: Array, side: int, width: float) -> Array:
    """Return the place of a foot `width` m beside a body pose, (3,): x, y (m), yaw (rad), odom.

    `body`: x, y (m), yaw (rad), odom, (3,); `side`: 0 = left, 1 = right.
    """
    y = width if side == LEFT else -width
    return np.array([body[0] - math.sin(body[2]) * y, body[1] + math.cos(body[2]) * y, body[2]])


def advanced(body: Array, forward: float, left: float, turn: float) -> Array:
    """Return a body pose after a turn, rad, and then a movement `forward` and `left`, m, along the new heading.

    `body` and result: x, y (m), yaw (rad), odom, (3,).
    """
    yaw = body[2] + turn
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([body[0] + c * forward - s * left, body[1] + s * forward + c * left, yaw])


@kernel
def support_point(foot: Array, side: int, ahead: float, inwards: float) -> Array:
    """Return the point at which the ZMP (zero-moment point) rests on a foot, (2,) m, odom.

    Args:
        foot: x, y (m), yaw (rad) of the point under its ankle, odom, (3,).
        side: 0 = left, 1 = right.
        ahead: distance forward from that point, m.
        inwards: distance from that point towards the other foot, m.
    """
    y = -inwards if side == 0 else inwards
    out = np.empty(2)
    c, s = math.cos(foot[2]), math.sin(foot[2])
    out[0] = foot[0] + c * ahead - s * y
    out[1] = foot[1] + s * ahead + c * y
    return out


@kernel
def reference(points: Array, ticks: Array, double: Array) -> Array:
    """Return the ZMP reference through support points: a ramp of `double[i]` ticks to point i + 1, then rest there.

    Args:
        points: (n + 1, 2) m, odom; the first is where the reference is now.
        ticks: (n,) length of each phase, ramp and rest, ticks.
        double: (n,) length of the ramp in each phase, ticks.

    Returns:
        ZMP (zero-moment point) in each tick, (sum of ticks, 2) m, odom.
    """
    total = 0
    for i in range(ticks.size):
        total += int(ticks[i])
    out = np.empty((total, 2))
    k = 0
    for i in range(ticks.size):
        for t in range(int(ticks[i])):
            s = 1.0 if t + 1 >= double[i] else (t + 1.0) / double[i]
            for a in range(2):
                out[k, a] = points[i, a] + s * (points[i + 1, a] - points[i, a])
            k += 1
    return out


@kernel
def smooth(s: float) -> float:
    """Return 10 s^3 - 15 s^4 + 6 s^5, s clipped to 0..1: from 0 to 1 with zero slope and curvature at the ends."""
    s = min(1.0, max(0.0, s))
    return s * s * s * (10.0 + s * (6.0 * s - 15.0))


@kernel
def swing(begin: Array, end: Array, s: float, lift: float) -> Array:
    """Return the foot at swing phase s in [0, 1], (4,): x, y (m), yaw (rad), height (m), with apex `lift` m midway.

    begin, end: x, y (m), yaw (rad) at lift-off and landing, odom, (3,).
    """
    out = np.empty(4)
    way = smooth(s)
    for i in range(3):
        out[i] = begin[i] + way * (end[i] - begin[i])
    up = math.sin(math.pi * min(1.0, max(0.0, s)))
    out[3] = lift * up * up
    return out


def between(feet: Array) -> Array:
    """Return the pose half way between two feet, (3,): x, y (m), yaw (rad); `feet` (2, 3): x, y, yaw of each, odom."""
    turn = math.atan2(math.sin(feet[1, 2] - feet[0, 2]), math.cos(feet[1, 2] - feet[0, 2]))
    return np.array([*(0.5 * (feet[0, :2] + feet[1, :2])), feet[0, 2] + 0.5 * turn])
