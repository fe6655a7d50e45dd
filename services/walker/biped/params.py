"""Settings of the biped walker; every default with its unit, robot-specific ones from `robot.toml`."""

import math
from dataclasses import dataclass, fields, replace

from surefoot.robot.description import Robot

from ..commands import Abilities, ArcLimits

GAITS = ("zmp", "quick")
"""Names of the gaits; the first is the usual one."""


@dataclass(frozen=True)
class BipedParams:
    """Gait, limits and reactions."""

    step_s: float = 0.7
    """Duration of a step."""
    step_m: float = 0.025
    """Advance of the body in one step at the gait's own speed; a foot moves twice as far."""
    quick_s: float = 0.4
    """The same of the gait `quick`,"""
    quick_m: float = 0.030
    """and its advance."""
    max_step_m: float = 0.060
    turn_step_rad: float = math.radians(11.5)
    """Change of heading in one step."""
    max_turn_rad: float = math.radians(15.0)
    lift_m: float = 0.015
    """Top of the swing."""
    crouch: float = 0.93
    """Hip height over the ankles as part of the leg's length."""
    double: float = 0.25
    """Part of a step with both feet down."""
    zmp_x_m: float = 0.0
    """ZMP of single support ahead of the ankle,"""
    zmp_y_m: float = 0.0
    """and inwards of it."""
    lean_rad: float = 0.0
    """Pitch of the trunk."""
    start_s: float = 1.0
    """Standing before the first step, in which the weight shifts."""
    rise_s: float = 1.0
    """From the measured joints to the stance."""
    sag: float = 1.0
    """Part of the servos' compliance that the set-points lead by."""
    lag: float = 1.0
    """Part of the servos' velocity lag that the set-points lead by."""
    lag_limit: float = 6.0
    """rad/s, joint rate up to which the lag is led."""
    gyro_s: float = 0.05
    """Ankle set-point against the trunk's rate, rad per rad/s,"""
    gyro_smooth: float = 0.5
    """with this much of the last value kept."""
    slow_from_rad: float = math.radians(3.0)
    """Peak of the unplanned tilt in a step from which on the next one becomes shorter,"""
    slow_full_rad: float = math.radians(8.0)
    """and marks time."""
    falling_rad: float = math.radians(30.0)
    """Unplanned tilt from which on the robot is lost and folds."""
    fold_s: float = 0.4
    """Time of that."""
    learn: float = 0.5
    """How fast the walker learns from the odometry what its steps become in the world; 0 = not at all,"""
    learn_limit: float = 0.3
    """and by how much at most."""
    stale_s: float = 0.1
    """Estimates older than this end the walk."""
    close_m: float = 0.003
    """Feet nearer than this to their place need no closing step,"""
    close_rad: float = 0.01
    """and this."""

    @classmethod
    def for_robot(cls, robot: Robot, **overrides: object) -> "BipedParams":
        """Defaults, then the robot's own gait table, then `overrides`."""
        own = {f.name: robot.gait[f.name] for f in fields(cls) if f.name in robot.gait}
        return replace(cls(**own), **overrides)  # type: ignore[arg-type]


def abilities(params: BipedParams) -> Abilities:
    """Return what a biped can do with these settings of a gait."""
    arcs = ArcLimits(params.step_m, params.step_s, params.max_turn_rad)
    return Abilities(GAITS, params.max_step_m / params.step_s, arcs=arcs)
