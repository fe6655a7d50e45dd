"""Posture of a biped from CoM and feet: the trunk is moved until the CoM of ALL links is where it should be, the legs
follow in closed form, and torques give the sag of the servos under the load.
"""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.kernels.jit import kernel
from surefoot.robot import kinematics
from surefoot.robot.description import KinematicModel

from .ik import LegGeometry, legs_ik

COM_ITERATIONS = 2


@kernel
def _rotation(roll: float, pitch: float, yaw: float, out: Array) -> None:
    """Write rot = Rz(yaw) Ry(pitch) Rx(roll), angles in rad, into `out`, (3, 3)."""
    cr, sr, cp, sp, cy, sy = (
        math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch), math.cos(yaw), math.sin(yaw),
    )  # fmt: skip
    out[0, 0], out[0, 1], out[0, 2] = cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr
    out[1, 0], out[1, 1], out[1, 2] = sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr
    out[2, 0], out[2, 1], out[2, 2] = -sp, cp * sr, cp * cr


@kernel
def pose_legs(g: LegGeometry, q: Array, feet: Array, trunk: Array, tilt: Array) -> tuple[float, bool, Array]:
    """Write the leg angles for feet and trunk in odom into q; return the remaining error and the trunk's rotation.

    Args:
        g: geometry of both legs.
        q: joint angles, (nj,) rad; start of the search, changed in place.
        feet: (2, 4) x, y, yaw, height of the soles, left and right, m and rad, odom; soles are level.
        trunk: (4,) x, y, yaw, height of base_link, m and rad, odom.
        tilt: (2,) roll and pitch of the trunk, rad.

    Returns:
        Yaw missed by the feet, rad; True if they are within reach; rotation from base_link to odom, (3, 3).
    """
    rot = np.empty((3, 3))
    _rotation(tilt[0], tilt[1], trunk[2], rot)
    ankles, rots = np.empty((2, 3)), np.empty((2, 3, 3))
    for leg in range(2):
        dx, dy = feet[leg, 0] - trunk[0], feet[leg, 1] - trunk[1]
        dz = feet[leg, 3] + g.ankle - trunk[3]
        c, s = math.cos(feet[leg, 2]), math.sin(feet[leg, 2])
        for i in range(3):
            ankles[leg, i] = rot[0, i] * dx + rot[1, i] * dy + rot[2, i] * dz
            rots[leg, i, 0] = rot[0, i] * c + rot[1, i] * s
            rots[leg, i, 1] = -rot[0, i] * s + rot[1, i] * c
            rots[leg, i, 2] = rot[2, i]
    missed, reachable = legs_ik(g, q, ankles, rots)
    return missed, reachable, rot


@kernel
def place_com(
    model: KinematicModel, g: LegGeometry, q: Array, feet: Array, trunk: Array, tilt: Array, com: Array
) -> tuple[float, bool, Array]:
    """Move the trunk until the centre of mass of all links is over `com`; q and trunk are changed in place.

    Args:
        model: kinematics of the robot.
        g: geometry of its legs.
        q: joint angles, (nj,) rad.
        feet: left and right foot, (2, 4) x, y, yaw, height of the sole, m and rad, odom.
        trunk: base_link, (4,) x, y, yaw, height, m and rad, odom; x and y are changed.
        tilt: roll and pitch of the trunk, (2,) rad.
        com: wanted place, (2,) m, odom.

    Returns:
        Yaw missed by the feet, rad; True if they are within reach; rotation from base_link to odom, (3, 3).
    """
    missed, reachable, rot = pose_legs(g, q, feet, trunk, tilt)
    for _ in range(COM_ITERATIONS):
        c = kinematics.com(model, q)
        for i in range(2):
            trunk[i] += com[i] - (trunk[i] + rot[i, 0] * c[0] + rot[i, 1] * c[1] + rot[i, 2] * c[2])
        missed, reachable, rot = pose_legs(g, q, feet, trunk, tilt)
    return missed, reachable, rot


@kernel
def load_torques(
    model: KinematicModel, q: Array, rot: Array, trunk: Array, push: Array, share: Array, zmp: Array
) -> Array:
    """Return the joint torques that hold the accelerating robot, (nj,) Nm: G(q) - J'f, links as point masses.

    G(q) are the torques by the weight and inertia of the links, f the force on a foot and J the Jacobian of its point.

    Args:
        model: kinematics of the robot.
        q: joint angles, (nj,) rad.
        rot: rotation from base_link to odom, (3, 3).
        trunk: (4,) x, y, yaw, height of base_link, m and rad, odom.
        push: (3,) m/s2, acceleration of the CoM less gravity: (c'', 9.81), odom.
        share: (2,) part of the load on each foot, left and right, 0 to 1.
        zmp: (2, 2) m, point on the ground at which each foot carries its share, x and y, odom.
    """
    up = np.empty(3)
    for i in range(3):
        up[i] = rot[0, i] * push[0] + rot[1, i] * push[1] + rot[2, i] * push[2]
    torque = kinematics.gravity_torques(model, q, up)
    links_rot, links_pos = kinematics.forward(model, q)
    weight = kinematics.total_mass(model)
    point, ax = np.empty(3), np.empty(3)
    for leg in range(2):
        dx, dy = zmp[leg, 0] - trunk[0], zmp[leg, 1] - trunk[1]
        for i in range(3):
            point[i] = rot[0, i] * dx + rot[1, i] * dy - rot[2, i] * trunk[3]
        link = model.foot_link[leg]
        while link > 0:
            j = model.joint[link]
            if j >= 0:
                for i in range(3):
                    ax[i] = 0.0
                    for k in range(3):
                        ax[i] += links_rot[link, i, k] * model.axis[link, k]
                rx, ry, rz = point[0] - links_pos[link, 0], point[1] - links_pos[link, 1], point[2] - links_pos[link, 2]
                # column of the point's Jacobian: axis x arm
                jx, jy, jz = ax[1] * rz - ax[2] * ry, ax[2] * rx - ax[0] * rz, ax[0] * ry - ax[1] * rx
                torque[j] -= weight * share[leg] * (jx * up[0] + jy * up[1] + jz * up[2])
            link = model.parent[link]
    return torque


@kernel
def load_share(zmp: Array, feet: Array) -> Array:
    """Return the share of the load on the left and right foot, (2,), 0 to 1, by the ZMP's position between them.

    w_left = clip((z - p_right).d / d.d, 0, 1), d = p_left - p_right. `zmp`: z, zero-moment point, (2,) m, odom; `feet`:
    left and right foot, their columns beginning with x, y, p, (2, 2 or more) m, odom.
    """
    dx, dy = feet[0, 0] - feet[1, 0], feet[0, 1] - feet[1, 1]
    w = ((zmp[0] - feet[1, 0]) * dx + (zmp[1] - feet[1, 1]) * dy) / (dx * dx + dy * dy)
    out = np.empty(2)
    out[0] = min(1.0, max(0.0, w))
    out[1] = 1.0 - out[0]
    return out
