"""Memory of the last goal in a file, so that a navigator that was killed and started again goes on with it.

The file belongs to one run (its folder); contents of another epoch, or of a later tick than now, are ignored.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast, get_args

from surefoot.bus.codec import MAX_JSON_BYTES
from surefoot.disk import whole
from surefoot.files import read_regular
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


class GoalMemory:
    """One file.

    Args:
        path: None = nothing is kept.
    """

    def __init__(self, path: str | None) -> None:
        self.path = None if path is None else Path(path)
        self.problem = ""

    def keep(self, epoch: int, tick: int, kept: Kept) -> None:
        """Replace the contents; a disk that fails costs the memory, not the goal."""
        if self.path is None:
            return
        try:
            goal, planned = kept.goal and kept.goal.kept(), [(at, each.kept()) for at, each in kept.planned]
            fields = {**vars(kept), "goal": goal, "planned": planned}
            with whole(self.path) as fresh:
                fresh.write_text(json.dumps({"epoch": epoch, "tick": tick, **fields}), encoding="utf-8")
        except OSError as error:
            self.problem = f"the goal cannot be kept for a restart: {error.strerror}"
            self.path = None

    def forget(self) -> None:
        """Remove the file of an earlier run; on a disk that forbids it the run has no memory."""
        try:
            if self.path is not None:
                self.path.unlink(missing_ok=True)
        except OSError as error:
            self.problem = f"the goal cannot be kept for a restart: {error.strerror}"
            self.path = None

    def recall(self, epoch: int, tick: int) -> Kept | None:
        """Return the state that was kept in this epoch, not after this tick, or None.

        A navigator may be killed between keeping a tick and publishing it: its successor does that tick again.
        """
        if self.path is None or not self.path.exists():
            return None
        try:
            found = json.loads(read_regular(self.path, MAX_JSON_BYTES))
            if found["epoch"] != epoch or found["tick"] > tick:
                return None
            odom, goal = found["odom"], found["goal"]
            return Kept(
                int(found["number"]), _pose(found["pose"]), _covariance(found["covariance"]),
                None if odom is None else _pose(odom), goal and NavigationGoal.restored(goal),
                _state(found["state"]), _end(*found["end"]), float(found["ended"]),
                tuple((int(tick), NavigationGoal.restored(fields)) for tick, fields in found["planned"]),
            )  # fmt: skip
        except (OSError, ArithmeticError, RecursionError, LookupError, TypeError, ValueError) as error:
            self.problem = f"the kept goal cannot be read: {error}"
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
