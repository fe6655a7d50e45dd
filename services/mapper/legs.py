"""Pose of the trunk by its standing feet alone, which do not move, while the state estimator restarts.

With the positions a_i of the feet in base_link before and b_i after, and their means A and B, the trunk has turned by

    psi = atan2(sum (b_i - B) x (a_i - A), sum (b_i - B) . (a_i - A))   and moved by   A - Rz(psi) B

in the axes of base_link before; its tilt is taken to stay as it was.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.geometry.linear import product
from surefoot.geometry.rotations import matrix_from_rpy

LEAST_FEET = 2
"""Least number of feet that stand both before and after a tick; with fewer the trunk is assumed not to have moved."""


class TrunkOverFeet:
    """Pose of base_link, updated by the standing feet alone while there is no odometry.

    Attributes:
        position: position of base_link, (3,) m, frame of the last odometry.
        yaw: heading of base_link in the frame of the last odometry, rad.
    """

    def __init__(self, position: Array, yaw: float) -> None:
        self.position, self.yaw = position, yaw
        self._feet: Array | None = None
        self._down: NDArray[np.bool_] | None = None

    def step(self, feet: Array, down: NDArray[np.bool_]) -> None:
        """Update the pose by the feet of a tick, (n, 3) m, base_link; `down`: True for those that stand, (n,)."""
        if self._feet is not None and self._down is not None:
            both = self._down & down
            if both.sum() >= LEAST_FEET:
                move, turn = trunk_moved(self._feet[both], feet[both])
                self.position = self.position + product(matrix_from_rpy(0.0, 0.0, self.yaw), move)
                self.yaw += turn
        self._feet, self._down = feet, down


def trunk_moved(before: Array, after: Array) -> tuple[Array, float]:
    """Return displacement, (3,) m, axes of base_link before it, and turn, rad, of a trunk over standing feet."""
    a, b = before.mean(axis=0), after.mean(axis=0)
    p, q = before - a, after - b
    turn = math.atan2(
        float(np.add.reduce(p[:, 1] * q[:, 0] - p[:, 0] * q[:, 1])),
        float(np.add.reduce(p[:, 0] * q[:, 0] + p[:, 1] * q[:, 1])),
    )
    return a - product(matrix_from_rpy(0.0, 0.0, turn), b), turn
