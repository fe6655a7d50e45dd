"""Settings of the legged walker, each with its unit. Numbers of one robot stand in `[gait]` of its `robot.toml`."""

from dataclasses import dataclass

from surefoot.robot.description import Robot

from ..commands import Abilities
from ..settings import settings_of
from .patterns import GaitPattern
from .swing import SwingShape


@dataclass(frozen=True, kw_only=True)
class WalkerParams:
    """Gait, limits and reactions of the walker.

    Fields without a default come from `[gait]` of the robot description, which may also change those with one. The
    walker's configuration may change `period_s`, `stride_m`, `hip_height_m` and `clearance_m`.
    """

    period_s: float
    """Duration of two steps of the tripod gait, s; a step of any gait lasts half of it."""
    stride_m: float
    """Way of the trunk in one full cycle of the gait at its own speed, m."""
    hip_height_m: float
    """Height of base_link over the mean ground under the feet, m."""
    clearance_m: float
    """Step height: level part of a swing over the highest swept ground, m."""
    overlap: float
    """Part of a step, at each end, in which all feet stand, 0..0.5."""
    level_gain: float
    """Part of the estimated tilt taken out in each tick of a step, 0..1."""
    level_limit_rad: float
    """Largest commanded roll and pitch of the trunk, rad."""
    gait: str | None = None
    """Name of the gait of a command that names none; None = the robot's own."""
    max_stride_m: float = 0.070
    """Longest way of the trunk in one full cycle of the gait, m."""
    full_speed_fall_m: float = 0.045
    """Fall of a foot from its top to the ground up to which a step has its usual duration, m."""
    longest_step: float = 2.0
    """Largest factor by which a step lasts longer when its foot falls farther than `full_speed_fall_m`."""
    touch_speed: float = 0.040
    """Downward speed of a foot that expects the ground, m/s."""
    margin_m: float = 0.006
    """Least distance of the foot sphere from the swept ground away from both ends, m."""
    corridor_m: float = 0.012
    """Half the width of the swept corridor, m."""
    turn_step_rad: float = 0.12
    """Largest change of heading in one step, rad."""
    stand_level_gain: float = 0.010
    """Part of the estimated tilt taken out in each tick while standing, 0..1."""
    sag: float = 1.0
    """Part of the servos' compliance that the set-points compensate, 0..1."""
    belly_m: float = 0.012
    """Least distance of the trunk's underside from the highest ground under it, m."""
    trunk_step_m: float = 0.030
    """Largest change of trunk height in one step, m."""
    trunk_speed: float = 0.030
    """Speed of trunk movements on six feet, m/s."""
    press_m: float = 0.002
    """Depth of a planned landing below the map's height, m: a foot meets the ground before its time is up."""
    search_m: float = 0.040
    """Depth below the map's height down to which a foot looks for the ground, m."""
    press_speed: float = 0.060
    """Speed at which a landed foot goes to its foothold, m/s."""
    steer_gain: float = 0.5
    """Part of the cross-track and heading error taken out in each step, 0..1."""
    steer_limit_m: float = 0.008
    """Largest sideways correction in one step, m."""
    steer_limit_rad: float = 0.08
    """Largest correction of the heading in one step, rad."""
    distance_tolerance_m: float = 0.003
    """Way still to go at which a walk is finished, m."""
    angle_tolerance_rad: float = 0.01
    """Angle still to go at which a turn is finished, rad."""
    close_tolerance_m: float = 0.010
    """Distance from neutral below which a foot needs no closing step, m."""
    anchor_height: float = 0.5
    """Part of the difference between the feet's and the map's heights taken out in each step, 0..1."""
    anchor_tilt: float = 0.1
    """Part of the tilt between the feet's and the map's heights learned as an error of the estimate in each step."""
    friction: float = 0.6
    """Coefficient of friction assumed in step checks."""
    low_margin_m: float = 0.010
    """Published static margin below which the next step is halved, m."""
    wanted_margin_m: float = 0.020
    """Static margin of a step below which the trunk first moves over its feet, m."""
    shift_limit_m: float = 0.030
    """Longest movement of the trunk over its feet before a step, m."""
    max_shifts: int = 2
    """Largest number of movements of the trunk before one step."""
    least_margin_m: float = 0.005
    """Static margin after these movements below which a gait that lifts fewer legs is taken, m."""
    lean_margin_m: float = 0.040
    """Static margin for which the trunk of a crawling robot moves before a foot lifts, m."""
    lean_s: float = 0.4
    """Least duration of a movement of the trunk before a foot lifts, s."""
    lean_acceleration: float = 0.6
    """Largest acceleration of the trunk in a movement before a foot lifts, m/s^2: 0.3 m over the ground that moves the
    point of zero moment by 18 mm."""
    max_attempts: int = 8
    """Plans tried for one step before it is refused."""
    stale_s: float = 0.1
    """Age of estimates and samples beyond which no new step begins, s."""
    swing: SwingShape = SwingShape()  # noqa: RUF009 - a named tuple
    """Shape of a swing over its phases: lift, way, touch-down."""

    @classmethod
    def for_robot(cls, robot: Robot, **changes: object) -> "WalkerParams":
        """Return the robot's own settings with some changed (raises RobotError)."""
        return settings_of(cls, robot, changes)


def abilities(params: WalkerParams, gaits: dict[str, GaitPattern]) -> Abilities:
    """Return what a robot can do with these settings and gaits."""
    cycles = [
        0.5 * gait.steps_per_cycle * params.period_s + gait.steps_per_cycle * params.lean_s
        if gait.leans
        else params.period_s
        for gait in gaits.values()
    ]
    return Abilities(tuple(gaits), params.max_stride_m / min(cycles), shifts=True)
