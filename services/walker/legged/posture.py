"""Servo set-points from trunk pose and feet: closed-form leg solutions and compensation of the servos' sag."""

import numpy as np

from surefoot.arrays import Array, Flags
from surefoot.geometry.constants import GRAVITY
from surefoot.kernels.jit import kernel
from surefoot.robot import kinematics
from surefoot.robot.description import KinematicModel


@kernel
def into_base(feet: Array, body: Array, rot: Array) -> Array:
    """Return feet (L, 3) m of frame map in base_link, (L, 3) m: rot' (feet - body).

    `body`: origin of base_link in the map, (3,) m; `rot`: rotation from base_link to map, (3, 3).
    """
    out = np.empty_like(feet)
    for i in range(feet.shape[0]):
        x, y, z = feet[i, 0] - body[0], feet[i, 1] - body[1], feet[i, 2] - body[2]
        for k in range(3):
            out[i, k] = rot[0, k] * x + rot[1, k] * y + rot[2, k] * z
    return out


@kernel
def into_map(feet_base: Array, body: Array, rot: Array) -> Array:
    """Return feet (L, 3) m of base_link in frame map, (L, 3) m: body + rot feet.

    `body`: origin of base_link in the map, (3,) m; `rot`: rotation from base_link to map, (3, 3).
    """
    out = np.empty_like(feet_base)
    for i in range(feet_base.shape[0]):
        for k in range(3):
            out[i, k] = (
                body[k] + rot[k, 0] * feet_base[i, 0] + rot[k, 1] * feet_base[i, 1] + rot[k, 2] * feet_base[i, 2]
            )
    return out


@kernel
def share_load(feet: Array, com_xy: Array, support: Array, weight: float) -> Array:
    """Return the vertical force on each foot that balances the weight, (L,) N, never negative.

    Smallest sum of f^2 / support under sum f = W and sum f r = W c: f = S A'(A S A')^-1 b, with S = diag(support), the
    rows (1, x, y) of A for feet about the centre of mass c, and b = (W, 0, 0). Without three feet that span a plane the
    weight is shared in proportion to `support`.

    Args:
        feet: foot centres, (L, 3) m, any frame with z up.
        com_xy: centre of mass in that frame, (2,) m.
        support: share with which each foot takes part in carrying the weight, 0..1, (L,).
        weight: W, N.
    """
    n = feet.shape[0]
    gram = np.zeros((3, 3))
    row = np.empty(3)
    row[0] = 1.0
    for i in range(n):
        row[1], row[2] = feet[i, 0] - com_xy[0], feet[i, 1] - com_xy[1]
        for a in range(3):
            for b in range(3):
                gram[a, b] += support[i] * row[a] * row[b]
    total = gram[0, 0]
    force = np.zeros(n)
    if total <= 1e-6:
        return force
    minor_00 = gram[1, 1] * gram[2, 2] - gram[1, 2] * gram[2, 1]
    minor_01 = gram[0, 1] * gram[2, 2] - gram[0, 2] * gram[2, 1]
    minor_02 = gram[0, 1] * gram[1, 2] - gram[0, 2] * gram[1, 1]
    det = gram[0, 0] * minor_00 - gram[0, 1] * minor_01 + gram[0, 2] * minor_02
    if det < 1e-9 * total:
        for i in range(n):
            force[i] = weight * support[i] / total
        return force
    l0, l1, l2 = weight * minor_00 / det, -weight * minor_01 / det, weight * minor_02 / det
    for i in range(n):
        x, y = feet[i, 0] - com_xy[0], feet[i, 1] - com_xy[1]
        force[i] = max(0.0, support[i] * (l0 + l1 * x + l2 * y))
    return force


@kernel
def set_points(
    model: KinematicModel,
    feet: Array,
    body: Array,
    rot: Array,
    support: Array,
    compliance: Array,
    measured: Array,
    felt: Array,
) -> tuple[Array, Array, Flags]:
    """Return the set-points of the servos that hold the trunk at a pose over the feet.

    A position servo of stiffness kp under the torque tau rests at q = command - tau / kp, tau = G(q) - J'f with G the
    torques by the weight of the links, f the ground's force on the foot, J its Jacobian; the set-point adds tau / kp.
    With the torques of the planned posture the weight pushes a trunk that has drifted farther from its plan; with those
    of the measured one they balance the weight where the trunk is, and the whole stiffness returns it to its plan.

    Args:
        model: kinematics of the robot.
        feet: wanted foot centres in the map, (L, 3) m.
        body: wanted base_link position in the map, (3,) m.
        rot: rotation from base_link to map, (3, 3).
        support: share of each foot in carrying the weight, 0..1, (L,).
        compliance: compensated part of 1 / kp of every joint, rad/Nm, (nj,); zeros switch it off.
        measured: joint angles (nj,), rad, at which the torques are computed; empty = the planned ones.
        felt: rotation from base_link to map at the measured angles, (3, 3); unused without them.

    Returns:
        Set-points (nj,) rad within the joint limits, joint angles (nj,) rad without compensation, True for legs that
        reach, (L,).
    """
    feet_base = into_base(feet, body, rot)
    q, reachable = kinematics.legs_ik(model, feet_base)
    at, turned, ground = q, rot, feet
    if measured.size > 0:
        at, turned = measured, felt
        ground = into_map(kinematics.foot_positions(model, at), body, turned)
    up, g_up = np.empty(3), np.empty(3)
    for k in range(3):
        up[k], g_up[k] = turned[2, k], GRAVITY * turned[2, k]
    rot_links, pos_links = kinematics.forward(model, at)
    torque = kinematics.gravity_torques_of(model, rot_links, pos_links, g_up)
    com = kinematics.com_of(model, rot_links, pos_links)
    com_xy = np.empty(2)
    for k in range(2):
        com_xy[k] = body[k] + turned[k, 0] * com[0] + turned[k, 1] * com[1] + turned[k, 2] * com[2]
    force = share_load(ground, com_xy, support, GRAVITY * kinematics.total_mass(model))
    jac = kinematics.foot_jacobians_of(model, rot_links, pos_links)
    for i in range(feet.shape[0]):
        for c in range(model.leg_joints.shape[1]):
            j = model.leg_joints[i, c]
            if j >= 0:
                torque[j] -= force[i] * (jac[i, 0, c] * up[0] + jac[i, 1, c] * up[1] + jac[i, 2, c] * up[2])
    command = np.empty_like(q)
    for j in range(q.size):
        command[j] = min(model.upper[j], max(model.lower[j], q[j] + compliance[j] * torque[j]))
    return command, q, reachable
