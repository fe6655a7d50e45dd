"""Foot forces from motor torques, and the CoM from foot forces (Walas & Belter 4.5, corrected as in note 2.7, 2.8)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.stability.contacts import Array
from surefoot.jit import row_kernel
from surefoot.kinematics import foot_jacobians, gravity_torques
from surefoot.robot import KinematicModel, Robot, load_robot

Flags = NDArray[np.bool_]

STRAIGHT = 30.0  # condition number of a leg's Jacobian above which its force is not observed (2.4 in a neutral stance)


@dataclass(frozen=True, slots=True)
class FootForces:
    """Force of the ground on each foot."""

    force: Array
    """(L, 3) N, base_link."""
    covariance: Array
    """(L, 3, 3) N^2, base_link."""
    observed: Flags
    """(L,) the leg's posture lets the torques tell the force (False also for legs with other than three joints)."""


@dataclass(frozen=True, slots=True)
class MeasuredCom:
    """CoM that the foot forces show."""

    com: Array
    """(2,) m, frame of the forces."""
    covariance: Array
    """(2, 2) m^2."""
    weight: float
    """N, sum of the vertical forces."""
    misfit: float
    """Squared, normalised violation of the three equations that hold at rest: chi-square with 3 degrees of freedom."""


def forces_from_torques(robot: Robot, joints: Array, torque: Array, g_up: Array, torque_variance: float) -> FootForces:
    """F = J^-T (G(q) - tau): ground on foot, with the weight of the leg itself.

    (30) prints F = J^-T Q, which is the force of the foot on the ground and leaves the leg's weight out (20 % of the
    load of a Ragno leg).

    Args:
        robot: the robot; legs of three joints are read.
        joints: q, (nj,) rad.
        torque: tau that the servos exert on the joints, (nj,) Nm.
        g_up: upward specific force at rest, base_link, (3,) m/s2.
        torque_variance: of each torque, Nm^2.
    """
    return FootForces(*_leg_forces(robot.model, joints, torque, g_up, torque_variance))


@row_kernel
def inverse3(m: Array) -> tuple[Array, float]:
    """Inverse of a 3x3 matrix by the adjugate, and its condition number in the Frobenius norm (inf: not inverted)."""
    inv = np.empty((3, 3))
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            c, d = (j + 1) % 3, (j + 2) % 3
            inv[j, i] = m[a, c] * m[b, d] - m[a, d] * m[b, c]
    det = m[0, 0] * inv[0, 0] + m[0, 1] * inv[1, 0] + m[0, 2] * inv[2, 0]
    if abs(det) < 1e-300:
        return np.zeros((3, 3)), math.inf
    inv /= det
    return inv, math.sqrt(np.sum(m * m) * np.sum(inv * inv))


@row_kernel
def _leg_forces(
    model: KinematicModel, joints: Array, torque: Array, g_up: Array, variance: float
) -> tuple[Array, Array, Flags]:
    jacobian, own = foot_jacobians(model, joints), gravity_torques(model, joints, g_up)
    count, width = model.leg_joints.shape
    force, covariance, observed = np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros(count, dtype=np.bool_)
    for i in range(count):
        if width != 3 or model.leg_joints[i, 2] < 0:
            continue
        inv, condition = inverse3(jacobian[i].T)  # J^-T
        if condition > STRAIGHT:
            continue
        observed[i] = True
        for r in range(3):
            for k in range(3):
                j = model.leg_joints[i, k]
                force[i, r] += inv[r, k] * (own[j] - torque[j])
                for s in range(3):
                    covariance[i, r, s] += variance * inv[r, k] * inv[s, k]
    return force, covariance, observed


def com_from_forces(position: Array, force: Array, covariance: Array, floor: float = 1e-9) -> MeasuredCom | None:
    """CoM and weight by least squares over the six equations of rest, both free: replaces (31).

    Three equations must hold whatever the CoM is: sum F_x = sum F_y = 0 and no yaw moment, C F = 0. The forces are
    projected on them, F = Fm - R C'(C R C')^-1 C Fm, then W = sum F_z and c = centroid + sum(r F_z - z F) / W. (31)
    divides by an assumed weight instead: there a gain error of the sensors scales c about the origin, here it cancels.

    Args:
        position: feet, (n, 3) m, gravity-aligned frame.
        force: ground on foot, (n, 3) N, same axes.
        covariance: of each force, (n, 3, 3) N^2.
        floor: smallest weight that counts, N.

    Returns:
        None when the feet carry less than `floor`.
    """
    if len(position) == 0:
        return None
    com, spread, weight, misfit = _com(position, force, covariance)
    return MeasuredCom(com, spread, float(weight), float(misfit)) if weight > floor else None


@row_kernel
def _com(position: Array, force: Array, covariance: Array) -> tuple[Array, Array, float, float]:
    n = position.shape[0]
    centroid = np.zeros(3)
    for i in range(n):
        centroid += position[i] / n
    row = np.zeros((n, 3, 3))  # C: for each foot the 3x3 block that maps its force to (sum F_x, sum F_y, yaw moment)
    gain = np.zeros((n, 3, 3))  # R C' for each foot
    square, broken = np.zeros((3, 3)), np.zeros(3)
    for i in range(n):
        row[i, 0, 0] = row[i, 1, 1] = 1.0
        row[i, 2, 0], row[i, 2, 1] = -(position[i, 1] - centroid[1]), position[i, 0] - centroid[0]
        for a in range(3):
            for b in range(3):
                broken[a] += row[i, a, b] * force[i, b]
                for c in range(3):
                    gain[i, a, b] += covariance[i, a, c] * row[i, b, c]
        for a in range(3):
            for b in range(3):
                for c in range(3):
                    square[a, b] += row[i, a, c] * gain[i, c, b]
    for a in range(3):  # one foot feels no yaw moment: leave that equation out
        square[a, a] += 1e-12 * (square[0, 0] + square[1, 1] + square[2, 2]) + 1e-300
    inv = inverse3(square)[0]
    pull, misfit = np.zeros(3), 0.0
    for a in range(3):
        for b in range(3):
            pull[a] += inv[a, b] * broken[b]
            misfit += broken[a] * inv[a, b] * broken[b]
    rest, weight = np.empty((n, 3)), 0.0
    for i in range(n):
        for a in range(3):
            rest[i, a] = force[i, a] - gain[i, a, 0] * pull[0] - gain[i, a, 1] * pull[1] - gain[i, a, 2] * pull[2]
        weight += rest[i, 2]
    com = np.zeros(2)
    for i in range(n):
        for d in range(2):
            com[d] += (
                (position[i, d] - centroid[d]) * rest[i, 2] - (position[i, 2] - centroid[2]) * rest[i, d]
            ) / weight
    slope = np.zeros((n, 2, 3))  # d com / d force
    seen = np.zeros((2, 3))  # slope R C'
    spread = np.zeros((2, 2))
    for i in range(n):
        for d in range(2):
            slope[i, d, 2] = (position[i, d] - centroid[d] - com[d]) / weight
            slope[i, d, d] = -(position[i, 2] - centroid[2]) / weight
            for b in range(3):
                for a in range(3):
                    seen[d, b] += slope[i, d, a] * gain[i, a, b]
        for d in range(2):
            for e in range(2):
                for a in range(3):
                    for b in range(3):
                        spread[d, e] += slope[i, d, a] * covariance[i, a, b] * slope[i, e, b]
    for d in range(2):
        for e in range(2):
            for a in range(3):
                for b in range(3):
                    spread[d, e] -= seen[d, a] * inv[a, b] * seen[e, b]
    return centroid[:2] + com, spread, weight, misfit


def warm() -> None:
    """Compile the kernels of this module."""
    robot = load_robot("ragno")
    found = forces_from_torques(robot, robot.neutral, np.zeros(len(robot.neutral)), np.array([0.0, 0.0, 9.81]), 1.0)
    com_from_forces(np.zeros((1, 3)), found.force[:1], found.covariance[:1])
