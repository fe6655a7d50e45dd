"""Interface of gaits to the walker service, for any number of legs."""

from typing import Protocol

from surefoot.geometry.heightmap import HeightMap

from .interface import CommandReply, MotionCommand, WalkerInputs, WalkerOutputs
from .memory import WalkMemory


class Gait(Protocol):
    """Interface of a gait, which turns commands into joint set-points, one control tick at a time."""

    @property
    def walk_id(self) -> int:
        """Number of the last command that was accepted, 0 before the first."""
        ...

    def command(self, command: MotionCommand) -> CommandReply:
        """Accept or refuse a command; an accepted one replaces the present one at the next step."""
        ...

    def never(self, command: MotionCommand) -> CommandReply | None:
        """Return the refusal of a command that cannot be obeyed at any time, or None."""
        ...

    def set_map(self, heights: HeightMap | None) -> None:
        """Use a new terrain map, frame map; None = the ground is where the feet are. A gait may ignore the map."""
        ...

    def kept(self) -> WalkMemory:
        """Return the command under way and what else a restarted walker needs to resume it."""
        ...

    def resume(self, kept: WalkMemory) -> None:
        """Resume the walk of the stored state after a restart; called before the first tick."""
        ...

    def step(self, inputs: WalkerInputs) -> WalkerOutputs:
        """Advance the gait by one control tick of 10 ms; return its set-points and state."""
        ...
