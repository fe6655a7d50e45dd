"""Settings of the biped walker, each with its unit. Numbers of one robot stand in `[gait]` of its `robot.toml`."""

import math
from dataclasses import dataclass

from surefoot.robot.description import Robot

from ..commands import Abilities, ArcLimits
from ..settings import settings_of

GAITS = ("zmp", "quick")
"""Names of the gaits; the first is the usual one."""


@dataclass(frozen=True, kw_only=True)
class BipedParams:
    """Gait, limits and reactions of the walker.

    Fields without a default come from `[gait]` of the robot description, which may also change those with one.
    """

    step_s: float
    """Duration of a step of the biped, s."""
    step_m: float
    """Advance of the body in one step at the gait's own speed, m; a foot moves twice as far."""
    lift_m: float
    """Step height: top of the swing over the floor, m."""
    crouch: float
    """Hip height over the ankles as part of the leg's length, 0..1."""
    zmp_y_m: float
    """ZMP (zero-moment point) of single support, from the ankle towards the other foot, m."""
    zmp_x_m: float = 0.0
    """ZMP (zero-moment point) of single support, ahead of the ankle, m."""
    quick_s: float = 0.4
    """Duration of a step of the gait `quick`, s."""
    quick_m: float = 0.030
    """Advance of the body in one step of the gait `quick`, m."""
    max_step_m: float = 0.060
    """Longest advance of the body in one step, m."""
    turn_step_rad: float = math.radians(11.5)
    """Change of heading in one step, rad."""
    max_turn_rad: float = math.radians(15.0)
    """Largest change of heading in one step, rad."""
    double: float = 0.25
    """Part of a step with both feet down, 0..1."""
    lean_rad: float = 0.0
    """Pitch of the trunk, rad."""
    start_s: float = 1.0
    """Time of standing before the first step, in which the weight shifts, s."""
    rise_s: float = 1.0
    """Time from the measured joints to the stance, s."""
    sag: float = 1.0
    """Part of the servos' compliance (torque / kp) that the set-points lead by, 0..1."""
    lag: float = 1.0
    """Part of the servos' velocity lag (joint rate times kv / kp) that the set-points lead by, 0..1."""
    lag_limit: float = 6.0
    """Largest joint rate for which the servos' lag is made up in advance, rad/s."""
    gyro_s: float = 0.05
    """Gain from the trunk's rate to the ankle's set-point, rad per rad/s."""
    gyro_smooth: float = 0.5
    """Part of the last rate that its smoothing keeps in each tick, 0..1."""
    slow_from_rad: float = math.radians(3.0)
    """Peak of the unplanned tilt in a step from which on the next one becomes shorter, rad."""
    slow_full_rad: float = math.radians(8.0)
    """Peak of the unplanned tilt in a step from which on the next one goes nowhere, a step on the spot, rad."""
    falling_rad: float = math.radians(30.0)
    """Unplanned tilt from which on the robot is lost and folds, rad."""
    fold_s: float = 0.4
    """Time in which a falling robot bends its knees, s."""
    learn: float = 0.5
    """Part of the difference between odometry and plan learned in each step, 0..1; 0 = none."""
    learn_limit: float = 0.3
    """Largest learned difference of a step from its plan, as a share of the plan."""
    stale_s: float = 0.1
    """Age of estimates beyond which the walk waits, s."""
    close_m: float = 0.003
    """Distance of a foot from its place below which it needs no closing step, m."""
    close_rad: float = 0.01
    """Turn of a foot from its place below which it needs no closing step, rad."""

    @classmethod
    def for_robot(cls, robot: Robot, **changes: object) -> "BipedParams":
        """Return the robot's own settings with some changed (raises RobotError)."""
        return settings_of(cls, robot, changes)


def abilities(params: BipedParams) -> Abilities:
    """Return what a biped can do with these settings of a gait."""
    arcs = ArcLimits(params.step_m, params.step_s, params.max_turn_rad)
    return Abilities(GAITS, params.max_step_m / params.step_s, arcs=arcs)
