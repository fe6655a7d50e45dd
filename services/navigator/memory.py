"""The last goal, kept in a file, so that a navigator that was killed and started again goes on with it.

The file belongs to one run (its folder); what is of another epoch, or of a later tick than now, is not taken up.
"""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast, get_args

from .goals import End, Goal, State


@dataclass(frozen=True)
class Kept:
    """What a navigator must know to go on."""

    number: int
    """Of the last order."""
    pose: tuple[float, float, float]
    """m and rad, map."""
    covariance: tuple[float, ...]
    """(9,) of it."""
    odom: tuple[float, float, float] | None
    """Odometry of the same moment, m and rad."""
    goal: Goal | None
    """The last one; None = there was none."""
    state: State = "idle"
    """State of the pilot."""
    end: End = ("idle", "", "")
    """How the goal ends or has ended; of one under way, its present state."""
    ended: float = 0.0
    """Simulated time at which the last goal ended, s."""
    planned: tuple[tuple[int, Goal], ...] = ()
    """Goals that wait for their tick."""


class Memory:
    """One file.

    Args:
        path: None = nothing is kept.
    """

    def __init__(self, path: str | None) -> None:
        self.path = None if path is None else Path(path)
        self.problem = ""

    def keep(self, epoch: int, tick: int, kept: Kept) -> None:
        """Replace what is kept; a disk that fails costs the memory, not the goal."""
        if self.path is None:
            return
        fresh = self.path.with_suffix(".new")
        try:
            goal, planned = kept.goal and kept.goal.kept(), [(at, each.kept()) for at, each in kept.planned]
            fields = {**vars(kept), "goal": goal, "planned": planned}
            fresh.write_text(json.dumps({"epoch": epoch, "tick": tick, **fields}), encoding="utf-8")
            os.replace(fresh, self.path)
        except OSError as error:
            self.problem = f"the goal cannot be kept for a restart: {error.strerror}"
            self.path = None

    def forget(self) -> None:
        """Remove what an earlier run has left."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)

    def recall(self, epoch: int, tick: int) -> Kept | None:
        """Return what was kept in this epoch, not after this tick, or None.

        A navigator may be killed between keeping a tick and sending it: its successor does that tick again.
        """
        if self.path is None or not self.path.exists():
            return None
        try:
            found = json.loads(self.path.read_text(encoding="utf-8"))
            if found["epoch"] != epoch or found["tick"] > tick:
                return None
            odom = found["odom"]
            return Kept(
                int(found["number"]), _pose(found["pose"]), _covariance(found["covariance"]),
                None if odom is None else _pose(odom), None if found["goal"] is None else Goal.restored(found["goal"]),
                _state(found["state"]), _end(*found["end"]), float(found["ended"]),
                tuple((int(tick), Goal.restored(fields)) for tick, fields in found["planned"]),
            )  # fmt: skip
        except (OSError, ValueError, KeyError, TypeError) as error:
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


def _state(value: Any) -> State:
    if value not in get_args(State):
        raise ValueError(f"state is {value!r}, allowed are {', '.join(get_args(State))}")
    return cast(State, value)


def _end(state: Any, error: Any, message: Any) -> End:
    return (_state(state), str(error), str(message))
