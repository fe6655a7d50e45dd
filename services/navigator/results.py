"""Results of ended goals, each with the believed pose at its end."""

from surefoot.schemas.navigation import RESULTS, GoalResult

from .goals import End, NavigationGoal
from .localiser import Localiser
from .messages import progress_of


class Results:
    """Memory of the results of the last goals since the last reset.

    Args:
        localiser: belief of the pose.
    """

    def __init__(self, localiser: Localiser) -> None:
        self.localiser = localiser
        self.now = 0.0
        """Simulated time of the present tick, s."""
        self.count = 0
        """Number of goals that have ended."""
        self.last: tuple[GoalResult, ...] = ()
        """Results of the most recent goals, the latest last."""

    def record(self, goal: NavigationGoal, end: End) -> None:
        """Store the result of a goal that ends now: outcome (state, error code, message), pose, time, recoveries."""
        state, error, reason = end
        goal.unpause(self.now)
        tracker, self.count = self.localiser.tracker, self.count + 1
        result = GoalResult(
            number=self.count, goal_id=goal.id, state=state, error_code=error,  # pyright: ignore[reportArgumentType] - one of the literals, set in the pilot
            reason=reason or state, pose=tracker.pose, covariance=tuple(tracker.body_covariance().ravel().tolist()),
            navigation_time=max(0.0, self.now - goal.began), number_of_recoveries=sum(goal.recoveries.values()),
            missed_waypoints=tuple(goal.missed), progress=progress_of(goal),
        )  # fmt: skip
        self.last = (*self.last, result)[-RESULTS:]
