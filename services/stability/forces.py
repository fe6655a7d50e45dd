"""Foot forces from motor torques, and the CoM from foot forces (Walas & Belter 4.5, corrected: design note 2.7, 2.8)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.stability.contacts import Array
from surefoot.kinematics import foot_jacobians, gravity_torques
from surefoot.robot import Robot

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
    """(L,) the leg's posture lets the torques tell the force."""


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

    (30) prints F = J^-T Q, which is the force of the foot on the ground and leaves the leg's weight out (20 % of the load
    of a Ragno leg).

    Args:
        robot: with three joints a leg.
        joints: q, (nj,) rad.
        torque: tau that the servos exert on the joints, (nj,) Nm.
        g_up: upward specific force at rest, base_link, (3,) m/s2.
        torque_variance: of each torque, Nm^2.
    """
    model = robot.model
    jacobian = foot_jacobians(model, joints)  # (L, 3, n)
    own = gravity_torques(model, joints, g_up)
    count = len(jacobian)
    force, covariance = np.zeros((count, 3)), np.zeros((count, 3, 3))
    observed = np.zeros(count, dtype=np.bool_)
    for i, leg in enumerate(robot.legs):
        chosen = list(leg.joints)
        transposed = jacobian[i, :, : len(chosen)].T  # (n, 3)
        singular = np.linalg.svd(transposed, compute_uv=False)
        if len(singular) < 3 or singular[2] * STRAIGHT <= singular[0]:
            continue
        inverse = np.linalg.pinv(transposed)  # J^-T
        force[i] = inverse @ (own[chosen] - torque[chosen])
        covariance[i] = torque_variance * inverse @ inverse.T
        observed[i] = True
    return FootForces(force, covariance, observed)


def com_from_forces(position: Array, force: Array, covariance: Array, floor: float = 1e-9) -> MeasuredCom | None:
    """CoM and weight by least squares over the six equations of rest, both free: replaces (31).

    Three equations must hold whatever the CoM is: sum F_x = sum F_y = 0 and no yaw moment, C F = 0. The forces are
    projected on them, F = Fm - R C'(C R C')^-1 C Fm, then W = sum F_z and c = centroid + sum(r F_z - z F) / W. (31) divides
    by an assumed weight instead, so that a gain error of the sensors scales c about the origin; here it cancels.

    Args:
        position: feet, (n, 3) m, gravity-aligned frame.
        force: ground on foot, (n, 3) N, same axes.
        covariance: of each force, (n, 3, 3) N^2.
        floor: smallest weight that counts, N.

    Returns:
        None when the feet carry less than `floor`.
    """
    n = len(position)
    if n == 0:
        return None
    centroid = position.mean(axis=0)
    r = position - centroid
    constraint = np.zeros((3, 3 * n))  # C
    constraint[0, 0::3] = constraint[1, 1::3] = 1.0
    constraint[2, 0::3], constraint[2, 1::3] = -r[:, 1], r[:, 0]
    spread = np.zeros((3 * n, 3 * n))  # R
    for i in range(n):
        spread[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = covariance[i]
    measured = force.ravel()
    gain = spread @ constraint.T @ np.linalg.pinv(constraint @ spread @ constraint.T)
    broken = constraint @ measured
    rest = measured - gain @ broken
    left = spread - gain @ constraint @ spread
    weight = float(rest[2::3].sum())
    if not weight > floor:
        return None
    gx, gy, gz = rest[0::3], rest[1::3], rest[2::3]
    com = np.array([r[:, 0] @ gz - r[:, 2] @ gx, r[:, 1] @ gz - r[:, 2] @ gy]) / weight
    slope = np.zeros((2, 3 * n))
    slope[0, 2::3], slope[0, 0::3] = r[:, 0] - com[0], -r[:, 2]
    slope[1, 2::3], slope[1, 1::3] = r[:, 1] - com[1], -r[:, 2]
    slope /= weight
    misfit = float(broken @ np.linalg.pinv(constraint @ spread @ constraint.T) @ broken)
    return MeasuredCom(centroid[:2] + com, slope @ left @ slope.T, weight, misfit)
