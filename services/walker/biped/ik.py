"""Inverse kinematics of legs with six joints: hip yaw, roll, pitch, knee, ankle pitch, roll; inclined yaw axis.

With the hip yaw q1 about the unit axis u, R1 = rot(u, q1), p the ankle from the hip in base_link and p' = R1'p, a and b
the lengths of thigh and shin, n the normal of the sole seen from the shin:

    q2 = atan2(p'_y, -p'_z),  v = Rx(-q2) p',  L = hypot(v_x, v_z),  cos q4 = (L^2 - a^2 - b^2) / (2 a b)
    q3 = atan2(-v_x, -v_z) - atan2(b sin q4, a + b cos q4),  q6 = asin(-n_y),  q5 = atan2(n_x, n_z)

Ankle point and sole normal are exact for every q1; what is left is the yaw e(q1) of the sole, and q1 solves e = 0.
Where one motor turns both hips, q1 solves e_left = e_right: the feet keep their relative yaw and the pelvis turns by
the common rest.
"""

import math
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Ints
from surefoot.geometry.rotations import matrix_from_axis_angle
from surefoot.kernels.jit import kernel
from surefoot.robot.description import Robot, RobotError
from surefoot.robot.kinematics import LIMIT_SLACK, REACH_SLACK

NEWTON_STEPS = 6  # at most; one to three when the search begins at the last tick's angle
NEWTON_DIFFERENCE = 1e-4  # rad
ALIGNED = 1e-9  # m and unit vectors, what counts as straight


class LegGeometry(NamedTuple):
    """Geometry of a biped's two legs, left first, as contiguous arrays for kernels; limits of the nj joints in rad."""

    hip: Array  # (2, 3) m, where the three hip axes meet, base_link
    yaw_axis: Array  # (2, 3) unit
    thigh: float  # m
    shin: float  # m
    ankle: float  # m, height of the ankle over the sole
    joints: Ints  # (2, 6) indices of yaw, roll, pitch, knee, ankle pitch, ankle roll
    coupled: bool  # one motor for both yaw axes
    lower: Array  # (nj,)
    upper: Array  # (nj,)


def leg_geometry(robot: Robot) -> LegGeometry:
    """Return the geometry of a biped's legs, m, base_link axes.

    Raises:
        RobotError: the legs are not of this kind; names the leg.
    """
    if len(robot.legs) != 2:
        raise RobotError("value", "limbs", f"a biped has two legs, got {len(robot.legs)}")
    hips, axes, sizes, indices = [], [], [], []
    for leg in robot.legs:
        joints = [j for j in leg.joints if j not in _arms(robot)]
        links = [robot.links[i] for i in leg.links]
        moved = [link for link in links if link.joint >= 0]
        directions = np.array([link.axis for link in moved])
        offsets = np.array([link.position for link in moved])
        straight = np.allclose([link.quat_wxyz for link in moved], [1, 0, 0, 0], atol=ALIGNED)
        wanted = [[1, 0, 0], [0, 1, 0], [0, 1, 0], [0, 1, 0], [1, 0, 0]]
        turning = len(moved) == 6 and np.allclose(directions[1:], wanted, atol=ALIGNED)
        if not (straight and turning and abs(directions[0, 0]) < ALIGNED):
            raise RobotError("value", f"limbs.{leg.name}", "expected the axes yaw, roll, pitch, pitch, pitch, roll")
        along = np.cross(offsets[1], directions[0])
        flat = np.allclose(np.delete(offsets[3:5], 2, axis=1), 0.0, atol=ALIGNED)
        if not (flat and np.allclose([along, offsets[2], offsets[5]], 0.0, atol=ALIGNED)):
            raise RobotError("value", f"limbs.{leg.name}", "expected three hip axes and two ankle axes that meet")
        hips.append(moved[0].position + offsets[1])
        axes.append(directions[0])
        sizes.append((-offsets[3, 2], -offsets[4, 2], -leg.foot.position[2]))
        indices.append(joints)
    if not np.allclose(sizes[0], sizes[1], atol=ALIGNED):
        raise RobotError("value", "limbs", f"both legs must have the same lengths, got {sizes}")
    thigh, shin, ankle = sizes[0]
    joints = np.array(indices, dtype=np.int64)
    return LegGeometry(
        np.array(hips), np.array(axes), float(thigh), float(shin), float(ankle), joints,
        bool(joints[0, 0] == joints[1, 0]), robot.joint_lower.copy(), robot.joint_upper.copy(),
    )  # fmt: skip


def _arms(robot: Robot) -> set[int]:
    used = {j for leg in robot.legs for j in leg.joints}
    return set(range(robot.nj)) - used


@kernel
def leg_angles(g: LegGeometry, leg: int, yaw: float, ankle: Array, rot: Array) -> tuple[Array, float, bool]:
    """Return the joint angles, rad, of a leg that bring ankle and sole to a pose, at a given hip yaw.

    Args:
        g: geometry of both legs.
        leg: 0 left, 1 right.
        yaw: angle of the hip's yaw joint, rad.
        ankle: ankle point in base_link, (3,) m.
        rot: rotation from the foot's axes to base_link, (3, 3).

    Returns:
        Angles of hip yaw, roll, pitch, knee, ankle pitch, roll, (6,) rad; yaw of the sole that is left over, rad; True
        if the ankle is within reach.
    """
    a, b = g.thigh, g.shin
    r1 = matrix_from_axis_angle(g.yaw_axis[leg], yaw)
    p = np.empty(3)
    for i in range(3):
        p[i] = 0.0
        for k in range(3):
            p[i] += r1[k, i] * (ankle[k] - g.hip[leg, k])
    q = np.empty(6)
    q[0] = yaw
    q[1] = math.atan2(p[1], -p[2])
    s2, c2 = math.sin(q[1]), math.cos(q[1])
    vx, vz = p[0], -s2 * p[1] + c2 * p[2]
    cos_knee = (vx * vx + vz * vz - a * a - b * b) / (2.0 * a * b)
    reachable = abs(cos_knee) <= 1.0 + REACH_SLACK
    cos_knee = min(1.0, max(-1.0, cos_knee))
    q[3] = math.acos(cos_knee)
    q[2] = math.atan2(-vx, -vz) - math.atan2(b * math.sin(q[3]), a + b * cos_knee)
    if q[2] > math.pi:
        q[2] -= 2.0 * math.pi
    elif q[2] < -math.pi:
        q[2] += 2.0 * math.pi
    # rot_shin_from_foot = (R1 Rx(q2) Ry(q3 + q4))' rot
    s, c = math.sin(q[2] + q[3]), math.cos(q[2] + q[3])
    rest = np.empty((3, 3))
    for k in range(3):
        ux = r1[0, 0] * rot[0, k] + r1[1, 0] * rot[1, k] + r1[2, 0] * rot[2, k]
        uy = r1[0, 1] * rot[0, k] + r1[1, 1] * rot[1, k] + r1[2, 1] * rot[2, k]
        uz = r1[0, 2] * rot[0, k] + r1[1, 2] * rot[1, k] + r1[2, 2] * rot[2, k]
        wy, wz = c2 * uy + s2 * uz, -s2 * uy + c2 * uz
        rest[0, k], rest[1, k], rest[2, k] = c * ux - s * wz, wy, s * ux + c * wz
    q[5] = math.asin(min(1.0, max(-1.0, -rest[1, 2])))
    q[4] = math.atan2(rest[0, 2], rest[2, 2])
    s5, c5, s6, c6 = math.sin(q[4]), math.cos(q[4]), math.sin(q[5]), math.cos(q[5])
    # first column of (Ry(q5) Rx(q6))' rest
    e11 = c5 * rest[0, 0] - s5 * rest[2, 0]
    e21 = s5 * s6 * rest[0, 0] + c6 * rest[1, 0] + c5 * s6 * rest[2, 0]
    return q, math.atan2(e21, e11), reachable


@kernel
def _mismatch(g: LegGeometry, legs: int, yaw: float, ankles: Array, rots: Array) -> float:
    """Return the remaining yaw error, rad: of one sole, or the difference of both if they share a motor (legs = 2).

    Args:
        g: geometry of the legs.
        legs: number of the leg, 0 or 1, or 2 for both.
        yaw: angle of the hip's yaw joint, rad.
        ankles: ankle points in base_link, (2, 3) m.
        rots: rotations from the axes of each foot to base_link, (2, 3, 3).
    """
    if legs < 2:
        return leg_angles(g, legs, yaw, ankles[legs], rots[legs])[1]
    return leg_angles(g, 0, yaw, ankles[0], rots[0])[1] - leg_angles(g, 1, yaw, ankles[1], rots[1])[1]


@kernel
def _solve_yaw(g: LegGeometry, legs: int, start: float, ankles: Array, rots: Array) -> float:
    yaw = start
    for _ in range(NEWTON_STEPS):
        e = _mismatch(g, legs, yaw, ankles, rots)
        slope = (_mismatch(g, legs, yaw + NEWTON_DIFFERENCE, ankles, rots) - e) / NEWTON_DIFFERENCE
        if abs(slope) < 0.1 or abs(e) < 1e-12:
            break
        yaw -= e / slope
    return yaw


@kernel
def legs_ik(g: LegGeometry, q: Array, ankles: Array, rots: Array) -> tuple[float, bool]:
    """Write the angles that bring both ankles and soles to their poses into q; return the remaining error.

    Args:
        g: geometry of both legs.
        q: joint angles, (nj,) rad; the hip yaws in it are the start of the search, the legs' angles are replaced.
        ankles: ankle points in base_link, left and right, (2, 3) m.
        rots: rotations from the axes of each foot to base_link, (2, 3, 3).

    Returns:
        Largest yaw by which a sole misses (rad; not 0 where one motor turns both hips and the pelvis is not half way),
        and True if both are reached within the joint limits. Angles beyond a limit are set to it.
    """
    worst, reachable = 0.0, True
    shared = _solve_yaw(g, 2, float(q[g.joints[0, 0]]), ankles, rots) if g.coupled else 0.0
    for leg in range(2):
        yaw = shared if g.coupled else _solve_yaw(g, leg, float(q[g.joints[leg, 0]]), ankles, rots)
        angles, rest, reached = leg_angles(g, leg, yaw, ankles[leg], rots[leg])
        worst = max(worst, abs(rest))
        reachable = reachable and reached
        for i in range(6):
            j = g.joints[leg, i]
            if not g.lower[j] - LIMIT_SLACK <= angles[i] <= g.upper[j] + LIMIT_SLACK:
                reachable = False
            q[j] = min(g.upper[j], max(g.lower[j], angles[i]))
    return worst, reachable
