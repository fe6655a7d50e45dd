"""Memory of the last goal in a file, so that a navigator that was killed and started again goes on with it.

The file belongs to one run (its folder); contents of another epoch, or of a later tick than now, are ignored.
"""

import json
from dataclasses import dataclass
from typing import Any, cast, get_args

from surefoot.lockstep.memory import RunMemory
from surefoot.schemas.navigation import GoalState

from .goals import End, NavigationGoal


@dataclass(frozen=True)
class Kept:
    """State that a navigator needs to go on."""

    number: int
    """Number of the last order."""
    pose: tuple[float, float, float]
    """Believed x, y (m) and heading (rad), frame map."""
    covariance: tuple[float, ...]
    """Covariance of the pose, (9,), row by row."""
    odom: tuple[float, float, float] | None
    """Odometry of the same moment, x, y (m) and heading (rad); None = there is none."""
    goal: NavigationGoal | None
    """Last goal; None = there was none."""
    state: GoalState = "idle"
    """State of the pilot."""
    end: End = ("idle", "", "")
    """End of the goal, coming or past; of one under way, its present state."""
    ended: float = 0.0
    """Simulated time at which the last goal ended, s."""
    planned: tuple[tuple[int, NavigationGoal], ...] = ()
    """Goals that wait for their tick."""


class GoalMemory(RunMemory):
    """File that keeps the last goal.

    Args:
        path: None = nothing is kept.
    """

    def __init__(self, path: str | None) -> None:
        super().__init__(path, "goal")

    def keep(self, epoch: int, tick: int, kept: Kept) -> None:
        """Replace the content."""
        goal, planned = kept.goal and kept.goal.kept(), [(at, each.kept()) for at, each in kept.planned]
        self.write(epoch, tick, {**vars(kept), "goal": goal, "planned": planned})

    def recall(self, epoch: int, tick: int) -> Kept | None:
        """Return the state that was kept in this epoch, not after this tick, or None.

        A navigator may be killed between keeping a tick and publishing it: its successor does that tick again.
        """
        content = self.read()
        if content is None:
            return None
        try:
            found = json.loads(content)
            if found["epoch"] != epoch or found["tick"] > tick:
                return None
            odom, goal = found["odom"], found["goal"]
            return Kept(
                int(found["number"]), _pose(found["pose"]), _covariance(found["covariance"]),
                None if odom is None else _pose(odom), goal and NavigationGoal.restored(goal),
                _state(found["state"]), _end(*found["end"]), float(found["ended"]),
                tuple((int(tick), NavigationGoal.restored(fields)) for tick, fields in found["planned"]),
            )  # fmt: skip
        except KeyError as error:
            self.give_up(f"{error.args[0]} is missing")
        except (ArithmeticError, RecursionError, LookupError, TypeError, ValueError) as error:
            self.give_up(error)
        return None


def _pose(values: Any) -> tuple[float, float, float]:
    x, y, yaw = map(float, values)
    return (x, y, yaw)


def _covariance(values: Any) -> tuple[float, ...]:
    numbers = tuple(map(float, values))
    if len(numbers) != 9:
        raise ValueError(f"covariance has {len(numbers)} numbers, allowed are 9")
    return numbers


def _state(value: Any) -> GoalState:
    if value not in get_args(GoalState):
        raise ValueError(f"state is {value!r}, allowed are {', '.join(get_args(GoalState))}")
    return cast(GoalState, value)


def _end(state: Any, error: Any, message: Any) -> End:
    return (_state(state), str(error), str(message))
