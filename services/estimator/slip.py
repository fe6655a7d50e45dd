"""How far each foot slips over its stance, by the robot's own measurements.

A foot that rolls without slipping moves its centre by phi x (r n), phi the rotation of its link since touch-down, r the
radius of the sphere, n the normal of the ground. What the centre has moved beyond that is slip:

    s = |(1 - n n') (c - c_0 - phi x (r n))|

c is the foot centre in `odom` (odometry and joints), so s holds the drift of the odometry over one stance as well. The
ground's normal is taken as the vertical unless one is given.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.linear import product
from surefoot.geometry.rotations import rotvec_from_matrix

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

SETTLE = 2
"""Samples with contact before a stance begins: the first belong to the landing."""
OPEN = 2
"""Samples without contact that end it: one may be a bounce."""


@dataclass(frozen=True, slots=True)
class FinishedStance:
    """One stance that has ended."""

    leg: int
    slip: float
    """m, between the first and the last settled sample."""
    begin: tuple[float, float, float]
    """Foot centre at its begin, `odom`, m."""
    samples: int
    """With contact, from begin to end."""


@dataclass(eq=False)
class StanceSlip:
    """Follows all feet from sample to sample.

    Args:
        legs: L.
        radius: of the foot spheres, (L,) m.
    """

    legs: int
    radius: Array
    slip: Array = field(init=False)
    """Of the present stance, (L,) m; 0 in swing."""
    _closed: NDArray[np.int64] = field(init=False)
    _open: NDArray[np.int64] = field(init=False)
    _centre: Array = field(init=False)
    _rot: Array = field(init=False)

    def __post_init__(self) -> None:
        n = self.legs
        self.slip = np.zeros(n)
        self._closed, self._open = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
        self._centre, self._rot = np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1))

    def update(
        self, contact: Flags, centre: Array, rot_odom_from_foot: Array, normal: Array | None = None
    ) -> list[FinishedStance]:
        """Take one sample of all feet; returns the stances that have ended.

        Args:
            contact: foot switches, (L,).
            centre: foot centres in `odom`, (L, 3) m; a row that is not finite leaves its foot as it was.
            rot_odom_from_foot: rotation of each foot's link, (L, 3, 3).
            normal: of the ground at each foot, (L, 3); None = vertical.
        """
        ended: list[FinishedStance] = []
        for leg in range(self.legs):
            row = centre[leg].tolist()
            if not all(math.isfinite(value) for value in row):
                continue
            if not contact[leg]:
                self._open[leg] += 1
                if self._open[leg] == OPEN:
                    if self._closed[leg] > SETTLE:
                        begin = tuple(self._centre[leg].tolist())
                        ended.append(FinishedStance(leg, float(self.slip[leg]), begin, int(self._closed[leg]) - SETTLE))
                    self._closed[leg], self.slip[leg] = 0, 0.0
                continue
            self._open[leg] = 0
            self._closed[leg] += 1
            if self._closed[leg] <= SETTLE:
                self._centre[leg], self._rot[leg] = centre[leg], rot_odom_from_foot[leg]
                continue
            up = (0.0, 0.0, 1.0) if normal is None else tuple(normal[leg].tolist())
            self.slip[leg] = self._way(leg, row, rot_odom_from_foot[leg], up)
        return ended

    def _way(self, leg: int, centre: list[float], rot: Array, n: tuple[float, ...]) -> float:
        """Way of the contact point in the plane of the ground since the begin of the stance, m."""
        phi = rotvec_from_matrix(product(rot, np.ascontiguousarray(self._rot[leg].T))).tolist()
        begin, r = self._centre[leg].tolist(), float(self.radius[leg])
        rolled = (phi[1] * n[2] - phi[2] * n[1], phi[2] * n[0] - phi[0] * n[2], phi[0] * n[1] - phi[1] * n[0])
        d = [centre[k] - begin[k] - r * rolled[k] for k in range(3)]
        along = d[0] * n[0] + d[1] * n[1] + d[2] * n[2]
        d = [d[k] - along * n[k] for k in range(3)]
        return math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
