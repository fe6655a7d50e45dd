"""Robots by name or file, and their kinematics. Each robot is a folder beside this file, see docs/robots.md.

    ragno = robots.load("ragno")
    robots.feet(ragno, robots.stance(ragno))

Angles in rad, positions in m, frame base_link, joints and legs in the order of the description.
"""

import numpy as np
from numpy.typing import ArrayLike

from surefoot.arguments import FARTHEST_FOOT, WIDEST_ANGLE, array, instance
from surefoot.arrays import Array
from surefoot.errors import FieldError
from surefoot.robot import kinematics
from surefoot.robot.description import Robot, RobotError
from surefoot.robot.reach import why_missed
from surefoot.robot.reader import load_robot as load
from surefoot.robot.reader import robot_names as names

__all__ = ["Robot", "RobotError", "com", "feet", "joints", "load", "names", "stance"]

MISSED_M = 1e-6
"""Distance, m, of a foot from its wanted place from which on the joint angles are refused."""


def stance(robot: Robot) -> Array:
    """Return the neutral joint angles of a robot, (nj,) rad, in the order of its description."""
    return _known(robot).neutral.copy()


def feet(robot: Robot, q: ArrayLike) -> Array:
    """Return the foot centres in base_link, (L, 3) m, at joint angles q (nj,) rad (raises FieldError)."""
    return kinematics.foot_positions(_known(robot).model, _angles(robot, q))


def com(robot: Robot, q: ArrayLike) -> Array:
    """Return the centre of mass of a robot in base_link, (3,) m, at joint angles q (nj,) rad (raises FieldError)."""
    return kinematics.com(_known(robot).model, _angles(robot, q))


def joints(robot: Robot, feet: ArrayLike) -> Array:
    """Return joint angles, (nj,) rad, at which the foot centres are at `feet`.

    Args:
        robot: description; legs without a closed form are solved step by step from the neutral stance, others with
            knee and foot on the sides of that stance.
        feet: foot centres in base_link, (L, 3) m.

    Raises:
        FieldError: a shape, NaN or range, or a place that a leg cannot reach, alone or with the others.
    """
    wanted = array(feet, "feet", (len(_known(robot).legs), 3), "m", low=-FARTHEST_FOOT, high=FARTHEST_FOOT)
    q, reached = kinematics.legs_ik(robot.model, wanted)
    if not reached.all():
        leg = int((~reached).argmax())
        text = f"got {wanted[leg].tolist()} m, out of reach of leg {robot.leg_names[leg]} within its joint limits"
        if reason := why_missed(robot.model, leg, wanted[leg]):
            text += f", {reason}"
        raise FieldError("range", f"feet.{leg}", text)
    missed = np.sqrt(((kinematics.foot_positions(robot.model, q) - wanted) ** 2).sum(axis=1))
    if missed.max() > MISSED_M:  # a motor that moves two legs, as the Nao's hips
        leg = int(missed.argmax())
        text = f"got {wanted[leg].tolist()} m, which leg {robot.leg_names[leg]} misses by {missed[leg]:.3g} m"
        raise FieldError("range", f"feet.{leg}", f"{text}: a motor of it moves another leg too")
    return q


def _known(robot: Robot) -> Robot:
    instance(robot, "robot", Robot, "the result of `robots.load`")
    return robot


def _angles(robot: Robot, q: ArrayLike) -> Array:
    return array(q, "q", (robot.nj,), "rad", low=-WIDEST_ANGLE, high=WIDEST_ANGLE)
