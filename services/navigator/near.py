"""Recovery from something too close to the robot: a step back, or a stand before it for a while."""

import math

from surefoot.arrays import Array

from .goals import Act, NavigationGoal
from .maps import Maps
from .orders import straight, walked
from .policy.settings import Conduct

CLOSE_S = 0.5
"""Time for which something close counts after it was sensed, s: half a stride, as the other foot is not at it."""
BACK_ROOM = 2.0
"""Length of the way behind the robot that is free when it steps back, as a multiple of that step."""


class Near:
    """Memory of when something was too close, and the choice of a step back or a stand.

    Args:
        acts: actions of the robot.
        conduct: number of steps back in a row, and the longest stand, s.
        ways: obstacles; None = there are none.
    """

    def __init__(self, acts: tuple[Act, ...], conduct: Conduct, ways: Maps | None) -> None:
        self._acts, self._conduct, self._ways = acts, conduct, ways
        self._at, self._stands_from = -math.inf, math.nan
        """`_at`: simulated time at which something was too close last, s; `_stands_from`: since when the robot stands
        before it, s; NaN = it does not."""

    def begin(self) -> None:
        """Forget since when the robot has stood before an obstacle, at the begin of a goal."""
        self._stands_from = math.nan

    def sense(self, now: float, *, close: bool) -> None:
        """Record whether something is too close at the simulated time `now`, s."""
        self._at = now if close else self._at

    def choose(self, goal: NavigationGoal, now: float, mean: Array) -> tuple[Act | None, bool]:
        """Choose a step back or a stand where something is too close, and count it among the recoveries of the goal.

        Args:
            goal: goal under way; its number of steps back is raised.
            now: simulated time, s.
            mean: believed x, y (m), heading (rad) in the map first, (n,).

        Returns:
            The step back, None = none; True if the robot is to stand instead. None, False: it goes on as usual.
        """
        if now - self._at >= CLOSE_S:
            self._stands_from = math.nan
            return None, False
        back = step_back(self._acts, mean, self._ways) if goal.backs < self._conduct.backs else None
        if back is not None:
            goal.backs += 1
            goal.recoveries["step_back"] += 1
            return back, False
        if math.isnan(self._stands_from):
            self._stands_from = now
            goal.recoveries["stand"] += 1
        return None, now - self._stands_from <= self._conduct.stand


def step_back(acts: tuple[Act, ...], mean: Array, ways: Maps | None) -> Act | None:
    """Return the straight walk backwards, or None if twice its length behind the robot is not free.

    Args:
        acts: actions of the robot.
        mean: believed x, y (m), heading (rad) in the map first, (n,).
        ways: obstacles; None = there are none.
    """
    act, (x, y, heading) = straight(acts), mean[:3].tolist()
    room = BACK_ROOM * act.motion.forward
    behind = (x - room * math.cos(heading), y - room * math.sin(heading))
    if ways is not None and not ways.enterable((x, y), behind):
        return None
    return walked(acts, "back", -act.motion.forward)
