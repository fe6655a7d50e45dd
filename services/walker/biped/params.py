"""Settings of the biped walker, each with its unit. Numbers of one robot stand in `[gait]` of its `robot.toml`."""

import math
from dataclasses import dataclass

from surefoot.robot.description import Robot

from ..commands import Abilities, ArcLimits
from ..settings import settings_of

GAITS = ("zmp", "quick")
"""Names of the biped's gaits; the first is the default."""


@dataclass(frozen=True, kw_only=True)
class BipedParams:
    """Gait, limits and reactions of the biped walker.

    Fields without a default come from `[gait]` of the robot description, which may also change those with one.
    """

    step_s: float
    """Duration of a step of the default gait, s."""
    step_m: float
    """Advance of the body in one step at the gait's own speed, m; a foot moves twice as far."""
    lift_m: float
    """Step height: largest height of the swinging sole above the floor, m."""
    crouch: float
    """Height of the hips above the ankles in the stance, as a part of the leg's length, 0..1."""
    zmp_y_m: float
    """Planned ZMP (zero-moment point) in single support: distance from the ankle towards the other foot, m."""
    zmp_x_m: float = 0.0
    """Planned ZMP (zero-moment point) in single support: distance ahead of the ankle, m."""
    quick_s: float = 0.4
    """Duration of a step of the gait `quick`, s."""
    quick_m: float = 0.030
    """Advance of the body in one step of the gait `quick`, m."""
    max_step_m: float = 0.060
    """Largest advance of the body in one step, m."""
    turn_step_rad: float = math.radians(11.5)
    """Change of heading in one step at the gait's own speed, rad."""
    max_turn_rad: float = math.radians(15.0)
    """Largest change of heading in one step, rad."""
    double: float = 0.25
    """Part of a step's duration with both feet down, 0..1."""
    lean_rad: float = 0.0
    """Pitch of the trunk while it stands and walks, rad, forward positive."""
    start_s: float = 1.0
    """Duration of standing before the first step of a walk, in which the weight shifts, s."""
    rise_s: float = 1.0
    """Duration of the movement from the measured joint angles to the stance at start-up, s."""
    sag: float = 1.0
    """Part of the servos' compliance (torque / kp) that the set-points compensate, 0..1."""
    lag: float = 1.0
    """Part of the servos' velocity lag (joint rate times kv / kp) that the set-points compensate, 0..1."""
    lag_limit: float = 6.0
    """Joint rate to which the compensation of the servos' lag is limited, rad/s."""
    gyro_s: float = 0.05
    """Feedback gain from the trunk's angular rate to the ankle's set-point, rad per rad/s."""
    gyro_smooth: float = 0.5
    """Weight of the previous value in the smoothing of the trunk's angular rate in each tick, 0..1."""
    slow_from_rad: float = math.radians(3.0)
    """Peak of the unplanned trunk tilt in a step above which the next step becomes shorter, rad."""
    slow_full_rad: float = math.radians(8.0)
    """Peak of the unplanned trunk tilt in a step from which on the next step is one on the spot, rad."""
    falling_rad: float = math.radians(30.0)
    """Unplanned trunk tilt above which the robot counts as falling and folds, rad."""
    fold_s: float = 0.4
    """Duration in which a falling robot bends its knees, s."""
    learn: float = 0.5
    """Part of the deviation of odometry from plan that is learned in each step, 0..1; 0 = none."""
    learn_limit: float = 0.3
    """Largest learned deviation of a step's size from its plan, as a part of the plan, 0..1."""
    stale_s: float = 0.1
    """Age of the estimate above which the walk pauses until a newer one comes, s."""
    close_m: float = 0.003
    """Distance of a foot from its place in the stance below which it needs no closing step, m."""
    close_rad: float = 0.01
    """Turn of a foot from its heading in the stance below which it needs no closing step, rad."""

    @classmethod
    def for_robot(cls, robot: Robot, **changes: object) -> "BipedParams":
        """Return the robot's own settings with the stated ones changed (raises RobotError)."""
        return settings_of(cls, robot, changes)


def abilities(params: BipedParams) -> Abilities:
    """Return the abilities of a biped with these settings of a gait."""
    arcs = ArcLimits(params.step_m, params.step_s, params.max_turn_rad)
    return Abilities(GAITS, params.max_step_m / params.step_s, arcs=arcs)
