"""Dataclasses of the navigator: a goal with its progress, an action, and the state of the walker."""

import json
import math
from collections import Counter
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from surefoot.schemas.navigation import GoalState
from surefoot.schemas.state import GaitState

from .belief.tracker import Motion
from .belief.ukf import wrap
from .marker import Dock
from .planning.grid import Point
from .policy.settings import Conduct

End = tuple[GoalState, str, str]
"""Outcome of a goal: final state, error code, message."""


@dataclass(frozen=True)
class GaitView:
    """State of the walker from the topic `state/gait`, reduced to what goals need."""

    state: str
    """State of the gait as in `state/gait`, such as standing, walking, waiting (the estimator calibrates), hold (inputs
    are stale), refused (the robot fell, or no step could be planned)."""
    walk_id: int = 0
    """Number of the walker's present command, from any client."""
    order: int = 0
    """Number of the last navigator order that the walker started."""
    refused: str = ""
    """Reason why the walker refused the navigator's last order; empty = accepted."""
    ends_in: float | None = None
    """Time until the last planned step lands, s; None = unknown, or no step is planned."""
    reason: str = ""
    """Reason of the gait state `refused`, in words; empty otherwise."""

    @classmethod
    def of(cls, gait: GaitState) -> "GaitView":
        """Return the parts of a `state/gait` message that goals need."""
        return cls(gait.state, gait.walk_id, gait.order, gait.order_refused, gait.ends_in_s, gait.reason)


@dataclass(frozen=True)
class Act:
    """Action of the robot, with its expected motion."""

    name: str
    kind: Literal["stand", "turn", "walk"]
    motion: Motion
    """Expected motion of the whole action: ordered distance and turn, and their variances."""
    duration: float
    """Duration of the action's steps, or of its standing, s."""
    match: float | None = None
    """Share of the landmarks in view that a camera frame recognises during the action, 0 to 1; None = unknown."""


FAR = 1e9
"""Distance larger than any path, m: initial value of a minimum."""
DETOUR_PACE = 0.04
"""Assumed speed of a robot on a detour, m/s, by which its extra length counts as time; the Nao walks at 0.05."""
PATIENCE = 10.0
"""Time, s, that the robot waits while marks close every way; then it tries, once a goal, one through unsure marks."""
NEARER = 3.0
"""Factor on the least progress, m, by which the remaining path has to shrink to count as shorter: the belief itself
jumps by one such step."""


@dataclass
class NavigationGoal:
    """Goal of the navigator, with its route and its progress."""

    id: str
    route: tuple[Point, ...]
    """Waypoints of the route in order, (x, y) in m, frame map."""
    policy: str
    """Name of the policy that chooses the actions."""
    began: float
    """Simulated time at which the goal began, s."""
    yaw: float | None = None
    """Wanted heading at the last waypoint, rad, frame map; None = any."""
    index: int = 0
    """Index in `route` of the present waypoint; equals its length once the last one is passed."""
    missed: list[int] = field(default_factory=list[int])
    """Indices in `places` of places that were given up."""
    recoveries: Counter[str] = field(default_factory=Counter[str])
    """Number of recovery actions by name."""
    nearest: float = math.inf
    """Least distance of the estimate to the present waypoint so far, m."""
    nearest_at: float = 0.0
    """Simulated time of the least distance to the present waypoint so far, s."""
    least: float = FAR
    """Least remaining path length over the waypoints so far, m; a new route does not reset it."""
    least_at: float = 0.0
    """Simulated time at which the remaining path length last reached its minimum, s."""
    detour: float = 0.0
    """Largest excess of the remaining path length over its minimum since that minimum was reached, m."""
    looks: int = 0
    """Number of stands for a camera frame at the present waypoint so far."""
    waited: float = 0.0
    """Time spent waiting for a free path, s."""
    dared: bool = False
    """True if a way was planned once through places where something may be, as everything else was closed."""
    backs: int = 0
    """Number of steps back since the last walk ahead."""
    turns: int = 0
    """Number of turns to the wanted heading at the present waypoint so far."""
    start: Point | None = None
    """Believed position of the robot when the goal began, x, y in m, frame map; None = not recorded."""
    asked: str | None = None
    """Name or file by which the policy was requested; None = the default policy."""
    places: tuple[Point, ...] = ()
    """Requested places in order, (x, y) in m, frame map; empty = the waypoints of `route`."""
    ends: tuple[int, ...] = ()
    """Index in `route` of the waypoint at each requested place."""
    xy_tolerance: float = Conduct().xy_goal_tolerance
    """Largest distance from the last waypoint at which the goal succeeds, m."""
    yaw_tolerance: float = Conduct().yaw_goal_tolerance
    """Largest error of the requested final heading at which the goal succeeds, rad."""
    timeout: float | None = None
    """Time after the beginning of the goal, pauses left out, at which it ends unreached, s; None = no limit."""
    yaws: tuple[float | None, ...] = ()
    """Wanted heading at each place, rad, frame map, None = any; empty = `yaw` at the last waypoint is all."""
    loops: int = 1
    """Number of rounds over the places; 0 = until the goal is cancelled."""
    loop: int = 1
    """Number of the present round, from 1."""
    reached: int = 0
    """Number of places that were reached in the present round."""
    paused_at: float | None = None
    """Simulated time since which the goal is paused, s; None = it is not."""
    paused: float = 0.0
    """Time that the goal spent in earlier pauses, s."""
    since: list[int] = field(default_factory=lambda: [0, 0])
    """Number of decisions without progress: those that a near echo restricted to turns, and all."""

    dock: Dock | None = None
    """Marker that the goal docks on; None = it ends by the belief."""

    def __post_init__(self) -> None:
        self.places = self.places or self.route
        if self.route and not self.ends:
            self.ends = tuple(range(len(self.route)))

    @property
    def final(self) -> bool:
        """True in the last round over the places."""
        return 0 < self.loops <= self.loop

    @property
    def at_last(self) -> bool:
        """True if the present waypoint is the last one of the last round."""
        return self.final and self.index >= len(self.route) - 1

    @property
    def place(self) -> int:
        """Index of the goal's place that the present waypoint leads to; past the last one the number of places."""
        return sum(end < self.index for end in self.ends)

    @property
    def bold(self) -> bool:
        """True after a wait of `PATIENCE` until a way was planned through places where something may be."""
        return self.waited >= PATIENCE and not self.dared

    def active(self, now: float) -> float:
        """Return the time that the goal has been under way without its pauses until the simulated time `now`, s."""
        return (now if self.paused_at is None else self.paused_at) - self.began - self.paused

    def unpause(self, now: float) -> None:
        """End the pause at the simulated time `now`, s; the time of the pause counts against no limit."""
        if self.paused_at is not None:
            span, self.paused_at = now - self.paused_at, None
            self.paused += span
            self.nearest_at, self.least_at = self.nearest_at + span, self.least_at + span

    def off_heading(self, heading: float) -> float:
        """Return the turn from a heading to the one wanted at the present waypoint, rad, left positive; 0 = any.

        `heading`: rad, frame map.
        """
        wanted = self.yaws[self.place] if self.yaws and self.index in self.ends else None
        wanted = self.yaw if self.at_last else wanted
        return 0.0 if wanted is None else float(wrap(wanted - heading))

    def pass_on(self, now: float, heading: float) -> None:
        """Advance from a waypoint that is not the last; its place is missed if the heading is beyond the tolerance.

        `now`: simulated time, s; `heading`: believed, rad, frame map.
        """
        if self.index in self.ends and abs(self.off_heading(heading)) > self.yaw_tolerance:
            self.miss()
        elif self.index in self.ends:
            self.reached += 1
        self.go_on(now)

    def miss(self) -> None:
        """Count the present place as missed, once however many rounds miss it."""
        if self.place not in self.missed:
            self.missed.append(self.place)

    def begin_round(self, now: float) -> None:
        """Begin the next round over the places, whose route is planned, at the simulated time `now`, s."""
        self.loop, self.index, self.reached = self.loop + 1, -1, 0
        self.least, self.least_at = FAR, now
        self.go_on(now)

    def give_up(self, now: float) -> None:
        """Skip the place that is walked to, count it as missed, and walk to the next waypoint from `now`, s, on."""
        self.miss()
        self.index = self.ends[self.place]
        self.least, self.least_at = FAR, now
        self.go_on(now)

    def lead(self, ways: tuple[tuple[Point, ...], ...], now: float) -> None:
        """Replace the remaining waypoints by new ones.

        Args:
            ways: waypoints to each place that is left, the place last, m, frame map.
            now: simulated time, s.
        """
        done, at = self.ends[: self.place], self.index
        if self.yaws:  # a place twice in a row is another heading there
            ways = tuple(way or (place,) for way, place in zip(ways, self.places[self.place :], strict=True))
        self.route = (*self.route[:at], *(point for way in ways for point in way))
        ends = [at - 1 + sum(len(way) for way in ways[: i + 1]) for i in range(len(ways))]
        self.ends = (*done, *ends)
        self.nearest, self.nearest_at = math.inf, now

    def stalled(self, left: float, now: float, progress: float) -> float:
        """Return the time without progress, s: since the remaining path last shrank, less an allowance for detours.

        The time of a detour is its additional length divided by 0.04 m/s. The least length so far is kept in the goal.

        Args:
            left: path length over the remaining waypoints, m.
            now: simulated time, s.
            progress: distance that counts as progress towards a waypoint, m; three of it shorten the path.
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
        if last < 0 or len(ends) != len(self.places) or [0, *ends, last] != sorted([0, *ends, last]) or ends[-1] < last:
            raise ValueError(
                f"its {len(self.places)} places end at {ends}, allowed are waypoints until the last, {last}"
            )
        if not 0 <= self.index <= last + 1:
            raise ValueError(f"it is at waypoint {self.index}, allowed are 0 to {last + 1}")
        if len(self.yaws) not in (0, len(self.places)) or self.loops < 0 or self.loop < 1:
            raise ValueError(f"it has {len(self.yaws)} headings and is in round {self.loop} of {self.loops}")

    def kept(self) -> dict[str, Any]:
        """Return the fields of the goal as JSON values; an infinite `nearest` becomes 1e9 m."""
        return {**asdict(self), "nearest": min(self.nearest, FAR), "recoveries": dict(self.recoveries)}

    def go_on(self, now: float) -> None:
        """Advance to the next waypoint, from the time `now`, s, on."""
        self.index += 1
        self.nearest, self.nearest_at, self.looks, self.turns = math.inf, now, 0, 0

    @property
    def waypoint(self) -> Point:
        """Waypoint that the robot walks to at present, m, frame map."""
        return self.route[min(self.index, len(self.route) - 1)]

    def left(self, x: float, y: float) -> float:
        """Return the path length from a place (x, y in m, frame map) over the remaining waypoints, m."""
        total = 0.0
        for px, py in self.route[self.index :]:
            total += math.hypot(px - x, py - y)
            x, y = px, py
        return total
