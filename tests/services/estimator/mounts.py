"""Feet and an inertial unit in the middle of the robot, for tests of the kernels."""

import numpy as np

from surefoot.services.estimator.feet.contact import BestGeometry, ContactPoints, point_feet

OPEN = np.zeros(2, dtype=np.int64)  # switches of two feet that have one for the whole foot


def mounted(points: ContactPoints) -> BestGeometry:
    """The points with the inertial unit at base_link."""
    return BestGeometry(*points, np.eye(3), np.zeros(3))


def balls(feet: int) -> BestGeometry:
    """So many point feet that do not roll."""
    return mounted(point_feet(np.zeros(feet)))
