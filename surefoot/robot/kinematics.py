"""Kinematics of a link tree: positions, Jacobians, centre of mass, gravity torques, inverse kinematics of legs.

All functions are numba kernels on a `KinematicModel` and joint angles `q` (nj,) in rad; results in `base_link`.
"""

import math

import numpy as np

from surefoot.arrays import Array, Flags
from surefoot.geometry.rotations import axis_angle_into
from surefoot.kernels.jit import kernel
from surefoot.robot.damped_legs import damped_ik
from surefoot.robot.description import KinematicModel
from surefoot.robot.rolled_legs import REACH_SLACK, rolled_ik

LIMIT_SLACK = 1e-7  # rad; a joint on its limit counts as inside


@kernel
def forward(model: KinematicModel, q: Array) -> tuple[Array, Array]:
    """Return the pose of each of nl links: rot_base_from_link (nl, 3, 3) and origins in base_link (nl, 3) m.

    `q`: joint angles, (nj,) rad.
    """
    n = model.parent.size
    rot, pos = np.empty((n, 3, 3)), np.empty((n, 3))
    joint, turn = np.empty((3, 3)), np.empty((3, 3))
    for i in range(n):
        up, j = model.parent[i], model.joint[i]
        if up < 0:
            for r in range(3):
                pos[i, r] = model.origin_pos[i, r]
                for c in range(3):
                    rot[i, r, c] = model.origin_rot[i, r, c]
            continue
        if j >= 0:
            axis_angle_into(joint, model.axis[i], float(q[j]))
            _multiply_into(turn, model.origin_rot[i], joint)
            _multiply_into(rot[i], rot[up], turn)
        else:
            _multiply_into(rot[i], rot[up], model.origin_rot[i])
        _point_into(pos[i], rot[up], pos[up], model.origin_pos[i])
    return rot, pos


@kernel
def _multiply_into(out: Array, a: Array, b: Array) -> None:
    for i in range(3):
        for k in range(3):
            out[i, k] = a[i, 0] * b[0, k] + a[i, 1] * b[1, k] + a[i, 2] * b[2, k]


@kernel
def _point_into(out: Array, rot: Array, pos: Array, point: Array) -> None:
    for i in range(3):
        out[i] = pos[i] + rot[i, 0] * point[0] + rot[i, 1] * point[1] + rot[i, 2] * point[2]


@kernel
def foot_positions(model: KinematicModel, q: Array) -> Array:
    """Return the foot centres in base_link, (L, 3) m, at joint angles q, (nj,) rad."""
    rot, pos = forward(model, q)
    return foot_positions_of(model, rot, pos)


@kernel
def foot_positions_of(model: KinematicModel, rot: Array, pos: Array) -> Array:
    """Return the foot centres in base_link, (L, 3) m, from the links' poses (l, 3, 3), (l, 3) m of `forward`."""
    n = model.foot_link.size
    feet = np.empty((n, 3))
    for i in range(n):
        k = model.foot_link[i]
        _point_into(feet[i], rot[k], pos[k], model.foot_point[i])
    return feet


@kernel
def foot_jacobians(model: KinematicModel, q: Array) -> Array:
    """Return the Jacobian of each foot centre by its leg's joints, (L, 3, n) m/rad, base_link, at q (nj,) rad.

    Columns are in the order of `model.leg_joints`; those of joints that a shorter leg lacks are 0.
    """
    rot, pos = forward(model, q)
    return foot_jacobians_of(model, rot, pos)


@kernel
def foot_jacobians_of(model: KinematicModel, rot: Array, pos: Array) -> Array:
    """Return the Jacobian of each foot centre by its leg's joints, (L, 3, n) m/rad, base_link, from the links' poses.

    Columns are in the order of `model.leg_joints`; those of joints that a shorter leg lacks are 0. rot, pos:
    orientations (links, 3, 3), base_link from link, and origins (links, 3) m of the links.
    """
    legs, width = model.leg_joints.shape
    jac = np.zeros((legs, 3, width))
    foot, arm, column = np.empty(3), np.empty(3), np.empty(3)
    for i in range(legs):
        k = model.foot_link[i]
        _point_into(foot, rot[k], pos[k], model.foot_point[i])
        for c in range(width):
            j = model.leg_joints[i, c]
            s = _moved_link(model, int(j), int(k))
            if s >= 0:
                for d in range(3):
                    arm[d] = foot[d] - pos[s, d]
                _cross_into(column, rot[s], model.axis[s], arm)
                for d in range(3):
                    jac[i, d, c] = column[d]
    return jac


@kernel
def _moved_link(model: KinematicModel, joint: int, tip: int) -> int:
    """Return the link between the trunk and the link `tip` that a joint moves, -1 = none."""
    while tip >= 0 and joint >= 0:
        if model.joint[tip] == joint:
            return tip
        tip = model.parent[tip]
    return -1


@kernel
def _cross_into(out: Array, rot: Array, axis: Array, arm: Array) -> None:
    x = rot[0, 0] * axis[0] + rot[0, 1] * axis[1] + rot[0, 2] * axis[2]
    y = rot[1, 0] * axis[0] + rot[1, 1] * axis[1] + rot[1, 2] * axis[2]
    z = rot[2, 0] * axis[0] + rot[2, 1] * axis[1] + rot[2, 2] * axis[2]
    out[0] = y * arm[2] - z * arm[1]
    out[1] = z * arm[0] - x * arm[2]
    out[2] = x * arm[1] - y * arm[0]


@kernel
def total_mass(model: KinematicModel) -> float:
    """Return the mass of all links, kg."""
    mass = 0.0
    for i in range(model.mass.size):
        mass += model.mass[i]
    return mass


@kernel
def com(model: KinematicModel, q: Array) -> Array:
    """Return the centre of mass of all links in base_link, (3,) m, at joint angles q, (nj,) rad."""
    rot, pos = forward(model, q)
    return com_of(model, rot, pos)


@kernel
def com_of(model: KinematicModel, rot: Array, pos: Array) -> Array:
    """Return the centre of mass of all links in base_link, (3,) m.

    rot, pos: orientations (n, 3, 3), base_link from link, and origins (n, 3) m of the links.
    """
    total, c = np.zeros(3), np.empty(3)
    for i in range(model.mass.size):
        _point_into(c, rot[i], pos[i], model.com[i])
        for d in range(3):
            total[d] += model.mass[i] * c[d]
    mass = total_mass(model)
    for d in range(3):
        total[d] /= mass
    return total


@kernel
def com_jacobian_of(model: KinematicModel, rot: Array, pos: Array) -> Array:
    """Return the derivative of the centre of mass by the joint angles, (3, nj) m/rad, base_link axes.

    Column j is the sum of m_sub/m axis x (c_sub - o) over the links that motor j turns: m_sub, c_sub mass and centre of
    the link and all beyond it, o a point of its axis, m the robot's mass.

    Args:
        model: the robot, n links and nj joints.
        rot: orientations of the links, (n, 3, 3), base_link from link.
        pos: their origins in base_link, (n, 3) m.
    """
    n = model.mass.size
    mass, moment = np.empty(n), np.empty((n, 3))
    for i in range(n):
        mass[i] = model.mass[i]
        _point_into(moment[i], rot[i], pos[i], model.com[i])
        for d in range(3):
            moment[i, d] *= mass[i]
    for i in range(n - 1, 0, -1):  # children before parents
        up = model.parent[i]
        mass[up] += mass[i]
        for d in range(3):
            moment[up, d] += moment[i, d]
    jac, part, arm = np.zeros((3, model.lower.size)), np.empty(3), np.empty(3)
    for i in range(n):
        j = model.joint[i]
        if j < 0:
            continue
        for d in range(3):
            arm[d] = (moment[i, d] - mass[i] * pos[i, d]) / mass[0]
        _cross_into(part, rot[i], model.axis[i], arm)
        for d in range(3):  # one motor may move several links
            jac[d, j] += part[d]
    return jac


@kernel
def gravity_torques(model: KinematicModel, q: Array, g_up: Array) -> Array:
    """Return the torques that hold the links' own weight while the trunk is fixed, (nj,) Nm.

    G(q) = dV/dq, V the potential energy of the links.

    Args:
        model: the robot, nj joints.
        q: joint angles, (nj,) rad.
        g_up: upward specific force at rest in base_link, (3,) m/s^2 (length 9.81).
    """
    rot, pos = forward(model, q)
    return gravity_torques_of(model, rot, pos, g_up)


@kernel
def gravity_torques_of(model: KinematicModel, rot: Array, pos: Array, g_up: Array) -> Array:
    """Return the torques that hold the links' own weight while the trunk is fixed, (nj,) Nm, from the links' poses.

    Args:
        model: the robot, n links and nj joints.
        rot: orientations of the links, (n, 3, 3), base_link from link.
        pos: their origins in base_link, (n, 3) m.
        g_up: upward specific force at rest in base_link, (3,) m/s^2 (length 9.81).
    """
    jac, weight = com_jacobian_of(model, rot, pos), total_mass(model)
    torques = np.empty(model.lower.size)
    for j in range(model.lower.size):
        torques[j] = weight * (jac[0, j] * g_up[0] + jac[1, j] * g_up[1] + jac[2, j] * g_up[2])
    return torques


@kernel
def leg_ik(model: KinematicModel, leg: int, p_base: Array) -> tuple[Array, bool]:
    """Return joint angles of a leg that bring its foot centre to `p_base`; closed form for the usual kinds of leg.

    Those are yaw-pitch-pitch and roll-pitch-pitch legs; others are solved iteratively by `damped_ik`.

    Args:
        model: the robot.
        leg: index of the leg.
        p_base: foot centre in base_link, (3,) m.

    Returns:
        The angles (n,) rad, clipped to the joint limits and approximate if the point is out of reach, and whether the
        point is reached with every joint inside its limits.
    """
    joints = model.leg_joints[leg]
    if math.isnan(model.segment[leg, 0]):
        if math.isnan(model.rolled.segment[leg, 0]):
            return damped_ik(model, leg, p_base)
        middle = np.empty(3)
        for i in range(3):
            middle[i] = 0.5 * (model.lower[joints[i]] + model.upper[joints[i]])
        q, reachable = rolled_ik(model.rolled, leg, p_base, middle)
    else:
        q, reachable = _yawed_ik(model, leg, p_base)
    for i in range(3):
        low, high = model.lower[joints[i]], model.upper[joints[i]]
        if not low - LIMIT_SLACK <= q[i] <= high + LIMIT_SLACK:
            reachable = False
        q[i] = min(high, max(low, q[i]))
    return q, reachable


@kernel
def _yawed_ik(model: KinematicModel, leg: int, p_base: Array) -> tuple[Array, bool]:
    """Return joint angles of a yaw-pitch-pitch leg, knee up, (3,) rad, without limits, and whether it is long enough.

    p = Rz(-psi) (p_base - hip), q1 = atan2(y, x), r = hypot(x, y) - c,
    D = (r^2 + z^2 - f^2 - t^2) / (2 f t), q3 = -acos D, q2 = atan2(z, r) - atan2(t sin q3, f + t cos q3).
    """
    c, f, t = model.segment[leg, 0], model.segment[leg, 1], model.segment[leg, 2]
    psi = model.hip[leg, 3]
    dx, dy, z = p_base[0] - model.hip[leg, 0], p_base[1] - model.hip[leg, 1], p_base[2] - model.hip[leg, 2]
    x = math.cos(psi) * dx + math.sin(psi) * dy
    y = -math.sin(psi) * dx + math.cos(psi) * dy
    r = math.hypot(x, y) - c
    cos_knee = (r * r + z * z - f * f - t * t) / (2.0 * f * t)
    reachable = abs(cos_knee) <= 1.0 + REACH_SLACK
    cos_knee = min(1.0, max(-1.0, cos_knee))
    q = np.empty(3)
    q[0] = math.atan2(y, x)
    q[2] = -math.acos(cos_knee)
    q[1] = math.atan2(z, r) - math.atan2(t * math.sin(q[2]), f + t * cos_knee)
    if q[1] > math.pi:
        q[1] -= 2.0 * math.pi
    elif q[1] < -math.pi:
        q[1] += 2.0 * math.pi
    return q, reachable


@kernel
def legs_ik(model: KinematicModel, feet: Array) -> tuple[Array, Flags]:
    """Return joint angles that bring the foot centres to `feet`, and whether each is reached inside the joint limits.

    Args:
        model: the robot.
        feet: foot centres in base_link, (L, 3) m.

    Returns:
        q (nj,) rad, 0 for joints outside the legs and approximate for legs whose foot is out of reach, and reachable
        (L,).
    """
    n = model.foot_link.size
    q, reachable = np.zeros(model.lower.size), np.zeros(n, dtype=np.bool_)
    for i in range(n):
        angles, reachable[i] = leg_ik(model, i, feet[i])
        for c in range(angles.size):
            q[model.leg_joints[i, c]] = angles[c]
    return q, reachable
