"""Short walk of a lost robot whose detections fit several poses: to where the landmarks around these poses differ."""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array

from .belief.apart import telling
from .belief.landmarks import FloorLandmarks
from .belief.matching import MatchLimits, SightNoise
from .belief.ukf import Pose
from .localiser import Localiser
from .maps import Maps
from .planning.costs import Costs
from .planning.grid import Point
from .searching import Aside

ENOUGH = 8.0
"""Number of distinguishing landmarks around the end of a walk above which more do not count: the shortest such walk
wins."""
LENGTHS = tuple(0.4 * k for k in range(1, 9))
"""Lengths of the straight walks among which a lost robot chooses one to single out its pose, m."""
BEARINGS = tuple(math.radians(22.5 * k) for k in range(-8, 8))
"""Directions of the straight walks among which a lost robot chooses, rad from its heading, left positive."""
FROM = 0.2
"""Length of the first part of a straight walk that is not checked for obstacles, m: the robot may stand beside one."""


def leading(localiser: Localiser, maps: Maps) -> Aside:
    """Return a function that finds a short walk by which a lost robot can single out one of its candidate poses.

    It takes candidate poses and maps as they are at the call, and returns x, y of the walk's end in the robot's axes,
    m, or None.
    """

    def lead() -> Point | None:
        world = localiser.tracker.world
        return None if world is None else way_aside(localiser.alike, world, localiser.tracker.noise, maps.costs)

    return lead


def way_aside(alike: tuple[Pose, ...], world: FloorLandmarks, noise: SightNoise, costs: Costs | None) -> Point | None:
    """Return the end of a straight walk to where landmarks differ between the candidate poses of a lost robot.

    The walk is free of obstacles from each of these poses.

    Args:
        alike: candidate poses, x, y (m) and heading (rad), frame map.
        world: landmarks.
        noise: noise of the camera; only its `look_sd`, of a descriptor's elements, counts.
        costs: obstacles; None = there is no map of them.

    Returns:
        x, y of the end in the robot's axes, m; None = no such walk, or fewer than two candidates.
    """
    if len(alike) < 2:
        return None
    poses = np.array(alike)
    ends = np.array([(d * math.cos(a), d * math.sin(a)) for d in LENGTHS for a in BEARINGS])
    found = telling(poses, ends, world, MatchLimits().look(noise, world.descriptor_length))
    if costs is not None:
        for pose in poses:
            found[~_free(pose, ends, costs)] = 0.0
    best = int(np.argmax(np.minimum(found, ENOUGH)))  # of those that are enough the shortest
    return (float(ends[best, 0]), float(ends[best, 1])) if found[best] >= 1.0 else None


def _free(pose: Array, ends: Array, costs: Costs) -> NDArray[np.bool_]:
    """Return True for each straight walk from a pose that is free of obstacles, but for its first 0.2 m, (e,).

    Args:
        pose: x, y (m), heading (rad), frame map, (3,).
        ends: ends of the walks, in the axes of that pose, (e, 2) m.
        costs: costs of walking over the cells of the map.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    length = np.hypot(*ends.T)
    share = np.linspace(0.0, 1.0, 2 + int(length.max() / costs.grid.cell))
    x = pose[0] + share[:, None] * (c * ends[:, 0] - s * ends[:, 1])
    y = pose[1] + share[:, None] * (s * ends[:, 0] + c * ends[:, 1])
    grid, (rows, cols) = costs.grid, costs.weight.shape
    x, y = grid.aligned(x, y)
    row = np.clip(np.floor((y - grid.origin[1]) / grid.cell).astype(np.int64) + 1, 0, rows - 1)
    col = np.clip(np.floor((x - grid.origin[0]) / grid.cell).astype(np.int64) + 1, 0, cols - 1)
    return ((costs.weight[row, col] > 0) | (share[:, None] * length < FROM)).all(axis=0)
