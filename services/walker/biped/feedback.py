"""Feedback of the estimate to the biped walker: the trunk's tilt, the true length of its steps, and a fall."""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.robot.description import Robot
from surefoot.schemas.topics import TICK_S

from ..interface import WalkerInputs
from .ik import LegGeometry
from .params import BipedParams
from .plan import smooth
from .state import BipedState, Mode

REST_TICKS = 100  # of standing, after which the tilt counts as that of the quiet stance
REST_GAIN = 0.02
STRIDES = 1.0
"""Time constant of the mean tilt that counts as usual while walking, in strides: the sway within a stride is damped to
a sixth, while floor, servos and the estimate's bias are followed while the robot turns by 23 deg an action."""
QUIET_RAD_S = 0.02
"""Angular rate of a standing robot's trunk up to which the ankles do not react, rad/s: five times the noise of Nao's
gyro. Without it 4 of 62 Naos kept trembling at 0.01 to 0.02 rad/s by servo, delay and gain, so that the gyro's bias was
never measured."""
FOLDED = (-1.0, 1.8, -0.9)  # rad, hip pitch, knee and ankle pitch of a robot that gives up


def watch(s: BipedState, p: BipedParams, inputs: WalkerInputs) -> bool:
    """Update the trunk's tilt and rate from the estimate; return True if the robot begins to fall.

    The unplanned tilt is the measured tilt less its slow mean `rest`. That mean holds the floor's slope, which turns
    with the heading, the servos' zeros and the bias of the estimate, which may wander by some degrees in a walk. A
    disturbance moves the mean by at most `slow_from_rad` of its size.

    Args:
        s: state; rate, rest, tilt and peak are updated, and the reason of a fall.
        p: settings.
        inputs: estimate of this tick: roll and pitch, rad, and their rates, rad/s.
    """
    rate = np.array(inputs.rate[:2])
    s.rate = p.gyro_smooth * s.rate + (1.0 - p.gyro_smooth) * rate
    measured = np.array([inputs.roll, inputs.pitch])
    tilt = measured - s.rest
    if s.mode is Mode.STAND and s.clock > REST_TICKS:
        s.rest += REST_GAIN * tilt
    elif s.mode is Mode.STEP:
        most = p.slow_from_rad
        s.rest += TICK_S / (STRIDES * 2.0 * p.step_s) * np.minimum(most, np.maximum(-most, tilt))
    tilt = measured - s.rest
    s.tilt = tilt
    size = float(np.hypot(*tilt))
    s.peak = max(s.peak, size)
    if size <= p.falling_rad or s.mode in (Mode.FOLD, Mode.FALLEN, Mode.WAIT):
        return False
    s.reason = f"fallen: trunk tilted by {math.degrees(size):.0f} deg"
    return True


def felt_rate(s: BipedState) -> Array:
    """Return the trunk's roll and pitch rate that the ankles counteract, (2,) rad/s, with a dead zone at a stand."""
    if s.mode is not Mode.STAND:
        return s.rate
    return np.sign(s.rate) * np.maximum(0.0, np.abs(s.rate) - QUIET_RAD_S)


def learn(s: BipedState, p: BipedParams, body: Array) -> None:
    """Update the gain of planned steps, `s.gain`, by the ratio of measured to planned distance of the whole walk.

    Args:
        s: state; its body pose is still that before the step; sums of distances and gains are changed in place.
        p: settings.
        body: x, y (m) and yaw (rad) of the body at the end of the step by plan, odom, (3,).
    """
    if s.seen_then is not None and p.learn > 0.0 and s.learning and not s.held:
        plan, seen = body - s.body, s.seen - s.seen_then
        heading, back = body[2], s.seen[2]
        s.planned_way += (math.cos(heading) * plan[0] + math.sin(heading) * plan[1], plan[2])
        s.measured_way += (math.cos(back) * seen[0] + math.sin(back) * seen[1], seen[2])
        for i, least in ((0, 4.0 * p.step_m), (1, 3.0 * p.turn_step_rad)):
            if abs(s.planned_way[i]) > least:
                ratio = s.measured_way[i] / s.planned_way[i]
                wanted = min(1.0 + p.learn_limit, max(1.0 - p.learn_limit, ratio))
                s.gain[i] += p.learn * (wanted - s.gain[i])
    s.seen_then = s.seen.copy()


def fold(s: BipedState, p: BipedParams, robot: Robot, g: LegGeometry) -> None:
    """Bend the knees of a falling robot by one more tick, feet in place, so that it falls from less height.

    Args:
        s: state; clock and command are changed, and at the end the mode.
        p: settings.
        robot: its neutral posture and joint limits are read.
        g: geometry of its legs.
    """
    s.clock += 1
    part = smooth(s.clock * TICK_S / p.fold_s)
    folded = robot.neutral.copy()
    for leg in range(2):
        for i, angle in zip((2, 3, 4), FOLDED, strict=True):
            folded[g.joints[leg, i]] = angle
    folded = np.clip(folded, robot.joint_lower, robot.joint_upper)
    if s.rise_from is not None:
        s.command = s.rise_from + part * (folded - s.rise_from)
    if part >= 1.0:
        s.mode = Mode.FALLEN
