"""Demands of a scenario on its run: the keys of `[limits]`."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, create_model

from surefoot.schemas import topics
from surefoot.schemas.topics import Topic
from surefoot.tables import FileModel, Number

JUDGED: tuple[Topic[Any], ...] = (
    topics.SIM_TRUTH,
    topics.STATE_VELOCITY,
    topics.STATE_ODOMETRY,
    topics.STATE_GAIT,
    topics.STATE_STABILITY,
    topics.STATE_VELOCITY_IMU,
    topics.STATE_VELOCITY_KINEMATICS,
    topics.STATE_VELOCITY_KINEMATICS_GYRO,
    topics.STATE_VELOCITY_EKF,
    topics.TERRAIN_MAP,
    topics.STATE_POSE,
    topics.NAVIGATOR_FEEDBACK,
)
"""Topics from which the metrics of a run are computed, for the verdict."""

Side = Literal["least", "most"]


@dataclass(frozen=True)
class Limit:
    """Demand on one metric of a run.

    Attributes:
        metric: name of the metric in a row of the verdict.
        side: `least`: the metric has to be at least the limit; `most`: at most.
        yes_no: True if the limit is a flag in the scenario file (`no_fall = true`), False if it is a number.
    """

    metric: str
    side: Side
    yes_no: bool = False


LIMITS: Mapping[str, Limit] = {
    "no_fall": Limit("fell", "most", yes_no=True),
    "max_touches": Limit("touches", "most"),
    "min_distance_m": Limit("distance_m", "least"),
    "max_distance_m": Limit("distance_m", "most"),
    "max_tilt_deg": Limit("max_tilt_deg", "most"),
    "max_mean_slip_mm": Limit("mean_slip_mm", "most"),
    "max_slip_mm": Limit("max_slip_mm", "most"),
    "min_twist_deg": Limit("max_twist_deg", "least"),
    "max_twist_deg": Limit("max_twist_deg", "most"),
    "max_velocity_rmse_mps": Limit("velocity_rmse_mps", "most"),
    "max_odometry_error_m": Limit("odometry_error_m", "most"),
    "max_odometry_error_percent": Limit("odometry_error_percent", "most"),
    "max_heading_error_deg": Limit("heading_error_deg", "most"),
    "min_margin_m": Limit("min_margin_m", "least"),
    "all_goals": Limit("goals_missed", "most", yes_no=True),
    "max_goal_error_m": Limit("goal_error_m", "most"),
    "max_goal_time_s": Limit("goal_time_s", "most"),
    "max_recoveries": Limit("recoveries", "most"),
    "max_pose_error_m": Limit("pose_error_m", "most"),
    "max_pose_nees": Limit("pose_nees", "most"),
    "max_duration_s": Limit("duration_s", "most"),
    "min_real_time_factor": Limit("real_time_factor", "least"),
}
"""Demand that each key of `[limits]` in a scenario file makes on a metric of the run."""


def _read(table: Any) -> Any:
    """Return the limits that a table sets, in the order of `LIMITS`; true is the limit 0.0, false sets none."""
    given = _TABLE.model_validate(table).model_dump(exclude_unset=True)
    return {name: 0.0 if value is True else value for name, value in given.items() if value is not False}


_KINDS: Any = {name: (bool, False) if limit.yes_no else (Number, 0.0) for name, limit in LIMITS.items()}
_TABLE = create_model("LimitsTable", __base__=FileModel, **_KINDS)
Limits = Annotated[Mapping[str, float], BeforeValidator(_read, json_schema_input_type=_TABLE)]
"""Limits of a scenario by name, in the unit that the name ends with; flags are 0.0. Read from `[limits]`."""
