"""Reach margin of a foot point in the workspace of a roll-pitch-pitch leg, without a trigonometric function per point.

The closed form is that of `surefoot.robot.rolled_legs`. A point is (x, rho) about the first axis; in the plane of femur
and tibia it is (u, v) = (x, w - h) with w = s_z sqrt(rho^2 - b^2), b and h the foot's way beside and the femur joint's
way above the first axis.
"""

import math

import numpy as np

from surefoot.kernels.jit import row_kernel
from surefoot.robot.description import KinematicModel

LegTable = tuple[float, ...]
"""Leg as 32 numbers (hip, lengths, joint limits) for kernels; a tuple, which kernels handle faster than arrays."""
LEG_NUMBERS = 32
"""Length of the tuple of numbers that describes a leg for kernels."""
OUTSIDE = -1.0
"""Value returned in place of the distance to the edge of the workspace for a point that cannot be reached."""
SLACK = 1e-9
"""Tolerance, in m and in cosines, up to which a point beyond an edge counts as inside, as in the closed-form
solution."""
ALONG = 21
"""Index, in a leg's 32 numbers, of the side (1 or -1 along z) on which its foot lies; 0 there: not roll-pitch-pitch."""


def rolled_table(model: KinematicModel, leg: int) -> LegTable:
    """Return a roll-pitch-pitch leg as 32 numbers for the kernels; NaN where the leg is of another kind.

    0-2 hip, base_link, m; 3-4 the foot's way beside and the femur joint's above the first axis, 5 their distance, 6-7
    femur, tibia, m; 8-11 cos, sin of the first joint's limits, 12 its range: 0 = below half a turn, 1 = above, 2 = a
    whole turn; 13-17 the same for the femur, angles from z towards x; 18-19 smallest and largest distance of the foot
    from the femur joint, m; 20 whether the knee may bend at all; 21-22 side along z, bend of the knee, each 1 or -1;
    23-31 rot_base_from_hip row by row.
    """
    table, rolled = np.full(LEG_NUMBERS, np.nan), model.rolled
    femur, tibia = (float(value) for value in rolled.segment[leg])
    if not math.isfinite(femur):
        return tuple(table.tolist())
    joints = model.leg_joints[leg]
    low, high = model.lower[joints], model.upper[joints]
    along, bend, turn = (float(value) for value in rolled.side[leg])
    table[0:3], table[3:5], table[5:8] = rolled.hip[leg], rolled.offset[leg], (0.0, femur, tibia)
    table[5] = math.hypot(*rolled.offset[leg])
    for start, j, rest in ((8, 0, 0.0), (13, 1, float(rolled.rest[leg, 0]))):
        a, b = rest + float(low[j]), rest + float(high[j])
        table[start : start + 4] = math.cos(a), math.sin(a), math.cos(b), math.sin(b)
        table[start + 4] = 2.0 if b - a >= 2.0 * math.pi else float(b - a > math.pi)
    knee = sorted(bend * (float(rolled.rest[leg, 1]) + turn * float(limit)) for limit in (low[2], high[2]))
    spans = [(max(knee[0] + k, 0.0), min(knee[1] + k, math.pi)) for k in (0.0, 2.0 * math.pi, -2.0 * math.pi)]
    straight, bent = max(spans, key=lambda span: span[1] - span[0])
    for k, angle in ((18, bent), (19, straight)):
        table[k] = math.sqrt(max(femur**2 + tibia**2 + 2.0 * femur * tibia * math.cos(angle), 0.0))
    table[20], table[ALONG], table[22] = float(straight <= bent), along, bend
    table[23:32] = rolled.rot[leg].ravel()
    return tuple(table.tolist())


@row_kernel
def _within(c: float, s: float, cos_low: float, sin_low: float, cos_high: float, sin_high: float, wide: float) -> bool:
    """Return True if a direction (c, s) lies in a sector from a lower to a higher one, all as cosine and sine.

    `wide`: 0 = the sector is up to half a turn, 1 = more, 2 = a whole turn.
    """
    after, before = cos_low * s - sin_low * c, sin_high * c - cos_high * s
    if wide > 1.5:
        return True
    return (after >= -SLACK or before >= -SLACK) if wide > 0.5 else (after >= -SLACK and before >= -SLACK)


@row_kernel
def _to_limit(cos: float, sin: float, w: float, beside: float) -> float:
    """Return the distance of a foot from the half plane of a limit of the first joint, m, or less.

    |w| sin d - |b| (1 - cos d), the true distance or less up to d = 60 deg; beyond, the value there; inf where the
    limit lies behind.

    Args:
        cos: cosine of the angle d from the joint to its limit.
        sin: sine of the angle d.
        w: |w|, distance of the foot from the first axis along the leg, m.
        beside: |b|, offset of the foot to the side of the first axis, m.
    """
    if sin < 0.0:
        return math.inf
    if cos < 0.5:
        cos, sin = 0.5, math.sqrt(0.75)
    return w * sin - beside * (1.0 - cos)


@row_kernel
def _from_arc(
    u: float, v: float, cos: float, sin: float, femur: float, tibia: float, bend: float
) -> float:  # fmt: skip
    """Return the distance of (u, v) from the arc of the foot with the femur at one limit, m; inf beyond its ends.

    Args:
        u: coordinate of the foot in the plane of femur and tibia, first axis from the femur joint, m.
        v: coordinate of the foot in that plane, second axis, m.
        cos: cosine of the femur's limit angle, counted from v towards u.
        sin: sine of the femur's limit angle.
        femur: length of the femur, m.
        tibia: length of the tibia, m.
        bend: side to which the knee bends, 1 or -1.
    """
    eu, ev = u - femur * sin, v - femur * cos
    if bend * (cos * eu - sin * ev) < 0.0:  # the nearest point of the circle has the knee bent to the other side
        return math.inf
    return abs(math.sqrt(eu * eu + ev * ev) - tibia)


@row_kernel
def _to_edges(
    leg: LegTable, foot: tuple[float, float], first: tuple[float, float], w: float, rho: float, ring: float
) -> float:
    """Return the distance of a foot inside the workspace from its nearest edge, m.

    Args:
        leg: 32 numbers of the leg.
        foot: u (along the first axis) and v (across it) from the femur joint, m.
        first: cos and sin of the first joint's angle.
        w: distance of the foot from the first axis along the leg, m, >= 0.
        rho: distance of the foot from the first axis, m.
        ring: distance in the plane of femur and tibia from the limits of the knee, m.
    """
    u, v = foot
    cos, sin = first
    beside = abs(leg[3])
    margin = ring
    if leg[17] < 1.5:
        margin = min(margin, _from_arc(u, v, leg[13], leg[14], leg[6], leg[7], leg[22]))
        margin = min(margin, _from_arc(u, v, leg[15], leg[16], leg[6], leg[7], leg[22]))
    # a way of m in rho is one of `margin` in w, towards the first axis where it is longest
    left = max(0.0, w - margin)
    margin = rho - math.sqrt(left * left + beside * beside)
    if leg[12] < 1.5:
        low = _to_limit(leg[8] * cos + leg[9] * sin, leg[8] * sin - leg[9] * cos, w, beside)
        high = _to_limit(leg[10] * cos + leg[11] * sin, leg[11] * cos - leg[10] * sin, w, beside)
        margin = min(margin, low, high)
    return margin


@row_kernel
def solve_rolled(
    leg: LegTable, px: float, py: float, pz: float
) -> tuple[float, float, float, float, float, float, float]:
    """Return how far a foot centre is inside the reach of a roll-pitch-pitch leg, and its femur joint and knee.

    Args:
        leg: 32 numbers of the leg.
        px: x of the foot centre, base_link, m.
        py: y of the foot centre, m.
        pz: z of the foot centre, m.

    Returns:
        Distance to the nearest edge of the workspace, m (never more than the true one), or -1 outside; then x, y, z of
        the femur joint and of the knee in the plane of the foot, base_link, m (0 when outside).
    """
    outside = (OUTSIDE, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    beside, above, femur, tibia, along, bend = leg[3], leg[4], leg[6], leg[7], leg[21], leg[22]
    dx, dy, dz = px - leg[0], py - leg[1], pz - leg[2]
    x = leg[23] * dx + leg[26] * dy + leg[29] * dz
    y = leg[24] * dx + leg[27] * dy + leg[30] * dz
    z = leg[25] * dx + leg[28] * dy + leg[31] * dz
    rho2 = y * y + z * z
    square = rho2 - beside * beside
    if not (square >= 0.0 and rho2 > 1e-18 and leg[20] > 0.5):  # false for NaN, too
        return outside
    w = along * math.sqrt(square)
    cos, sin = (beside * y + w * z) / rho2, (beside * z - w * y) / rho2  # of the first joint's angle
    if not _within(cos, sin, leg[8], leg[9], leg[10], leg[11], leg[12]):
        return outside
    u, v = x, w - above
    d = math.sqrt(u * u + v * v)
    ring = min(d - leg[18], leg[19] - d)
    if not (ring >= -SLACK and d > SLACK):
        return outside
    cos_hip = min(1.0, max(-1.0, (femur * femur + d * d - tibia * tibia) / (2.0 * femur * d)))
    sin_hip = bend * math.sqrt(1.0 - cos_hip * cos_hip)
    cos_femur, sin_femur = (v * cos_hip + u * sin_hip) / d, (u * cos_hip - v * sin_hip) / d
    if not _within(cos_femur, sin_femur, leg[13], leg[14], leg[15], leg[16], leg[17]):
        return outside
    margin = _to_edges(leg, (u, v), (cos, sin), abs(w), math.sqrt(rho2), max(ring, 0.0))
    hy, hz = beside * cos - above * sin, beside * sin + above * cos
    knee = above + femur * cos_femur
    kx, ky, kz = femur * sin_femur, beside * cos - knee * sin, beside * sin + knee * cos
    return (
        max(margin, 0.0),
        leg[0] + leg[24] * hy + leg[25] * hz,
        leg[1] + leg[27] * hy + leg[28] * hz,
        leg[2] + leg[30] * hy + leg[31] * hz,
        leg[0] + leg[23] * kx + leg[24] * ky + leg[25] * kz,
        leg[1] + leg[26] * kx + leg[27] * ky + leg[28] * kz,
        leg[2] + leg[29] * kx + leg[30] * ky + leg[31] * kz,
    )
