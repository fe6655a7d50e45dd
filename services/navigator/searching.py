"""Search for a pose that is or may be lost: the robot stands for camera frames, turns, walks to where poses differ."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

from surefoot.schemas.navigation import GoalState

from .goals import Act, GaitView, NavigationGoal, Point
from .orders import straight, turned
from .policy.settings import Conduct

Aside = Callable[[], Point | None]
"""Function that returns the end of a straight walk which distinguishes a lost robot's candidate poses, x, y in robot
axes, m; None = no such walk."""


def no_way() -> Point | None:
    """Return None: no walk helps to find the pose (default without a map)."""
    return None


class Moves(Protocol):
    """Interface of the motions that a search for the robot's pose may order, and of ending its goal."""

    acts: tuple[Act, ...]
    """Actions of the robot."""

    def halt(self, state: GoalState, error: str, message: str) -> None:
        """Order a stop; the goal has the given end (state, error code, message) as soon as the robot stands."""
        ...

    def stop(self) -> None:
        """Order the walker to stop; the goal stays under way."""
        ...

    def move(self, act: Act) -> None:
        """Order an action that moves the robot."""
        ...

    def replan(self, goal: NavigationGoal, now: float, here: Point) -> str:
        """Plan a goal's route anew from a place; return the reason why that is not possible, empty = done.

        `now`: simulated time, s; `here`: the place, x, y in m, frame map.
        """
        ...


@dataclass
class Look:
    """State of a search for the robot's pose: stands for camera frames, turns and walks so far."""

    until: float = math.inf
    """Simulated time at which the present stand for camera frames ends, s; inf = not begun."""
    lost: bool = True
    """True if the robot is lost, False if its pose is only suspected to be wrong."""
    turns: int = 0
    """Number of turns since the search began or the last walk aside."""
    walks: int = 0
    """Number of walks aside since the search began."""
    left: float = 0.0
    """Remaining distance of the walk aside, m."""


class Search:
    """Search for the pose of a robot that has a goal: it stands for the camera, turns, walks to where poses differ.

    Args:
        body: robot, whose motions and end of the goal the search orders.
        conduct: times and numbers of stands, turns and walks.
        aside: finds a walk to where the candidate poses differ.
    """

    def __init__(self, body: Moves, conduct: Conduct, aside: Aside) -> None:
        self.body, self.conduct, self.aside = body, conduct, aside
        self.begin()

    def begin(self) -> None:
        """Discard the search of an earlier goal, so that none is under way."""
        self.look: Look | None = None
        self._suspects_from = -math.inf
        """Simulated time from which on a suspected pose makes the robot stand and look, s."""

    def tick(
        self, goal: NavigationGoal, now: float, gait: GaitView, here: Point, *, blocked: bool, lost: bool,
        suspected: bool,
    ) -> bool:  # fmt: skip
        """Order the next motion of a search while the pose is or may be wrong: stop, stand for the camera, turn, walk.

        Args:
            goal: under way.
            now: simulated time, s.
            gait: state of the walker.
            here: believed place, x, y in m, frame map.
            blocked: True = an obstacle is too near ahead to walk.
            lost: the belief is wrong.
            suspected: the belief may be wrong.

        Returns:
            True while the search is under way: nothing else is to be decided.
        """
        look, suspected = self.look, suspected and now >= self._suspects_from
        if look is None and not lost and not (suspected and gait.state != "standing"):
            return False
        if look is None or (lost and not look.lost):
            self._enter(goal, gait, lost=lost)
        elif not lost and look.lost:
            self.look = None
            goal.recoveries["relocalise"] += 1
            goal.nearest, goal.nearest_at = math.inf, now
            why = self.body.replan(goal, now, here)
            if why:
                self.body.halt("failed", "unreachable", why)
        elif not lost and not suspected:
            self._leave(now)
        elif look.left > 0.0:
            self._advance(look, gait, blocked=blocked)
        elif gait.state == "standing" and gait.ends_in is None:
            self._look_around(goal, look, now, lost=lost)
        return self.look is not None

    def _enter(self, goal: NavigationGoal, gait: GaitView, *, lost: bool) -> None:
        found, begun = self.conduct.found_again, self.look is not None
        if lost and goal.recoveries["relocalise"] > found:
            self.look = None
            self.body.halt("failed", "lost", f"lost again after the pose was found {found} times and more")
            return
        self.look = Look(lost=lost)
        goal.recoveries["stand_and_look" if lost else "suspect_look"] += 1
        if not begun and (gait.ends_in is not None or gait.state != "standing"):
            self.body.stop()

    def _leave(self, now: float) -> None:
        self.look, self._suspects_from = None, now + self.conduct.suspect_again

    def _look_around(self, goal: NavigationGoal, look: Look, now: float, *, lost: bool) -> None:
        """Do the next part of a look around: stand for frames, turn, finally walk aside, or give up.

        Args:
            goal: under way; its recoveries are counted.
            look: state of the search, changed.
            now: simulated time, s.
            lost: the belief is wrong; else it may be.
        """
        conduct = self.conduct
        most = conduct.search_turns if lost else conduct.suspect_turns
        if math.isinf(look.until):
            look.until = now + conduct.search_look
        elif now >= look.until and look.turns >= most:
            way = self.aside() if lost and look.walks < conduct.search_walks else None
            if way is not None:
                goal.recoveries["walk_aside"] += 1
                look.until, look.turns, look.walks, look.left = math.inf, 0, look.walks + 1, math.hypot(*way)
                self.body.move(turned(self.body.acts, "aside", math.atan2(way[1], way[0])))
                return
            self._leave(now)
            if lost:
                self.body.halt("failed", "lost", f"the pose was not found again in {most + 1} looks around")
        elif now >= look.until:
            look.until, look.turns = math.inf, look.turns + 1
            goal.recoveries["turn_and_look"] += 1
            self.body.move(turned(self.body.acts, "look", math.radians(conduct.search_turn_deg)))

    def _advance(self, look: Look, gait: GaitView, *, blocked: bool) -> None:
        """Order the next part of the walk aside when it is due; an obstacle close ahead ends the walk."""
        stands = gait.state == "standing" and gait.ends_in is None
        if stands and blocked:
            look.left = 0.0
        elif stands or (gait.ends_in is not None and gait.ends_in <= self.conduct.lead and not blocked):
            ahead = straight(self.body.acts)
            self.body.move(replace(ahead, name="aside"))
            look.left -= ahead.motion.forward
