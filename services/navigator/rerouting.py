"""Way to the places of a goal: planned anew around what the map does not know, or waited for until it is free."""

from surefoot.errors import Refusal

from .goals import NavigationGoal, Point
from .maps import Maps
from .policy.settings import Conduct


class Rerouting:
    """Planner of the remaining route of a goal, and counter of the time that it waits for a free way.

    Args:
        conduct: number of new routes of a goal, and its longest wait, s.
        ways: obstacles; None = routes stay as they are.
    """

    def __init__(self, conduct: Conduct, ways: Maps | None) -> None:
        self._conduct, self._ways = conduct, ways
        self.begin()

    def begin(self) -> None:
        """Forget the present wait, at the begin of a goal or after a pause."""
        self._waiting: float | None = None
        """Simulated time of the last decision at which no path led around an obstacle, s; None = the path is open."""

    def closed(self, goal: NavigationGoal, now: float, here: Point) -> str:
        """Return why the next action may not be decided, empty = it may; the route is planned anew where it helps.

        Args:
            goal: its waypoints are replaced where an obstacle stands on them.
            now: simulated time, s.
            here: where the robot is, x, y in m, frame map.
        """
        why = ""
        if self._ways is not None and not self._ways.free(here, goal.route[goal.index :]):
            why = f"planned around obstacles {goal.recoveries['replan']} times"
            if goal.recoveries["replan"] < self._conduct.replans:
                why = self.replan(goal, now, here)
                if not why:
                    goal.recoveries["replan"] += 1
        if not why:
            self._waiting = None
        return why

    def waits(self, goal: NavigationGoal, now: float) -> bool:
        """Count a wait of the robot at the simulated time `now`, s; return False if the goal has waited too long."""
        if self._waiting is None:
            self._waiting = now
            goal.recoveries["wait"] += 1
        goal.waited += now - self._waiting
        self._waiting = now
        return goal.waited <= self._conduct.wait

    def replan(self, goal: NavigationGoal, now: float, here: Point) -> str:
        """Plan the remaining route of a goal from a place; return the reason why that is not possible, empty = done.

        Args:
            goal: its waypoints are replaced.
            now: simulated time, s.
            here: x, y in m, frame map.
        """
        if self._ways is None:
            return ""
        why = ""
        for bold in (False, True)[: 1 + goal.bold]:
            try:
                goal.lead(self._ways.follow(here, goal.places[goal.place :], bold=bold), now)
                goal.dared |= bold
                return ""
            except Refusal as refusal:
                why = why or refusal.message
        return why

    def next_round(self, goal: NavigationGoal, now: float, here: Point) -> str:
        """Begin the next round over the places of a goal; return why no way leads to them now, empty = begun.

        The arguments are those of `replan`.
        """
        done, goal.index = goal.index, 0
        why = self.replan(goal, now, here)
        if why:
            goal.index = done
        else:
            self._waiting = None
            goal.begin_round(now)
        return why
