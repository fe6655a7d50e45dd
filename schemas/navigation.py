"""Navigation: believed pose with its uncertainty, goals, decisions with their reasons, results."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from .base import Bulk, Message, Reply, Request, Vec2, Vec3, Wire
from .cmd import WalkCommand

MAX_WAYPOINTS = 200

Covariance3 = Annotated[
    tuple[float, ...], Field(min_length=9, max_length=9, description="row-major 3x3 of (x, y, yaw), m and rad")
]
FloorPose = Annotated[Vec3, Field(description="x, y in m and yaw in rad, frame map")]
GoalState = Literal["idle", "navigating", "stopping", "succeeded", "failed", "cancelled"]
GoalError = Literal[
    "", "replaced", "cancelled", "taken_over", "lost", "unreachable", "stuck", "timeout", "fallen", "stopped",
    "walker_refused", "arrived_unsure", "blocked",
]  # fmt: skip
RESULTS = 4
"""Number of most recently ended goals whose results the navigator's feedback carries."""


def absent(value: object) -> bool:
    """Return True for null: such a field is left out, so that messages without it are those of earlier versions."""
    return value is None


class PoseBelief(Message):
    """The pose of the robot in the map: estimate, covariance, drift, and a check of the estimate."""

    pose: FloorPose
    covariance: Covariance3
    entropy: float = Field(description="nats, differential entropy of (x, y, yaw) in m and rad")
    drift: float = Field(description="rad per m, estimated turn of the robot per way walked that no command asked for")
    drift_sd: float = Field(ge=0, description="rad per m, its standard deviation")
    map_from_odom: FloorPose = Field(description="pose of the odom frame in map, by this estimate")
    initialised: bool = Field(description="the estimator is calibrated: goals are accepted")
    control: Literal["commands", "odometry"] = Field(description="input of the prediction")
    matched: int = Field(ge=0, description="landmarks of the last frame that were matched with the map")
    nis: float | None = Field(default=None, description="normalised innovation squared per degree of freedom, smoothed")
    lost: bool = Field(default=False, description="the estimate is wrong")
    lost_probability: float = Field(default=0.0, ge=0, le=1, description="probability that the estimate is wrong")
    lost_reason: str = Field(default="", description="why the estimate counts as wrong, in words")


class MotionOrder(Message):
    """Order of the navigator to the walker; an order is new if its number differs from the last one."""

    number: int = Field(ge=0, description="number of the order in this epoch, 0 = none yet")
    command: WalkCommand | None = Field(default=None, description="null as long as number is 0")


class Decision(Wire):
    """Choice of an action by the navigator's policy, with the reason and the robot's state at that time."""

    number: int = Field(ge=0, description="counts the decisions of this epoch")
    action: str = Field(description="name of the chosen action")
    reason: str = Field(description="why it was chosen, in words")
    values: dict[str, float] = Field(
        default_factory=dict, description="s or return: value of each action that could be chosen, larger is better"
    )
    distance: float = Field(ge=0, description="m to the present waypoint, by the estimate")
    bearing: float = Field(description="rad, of the waypoint against the heading, left positive")
    entropy: float = Field(description="nats, entropy of the pose at the decision")


class GoalProgress(Wire):
    """Progress of a goal with several places or rounds, of one that docks on a marker, or of one that is paused."""

    place: int = Field(ge=1, description="number of the place that is walked to, 1 = the first")
    places: int = Field(ge=1, description="number of places")
    loop: int = Field(default=1, ge=1, description="number of the round over the places, 1 = the first")
    loops: int = Field(default=1, ge=0, description="number of rounds; 0 = until cancelled")
    paused: bool = Field(default=False, description="the robot stands until the goal is resumed")
    marker: Vec2 | None = Field(
        default=None,
        description="m forward and left in base_link, marker that is docked on by the last look; null = none",
    )
    approaches: int = Field(default=0, ge=0, description="number of approaches to the marker so far")


class GoalResult(Wire):
    """Result of a goal that has ended; each goal that began gets one."""

    number: int = Field(ge=1, description="counts the goals that ended in this epoch")
    goal_id: str = Field(description="name of the goal")
    state: GoalState = Field(description="succeeded: surely within the goal's tolerances; failed; cancelled")
    error_code: GoalError = Field(default="", description="why it did not succeed; empty = it did")
    reason: str = Field(description="in words")
    pose: FloorPose = Field(description="believed pose at the end")
    covariance: Covariance3
    navigation_time: float = Field(ge=0, description="s from its begin to its end, pauses included")
    number_of_recoveries: int = Field(default=0, ge=0, description="number of recoveries")
    missed_waypoints: tuple[int, ...] = Field(default=(), description="indices of places that were given up")
    progress: GoalProgress | None = Field(
        default=None, exclude_if=absent, description="where it ended, as in `NavigationFeedback`"
    )


class NavigationFeedback(Message):
    """Progress of the present goal, or of the last one; names as in Nav2."""

    schema_version: ClassVar[str] = "2.2"
    state: GoalState = Field(description="state of the goal")
    goal_id: str = Field(default="", description="name of the present or last goal, empty = none yet")
    policy: str = Field(default="", description="name of the policy")
    goal_pose: Vec2 | None = Field(default=None, description="m, the last pose of the goal, frame map")
    current_pose: FloorPose
    navigation_time: float = Field(default=0.0, ge=0, description="s since the goal was accepted")
    estimated_time_remaining: float | None = Field(default=None, description="s; null = not known")
    number_of_recoveries: int = Field(default=0, ge=0, description="number since the goal was accepted")
    recoveries: dict[str, int] = Field(default_factory=dict, description="number of recoveries by name")
    distance_remaining: float = Field(default=0.0, ge=0, description="m along the route")
    number_of_poses_remaining: int = Field(default=0, ge=0, description="waypoints not yet reached")
    position_tracking_error: float = Field(default=0.0, description="m, distance from the route")
    heading_tracking_error: float = Field(default=0.0, description="rad, bearing of the present waypoint")
    decision: Decision | None = Field(default=None, description="last decision of this goal")
    missed_waypoints: tuple[int, ...] = Field(default=(), description="indices of places that were given up")
    error_code: GoalError = Field(default="", description="why the goal failed; empty = it has not")
    error_msg: str = Field(default="", description="why the goal failed, in words")
    results: tuple[GoalResult, ...] = Field(default=(), description="of the last four goals, the last one last")
    progress: GoalProgress | None = Field(
        default=None,
        exclude_if=absent,
        description="of a goal with places, rounds or a marker, or paused; left out = of another",
    )


class GotoRequest(Request):
    """Send the robot to a place. A new goal replaces the present one without a halt."""

    schema_version: ClassVar[str] = "1.1"
    position: Vec2 = Field(description="m, frame map")
    yaw: float | None = Field(default=None, description="rad, heading at the end; null = any")
    yaw_goal_tolerance: float | None = Field(
        default=None, gt=0, le=3.1416, description="rad, likewise of the heading; null = that of the model"
    )
    frame: str = Field(default="map", max_length=32, description="map, or odom")
    policy: str | None = Field(default=None, max_length=256, description="name or file of a policy; null = configured")
    goal_id: str | None = Field(default=None, max_length=64, description="name of the goal; null = made up")
    xy_goal_tolerance: float | None = Field(
        default=None, gt=0, le=10, description="m, at a success the robot is surely so near; null = that of the model"
    )
    timeout: float | None = Field(
        default=None, gt=0, description="s, the goal ends after this time; null = that of the model"
    )
    at_tick: int | None = Field(
        default=None, ge=0, description="tick it takes effect in (reproducible); null = the next one"
    )


class WaypointsRequest(Request):
    """Send the robot to several places, one after the other, once or round after round."""

    schema_version: ClassVar[str] = "1.2"
    positions: Annotated[tuple[Vec2, ...], Field(min_length=1, max_length=MAX_WAYPOINTS)] = Field(
        description="m, frame map"
    )
    yaws: Annotated[tuple[float | None, ...], Field(max_length=MAX_WAYPOINTS)] = Field(
        default=(), description="rad, heading at each place, null = any; empty = any everywhere"
    )
    yaw_goal_tolerance: float | None = Field(
        default=None, gt=0, le=3.1416, description="rad, largest error of these headings; null = that of the model"
    )
    loops: int = Field(default=1, ge=0, le=1_000_000, description="rounds over the places; 0 = until cancelled")
    policy: str | None = Field(default=None, max_length=256, description="name or file of a policy; null = configured")
    goal_id: str | None = Field(default=None, max_length=64, description="name of the goal; null = made up")
    xy_goal_tolerance: float | None = Field(
        default=None, gt=0, le=10, description="m, at a success the robot is surely so near; null = that of the model"
    )
    timeout: float | None = Field(
        default=None, gt=0, description="s, the goal ends after this time; null = that of the model"
    )
    at_tick: int | None = Field(
        default=None, ge=0, description="tick it takes effect in (reproducible); null = the next one"
    )


class DockRequest(Request):
    """Send the robot to a marker, and lead it the last part by what it sees of the marker itself."""

    landmark: int | None = Field(
        default=None, ge=0, description="row of terrain/landmarks; null = the marker of the goal, as in hw/landmarks"
    )
    position: Vec2 | None = Field(
        default=None, description="m, frame map, about where the marker lies; null = that of the landmark"
    )
    offset: Vec2 = Field(
        default=(0.5, 0.0), description="m forward and left, place of the marker in base_link at the end"
    )
    yaw: float | None = Field(default=None, description="rad, frame map, heading at the end; null = any")
    xy_goal_tolerance: float | None = Field(
        default=None,
        gt=0,
        le=1,
        description="m, at a success the marker is surely so near to its place; null = model's",
    )
    yaw_goal_tolerance: float | None = Field(
        default=None, gt=0, le=3.1416, description="rad, likewise of its bearing, and of the heading; null = model's"
    )
    policy: str | None = Field(default=None, max_length=256, description="name or file of a policy; null = configured")
    goal_id: str | None = Field(default=None, max_length=64, description="name of the goal; null = made up")
    timeout: float | None = Field(
        default=None, gt=0, description="s, the goal ends after this time; null = that of the model"
    )
    at_tick: int | None = Field(
        default=None, ge=0, description="tick it takes effect in (reproducible); null = the next one"
    )


class GoalReply(Reply):
    """Reply of the navigator to a goal: whether it is accepted; progress is in navigator/feedback."""

    accepted: bool = Field(description="false: nothing changes")
    goal_id: str = Field(default="", description="name of the goal")
    route: tuple[Vec2, ...] = Field(default=(), description="m, the waypoints that will be walked to")
    length: float = Field(default=0.0, ge=0, description="m, of the route")


class CancelRequest(Request):
    """End the present goal; the robot stops walking and stands."""

    goal_id: str | None = Field(default=None, max_length=64, description="only if this is the goal; null = any")
    at_tick: int | None = Field(
        default=None, ge=0, description="tick it takes effect in (reproducible); null = the next one"
    )


class PauseGoalRequest(CancelRequest):
    """Pause the present goal: the robot stands, and no time limit of the goal runs."""


class ResumeGoalRequest(CancelRequest):
    """Resume the goal that is paused."""


class SetPoseRequest(Request):
    """Set the navigator's estimate of the robot's pose in the map; the present goal continues."""

    pose: FloorPose
    covariance: Covariance3 | None = Field(default=None, description="null = 5 cm, 5 cm, 5 deg")
    at_tick: int | None = Field(
        default=None, ge=0, description="tick it takes effect in (reproducible); null = the next one"
    )


class NavigatorReply(Reply):
    """Reply of the navigator: whether it accepted the request, and why not."""

    accepted: bool = Field(description="false: nothing changes")
    reason: str = Field(default="", description="why not, in words")


class NavigatorMapRequest(Request):
    """Request the map that routes are planned on."""


class OccupancyGrid(Bulk):
    """Occupancy, int8, C order ``[row = y, col = x]``, row 0 = y-min: 0 free, 100 occupied, -1 unknown."""

    schema_version: ClassVar[str] = "1.1"
    rows: int = Field(ge=0, description="cells along y; 0 = there is no map")
    cols: int = Field(ge=0, description="cells along x")
    cell: float = Field(gt=0, description="edge of a cell, m")
    origin: Vec2 = Field(description="x, y of the lower-left CORNER of cell [0, 0], m, frame map")
    yaw: float = Field(default=0.0, description="rad, angle of the rows about that corner, frame map, left positive")
    source: str = Field(default="", description="file, or terrain/map")

    def data_bytes(self) -> int:
        """Return the length of the raw occupancy values by the other fields of the message, bytes."""
        return self.rows * self.cols


class PolicyRequest(Request):
    """Request the names of the policies, or choose another default."""

    use: str | None = Field(default=None, max_length=256, description="name or file of the policy; null = no change")


class PolicyReply(Reply):
    """Default policy of the navigator and its provenance."""

    policy: str = Field(description="name of the default policy")
    known: tuple[str, ...] = Field(description="names that ship")
    actions: tuple[str, ...] = Field(description="names of its actions")
    version: str = Field(default="", description="version of the file")
    sha256: str = Field(default="", description="of the file; empty = the policy has none")
    provenance: dict[str, str] = Field(default_factory=dict, description="parameters, seed and date of the training")
