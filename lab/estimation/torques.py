"""Ground forces of a log by its joint torques and the legs of a robot description: tau = G(q) - J^T f at rest.

G holds the weight of the links, J is the Jacobian of the foot's centre, f the force of the ground on the foot; what
accelerates legs, friction of gears, and the moments of flat soles are left out.
"""

from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.errors import SurefootError
from surefoot.geometry.constants import GRAVITY
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import foot_jacobians, gravity_torques

FACTOR = 2.0
"""Ratio of median total foot force to robot weight, or its inverse, above which a note reports that joint torques have
a wrong scale."""
STRETCHED = 0.02
"""Ratio of a singular value of a leg's Jacobian to the largest one, below which the foot force in the direction of that
singular value is set to 0: the torques of a stretched leg do not show it."""


class TorqueForces(NamedTuple):
    """Ground forces of the feet, computed from joint torques."""

    force: Array  # (m, F) N, along the vertical
    note: str  # on their scale; empty = as the robot's weight


def forces_by_torques(robot: Robot, joints: Array, torques: Array, up: Array) -> TorqueForces:
    """Return the vertical ground force on each foot, N, by statics of joint torques and link weights.

    Args:
        robot: robot description with the legs and their weight.
        joints: joint angles, (m, nj) rad.
        torques: torques of the motors on the joints, (m, nj) Nm, positive as the angles.
        up: direction of the vertical, (m, 3), axes of base_link.

    Raises:
        SurefootError: the torques have the other sign.
    """
    model, legs = robot.model, robot.model.leg_joints
    force = np.zeros((len(joints), len(legs)))
    for row, (q, tau, vertical) in enumerate(zip(joints, torques, up, strict=True)):
        if not np.isfinite(q).all():
            force[row] = np.nan
            continue
        jacobians, weight = foot_jacobians(model, q), gravity_torques(model, q, GRAVITY * vertical)
        for leg, own in enumerate(legs):
            own = own[own >= 0]
            pulled = np.linalg.lstsq(jacobians[leg][:, : len(own)].T, (weight - tau)[own], rcond=STRETCHED)[0]
            force[row, leg] = pulled @ vertical
    usual, known = float(np.nanmedian(force.sum(axis=1))), GRAVITY * robot.mass
    ratio = usual / known
    seen = f"joint torques make ground forces of {usual:.3g} N (median), {robot.name} weighs {known:.3g} N"
    if -FACTOR < ratio < -1.0 / FACTOR:
        raise SurefootError("invalid", f"{seen}: multiply the torques by -1", "torque")
    if not 1.0 / FACTOR < ratio < FACTOR:
        return TorqueForces(force, f"{seen}: another scale (gear, unit), sign of single joints, or another robot?")
    return TorqueForces(force, "")
