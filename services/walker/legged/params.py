"""Settings of the legged walker, each with its unit. Numbers of one robot stand in `[gait]` of its `robot.toml`."""

from dataclasses import dataclass

from surefoot.robot.description import Robot, RobotError

from ..commands import Abilities
from ..settings import settings_of
from .patterns import GaitPattern
from .swing import SwingShape

MOST_BRACE, MOST_LEAD_S = 1.2, 0.05
"""Largest values of `brace_gain`, no unit, and `brace_lead_s`, s: beyond them quadrupeds have oscillated and fallen."""


@dataclass(frozen=True, kw_only=True)
class WalkerParams:
    """Gait, limits and reactions of the walker with four or six legs.

    Fields without a default come from `[gait]` of the robot description, which may also change those with one. The
    walker's configuration may change `period_s`, `stride_m`, `hip_height_m` and `clearance_m`.
    """

    period_s: float
    """Duration of two steps of the tripod gait, s; a step of any gait lasts half of this."""
    stride_m: float
    """Advance of the trunk in one full cycle of the gait at its own speed, m."""
    hip_height_m: float
    """Height of base_link above the mean ground under the feet, m."""
    clearance_m: float
    """Step height: level part of a swing above the highest ground on the foot's path, m."""
    overlap: float
    """Part of a step's duration, at each end, in which all feet stand, 0..0.5."""
    level_gain: float
    """Part of the estimated trunk tilt that is corrected in each tick of a step, 0..1."""
    level_limit_rad: float
    """Largest commanded roll and pitch of the trunk, rad."""
    gait: str | None = None
    """Name of the gait for commands that name none; None = the robot's own."""
    max_stride_m: float = 0.070
    """Largest advance of the trunk in one full cycle of the gait, m."""
    full_speed_fall_m: float = 0.045
    """Descent of a foot from its top to the ground above which a step takes longer than usual, m."""
    longest_step: float = 2.0
    """Largest factor on a step's duration when its foot descends by more than `full_speed_fall_m`."""
    touch_speed: float = 0.040
    """Downward speed of a foot that approaches or searches the ground, m/s."""
    margin_m: float = 0.006
    """Least distance of the foot sphere from the ground along its path, except near both ends, m."""
    corridor_m: float = 0.012
    """Half the width of the strip of ground below a foot's path that is checked for obstacles, m."""
    turn_step_rad: float = 0.12
    """Largest change of heading in one step, rad."""
    stand_level_gain: float = 0.010
    """Part of the estimated trunk tilt that is corrected in each tick while standing, 0..1."""
    brace_gain: float = 0.6
    """Part of a change of the trunk's tilt that a crawling robot counters in the same tick, 0..1.2; 0 = none, from 1.6
    on robots oscillate."""
    brace_lead_s: float = 0.0125
    """Time by which that tilt is predicted by the trunk's rate, s, 0..0.05: by default a tick and a quarter."""
    sag: float = 1.0
    """Part of the servos' compliance (torque / stiffness) that the set-points compensate, 0..1."""
    belly_m: float = 0.012
    """Least distance of the trunk's underside above the highest ground under it, m."""
    trunk_step_m: float = 0.030
    """Largest change of trunk height in one step, m."""
    trunk_speed: float = 0.030
    """Speed of the trunk when it moves while all feet stand, m/s."""
    press_m: float = 0.002
    """Depth of a planned landing below the mapped ground, m: a foot touches before the end of its swing."""
    search_m: float = 0.040
    """Largest depth below the mapped ground to which a foot searches for contact, m."""
    press_speed: float = 0.060
    """Vertical speed at which a landed foot moves to its planned foothold, m/s."""
    steer_gain: float = 0.5
    """Part of the cross-track and heading error that is corrected in each step, 0..1."""
    steer_limit_m: float = 0.008
    """Largest sideways correction in one step, m."""
    steer_limit_rad: float = 0.08
    """Largest correction of the heading in one step, rad."""
    distance_tolerance_m: float = 0.003
    """Remaining distance at which a walk counts as finished, m."""
    angle_tolerance_rad: float = 0.01
    """Remaining angle at which a turn counts as finished, rad."""
    close_tolerance_m: float = 0.010
    """Distance from its neutral position below which a foot needs no closing step, m."""
    anchor_height: float = 0.5
    """Part of the height difference between standing feet and map that each step corrects, 0..1."""
    anchor_tilt: float = 0.1
    """Part of the tilt between standing feet and map that each step learns as an error of the estimate, 0..1."""
    friction: float = 0.6
    """Coefficient of friction assumed in step checks."""
    low_margin_m: float = 0.010
    """Published static stability margin below which the next step is halved, m."""
    wanted_margin_m: float = 0.020
    """Static stability margin of a planned step below which the trunk first moves over its feet, m."""
    shift_limit_m: float = 0.030
    """Largest movement of the trunk over its feet before a step, m."""
    max_shifts: int = 2
    """Largest number of movements of the trunk over its feet before one step."""
    least_margin_m: float = 0.005
    """Static stability margin after the trunk's movements below which a gait that lifts fewer legs is used, m."""
    lean_margin_m: float = 0.040
    """Static stability margin to which the trunk of a crawling robot moves before a foot lifts, m."""
    lean_s: float = 0.4
    """Least duration of a movement of the trunk before a foot lifts, s."""
    lean_acceleration: float = 0.6
    """Largest acceleration of the trunk in a movement before a foot lifts, m/s^2: 0.3 m over the ground that moves the
    point of zero moment by 18 mm."""
    max_attempts: int = 8
    """Largest number of plans tried for one step before it is refused."""
    stale_s: float = 0.1
    """Age of estimates and sensor samples above which no new step begins, s."""
    swing: SwingShape = SwingShape()  # noqa: RUF009 - a named tuple
    """Phases of a swing at which the foot stops rising, starts to descend and reaches the slow approach."""

    def __post_init__(self) -> None:
        for name, most in (("brace_gain", MOST_BRACE), ("brace_lead_s", MOST_LEAD_S)):
            if not 0.0 <= getattr(self, name) <= most:
                raise RobotError("value", f"gait.{name}", f"got {getattr(self, name):g}, allowed are 0 to {most:g}")

    @classmethod
    def for_robot(cls, robot: Robot, **changes: object) -> "WalkerParams":
        """Return the robot's own settings with the stated ones changed (raises RobotError)."""
        return settings_of(cls, robot, changes)


def abilities(params: WalkerParams, gaits: dict[str, GaitPattern]) -> Abilities:
    """Return the abilities of a robot with these settings and gaits."""
    cycles = [
        0.5 * gait.steps_per_cycle * params.period_s + gait.steps_per_cycle * params.lean_s
        if gait.leans
        else params.period_s
        for gait in gaits.values()
    ]
    return Abilities(tuple(gaits), params.max_stride_m / min(cycles), shifts=True)
