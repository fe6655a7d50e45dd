"""How far inside the workspace of a three-joint leg a foot point lies, without a trigonometric function per point.

The same closed form as `surefoot.kinematics.leg_ik` (yaw-pitch-pitch, knee up), turned round: instead of joint angles
it gives the distance from the point to the nearest edge of the workspace, which is the reach margin in metres.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.jit import row_kernel
from surefoot.robot import KinematicModel

Array = NDArray[np.float64]
LEG_NUMBERS = 21
"""Length of the table of one leg, see `leg_table`."""
OUTSIDE = -1.0
"""Margin of a point that cannot be reached."""
SLACK = 1e-9
"""m and 1: a point on the edge counts as inside, as in the closed-form solution."""


def leg_table(model: KinematicModel, leg: int) -> Array:
    """The leg as numbers for the kernels, (LEG_NUMBERS,).

    0-2 hip, 3-4 cos and sin of the heading, 5-7 coxa, femur, tibia; 8-11 cos, sin of the coxa's lower and upper
    limit; 12 whether the coxa's range exceeds 180 deg; 13-16 the same for the femur, 17 its flag; 18-19 smallest and
    largest distance of the foot from the femur joint; 20 whether the knee may bend at all. NaN lengths (a leg without
    closed form) make every point unreachable.
    """
    hip, psi = model.hip[leg, :3], float(model.hip[leg, 3])
    coxa, femur, tibia = (float(value) for value in model.segment[leg])
    table = np.full(LEG_NUMBERS, np.nan)
    if not np.isfinite([coxa, femur, tibia]).all():
        return table
    joints = model.leg_joints[leg]
    low, high = model.lower[joints], model.upper[joints]
    table[0:3] = hip
    table[3:5] = math.cos(psi), math.sin(psi)
    table[5:8] = coxa, femur, tibia
    for start, j in ((8, 0), (13, 1)):
        table[start : start + 4] = math.cos(low[j]), math.sin(low[j]), math.cos(high[j]), math.sin(high[j])
        table[start + 4] = float(high[j] - low[j] > math.pi)
    bent, straight = max(float(low[2]), -math.pi), min(float(high[2]), 0.0)  # knee up: q3 in [-pi, 0]
    for k, knee in ((18, bent), (19, straight)):
        table[k] = math.sqrt(max(femur**2 + tibia**2 + 2.0 * femur * tibia * math.cos(knee), 0.0))
    table[20] = float(bent <= straight)
    return table


@row_kernel
def _sector(x: float, y: float, limits: Array, start: int) -> float:
    """Signed distance of (x, y) from the two rays that bound a sector of angles; > 0 inside."""
    low = limits[start] * y - limits[start + 1] * x
    high = limits[start + 3] * x - limits[start + 2] * y
    return max(low, high) if limits[start + 4] > 0.5 else min(low, high)


@row_kernel
def _arc(r: float, z: float, cos: float, sin: float, femur: float, tibia: float) -> float:
    """Distance of (r, z) from the arc the foot draws with the femur held at one limit; inf beyond the arc."""
    ex, ez = r - femur * cos, z - femur * sin
    if cos * ez - sin * ex > 0.0:  # the nearest point of the circle has its knee down
        return math.inf
    return abs(math.sqrt(ex * ex + ez * ez) - tibia)


@row_kernel
def solve(leg: Array, px: float, py: float, pz: float, out: Array) -> float:
    """Reach margin of a foot centre in base_link and the two inner joints.

    Args:
        leg: table of the leg.
        px: foot centre, base_link, m.
        py: as px.
        pz: as px.
        out: receives the femur joint and the knee in base_link, (6,) m, when the point is in reach.

    Returns:
        Distance to the nearest edge of the workspace, m (never more than the true one near corners), or OUTSIDE.
    """
    dx, dy, z = px - leg[0], py - leg[1], pz - leg[2]
    x = leg[3] * dx + leg[4] * dy
    y = leg[3] * dy - leg[4] * dx
    coxa, femur, tibia = leg[5], leg[6], leg[7]
    radius = math.sqrt(x * x + y * y)
    yaw_margin = _sector(x, y, leg, 8)
    if not yaw_margin >= -SLACK:  # also refuses NaN
        return OUTSIDE
    r = radius - coxa
    d2 = r * r + z * z
    d = math.sqrt(d2)
    ring = min(d - leg[18], leg[19] - d)
    if not ring >= -SLACK or leg[20] < 0.5 or d < 1e-9:
        return OUTSIDE
    cos_femur = min(1.0, max(-1.0, (femur * femur + d2 - tibia * tibia) / (2.0 * femur * d)))
    sin_femur = math.sqrt(1.0 - cos_femur * cos_femur)
    ux, uz = r / d, z / d
    kx, kz = ux * cos_femur - uz * sin_femur, uz * cos_femur + ux * sin_femur
    if not _sector(kx, kz, leg, 13) >= -SLACK:
        return OUTSIDE
    margin = min(yaw_margin, ring)
    margin = min(margin, _arc(r, z, leg[13], leg[14], femur, tibia))
    margin = min(margin, _arc(r, z, leg[15], leg[16], femur, tibia))
    if radius < 1e-12:
        hx, hy = leg[3], leg[4]
    else:
        hx, hy = (leg[3] * x - leg[4] * y) / radius, (leg[4] * x + leg[3] * y) / radius
    out[0], out[1], out[2] = leg[0] + coxa * hx, leg[1] + coxa * hy, leg[2]
    knee = coxa + femur * kx
    out[3], out[4], out[5] = leg[0] + knee * hx, leg[1] + knee * hy, leg[2] + femur * kz
    return max(margin, 0.0)


def warm() -> None:
    """Compile the kernels."""
    solve(np.ones(LEG_NUMBERS), 0.0, 0.0, 0.0, np.zeros(6))
