"""Settings of the walker of robots with four or six legs; numbers of one robot stand in `[gait]` of its file."""

from pydantic import Field

from surefoot.robot.description import Robot
from surefoot.tables import FileModel

from ..commands import Abilities
from ..settings import settings_of
from .patterns import GaitPattern
from .swing import GENTLE_TIME


class WalkerParams(FileModel):
    """Gait, limits and reactions of the walker with four or six legs; no unit where none is stated.

    Fields without a default come from `[gait]` of the robot description, which may also change those with one. The
    walker's configuration may change `period_s`, `stride_m`, `hip_height_m` and `clearance_m`.
    """

    period_s: float = Field(
        gt=0, le=20,
        description="s, two steps of the tripod gait; a step of any gait takes half, a swing of a crawl 0.675 of it",
    )  # fmt: skip
    stride_m: float = Field(gt=0, le=5, description="m, way of the trunk in a full cycle of the gait at its own speed")
    hip_height_m: float = Field(gt=0, le=5, description="m, base_link above the mean ground under the feet")
    clearance_m: float = Field(
        gt=0, le=1, description="m, step height: level part of a swing above the highest ground on the foot's path"
    )
    overlap: float = Field(ge=0, le=0.4, description="part of a step, at each end, in which all feet stand")
    level_gain: float = Field(ge=0, le=1, description="part of the trunk's tilt that is corrected per tick of a step")
    level_limit_rad: float = Field(ge=0, le=0.8, description="rad, largest commanded roll and pitch of the trunk")
    gait: str | None = Field(default=None, description="gait of commands that name none; null = the robot's own")
    max_stride_m: float = Field(
        default=0.070, gt=0, le=5, description="m, largest way of the trunk in a full cycle of the gait"
    )
    full_speed_fall_m: float = Field(
        default=0.045, gt=0, le=5, description="m, descent of a foot from its top above which its step takes longer"
    )
    longest_step: float = Field(
        default=2.0, ge=1, le=10, description="largest factor on the duration of a step whose foot descends farther"
    )
    touch_speed: float = Field(
        default=0.040, gt=0, le=1, description="m/s, downwards, of a foot that approaches or searches the ground"
    )
    margin_m: float = Field(
        default=0.006, ge=0, le=0.5, description="m, least distance of a foot from the ground along its path"
    )
    corridor_m: float = Field(
        default=0.012, ge=0, le=0.5, description="m, half the width of the ground below that path that is checked"
    )
    turn_step_rad: float = Field(default=0.12, gt=0, le=0.8, description="rad, largest change of heading in one step")
    stand_level_gain: float = Field(
        default=0.010, ge=0, le=1, description="part of the trunk's tilt that is corrected per tick of standing"
    )
    brace_gain: float = Field(
        default=0.6, ge=0, le=1.2,
        description="part of a change of tilt that a crawling trunk counters in its tick; from 1.6 on robots oscillate",
    )  # fmt: skip
    brace_lead_s: float = Field(
        default=0.0125,
        ge=0,
        le=0.05,
        description="s, by which that tilt is predicted by its rate; a tick and a quarter",
    )
    sag: float = Field(
        default=1.0, ge=0, le=1, description="part of the servos' compliance (torque / stiffness) that is compensated"
    )
    belly_m: float = Field(
        default=0.012, ge=0, le=1, description="m, least distance of the trunk's underside from the ground under it"
    )
    trunk_step_m: float = Field(
        default=0.030, gt=0, le=1, description="m, largest change of the trunk's height in one step"
    )
    trunk_speed: float = Field(
        default=0.030, gt=0, le=1, description="m/s, of the trunk when it moves while all feet stand"
    )
    press_m: float = Field(
        default=0.002, ge=0, le=0.1,
        description="m, planned landing below the mapped ground: a foot touches before its swing ends",
    )  # fmt: skip
    search_m: float = Field(
        default=0.040, ge=0, le=1, description="m, below the mapped ground, to which a foot searches for contact"
    )
    press_speed: float = Field(
        default=0.060, gt=0, le=1, description="m/s, vertical, of a landed foot on its way to its planned height"
    )
    steer_gain: float = Field(
        default=0.5, ge=0, le=1, description="part of the error across the way and of the heading corrected per step"
    )
    steer_limit_m: float = Field(default=0.008, ge=0, le=0.5, description="m, largest sideways correction in one step")
    steer_limit_rad: float = Field(
        default=0.08, ge=0, le=0.8, description="rad, largest correction of the heading in one step"
    )
    distance_tolerance_m: float = Field(
        default=0.003, gt=0, le=0.5, description="m, remaining way at which a walk has ended"
    )
    angle_tolerance_rad: float = Field(
        default=0.01, gt=0, le=0.5, description="rad, remaining angle at which a turn has ended"
    )
    close_tolerance_m: float = Field(
        default=0.010, gt=0, le=0.5, description="m, from its neutral place, below which a foot needs no closing step"
    )
    anchor_height: float = Field(
        default=0.5, ge=0, le=1, description="part of the height between standing feet and map corrected per step"
    )
    anchor_tilt: float = Field(
        default=0.1, ge=0, le=1, description="part of the tilt between standing feet and map learned per step"
    )
    friction: float = Field(default=0.6, gt=0, le=5, description="coefficient of friction assumed in step checks")
    low_margin_m: float = Field(
        default=0.010, ge=0, le=1, description="m, published static margin below which the next step is halved"
    )
    wanted_margin_m: float = Field(
        default=0.020, ge=0, le=1,
        description="m, static margin of a planned step below which the trunk first moves over its feet",
    )  # fmt: skip
    shift_limit_m: float = Field(
        default=0.030, ge=0, le=1, description="m, largest movement of the trunk over its feet before a step"
    )
    max_shifts: int = Field(
        default=2, ge=0, le=20, strict=False, description="largest number of such movements before one step"
    )
    least_margin_m: float = Field(
        default=0.005, ge=0, le=1, description="m, static margin after them below which a gait lifts fewer legs"
    )
    lean_margin_m: float = Field(
        default=0.040, ge=0, le=1,
        description="m, static margin to which a crawling robot's trunk moves before a foot lifts",
    )  # fmt: skip
    lean_s: float = Field(default=0.4, gt=0, le=20, description="s, least duration of that movement")
    lean_acceleration: float = Field(
        default=0.6, gt=0, le=20,
        description="m/s^2, largest in that movement: 0.3 m over the ground it moves the zero-moment point by 18 mm",
    )  # fmt: skip
    max_attempts: int = Field(
        default=8, ge=1, le=100, strict=False, description="largest number of plans for one step before it is refused"
    )
    stale_s: float = Field(
        default=0.1, gt=0, le=5, description="s, age of estimates and samples above which no new step begins"
    )

    @classmethod
    def for_robot(cls, robot: Robot, **changes: object) -> "WalkerParams":
        """Return the robot's own settings with the stated ones changed (raises RobotError)."""
        return settings_of(cls, robot, changes)


def abilities(params: WalkerParams, gaits: dict[str, GaitPattern]) -> Abilities:
    """Return the abilities of a robot with these settings and gaits."""
    cycles = [
        gait.steps_per_cycle * (0.5 * GENTLE_TIME * params.period_s + params.lean_s) if gait.leans else params.period_s
        for gait in gaits.values()
    ]
    return Abilities(tuple(gaits), params.max_stride_m / min(cycles), shifts=True)
