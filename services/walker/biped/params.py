"""Settings of the biped walker, each with its unit. Numbers of one robot stand in `[gait]` of its `robot.toml`."""

import math

from pydantic import Field

from surefoot.robot.description import Robot
from surefoot.tables import FileModel

from ..commands import Abilities, ArcLimits
from ..settings import settings_of

GAITS = ("zmp", "quick")
"""Names of the biped's gaits; the first is the default."""


class BipedParams(FileModel):
    """Gait, limits and reactions of the biped walker; no unit where none is stated.

    Fields without a default come from `[gait]` of the robot description, which may also change those with one. ZMP:
    zero-moment point.
    """

    step_s: float = Field(gt=0, le=10, description="s, duration of a step of the default gait")
    step_m: float = Field(
        gt=0, le=1, description="m, way of the body in one step at the gait's own speed; a foot moves twice as far"
    )
    lift_m: float = Field(gt=0, le=1, description="m, step height: largest height of the swinging sole over the floor")
    crouch: float = Field(
        gt=0, le=1, description="height of the hips above the ankles in the stance, as a part of the leg's length"
    )
    zmp_y_m: float = Field(
        ge=-0.5, le=0.5, description="m, planned ZMP on one foot: from the ankle towards the other foot"
    )
    zmp_x_m: float = Field(default=0.0, ge=-0.5, le=0.5, description="m, planned ZMP on one foot: ahead of the ankle")
    quick_s: float = Field(default=0.4, gt=0, le=10, description="s, duration of a step of the gait `quick`")
    quick_m: float = Field(default=0.030, gt=0, le=1, description="m, way of the body in one step of the gait `quick`")
    max_step_m: float = Field(default=0.060, gt=0, le=1, description="m, largest way of the body in one step")
    turn_step_rad: float = Field(
        default=math.radians(11.5), gt=0, le=1.6, description="rad, turn in one step at the gait's own speed"
    )
    max_turn_rad: float = Field(default=math.radians(15.0), gt=0, le=1.6, description="rad, largest turn in one step")
    double: float = Field(default=0.25, gt=0, le=0.9, description="part of a step in which both feet stand")
    lean_rad: float = Field(
        default=0.0, ge=-0.8, le=0.8, description="rad, pitch of the trunk that stands and walks, forward positive"
    )
    start_s: float = Field(
        default=1.0, gt=0, le=20, description="s, standing before the first step, in which the weight shifts"
    )
    rise_s: float = Field(
        default=1.0, gt=0, le=20, description="s, from the measured joint angles to the stance at start-up"
    )
    sag: float = Field(
        default=1.0, ge=0, le=1, description="part of the servos' compliance (torque / kp) that is compensated"
    )
    lag: float = Field(
        default=1.0, ge=0, le=1, description="part of the servos' lag (joint rate times kv / kp) that is compensated"
    )
    lag_limit: float = Field(
        default=6.0, ge=0, le=100, description="rad/s, joint rate to which that compensation is limited"
    )
    gyro_s: float = Field(
        default=0.05, ge=0, le=1, description="rad per rad/s, from the trunk's rate to the ankles' set-points"
    )
    gyro_smooth: float = Field(
        default=0.5, ge=0, lt=1, description="weight of the value before in the smoothing of that rate per tick"
    )
    slow_from_rad: float = Field(
        default=math.radians(3.0), ge=0, le=1.6,
        description="rad, peak of the unplanned tilt in a step above which the next step is shorter",
    )  # fmt: skip
    slow_full_rad: float = Field(
        default=math.radians(8.0), gt=0, le=1.6,
        description="rad, peak of the unplanned tilt in a step from which on the next step is on the spot",
    )  # fmt: skip
    falling_rad: float = Field(
        default=math.radians(30.0), gt=0, le=1.6,
        description="rad, unplanned tilt above which the robot counts as falling and folds",
    )  # fmt: skip
    fold_s: float = Field(default=0.4, gt=0, le=10, description="s, in which a falling robot bends its knees")
    learn: float = Field(
        default=0.5, ge=0, le=1, description="part of the deviation of odometry from plan that is learned per step"
    )
    learn_limit: float = Field(
        default=0.3, ge=0, lt=1, description="largest learned deviation of a step's size, as a part of the plan"
    )
    stale_s: float = Field(default=0.1, gt=0, le=5, description="s, age of the estimate above which the walk pauses")
    close_m: float = Field(
        default=0.003, gt=0, le=0.5, description="m, from its place in the stance, below which a foot needs no step"
    )
    close_rad: float = Field(
        default=0.01, gt=0, le=0.8, description="rad, from its heading in the stance, below which a foot needs no step"
    )

    @classmethod
    def for_robot(cls, robot: Robot, **changes: object) -> "BipedParams":
        """Return the robot's own settings with the stated ones changed (raises RobotError)."""
        return settings_of(cls, robot, changes)


def abilities(params: BipedParams) -> Abilities:
    """Return the abilities of a biped with these settings of a gait."""
    arcs = ArcLimits(params.step_m, params.step_s, params.max_turn_rad)
    return Abilities(GAITS, params.max_step_m / params.step_s, arcs=arcs)
