"""Joint-space mass matrix of a floating-base robot from its description."""

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import forward


def mass_matrix(robot: Robot, q: Array) -> Array:
    """Return the mass matrix (6 + nj, 6 + nj), SI units, at joint angles q (nj,) rad, without servo rotors.

    M(q) = sum m_i V_i' V_i + W_i' R_i I_i R_i' W_i; V_i and W_i are the Jacobians of link i: velocity of
    its centre of mass, and angular velocity. Columns: linear and angular velocity of base_link, then joint rates.
    """
    rot, pos = forward(robot.model, q)
    whole = np.zeros((6 + robot.nj, 6 + robot.nj))
    for i, link in enumerate(robot.links):
        centre = pos[i] + rot[i] @ link.com
        moves, turns = np.zeros((3, 6 + robot.nj)), np.zeros((3, 6 + robot.nj))
        moves[:, :3], turns[:, 3:6] = np.eye(3), np.eye(3)
        moves[:, 3:6] = np.cross(np.eye(3), centre).T
        at = i
        while at > 0:
            if robot.links[at].joint >= 0:
                axis, column = rot[at] @ robot.links[at].axis, 6 + robot.links[at].joint
                turns[:, column] += axis
                moves[:, column] += np.cross(axis, centre - pos[at])
            at = robot.links[at].parent
        axes = rot[i] @ matrix_from_quat(link.inertia_quat_wxyz)
        whole += link.mass * moves.T @ moves + turns.T @ (axes * link.inertia) @ axes.T @ turns
    return whole
