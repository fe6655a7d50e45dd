"""Settings of the hexapod walker; every default with its unit, robot-specific ones from `robot.toml`."""

from dataclasses import dataclass, fields, replace

from surefoot.robot.description import Robot

from ..commands import Abilities
from .patterns import HEXAPOD_GAITS
from .swing import SwingShape


@dataclass(frozen=True)
class WalkerParams:
    """Gait, limits and reactions of the walker."""

    gait: str = "tripod"
    period_s: float = 1.0
    """Duration of two steps of the tripod gait; a step of any gait lasts half of it."""
    stride_m: float = 0.050
    """Way of the trunk in one full cycle of the gait at its own speed."""
    max_stride_m: float = 0.070
    hip_height_m: float = 0.085
    """base_link over the mean ground under the feet."""
    clearance_m: float = 0.030
    """Level part of a swing over the highest swept ground."""
    full_speed_fall_m: float = 0.045
    """A foot that falls farther from its top to the ground makes the step longer in proportion,"""
    longest_step: float = 2.0
    """up to this factor."""
    touch_speed: float = 0.040
    """m/s, downward speed of a foot that expects the ground."""
    margin_m: float = 0.006
    """Least distance of the foot sphere from the swept ground away from both ends."""
    corridor_m: float = 0.012
    """Half the width of the swept corridor."""
    overlap: float = 0.10
    """Part of a step, at each end, in which all feet stand."""
    turn_step_rad: float = 0.12
    """Largest change of heading in one step."""
    level_gain: float = 0.025
    """Part of the estimated tilt taken out in each tick."""
    level_limit_rad: float = 0.25
    stand_level_gain: float = 0.010
    """The same while standing."""
    sag: float = 1.0
    """Part of the servos' compliance that the set-points compensate."""
    belly_m: float = 0.012
    """Least distance of the trunk's underside from the highest ground under it."""
    trunk_step_m: float = 0.030
    """Largest change of trunk height in one step."""
    trunk_speed: float = 0.030
    """m/s, speed of trunk movements on six feet."""
    press_m: float = 0.002
    """Landings are planned this far below the map's height, so that a foot meets the ground before its time is up."""
    search_m: float = 0.040
    """How far a foot looks for the ground below the map's height."""
    press_speed: float = 0.060
    """m/s, how fast a landed foot goes to its foothold."""
    steer_gain: float = 0.5
    """Part of the cross-track and heading error taken out in each step."""
    steer_limit_m: float = 0.008
    steer_limit_rad: float = 0.08
    distance_tolerance_m: float = 0.003
    angle_tolerance_rad: float = 0.01
    close_tolerance_m: float = 0.010
    """Feet nearer than this to neutral need no closing step."""
    anchor_height: float = 0.5
    """Part of the difference between the feet's and the map's heights taken out in each step."""
    anchor_tilt: float = 0.1
    """Part of the tilt between the feet's and the map's heights learned as an error of the estimate in each step."""
    friction: float = 0.6
    """Coefficient assumed in step checks."""
    low_margin_m: float = 0.010
    """A published margin below this halves the next step."""
    wanted_margin_m: float = 0.020
    """A step with less static margin makes the trunk move over its feet first,"""
    shift_limit_m: float = 0.030
    """by so much at most"""
    max_shifts: int = 2
    """and so often for one step."""
    least_margin_m: float = 0.005
    """A step that keeps less after that is taken in a gait that lifts fewer legs."""
    max_attempts: int = 8
    """Plans tried for one step before it is refused."""
    stale_s: float = 0.1
    """Estimates and samples older than this stop new steps."""
    swing: SwingShape = SwingShape()  # noqa: RUF009 - a named tuple

    @classmethod
    def for_robot(cls, robot: Robot, **overrides: object) -> "WalkerParams":
        """Defaults, then the robot's own gait table, then `overrides`."""
        own = {f.name: robot.gait[f.name] for f in fields(cls) if f.name in robot.gait}
        return replace(cls(**own), **overrides)  # type: ignore[arg-type]


def abilities(params: WalkerParams) -> Abilities:
    """Return what a hexapod can do with these settings."""
    return Abilities(tuple(HEXAPOD_GAITS), params.max_stride_m / params.period_s, shifts=True)
