"""Goals, actions and orders: what the pilot works with."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from .belief.tracker import Motion

Array = NDArray[np.float64]
Point = tuple[float, float]
State = Literal["idle", "navigating", "stopping", "succeeded", "failed", "cancelled"]
End = tuple[State, str, str]
"""State in which a goal ends, error, and what happened in words."""


@dataclass(frozen=True)
class GaitView:
    """What the walker says."""

    state: str
    walk_id: int = 0
    order: int = 0
    """Number of the last order it took up."""
    refused: str = ""
    """Why it refused that order."""
    ends_in: float | None = None
    """s until the last planned step lands."""
    reason: str = ""


@dataclass(frozen=True)
class Act:
    """One action the robot offers: what is ordered, and what becomes of it."""

    name: str
    kind: Literal["stand", "turn", "walk"]
    motion: Motion
    """Of the whole action; forward and turn are what is ordered."""
    duration: float
    """s, of its steps; of a stand, of standing."""


@dataclass(frozen=True)
class Order:
    """A command to the walker."""

    action: Literal["walk", "turn", "stop"]
    distance: float | None = None
    """m."""
    angle: float | None = None
    """rad."""


class Choice(Protocol):
    """What a policy decided."""

    @property
    def index(self) -> int:
        """Of the action."""
        ...

    @property
    def values(self) -> tuple[float, ...]:
        """Per action, larger is better; NaN for those that were not allowed."""
        ...

    @property
    def reason(self) -> str:
        """In words."""
        ...


@dataclass
class Searching:
    """A search for the pose of a lost robot."""

    until: float
    """s, when this look ends; inf: it has not begun."""
    turns: int = 0


class Policy(Protocol):
    """Chooses the next action."""

    def decide(self, mean: Array, cov: Array, goal: Point, *, blocked: bool) -> Choice:
        """Return the next action for a belief (4,), (4, 4) as it will be when that action begins."""
        ...

    def begin(self) -> None:
        """Forget the run of actions so far: a new goal."""
        ...


@dataclass
class Goal:
    """One goal and how it went."""

    id: str
    route: tuple[Point, ...]
    policy: str
    began: float
    """s."""
    yaw: float | None = None
    index: int = 0
    """Present waypoint."""
    missed: list[int] = field(default_factory=list[int])
    recoveries: Counter[str] = field(default_factory=Counter[str])
    nearest: float = math.inf
    """m, to the present waypoint so far,"""
    nearest_at: float = 0.0
    """s, and since when."""
    looks: int = 0
    start: Point | None = None
    """Where the robot was when the goal began, m."""
    asked: str | None = None
    """Name or file that finds the policy again; None: the default."""

    def off_route(self, x: float, y: float) -> float:
        """Return the distance of a place from the present leg of the route, m."""
        end = self.waypoint
        begin = self.route[self.index - 1] if 0 < self.index < len(self.route) else self.start or end
        dx, dy = end[0] - begin[0], end[1] - begin[1]
        length = dx * dx + dy * dy
        along = 0.0 if length == 0.0 else min(1.0, max(0.0, ((x - begin[0]) * dx + (y - begin[1]) * dy) / length))
        return math.hypot(x - begin[0] - along * dx, y - begin[1] - along * dy)

    @classmethod
    def restored(cls, kept: Mapping[str, Any]) -> "Goal":
        """Return a goal from the fields that `kept` returned, also after JSON has made lists of tuples."""
        start, route = kept["start"], tuple((float(x), float(y)) for x, y in kept["route"])
        found = {"route": route, "start": start and (start[0], start[1]), "recoveries": Counter(kept["recoveries"])}
        goal = cls(**{**kept, **found})
        if not route or not 0 <= goal.index <= len(route):
            raise ValueError(f"the goal is at waypoint {goal.index} of {len(route)}")
        return goal

    def kept(self) -> dict[str, Any]:
        """Return the fields as plain values of JSON; an infinite distance begins anew."""
        return {**asdict(self), "nearest": min(self.nearest, 1e9), "recoveries": dict(self.recoveries)}

    @property
    def waypoint(self) -> Point:
        """The present waypoint, m."""
        return self.route[min(self.index, len(self.route) - 1)]

    def left(self, x: float, y: float) -> float:
        """Return the way from a place over the waypoints that are left, m."""
        total = 0.0
        for px, py in self.route[self.index :]:
            total += math.hypot(px - x, py - y)
            x, y = px, py
        return total


@dataclass(frozen=True)
class Decided:
    """A decision as it is published."""

    number: int
    action: str
    reason: str
    values: dict[str, float]
    distance: float
    bearing: float
    entropy: float
