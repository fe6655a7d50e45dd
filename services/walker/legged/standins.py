"""Substitutes for the replies of the foothold and stability services, computed by the walker itself."""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry import rotations
from surefoot.geometry.linear import angle_of, product
from surefoot.robot import kinematics
from surefoot.robot.description import Robot

from ..interface import FootholdReply, LandingRequest, StanceCheck, StanceVerdict


def nominal_footholds(request: LandingRequest) -> tuple[FootholdReply, ...]:
    """Return the nominal foothold of each leg of a request, in the form of the foothold service's reply."""
    return tuple(FootholdReply("ok", leg.nominal) for leg in request.legs)


def ring_of(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (n, 2) m in counter-clockwise order about their mean."""
    centre = points.mean(axis=0)
    return points[np.argsort(angle_of(points[:, 1] - centre[1], points[:, 0] - centre[0]))]


def hull_margin(points: NDArray[np.float64], c: NDArray[np.float64]) -> float:
    """Return the distance of c (2,) m from the edge of the convex hull of points (n, 2) m, positive inside, m.

    Outside it is the distance from the line of the farthest violated edge, negative. The points are corners of the
    hull.
    """
    ring = ring_of(points)
    margin = math.inf
    for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        edge = b - a
        length = math.hypot(edge[0], edge[1])
        if length > 1e-9:
            margin = min(margin, (edge[0] * (c[1] - a[1]) - edge[1] * (c[0] - a[0])) / length)
    return float(margin)


class HullCheck:
    """Check of a planned step by the margin of the centre of mass in the convex hull of the standing feet."""

    def __init__(self, robot: Robot) -> None:
        self._model = robot.model

    def __call__(self, request: StanceCheck) -> StanceVerdict:
        """Return a verdict by the smaller margin before and after the planned movement; under 3 feet: unstable."""
        if len(request.positions) < 3:
            return StanceVerdict(False, None, "segment")
        rot = rotations.matrix_from_quat(request.base_quat)
        com = request.base_position + product(rot, kinematics.com(self._model, request.joints))
        feet = request.positions[:, :2]
        after = com[:2] + np.array(request.movement[:2])
        margin = min(hull_margin(feet, com[:2]), hull_margin(feet, after))
        return StanceVerdict(margin >= 0.0, margin, "ok", ring_of(feet), com[:2], after)
