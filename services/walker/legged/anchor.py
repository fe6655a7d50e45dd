"""Alignment of planned trunk and feet with the map: from measured joints at the start, from the estimate at each step.

Placing the plan anew moves trunk and feet together, so the feet keep their place in the trunk frame and no joint moves.
"""

import math
from dataclasses import replace

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry import rotations
from surefoot.geometry.linear import dot
from surefoot.robot import kinematics
from surefoot.robot.description import Robot

from ..interface import WalkerInputs
from . import posture
from .ground import Ground
from .params import WalkerParams
from .state import Stage, WalkerState

MIN_FEET = 5  # standing feet on known ground from which a tilt is learned; all feet of a quadruped
MIN_SPREAD = 0.1  # m, of the feet
MAX_TILT_OFFSET = 0.06  # rad; an accelerometer bias of 3 sigma (ADIS16365: 16 mg turn-on)


def begin(state: WalkerState, robot: Robot, inputs: WalkerInputs) -> None:
    """Set planned trunk and feet by measured joints and estimate; feet without contact will be lowered first.

    `state` is changed in place: the stage becomes STAND if all feet have contact, or none has, else SETTLE. Its joints
    must have been measured.
    """
    s = state
    assert s.measured is not None
    rot = rotations.matrix_from_rpy(inputs.roll, inputs.pitch, inputs.yaw)
    feet = posture.into_map(kinematics.foot_positions(robot.model, s.measured), np.zeros(3), rot)
    down = s.contacts if s.contacts.any() else np.ones(robot.nlegs, dtype=np.bool_)
    s.body[:] = (inputs.x, inputs.y, -float(np.mean(feet[down, 2])) + robot.foot_radius)
    s.yaw, s.level[:] = inputs.yaw, (inputs.roll, inputs.pitch)
    s.feet = feet + s.body
    s.footholds = s.feet.copy()
    s.support[:] = down
    s.landed = down.copy()
    s.recovering = s.recovering or not bool(down.all())
    s.stage = Stage.STAND if down.all() else Stage.SETTLE


def lay_over(state: WalkerState, params: WalkerParams, ground: Ground | None, inputs: WalkerInputs) -> None:
    """Align planned trunk and feet with the estimated pose and tilt, and in part with the heights of the map.

    Trunk and feet move together, so the feet keep their place in the trunk frame. `state` is changed in place; `ground`
    None: no height errors are corrected.
    """
    s, limit = state, params.level_limit_rad
    old = rotations.matrix_from_rpy(s.level[0], s.level[1], s.yaw)
    roll, pitch = tilt(s, inputs)
    s.level[:] = max(-limit, min(limit, roll)), max(-limit, min(limit, pitch))
    s.yaw = inputs.yaw
    new = rotations.matrix_from_rpy(s.level[0], s.level[1], s.yaw)
    at = np.array([inputs.x, inputs.y, s.body[2]])
    s.feet = posture.into_map(posture.into_base(s.feet, s.body, old), at, new)
    s.footholds = posture.into_map(posture.into_base(s.footholds, s.body, old), at, new)
    s.body = at
    if ground is None:
        return
    standing = s.footholds[s.landed]
    gaps = np.array([ground.centre_height(p[0], p[1]) - p[2] for p in standing])
    known = np.isfinite(gaps)
    gaps, standing = gaps[known], standing[known]
    if not gaps.size:
        return
    rise = (params.anchor_height if s.calibrated else 1.0) * float(np.median(gaps))
    s.body[2] += rise
    s.feet[:, 2] += rise
    s.footholds[:, 2] += rise
    if gaps.size >= min(MIN_FEET, s.legs):
        _correct_tilt(s, params.anchor_tilt, standing[:, :2] - s.body[:2], gaps)


def _correct_tilt(state: WalkerState, gain: float, xy: Array, gaps: Array) -> None:
    """Learn a constant error of the estimated tilt: gaps that grow forward mean a nose higher than estimated.

    Args:
        state: state of the walker; `tilt_offset` is changed.
        gain: share of the found error that is learned.
        xy: places of the standing feet from the trunk, axes of the map, (n, 2) m.
        gaps: height of a foot centre on the map's ground less that of the planned foot, (n,) m.
    """
    s = state
    c, n = math.cos(s.yaw), math.sin(s.yaw)
    ahead, left = c * xy[:, 0] + n * xy[:, 1], -n * xy[:, 0] + c * xy[:, 1]
    ahead, left, gaps = ahead - ahead.mean(), left - left.mean(), gaps - gaps.mean()
    xx, xy_, yy = dot(ahead, ahead), dot(ahead, left), dot(left, left)
    det = xx * yy - xy_ * xy_
    if det < MIN_SPREAD**4:
        return
    gx, gy = dot(ahead, gaps), dot(left, gaps)
    s.tilt_offset[0] += gain * (xx * gy - xy_ * gx) / det
    s.tilt_offset[1] -= gain * (yy * gx - xy_ * gy) / det
    np.clip(s.tilt_offset, -MAX_TILT_OFFSET, MAX_TILT_OFFSET, out=s.tilt_offset)


def placed(state: WalkerState, inputs: WalkerInputs) -> WalkerInputs:
    """Return the inputs with the odometry pose expressed in frame map.

    An estimator that is started again begins at the start pose, wherever the robot is. The robot rests meanwhile, so it
    stands where the plan has it: that pose defines the new offset of odom in the map. The learned error of the tilt is
    reset. `state` is changed in place.
    """
    s = state
    if not s.calibrated:
        return inputs if s.offset == (0.0, 0.0, 0.0) else _moved(inputs, s.offset)
    if not inputs.initialised:
        s.lost = True
    elif s.lost:
        s.lost = False
        turn = s.yaw - inputs.yaw
        c, n = math.cos(turn), math.sin(turn)
        x, y = float(s.body[0]), float(s.body[1])
        s.offset = (x - c * inputs.x + n * inputs.y, y - n * inputs.x - c * inputs.y, turn)
        s.tilt_offset[:] = 0.0
    return inputs if s.offset == (0.0, 0.0, 0.0) else _moved(inputs, s.offset)


def _moved(inputs: WalkerInputs, offset: tuple[float, float, float]) -> WalkerInputs:
    x, y, turn = offset
    c, n = math.cos(turn), math.sin(turn)
    return replace(
        inputs,
        x=x + c * inputs.x - n * inputs.y,
        y=y + n * inputs.x + c * inputs.y,
        yaw=inputs.yaw + turn,
    )


def tilt(state: WalkerState, inputs: WalkerInputs) -> tuple[float, float]:
    """Return estimated roll and pitch less their learned error, rad."""
    return inputs.roll + float(state.tilt_offset[0]), inputs.pitch + float(state.tilt_offset[1])
