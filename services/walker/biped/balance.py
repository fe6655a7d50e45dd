"""What a biped does against disturbances: where the capture point is, where the foot has to land, when all is lost.

The robot is a stiff inverted pendulum over the foot it stands on: a trunk that is tilted by (roll, pitch) more than
planned carries the CoM beside the plan by d = (z sin pitch, -z sin roll), and its rate by d'. The capture point then
lies beside the plan's by d + d'/w, w = sqrt(g/z). Beyond the sole's edge e it runs away as
xi(t) = e + (xi - e) exp(w t) until the next foot lands: that foot has to follow (Pratt et al. 2006; Englsberger et al.
2011).
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import kernel

Array = NDArray[np.float64]


@kernel
def com_beside(tilt: Array, rate: Array, height: float, yaw: float) -> Array:
    """CoM beside the plan, (2, 2): position m and velocity m/s in odom.

    Args:
        tilt: (2,) roll and pitch beyond the plan, rad.
        rate: (2,) their rates, rad/s.
        height: of the CoM, m.
        yaw: heading of the trunk, rad.
    """
    out = np.empty((2, 2))
    c, s = math.cos(yaw), math.sin(yaw)
    for i in range(2):
        ahead = height * (math.sin(tilt[1]) if i == 0 else rate[1])
        left = -height * (math.sin(tilt[0]) if i == 0 else rate[0])
        out[i, 0] = c * ahead - s * left
        out[i, 1] = s * ahead + c * left
    return out


@kernel
def foothold_shift(offset: Array, omega: float, left_s: float, dead: float, growth: float) -> Array:
    """How far the landing has to move for the capture point at touch-down, (2,) m.

    Args:
        offset: CoM beside the plan, (2, 2).
        omega: sqrt(g/z), 1/s.
        left_s: time until touch-down.
        dead: length of the error that the ankles take, m.
        growth: part of the pendulum's growth until touch-down that is counted on, 0..1: ankles and sole slow it down.
    """
    x = offset[0, 0] + offset[1, 0] / omega
    y = offset[0, 1] + offset[1, 1] / omega
    size = math.hypot(x, y)
    out = np.zeros(2)
    if size > dead:
        part = (size - dead) / size * math.exp(growth * min(omega * left_s, 1.5))
        out[0], out[1] = part * x, part * y
    return out


def limited(shift: Array, yaw: float, longest: float) -> Array:
    """A shift within +-longest along and across the heading."""
    c, s = math.cos(yaw), math.sin(yaw)
    along = min(longest, max(-longest, c * shift[0] + s * shift[1]))
    across = min(longest, max(-longest, -s * shift[0] + c * shift[1]))
    return np.array([c * along - s * across, s * along + c * across])


def beside(foot: Array, stance: Array, swing: int, least: float) -> Array:
    """The landing (3,), moved outwards if it came nearer to the standing foot than `least` across: no crossing."""
    c, s = math.cos(stance[2]), math.sin(stance[2])
    across = -s * (foot[0] - stance[0]) + c * (foot[1] - stance[1])
    missing = max(0.0, least - across) if swing == 0 else min(0.0, -least - across)
    return np.array([foot[0] - s * missing, foot[1] + c * missing, foot[2]])
