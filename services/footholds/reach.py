"""Reach margin of a foot point in the workspace of a three-joint leg, without a trigonometric function per point.

Roll-pitch-pitch legs are solved by `rolled_reach`. The closed form is that of `surefoot.robot.kinematics.leg_ik`
(yaw-pitch-pitch, knee up); in place of joint angles it gives the distance from the point to the nearest edge of the
workspace, m.
"""

import math

import numpy as np

from surefoot.kernels.jit import row_kernel
from surefoot.robot.description import KinematicModel

from .rolled_reach import ALONG, LEG_NUMBERS, OUTSIDE, SLACK, LegTable, rolled_table, solve_rolled


def leg_table(model: KinematicModel, leg: int) -> LegTable:
    """Return a leg as 32 numbers for the kernels.

    0-2 hip, base_link, m; 3-4 cos and sin of the heading; 5-7 coxa, femur, tibia, m; 8-11 cos, sin of the coxa's lower
    and upper limit; 12 whether its range exceeds 180 deg; 13-17 the same for the femur; 18-19 smallest and largest
    distance of the foot from the femur joint, m; 20 whether the knee may bend at all; 21-31 are 0. A roll-pitch-pitch
    leg has another table, with 21 not 0. NaN (a leg without closed form) makes every point unreachable.
    """
    hip, psi = model.hip[leg, :3], float(model.hip[leg, 3])
    coxa, femur, tibia = (float(value) for value in model.segment[leg])
    if not np.isfinite([coxa, femur, tibia]).all():
        return rolled_table(model, leg)
    table = np.zeros(LEG_NUMBERS)
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
    return tuple(table.tolist())


@row_kernel
def _sector(x: float, y: float, cos_low: float, sin_low: float, cos_high: float, sin_high: float, wide: float) -> float:
    """Return the signed distance of (x, y) from the two rays that bound a sector, m; > 0 inside.

    The rays leave the origin at a lower and a higher angle, given by cosine and sine; `wide` > 0.5: the sector exceeds
    half a turn.
    """
    low = cos_low * y - sin_low * x
    high = sin_high * x - cos_high * y
    return max(low, high) if wide > 0.5 else min(low, high)


@row_kernel
def _arc(r: float, z: float, cos: float, sin: float, femur: float, tibia: float) -> float:
    """Return the distance of (r, z) from the arc of the foot with the femur at one limit, m; inf beyond its ends.

    Args:
        r: coordinate of the foot along the leg's plane from the femur joint, m.
        z: height of the foot over the femur joint, m.
        cos: cosine of the femur's limit angle.
        sin: sine of the femur's limit angle.
        femur: length of the femur, m.
        tibia: length of the tibia, m.
    """
    ex, ez = r - femur * cos, z - femur * sin
    if cos * ez - sin * ex > 0.0:  # the nearest point of the circle has its knee down
        return math.inf
    return abs(math.sqrt(ex * ex + ez * ez) - tibia)


@row_kernel
def solve(leg: LegTable, px: float, py: float, pz: float) -> tuple[float, float, float, float, float, float, float]:
    """Return how far a foot centre is inside the reach of a leg, and the places of its femur joint and knee.

    Args:
        leg: the leg as 32 numbers for the kernels.
        px: x of the foot centre, base_link, m.
        py: y of the foot centre, m.
        pz: z of the foot centre, m.

    Returns:
        Distance to the nearest edge of the workspace, m (never more than the true one), or -1 outside; then x, y, z of
        the femur joint and of the knee, base_link, m (0 when outside).
    """
    if leg[ALONG] != 0.0:
        return solve_rolled(leg, px, py, pz)
    hip_x, hip_y, hip_z, cos, sin, coxa, femur, tibia = leg[0], leg[1], leg[2], leg[3], leg[4], leg[5], leg[6], leg[7]
    dx, dy, z = px - hip_x, py - hip_y, pz - hip_z
    x = cos * dx + sin * dy
    y = cos * dy - sin * dx
    radius = math.sqrt(x * x + y * y)
    yaw_margin = _sector(x, y, leg[8], leg[9], leg[10], leg[11], leg[12])
    r = radius - coxa
    d2 = r * r + z * z
    d = math.sqrt(d2)
    ring = min(d - leg[18], leg[19] - d)
    # the comparisons are false for NaN, too
    if not (yaw_margin >= -SLACK and ring >= -SLACK and leg[20] > 0.5 and d > 1e-9):
        return OUTSIDE, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    cos_femur = min(1.0, max(-1.0, (femur * femur + d2 - tibia * tibia) / (2.0 * femur * d)))
    sin_femur = math.sqrt(1.0 - cos_femur * cos_femur)
    ux, uz = r / d, z / d
    kx, kz = ux * cos_femur - uz * sin_femur, uz * cos_femur + ux * sin_femur
    if not _sector(kx, kz, leg[13], leg[14], leg[15], leg[16], leg[17]) >= -SLACK:
        return OUTSIDE, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    margin = min(yaw_margin, ring)
    margin = min(margin, _arc(r, z, leg[13], leg[14], femur, tibia))
    margin = min(margin, _arc(r, z, leg[15], leg[16], femur, tibia))
    hx, hy = cos, sin
    if radius > 1e-12:
        hx, hy = (cos * x - sin * y) / radius, (sin * x + cos * y) / radius
    knee = coxa + femur * kx
    return (
        max(margin, 0.0),
        hip_x + coxa * hx, hip_y + coxa * hy, hip_z,
        hip_x + knee * hx, hip_y + knee * hy, hip_z + femur * kz,
    )  # fmt: skip
