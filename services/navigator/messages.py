"""Conversion of the navigator's state to messages."""

import math
from dataclasses import dataclass

from surefoot.schemas.navigation import GoalProgress, GoalResult, MotionOrder, NavigationFeedback, PoseBelief
from surefoot.schemas.state import SeenLandmarks

from .belief.relocalise import between
from .belief.tracker import Control, PoseTracker
from .belief.ukf import Pose, wrap
from .goals import NavigationGoal
from .pilot import Pilot


@dataclass(frozen=True)
class LostView:
    """Result of the check whether the believed pose is wrong, by the landmarks that the camera recognised."""

    lost: bool = False
    """True if the believed pose is wrong; False if it fits or is only suspected."""
    probability: float = 0.0
    """Probability that the believed pose is wrong, 0 to 1."""
    reason: str = ""
    """Reason why the believed pose may be wrong, in words; empty = none."""
    suspected_until: float = -math.inf
    """Simulated time until which the pose counts as suspected, s, as recent detections may not fit it; -inf = no
    suspicion. A camera that sees nothing raises none."""


def order_message(pilot: Pilot) -> MotionOrder:
    """Return the present order as a message; the walker obeys each order number once."""
    return MotionOrder(number=0 if pilot.orders.order is None else pilot.orders.number, command=pilot.orders.order)


def pose_message(
    tracker: PoseTracker,
    odom: Pose | None,
    control: Control,
    matched: int,
    nis: float | None,
    lost: LostView,
    ready: bool,
) -> PoseBelief:
    """Return the belief of the pose as a message.

    Args:
        tracker: holds the belief.
        odom: pose of base_link in odom, x, y (m), heading (rad); None = there is no odometry.
        control: what moves the belief between frames: commands or odometry.
        matched: landmarks of the last frame that were matched.
        nis: smoothed normalised innovation squared per degree of freedom; None = nothing was matched yet.
        lost: check of the belief.
        ready: the estimator is calibrated, goals are accepted.
    """
    cov = tracker.body_covariance()
    return PoseBelief(
        pose=tracker.pose,
        covariance=tuple(cov.ravel().tolist()),
        entropy=max(tracker.entropy, -1e3),
        drift=float(tracker.mean[3]),
        drift_sd=math.sqrt(max(0.0, float(tracker.cov[3, 3]))),
        map_from_odom=(0.0, 0.0, 0.0) if odom is None else between(tracker.pose, odom),
        initialised=ready,
        control=control,
        matched=matched,
        nis=nis,
        lost=lost.lost,
        lost_probability=min(1.0, max(0.0, lost.probability)),
        lost_reason=lost.reason,
    )


def feedback_message(pilot: Pilot, pose: Pose, now: float, results: tuple[GoalResult, ...] = ()) -> NavigationFeedback:
    """Return the progress of the present or last goal, with the results of the last ones.

    `pose`: believed x, y (m), heading (rad), frame map; `now`: simulated time, s.
    """
    goal = pilot.goal
    if goal is None:
        return NavigationFeedback(state="idle", current_pose=pose)
    under_way = pilot.under_way
    elapsed = max(0.0, (now if under_way else pilot.ended or now) - goal.began)
    left = goal.left(pose[0], pose[1]) if under_way else 0.0
    whole = goal.left(*goal.start) if goal.start is not None else left
    walked = abs(whole - left)
    active = goal.active(now) if under_way else 0.0
    remaining = active * left / walked if walked > 0.2 and active > 0.0 else None
    return NavigationFeedback(
        state=pilot.state,
        goal_id=goal.id,
        policy=goal.policy,
        goal_pose=goal.route[-1],
        current_pose=pose,
        navigation_time=elapsed,
        estimated_time_remaining=remaining,
        number_of_recoveries=sum(goal.recoveries.values()),
        recoveries=dict(goal.recoveries),
        distance_remaining=left,
        number_of_poses_remaining=max(0, len(goal.route) - goal.index),
        position_tracking_error=goal.off_route(pose[0], pose[1]),
        heading_tracking_error=_bearing(goal.waypoint, pose),
        decision=pilot.decision,
        missed_waypoints=tuple(goal.missed),
        error_code=pilot.error,  # pyright: ignore[reportArgumentType] - one of the literals, set in the pilot
        error_msg=pilot.message if pilot.error else "",
        results=results,
        progress=progress_of(goal),
    )  # fmt: skip


def progress_of(goal: NavigationGoal) -> GoalProgress | None:
    """Return where in places, rounds and docking a goal is; None for one place without rounds, marker and pause."""
    paused, dock = goal.paused_at is not None, goal.dock
    if len(goal.places) == 1 and goal.loops == 1 and not paused and dock is None:
        return None
    at = min(goal.place, len(goal.places) - 1) + 1
    return GoalProgress(
        place=at, places=len(goal.places), loop=goal.loop, loops=goal.loops, paused=paused,
        marker=dock and dock.seen, approaches=dock.moves if dock else 0,
    )  # fmt: skip


def _bearing(place: tuple[float, float], pose: Pose) -> float:
    return float(wrap(math.atan2(place[1] - pose[1], place[0] - pose[0]) - pose[2]))


def fresh_of(seen: SeenLandmarks | None) -> SeenLandmarks | None:
    """Return the landmarks that vision found in a new image; None = no new image, or no vision service."""
    return seen if seen is not None and seen.fresh else None


def camera_words(turn: Pose) -> str:
    """Return the log text on a turned camera.

    `turn`: by which it is pitched, rolled and turned aside, rad.
    """
    pitch, roll, aside = (math.degrees(angle) for angle in turn)
    return (
        f"the landmark camera is pitched by {pitch:.1f} deg, rolled by {roll:.1f} deg and turned aside by {aside:.1f} "
        "deg from where it is stated to be; its frames are turned back"
    )
