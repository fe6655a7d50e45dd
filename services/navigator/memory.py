"""The last goal, kept in a file, so that a navigator that was killed and started again goes on with it.

The file belongs to one run (its folder); what is of another epoch, or of a later tick than now, is not taken up.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from surefoot.services.navigator.goals import End, State


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
    goal: Mapping[str, Any] | None
    """Fields of the last goal; None = there was none."""
    state: State = "idle"
    """Of the pilot,"""
    end: End = ("idle", "", "")
    """how the goal ends,"""
    ended: float = 0.0
    """s, and since when."""
    planned: tuple[tuple[int, Mapping[str, Any]], ...] = ()
    """Goals that wait for their tick: the tick, and the fields."""


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
            fresh.write_text(json.dumps({"epoch": epoch, "tick": tick, **asdict(kept)}), encoding="utf-8")
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
                int(found["number"]), _pose(found["pose"]), tuple(map(float, found["covariance"])),
                None if odom is None else _pose(odom), found["goal"],
                found["state"], tuple(found["end"]), float(found["ended"]),
                tuple((int(tick), fields) for tick, fields in found["planned"]),
            )  # fmt: skip
        except (OSError, ValueError, KeyError, TypeError) as error:
            self.problem = f"the kept goal cannot be read: {error}"
            return None


def _pose(values: Any) -> tuple[float, float, float]:
    x, y, yaw = map(float, values)
    return (x, y, yaw)
