"""Closed-form inverse kinematics of roll-pitch-pitch legs: two parallel joint axes perpendicular to the first one."""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.rotations import wrap_angle
from surefoot.kernels.jit import kernel

from .description import RolledLegs

REACH_SLACK = 1e-9
"""Tolerance of the cosine of the knee angle, no unit, and of the foot's distance from the first axis, m; a point that
exceeds it counts as out of reach."""


@kernel
def rolled_ik(legs: RolledLegs, leg: int, p_base: Array, middle: Array) -> tuple[Array, bool]:
    """Return the joint angles of a roll-pitch-pitch leg that bring the foot centre to `p_base`.

    (x, y, z) = R' (p_base - hip), w = s_z sqrt(y^2 + z^2 - b^2), q1 = atan2(z, y) - atan2(w, b),
    u = x, v = w - h, cos k = (u^2 + v^2 - f^2 - t^2) / (2 f t), k = s_k acos(cos k),
    q2 = atan2(u, v) - atan2(t sin k, f + t cos k) - rest_f, q3 = s_t (k - rest_k),
    with b and h the offsets of the foot along y and of the femur joint along z, f and t the lengths of femur and tibia,
    R, signs s and rest angles those of `RolledLegs`.

    Args:
        legs: geometry of the legs.
        leg: index of the leg.
        p_base: foot centre in base_link, (3,) m.
        middle: middles of the joints' ranges, (3,) rad; each angle is returned within pi of it.

    Returns:
        The angles (3,) rad, approximate if the point is too near or too far, without regard to joint limits, and
        whether the point is reached. NaN lengths (no closed form) give False.
    """
    beside, above = legs.offset[leg, 0], legs.offset[leg, 1]
    f, t = legs.segment[leg, 0], legs.segment[leg, 1]
    along, bend, turn = legs.side[leg, 0], legs.side[leg, 1], legs.side[leg, 2]
    d, local = np.empty(3), np.empty(3)
    for k in range(3):
        d[k] = p_base[k] - legs.hip[leg, k]
    for k in range(3):
        local[k] = legs.rot[leg, 0, k] * d[0] + legs.rot[leg, 1, k] * d[1] + legs.rot[leg, 2, k] * d[2]
    x, y, z = local[0], local[1], local[2]
    square = y * y + z * z - beside * beside
    reached = square >= -REACH_SLACK * abs(beside)
    w = along * math.sqrt(max(0.0, square))
    v = w - above
    cos_knee = (x * x + v * v - f * f - t * t) / (2.0 * f * t)
    reached = reached and abs(cos_knee) <= 1.0 + REACH_SLACK
    cos_knee = min(1.0, max(-1.0, cos_knee))
    knee = bend * math.acos(cos_knee)
    q = np.empty(3)
    q[0] = math.atan2(z, y) - math.atan2(w, beside)
    q[1] = math.atan2(x, v) - math.atan2(t * math.sin(knee), f + t * cos_knee) - legs.rest[leg, 0]
    q[2] = turn * (knee - legs.rest[leg, 1])
    for k in range(3):
        q[k] = middle[k] + wrap_angle(q[k] - middle[k])
    return q, reached
