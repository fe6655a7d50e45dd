"""Reasons why the inverse kinematics of a leg refuses a place of its foot: too far, or not by its closed form."""

import math

import numpy as np

from surefoot.arrays import Array

from .description import KinematicModel
from .kinematics import LIMIT_SLACK
from .rolled_legs import REACH_SLACK, rolled_ik

KNEE = "as its knee always bends to the side of the neutral stance; to the other side it would reach"
HIP = "as its foot always stays on the side of the first joint axis where it neutrally is; on the other it would reach"
STEPS = "by steps from the neutral stance (this kind of leg has no closed form)"


def why_missed(model: KinematicModel, leg: int, place: Array) -> str:
    """Return the reason in words why inverse kinematics refuses a place of the foot; empty: no joint angles reach it.

    The closed forms bend each knee to one side, that of the neutral stance (yaw-pitch-pitch legs: knee up), and keep
    the foot on one side of the first axis, so a place that other angles within the limits reach may be refused.

    Args:
        model: the robot.
        leg: index of the leg.
        place: foot centre in base_link, (3,) m.
    """
    yawed = not math.isnan(model.segment[leg, 0])
    if not yawed and math.isnan(model.rolled.segment[leg, 0]):
        return STEPS
    solve = _yawed if yawed else _rolled
    for side, bend in ((1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
        q = solve(model, leg, place, side, bend)
        if q is not None and _within(model, leg, q):
            return KNEE if side > 0.0 else HIP
    return ""


def _yawed(model: KinematicModel, leg: int, place: Array, side: float, bend: float) -> Array | None:
    """Return the angles (3,) rad of a yaw-pitch-pitch leg whose foot is at `place` (3,) m; None: it is too short.

    side: 1 = foot outside of the first axis, -1 = behind it; bend: 1 = knee up, -1 = knee down.
    """
    c, f, t = model.segment[leg].tolist()
    psi = float(model.hip[leg, 3])
    dx, dy, z = (place - model.hip[leg, :3]).tolist()
    x, y = math.cos(psi) * dx + math.sin(psi) * dy, math.cos(psi) * dy - math.sin(psi) * dx
    r = side * math.hypot(x, y) - c
    cos_knee = (r * r + z * z - f * f - t * t) / (2.0 * f * t)
    if abs(cos_knee) > 1.0 + REACH_SLACK:
        return None
    knee = -bend * math.acos(min(1.0, max(-1.0, cos_knee)))
    femur = math.atan2(z, r) - math.atan2(t * math.sin(knee), f + t * math.cos(knee))
    return np.array([math.atan2(side * y, side * x), math.remainder(femur, 2.0 * math.pi), knee])


def _rolled(model: KinematicModel, leg: int, place: Array, side: float, bend: float) -> Array | None:
    """Return the angles (3,) rad of a roll-pitch-pitch leg whose foot is at `place` (3,) m; None: it is too short.

    `side`, `bend`: 1 = those of the neutral stance, -1 = foot on the other side of the first axis, other bend.
    """
    joints, signs = model.leg_joints[leg][:3], model.rolled.side.copy()
    signs[leg, :2] *= side, bend
    middle = 0.5 * (model.lower[joints] + model.upper[joints])
    q, reached = rolled_ik(model.rolled._replace(side=signs), leg, place, middle)
    return q if reached else None


def _within(model: KinematicModel, leg: int, q: Array) -> bool:
    """Return True if the angles (3,) rad of a leg lie within its joint limits."""
    joints = model.leg_joints[leg][:3]
    return bool(((q >= model.lower[joints] - LIMIT_SLACK) & (q <= model.upper[joints] + LIMIT_SLACK)).all())
