"""File with the state of the last goal, from which a navigator that was killed and restarted resumes.

The file belongs to one run (its folder); contents from before the last reset (of another epoch), or of a later tick
than now, are ignored.
"""

from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator

from surefoot.arrays import Array
from surefoot.geometry.linear import eigen3
from surefoot.lockstep.memory import MOST_ID, RunMemory, Stored
from surefoot.schemas.navigation import GoalState

from .belief.ukf import Pose
from .goals import End, NavigationGoal


class Kept(BaseModel):
    """State that a restarted navigator needs to resume its goal."""

    model_config = ConfigDict(allow_inf_nan=False)
    number: int = Field(ge=0, le=MOST_ID, description="of the last order")
    pose: Pose = Field(description="believed x, y (m) and heading (rad), frame map")
    covariance: tuple[float, ...] = Field(description="of the pose, (9,), row by row")
    odom: Pose | None = Field(description="odometry of the same moment, m and rad; null = there is none")
    goal: NavigationGoal | None = Field(description="last goal; null = there was none")
    state: GoalState = Field(default="idle", description="of the pilot")
    end: End = Field(default=("idle", "", ""), description="of the goal, coming or past; else its present state")
    ended: float = Field(default=0.0, description="simulated time at which the last goal ended, s")
    planned: tuple[tuple[int, NavigationGoal], ...] = Field(default=(), description="goals that wait for their tick")

    @field_validator("covariance")
    @classmethod
    def _positive(cls, covariance: tuple[float, ...]) -> tuple[float, ...]:
        if not is_covariance(np.array(covariance).reshape(3, 3)):
            raise ValueError(f"got {covariance}, allowed is a covariance: symmetric, without negative variances")
        return covariance

    @field_validator("goal", "planned")
    @classmethod
    def _goals(cls, kept: Any) -> Any:
        for goal in (goal for _, goal in kept) if isinstance(kept, tuple) else (kept,) if kept else ():
            goal.check()
        return kept


class _StoredGoal(Stored, Kept):
    """State of a navigator as stored in the file, with the epoch and tick of storage."""


def is_covariance(matrix: Array) -> bool:
    """Return True if a matrix (3, 3) is symmetric up to rounding and has no negative variance."""
    least = -1e-9 * float(np.abs(matrix).max())
    return bool((np.abs(matrix - matrix.T) <= -least).all() and eigen3(matrix)[0].min() >= least)


class GoalMemory(RunMemory):
    """File that keeps the state a navigator needs when it is started again: last goal, belief, order number.

    Args:
        path: path of the file; None = nothing is kept.
    """

    def __init__(self, path: str | None) -> None:
        super().__init__(path, "goal")

    def keep(self, epoch: int, tick: int, kept: Kept) -> None:
        """Write the state of a tick to the file, in place of the previous one.

        `epoch`: number of the reset that the tick belongs to; `tick`: its number.
        """
        goal, planned = kept.goal and kept.goal.kept(), [(at, each.kept()) for at, each in kept.planned]
        self.write(epoch, tick, {**vars(kept), "goal": goal, "planned": planned})

    def recall(self, epoch: int, tick: int) -> Kept | None:
        """Return the state stored in this epoch (since the last reset) at or before this tick, None = there is none."""
        found = self.read(_StoredGoal, epoch, tick)
        return found and Kept.model_construct(**{name: getattr(found, name) for name in Kept.model_fields})
