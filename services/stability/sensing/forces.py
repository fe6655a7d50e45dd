"""Foot forces from motor torques, and the CoM from foot forces (Walas & Belter 4.5, corrected)."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Flags
from surefoot.geometry.linear import dot, norm, product
from surefoot.geometry.linear_kernels import inverse3
from surefoot.kernels.jit import row_kernel
from surefoot.robot.description import KinematicModel, Robot
from surefoot.robot.kinematics import forward, gravity_torques_of

from .posture import contact_jacobians_of

LEAST_SHARE = 0.02  # of the weight: torques that make less of it do not determine their gain
BLIND = 0.5  # standard deviation of a tangential force that nothing measures, as a share of the normal force
STRAIGHT = 30.0  # condition number of a leg's Jacobian above which its force is not observed (2.4 in a neutral stance)


@dataclass(frozen=True, slots=True)
class FootForces:
    """Force of the ground on each of L feet, with covariance; axes of base_link unless the forces have been rotated."""

    force: Array
    """Force of the ground on each foot, base_link, (L, 3) N."""
    covariance: Array
    """Covariance of each force, base_link, (L, 3, 3) N^2."""
    observed: Flags
    """True where torques (a leg of three joints, not stretched) or a sensor determine the force, (L,)."""


@dataclass(frozen=True, slots=True)
class MeasuredCom:
    """Centre of mass by the forces on the feet."""

    com: Array
    """Coordinates x and y of the CoM, (2,) m, frame of the forces."""
    covariance: Array
    """Covariance of the x and y of the CoM, (2, 2) m^2."""
    weight: float
    """Sum of the measured vertical forces, N."""
    misfit: float
    """Squared, normalised violation of the equations of rest (F_x, F_y, yaw moment), chi-square of 3 degrees of
    freedom."""


def forces_from_torques(robot: Robot, joints: Array, torque: Array, g_up: Array, torque_variance: float) -> FootForces:
    """Return the forces of the ground on the feet, F = J^-T (G(q) - tau), with the weight of the leg itself.

    Equation (30) of Walas & Belter is F = J^-T Q, which is the force of the foot on the ground and leaves the leg's
    weight out (20 % of the load of a Ragno leg). J belongs to the point of the foot sphere that touches level ground.

    Args:
        robot: the robot; legs of three joints are read.
        joints: q, (nj,) rad.
        torque: tau that the servos exert on the joints, (nj,) Nm.
        g_up: upward specific force at rest, base_link, (3,) m/s2.
        torque_variance: variance of each torque, Nm^2.
    """
    found = leg_inverses(robot, joints, g_up)
    force, covariance = _leg_forces(robot.model, found.inverse, found.own, torque, torque_variance)
    return FootForces(force, covariance, found.observed)


class LegInverses(NamedTuple):
    """Maps from joint torques to foot forces in one posture."""

    inverse: Array
    """Maps J^-T (J Jacobian of the foot) of each leg, base_link, (L, 3, 3) 1/m; zero where no force is observed."""
    own: Array
    """Torques G(q) with which the servos hold the weight of the legs themselves, (nj,) Nm."""
    observed: Flags
    """True where the torques of the leg determine its foot's force, (L,)."""


def leg_inverses(robot: Robot, joints: Array, g_up: Array) -> LegInverses:
    """Return maps from joint torques to foot forces, J^-T, and the torques G(q) that hold the legs' own weight.

    J is the Jacobian of the point where a foot touches level ground. joints: q, (nj,) rad; g_up: upward specific force
    at rest, base_link, (3,) m/s^2.
    """
    return LegInverses(*_leg_inverses(robot.model, joints, g_up, robot.foot_radii))


def gain_from_weight(robot: Robot, joints: Array, torque: Array, g_up: Array, stance: Flags) -> float | None:
    """Return the factor s on all torques with which the feet carry the known weight, so that the CoM needs no gain.

    With a wrong gain forces are not just scaled, because the leg's own weight is known and not measured: F = J^-T
    (G - s tau), J Jacobians of the feet, G torques that hold the legs. Vertical forces of the standing feet give s =
    (sum [J^-T G]_z - m g) / sum [J^-T tau]_z.

    Args:
        robot: description of the robot, whose mass is m.
        joints: angles, (nj,) rad.
        torque: tau as measured, (nj,) Nm.
        g_up: upward specific force at rest, base_link, (3,) m/s^2; its length is g.
        stance: standing feet, (L,).

    Returns:
        The factor s, no unit; None when a standing leg is not observed, or the torques carry too little of the weight.
    """
    found = leg_inverses(robot, joints, g_up)
    if not stance.any() or not found.observed[stance].all():
        return None
    size = norm(g_up)
    rows = product(g_up / size, found.inverse[stance])  # vertical force per torque, (n, 3)
    index = robot.model.leg_joints[stance][:, :3]
    measured = float(np.sum(rows * torque[index]))
    if abs(measured) < LEAST_SHARE * robot.mass * size:
        return None
    return (float(np.sum(rows * found.own[index])) - robot.mass * size) / measured


def fuse_normal(found: FootForces, normal: Array, load: Array, variance: Array) -> FootForces:
    """Fuse forces F from torques with the loads p = n'F of sensors under the feet, each weighted by its covariance.

    F += K (p - n'F), K = R n / (n'R n + s^2), n normal of the sole, R covariance of F, s^2 variance of p. A leg that is
    not observed is taken from its sensor alone: F = p n, with tangential parts as uncertain as half of the load.

    Args:
        found: forces from torques; not changed.
        normal: unit normal of each sole, axes of the forces, (L, 3).
        load: p, (L,) N; NaN = no reading.
        variance: variance of each load, (L,) N^2.
    """
    force, covariance, observed = found.force.copy(), found.covariance.copy(), found.observed.copy()
    for i in np.flatnonzero(np.isfinite(load)):
        n: Array = normal[i]
        if not observed[i]:
            side = (BLIND * max(float(load[i]), 0.0)) ** 2 + float(variance[i])
            force[i] = load[i] * n
            covariance[i] = variance[i] * np.outer(n, n) + side * (np.eye(3) - np.outer(n, n))
            observed[i] = True
            continue
        seen = product(covariance[i], n)
        gain = seen / (dot(n, seen) + float(variance[i]))
        force[i] = force[i] + gain * (load[i] - dot(n, force[i]))
        rest: Array = np.eye(3) - np.outer(gain, n)
        covariance[i] = product(product(rest, covariance[i]), rest.T) + variance[i] * np.outer(gain, gain)
    return FootForces(force, covariance, observed)


@row_kernel
def _leg_inverses(model: KinematicModel, joints: Array, g_up: Array, radius: Array) -> tuple[Array, Array, Flags]:
    rot, pos = forward(model, joints)
    return _leg_inverses_of(model, rot, pos, g_up, radius)


@row_kernel
def _leg_inverses_of(
    model: KinematicModel, rot: Array, pos: Array, g_up: Array, radius: Array
) -> tuple[Array, Array, Flags]:
    size = math.sqrt(g_up[0] * g_up[0] + g_up[1] * g_up[1] + g_up[2] * g_up[2])
    up, transposed = np.empty(3), np.empty((3, 3))
    for r in range(3):
        up[r] = g_up[r] / size
    jacobian = contact_jacobians_of(model, rot, pos, up, radius)
    count, width = model.leg_joints.shape
    inverse, observed = np.zeros((count, 3, 3)), np.zeros(count, dtype=np.bool_)
    for i in range(count):
        if width != 3 or model.leg_joints[i, 2] < 0:
            continue
        for r in range(3):
            for s in range(3):
                transposed[r, s] = jacobian[i, s, r]
        inv, condition = inverse3(transposed)  # J^-T
        if condition <= STRAIGHT:
            observed[i] = True
            for r in range(3):
                for s in range(3):
                    inverse[i, r, s] = inv[r, s]
    return inverse, gravity_torques_of(model, rot, pos, g_up), observed


@row_kernel
def leg_forces_of(
    model: KinematicModel, rot: Array, pos: Array, g_up: Array, radius: Array, torque: Array, variance: float
) -> tuple[Array, Array, Flags]:
    """Return force (L, 3) N on each foot, covariance (L, 3, 3) N^2, base_link, and True where observed, (L,).

    Args:
        model: links and joints of the robot.
        rot: orientations of its links, (n, 3, 3), base_link from link.
        pos: origins of the links in base_link, (n, 3) m.
        g_up: upward specific force at rest, base_link, (3,) m/s^2.
        radius: radii of the foot spheres, (L,) m.
        torque: torques of the servos, (nj,) Nm.
        variance: variance of each torque, Nm^2.
    """
    inverse, own, observed = _leg_inverses_of(model, rot, pos, g_up, radius)
    force, covariance = _leg_forces(model, inverse, own, torque, variance)
    return force, covariance, observed


@row_kernel
def _leg_forces(
    model: KinematicModel, inverse: Array, own: Array, torque: Array, variance: float
) -> tuple[Array, Array]:
    count = inverse.shape[0]
    force, covariance = np.zeros((count, 3)), np.zeros((count, 3, 3))
    for i in range(count):
        for r in range(3):
            for k in range(min(3, model.leg_joints.shape[1])):
                j = model.leg_joints[i, k]
                if j < 0:
                    continue
                force[i, r] += inverse[i, r, k] * (own[j] - torque[j])
                for s in range(3):
                    covariance[i, r, s] += variance * inverse[i, r, k] * inverse[i, s, k]
    return force, covariance


def com_from_forces(
    position: Array, force: Array, covariance: Array, floor: float = 1e-9, tilt_sd: float = 0.0
) -> MeasuredCom | None:
    """Return CoM and weight by least squares over the six equations of rest; replaces (31) of Walas & Belter.

    Three equations must hold whatever the CoM is: sum F_x = sum F_y = 0 and no yaw moment, C F = 0. The measured forces
    Fm, covariance R, are projected on them, F = Fm - R C'(C R C')^-1 C Fm; then W = sum F_z and c = centroid + sum(r
    F_z - z F) / W, with the feet r (x, y), z from their centroid. (31) divides by an assumed weight instead: there a
    gain error of the sensors scales c about the origin, here it cancels.

    Args:
        position: feet, (n, 3) m, gravity-aligned frame.
        force: ground on foot, (n, 3) N, in these axes.
        covariance: covariance of each force, (n, 3, 3) N^2.
        floor: smallest weight that counts, N.
        tilt_sd: standard deviation of the frame's roll and pitch, rad: the weight seen in a tilted frame has a
            horizontal part, so sum F_x = sum F_y = 0 holds only up to W times that.

    Returns:
        None when the feet carry less than `floor`.
    """
    if len(position) == 0:
        return None
    com, spread, weight, misfit = _com(position, force, covariance, tilt_sd)
    return MeasuredCom(com, spread, float(weight), float(misfit)) if weight > floor else None


@row_kernel
def _com(position: Array, force: Array, covariance: Array, tilt_sd: float) -> tuple[Array, Array, float, float]:
    n = position.shape[0]
    centroid = np.zeros(3)
    for i in range(n):
        for a in range(3):
            centroid[a] += position[i, a] / n
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
    vertical = 0.0
    for i in range(n):
        vertical += force[i, 2]
    lean = tilt_sd * vertical
    square[0, 0] += lean * lean
    square[1, 1] += lean * lean
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
    spread = _com_covariance(position, covariance, centroid, com, weight, gain, inv)
    for d in range(2):
        com[d] = centroid[d] + com[d]
    return com, spread, weight, misfit


@row_kernel
def _com_covariance(
    position: Array, covariance: Array, centroid: Array, com: Array, weight: float, gain: Array, inv: Array
) -> Array:
    """Return the covariance (2, 2) m^2 of the CoM, `com` (2,) m from the centroid of the feet.

    Args:
        position: feet, (n, 3) m.
        covariance: R of the force on each, (n, 3, 3) N^2.
        centroid: mean of the feet, (3,) m.
        com: x, y of the CoM from the centroid, (2,) m.
        weight: sum of the vertical forces, N.
        gain: R C' of each foot, (n, 3, 3), C (3, 3) mapping its force to sum F_x, sum F_y and yaw moment.
        inv: inverse of the sum of C R C', (3, 3).
    """
    n = position.shape[0]
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
    return spread
