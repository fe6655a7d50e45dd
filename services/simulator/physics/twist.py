"""Turn of standing soles about the vertical: small in a normal biped gait, large on ice or in a fast gait."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array


class TwistTracker:
    """Tracker of the turn of each sole about the vertical since its touch-down, rad; only for feet with soles.

    Args:
        bodies: MuJoCo ids of the bodies of the feet, (L,).
    """

    def __init__(self, bodies: NDArray[np.int64]) -> None:
        self.bodies = bodies
        n = len(bodies)
        self.start, self.twist, self.last = np.zeros(n), np.zeros(n), np.zeros(n)
        self.standing = np.zeros(n, dtype=np.bool_)

    def update(self, xmat: Array, below: NDArray[np.int64], first: bool) -> None:
        """Update the turn of each sole by the state at the end of a tick.

        Args:
            xmat: rotations from each body to the world, row by row, (nbody, 9), no unit.
            below: (L,) ticks since a foot last stood, -1 = in swing.
            first: True = forget earlier ticks: feet that stand begin their stance here.
        """
        if first:
            self.standing[:], self.last[:] = False, 0.0
        for i, body in enumerate(self.bodies):
            yaw = math.atan2(xmat[body, 3], xmat[body, 0])
            stands = bool(below[i] >= 0)
            if stands and not self.standing[i]:
                self.start[i] = yaw
            if stands:
                turn = yaw - self.start[i]
                self.twist[i] = math.atan2(math.sin(turn), math.cos(turn))
            elif self.standing[i]:
                self.last[i], self.twist[i] = self.twist[i], 0.0
            self.standing[i] = stands

    def state(self) -> dict[str, Any]:
        """Return the turns of the soles, rad, and which of them stand as lists, for a checkpoint."""
        return {name: getattr(self, name).tolist() for name in ("start", "twist", "last", "standing")}

    def restore(self, state: dict[str, Any]) -> None:
        """Set the turns of the soles, and which of them stand, to a `state` that was returned earlier."""
        for name, values in state.items():
            getattr(self, name)[:] = values
