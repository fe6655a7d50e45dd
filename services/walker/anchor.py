"""Where the plan lies in the map: laid under measured joints at the start, laid anew over the estimate at each step.

Laying the plan anew moves trunk and feet together, so the feet keep their place in the trunk frame and no joint moves.
"""

import numpy as np

from services.walker import posture
from services.walker.ground import Ground
from services.walker.interface import WalkerInputs
from services.walker.params import WalkerParams
from services.walker.state import Stage, WalkerState
from surefoot import kinematics, rotations
from surefoot.robot import Robot


def begin(state: WalkerState, robot: Robot, inputs: WalkerInputs) -> None:
    """Lay the plan under the measured joints; feet without contact will be lowered first."""
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
    s.recovering = not bool(down.all())
    s.stage = Stage.SETTLE if s.recovering else Stage.STAND


def lay_over(state: WalkerState, params: WalkerParams, ground: Ground | None, inputs: WalkerInputs) -> None:
    """Lay the whole plan over the estimated position, heading and tilt, and part of the way over the map's heights."""
    s, limit = state, params.level_limit_rad
    old = rotations.matrix_from_rpy(s.level[0], s.level[1], s.yaw)
    s.level[:] = max(-limit, min(limit, inputs.roll)), max(-limit, min(limit, inputs.pitch))
    s.yaw = inputs.yaw
    new = rotations.matrix_from_rpy(s.level[0], s.level[1], s.yaw)
    at = np.array([inputs.x, inputs.y, s.body[2]])
    s.feet = posture.into_map(posture.into_base(s.feet, s.body, old), at, new)
    s.footholds = posture.into_map(posture.into_base(s.footholds, s.body, old), at, new)
    s.body = at
    if ground is None:
        return
    gaps = np.array([ground.centre_height(p[0], p[1]) - p[2] for p in s.footholds[s.landed]])
    gaps = gaps[np.isfinite(gaps)]
    if gaps.size:
        rise = (params.anchor_height if s.calibrated else 1.0) * float(np.median(gaps))
        s.body[2] += rise
        s.feet[:, 2] += rise
        s.footholds[:, 2] += rise
