"""File with the command under way, from which a walker that was killed and started again resumes it.

The file belongs to one run (its folder); a command of another epoch, or of a later tick than now, is ignored.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, Self

from pydantic import Field, field_validator, model_validator

from surefoot.lockstep.memory import MOST_ID, RunMemory, Stored
from surefoot.schemas.cmd import WalkCommand

from .interface import BodyPose, MotionCommand


@dataclass(frozen=True)
class WalkMemory:
    """State from which a restarted walker resumes: command under way, its start, planned commands, last order."""

    walk_id: int
    command: MotionCommand | None
    """Command under way (of a biped its remaining part); None = none is."""
    start: BodyPose | None
    """Pose of the trunk at which the command began, map frame; None = not begun, or `command` is a remaining part."""
    began: float | None
    """Simulated time at which the command began, s; None = not begun."""
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Pose of frame odom in frame map: x, y (m), heading (rad)."""
    planned: tuple[Mapping[str, Any], ...] = ()
    """Commands that wait for the tick at which they begin, as received."""
    order: int = 0
    """Number of the last navigator order that the walker took up; 0 = none yet."""


class _StoredWalk(Stored):
    """Content of the memory file: the state that a walker needs to resume, checked when it is read."""

    walk_id: int = Field(ge=0, le=MOST_ID)
    command: MotionCommand | None
    start: BodyPose | None
    began: float | None
    offset: tuple[float, float, float]
    planned: tuple[dict[str, Any], ...]
    order: int = Field(ge=0, le=MOST_ID)

    @field_validator("planned")
    @classmethod
    def _commands(cls, planned: tuple[dict[str, Any], ...]) -> tuple[dict[str, Any], ...]:
        for item in planned:
            WalkCommand.model_validate(item)
        return planned

    @model_validator(mode="after")
    def _finite(self) -> Self:
        json.dumps([asdict(part) for part in (self.command, self.start) if part], allow_nan=False)
        json.dumps((self.began, self.offset), allow_nan=False)
        return self


class MemoryFile(RunMemory):
    """File that stores the command under way.

    Args:
        path: path of the file; None = nothing is stored.
    """

    def __init__(self, path: str | None) -> None:
        super().__init__(path, "command")
        self._last: WalkMemory | None = None

    def keep(self, epoch: int, tick: int, kept: WalkMemory) -> None:
        """Write the state of the walker in a tick to the file if it has changed."""
        if kept != self._last:
            self._last = kept
            self.write(epoch, tick, asdict(kept))

    def forget(self) -> None:
        """Remove the file of an earlier run; the first state of the new run is written even if it has not changed."""
        self._last = None
        super().forget()

    def recall(self, epoch: int, tick: int) -> WalkMemory | None:
        """Return the state stored in `epoch` at or before `tick`; None = there is none."""
        found = self.read(_StoredWalk, epoch, tick)
        return found and WalkMemory(**{field.name: getattr(found, field.name) for field in fields(WalkMemory)})
