"""Memory of the last goal in a file, so that a navigator that was killed and started again goes on with it.

The file belongs to one run (its folder); contents of another epoch, or of a later tick than now, are ignored.
"""

from dataclasses import dataclass, fields

import numpy as np
from pydantic import ConfigDict, Field, field_validator

from surefoot.geometry.linear import eigen3
from surefoot.lockstep.memory import MOST_ID, RunMemory, Stored
from surefoot.schemas.navigation import GoalState

from .goals import End, NavigationGoal


@dataclass(frozen=True)
class Kept:
    """State that a restarted navigator needs to go on."""

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


class _StoredGoal(Stored):
    """Content of the file: what is `Kept`."""

    model_config = ConfigDict(allow_inf_nan=False)
    number: int = Field(ge=0, le=MOST_ID)
    pose: tuple[float, float, float]
    covariance: tuple[float, ...]
    odom: tuple[float, float, float] | None
    goal: NavigationGoal | None
    state: GoalState
    end: End
    ended: float
    planned: tuple[tuple[int, NavigationGoal], ...]

    @field_validator("covariance")
    @classmethod
    def _positive(cls, covariance: tuple[float, ...]) -> tuple[float, ...]:
        matrix = np.array(covariance).reshape(3, 3)
        least = -1e-9 * float(np.abs(matrix).max())
        if (np.abs(matrix - matrix.T) > -least).any() or not eigen3(matrix)[0].min() >= least:
            raise ValueError(f"got {covariance}, allowed is a covariance: symmetric, without negative variances")
        return covariance

    @field_validator("goal")
    @classmethod
    def _goal(cls, goal: NavigationGoal | None) -> NavigationGoal | None:
        if goal is not None:
            goal.check()
        return goal

    @field_validator("planned")
    @classmethod
    def _goals(cls, planned: tuple[tuple[int, NavigationGoal], ...]) -> tuple[tuple[int, NavigationGoal], ...]:
        for _, goal in planned:
            goal.check()
        return planned


class GoalMemory(RunMemory):
    """File that keeps the last goal.

    Args:
        path: None = nothing is kept.
    """

    def __init__(self, path: str | None) -> None:
        super().__init__(path, "goal")

    def keep(self, epoch: int, tick: int, kept: Kept) -> None:
        """Write the goal of a tick to the file, in place of the one before."""
        goal, planned = kept.goal and kept.goal.kept(), [(at, each.kept()) for at, each in kept.planned]
        self.write(epoch, tick, {**vars(kept), "goal": goal, "planned": planned})

    def recall(self, epoch: int, tick: int) -> Kept | None:
        """Return the state that was kept in this epoch, not after this tick, or None."""
        found = self.read(_StoredGoal, epoch, tick)
        return found and Kept(**{field.name: getattr(found, field.name) for field in fields(Kept)})
