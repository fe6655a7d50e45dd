"""Goals, actions and the state of the walker, as the pilot takes them."""

import json
import math
from collections import Counter
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from surefoot.schemas.navigation import GoalState
from surefoot.schemas.state import GaitState

from .belief.tracker import Motion
from .planning.grid import Point
from .policy.settings import Conduct

End = tuple[GoalState, str, str]
"""State in which a goal ends, error code, message."""


@dataclass(frozen=True)
class GaitView:
    """State of the walker as the topic `state/gait` reports it, as far as goals need it."""

    state: str
    """State of the gait: standing, walking, waiting (the estimator calibrates), refused (the robot fell), ..."""
    walk_id: int = 0
    """Number of its present command, of any client."""
    order: int = 0
    """Number of the last order that the walker took up."""
    refused: str = ""
    """Reason why the walker refused its last order; empty = it did not."""
    ends_in: float | None = None
    """Time until the last planned step lands, s; None = not published, or no step is planned."""
    reason: str = ""
    """Reason of a refused state."""

    @classmethod
    def of(cls, gait: GaitState) -> "GaitView":
        """Return the parts of a `state/gait` message that goals need."""
        return cls(gait.state, gait.walk_id, gait.order, gait.order_refused, gait.ends_in_s, gait.reason)


@dataclass(frozen=True)
class Act:
    """One action of the robot, with the motion that is expected of it."""

    name: str
    kind: Literal["stand", "turn", "walk"]
    motion: Motion
    """Expected motion of the whole action: way forward and turn as ordered, and their variances."""
    duration: float
    """Duration of its steps, or of standing, s."""
    match: float | None = None
    """Share of the landmarks in view that a frame recognises; None = not known."""


FAR = 1e9
"""A way that is longer than any, m."""
DETOUR_PACE = 0.04
"""Pace at which a robot walks a detour at least, m/s; the Nao makes 0.05."""
NEARER = 3.0
"""Steps of progress by which the way that is left becomes shorter: the belief itself moves by one."""


@dataclass
class NavigationGoal:
    """One goal of the navigator, with its route and its progress."""

    id: str
    route: tuple[Point, ...]
    """Waypoints of the route, m, frame map."""
    policy: str
    """Name of the policy."""
    began: float
    """Simulated time of its begin, s."""
    yaw: float | None = None
    """Heading at the end, rad, frame map; None = any."""
    index: int = 0
    """Index of the present waypoint; the length of the route behind the last one."""
    missed: list[int] = field(default_factory=list[int])
    """Indices of places that were given up."""
    recoveries: Counter[str] = field(default_factory=Counter[str])
    """Number of recoveries by name."""
    nearest: float = math.inf
    """Least distance to the present waypoint so far, m."""
    nearest_at: float = 0.0
    """Simulated time at which the robot was nearest to the present waypoint, s."""
    least: float = FAR
    """Least way over the waypoints that was left so far, m; new routes do not begin it anew."""
    least_at: float = 0.0
    """Simulated time at which the least way was left, s."""
    detour: float = 0.0
    """Most by which the way that is left has exceeded the least way since that time, m."""
    looks: int = 0
    """Looks at the present waypoint so far."""
    waited: float = 0.0
    """Time of waiting for a way, s."""
    turns: int = 0
    """Turns to the wanted heading so far."""
    start: Point | None = None
    """Place of the robot when the goal began, m, frame map."""
    asked: str | None = None
    """Name or file that finds the policy again; None = the default."""
    places: tuple[Point, ...] = ()
    """Places that were asked for, m, frame map; empty = the waypoints."""
    ends: tuple[int, ...] = ()
    """Index in `route` of the waypoint at each place."""
    xy_tolerance: float = Conduct().xy_goal_tolerance
    """Distance within which the robot surely is at a success, m."""
    yaw_tolerance: float = Conduct().yaw_goal_tolerance
    """Largest error of a heading that is asked for, rad."""
    timeout: float | None = None
    """Time after which the goal ends, s; None = never."""

    def __post_init__(self) -> None:
        self.places = self.places or self.route
        if self.route and not self.ends:
            self.ends = tuple(range(len(self.route)))

    @property
    def at_last(self) -> bool:
        """True if the present waypoint is the last one."""
        return self.index >= len(self.route) - 1

    @property
    def place(self) -> int:
        """Index of the goal's place that the present waypoint leads to; after the last place the number of places."""
        return sum(end < self.index for end in self.ends)

    def give_up(self, now: float) -> None:
        """Skip the place that is walked to, count it as missed, and walk to the next waypoint from `now`, s, on."""
        self.missed.append(self.place)
        self.index = self.ends[self.place]
        self.least, self.least_at = FAR, now
        self.go_on(now)

    def lead(self, ways: tuple[tuple[Point, ...], ...], now: float) -> None:
        """Replace the waypoints that are left by new ones.

        Args:
            ways: waypoints to each place that is left, the place last, m, frame map.
            now: simulated time, s.
        """
        done, at = self.ends[: self.place], self.index
        self.route = (*self.route[:at], *(point for way in ways for point in way))
        ends = [at - 1 + sum(len(way) for way in ways[: i + 1]) for i in range(len(ways))]
        self.ends = (*done, *ends)
        self.nearest, self.nearest_at = math.inf, now

    def stalled(self, left: float, now: float, progress: float) -> float:
        """Return the time without progress, s: since the way left was last shortened, less that of detours.

        The time of a detour is its additional way divided by 0.04 m/s. The least way so far is kept in the goal.

        Args:
            left: way over the waypoints that are left, m.
            now: simulated time, s.
            progress: way that counts as progress towards a waypoint, m; three of it shorten the way.
        """
        if left < self.least - NEARER * progress:
            self.least, self.least_at, self.detour = left, now, 0.0
        self.detour = max(self.detour, left - self.least)
        return now - self.least_at - self.detour / DETOUR_PACE

    def off_route(self, x: float, y: float) -> float:
        """Return the distance of a place (x, y in m, frame map) from the leg of the route to the present waypoint."""
        end = self.waypoint
        begin = self.route[self.index - 1] if 0 < self.index < len(self.route) else self.start or end
        dx, dy = end[0] - begin[0], end[1] - begin[1]
        length = dx * dx + dy * dy
        along = 0.0 if length == 0.0 else min(1.0, max(0.0, ((x - begin[0]) * dx + (y - begin[1]) * dy) / length))
        return math.hypot(x - begin[0] - along * dx, y - begin[1] - along * dy)

    def check(self) -> None:
        """Refuse a goal read from a file whose waypoints, places or index cannot be those of a navigator.

        Raises:
            ValueError: a number that is not finite, or indices that do not fit the route.
        """
        json.dumps(self.kept(), allow_nan=False)
        last, ends = len(self.route) - 1, self.ends
        if last < 0 or len(ends) != len(self.places) or [*ends] != sorted({*ends, last}) or ends[0] < 0:
            raise ValueError(
                f"its {len(self.places)} places end at {ends}, allowed are waypoints until the last, {last}"
            )
        if not 0 <= self.index <= last + 1:
            raise ValueError(f"it is at waypoint {self.index}, allowed are 0 to {last + 1}")

    def kept(self) -> dict[str, Any]:
        """Return the fields as plain values of JSON; an infinite `nearest` becomes 1e9 m."""
        return {**asdict(self), "nearest": min(self.nearest, FAR), "recoveries": dict(self.recoveries)}

    def go_on(self, now: float) -> None:
        """Make the next waypoint the present one, from the time `now`, s, on."""
        self.index += 1
        self.nearest, self.nearest_at, self.looks = math.inf, now, 0

    @property
    def waypoint(self) -> Point:
        """Waypoint that the robot walks to at present, m, frame map."""
        return self.route[min(self.index, len(self.route) - 1)]

    def left(self, x: float, y: float) -> float:
        """Return the length of the way from a place (x, y in m, frame map) over the waypoints that are left, m."""
        total = 0.0
        for px, py in self.route[self.index :]:
            total += math.hypot(px - x, py - y)
            x, y = px, py
        return total
