"""Count of landmarks that distinguish the candidate poses of a lost robot, for the ends of possible walks."""

import math

import numpy as np

from surefoot.arrays import Array, Flags
from surefoot.kernels.jit import row_kernel

from .gate import apart2
from .landmarks import FloorLandmarks

FAR = 0.25
"""Largest distance, m, between a landmark and the place expected at another pose at which both count as the same."""
AROUND = 1.0
"""Viewing distance of a robot that turns around on the spot, m: landmarks within it count for the end of a walk."""
MOST_COMPARED = 256
"""Largest number of landmarks in reach that are compared, evenly spaced in the list: bounds the time of a tick."""


@row_kernel
def alone(places: Array, looks: Array, positions: Array, others: Array, look: float) -> Flags:
    """Return True, (m,), where no landmark of the map of similar descriptor lies within 0.25 m of a given place.

    Args:
        places: where m landmarks would stand, (m, 2) m, frame map.
        looks: descriptors of the places, (m, k), no unit.
        positions: landmarks of the map, (n, 2) m, frame map.
        others: descriptors of the landmarks of the map, (n, k), no unit.
        look: largest distance of two descriptors of one landmark, no unit.
    """
    found, most = np.ones(places.shape[0], dtype=np.bool_), look * look
    for i in range(places.shape[0]):
        for j in range(positions.shape[0]):
            dx, dy = positions[j, 0] - places[i, 0], positions[j, 1] - places[i, 1]
            if dx * dx + dy * dy < FAR * FAR and apart2(looks[i], others[j], most) < most:
                found[i] = False
                break
    return found


def telling(poses: Array, ends: Array, world: FloorLandmarks, look: float) -> Array:
    """Return how many landmarks around each end of a walk distinguish the first pose from the most similar other one.

    Args:
        poses: candidate poses of a lost robot, x, y (m) and heading (rad), frame map, (p, 3), p >= 2.
        ends: ends of the walks, in the axes of the robot, (e, 2) m.
        world: landmarks of the map.
        look: largest distance of two descriptors of one landmark, no unit.

    Returns:
        Numbers, (e,): landmarks within 1 m of the end that would stand there at one of the two poses only.
    """
    least = np.full(len(ends), np.inf)
    for other in poses[1:]:
        there = _stranger(poses[0], other, ends, world, look)
        least = np.minimum(least, there + _stranger(other, poses[0], ends, world, look))
    return least


def _stranger(pose: Array, other: Array, ends: Array, world: FloorLandmarks, look: float) -> Array:
    """Return the number of landmarks around each end of a walk that one pose predicts and another does not, (k,).

    Args:
        pose: x, y (m), heading (rad), frame map, (3,), from which the landmarks are taken.
        other: another pose, at which they are sought, (3,).
        ends: ends of the walks, in the axes of the robot, (k, 2) m.
        world: landmarks of the map; of more than 256 in reach a part is compared and scaled up.
        look: largest distance of two descriptors of one landmark, no unit.
    """
    local = _turned(world.positions - pose[:2], -pose[2])
    near = np.flatnonzero(np.hypot(*local.T) < np.hypot(*ends.T).max() + AROUND)
    each = max(1.0, near.size / MOST_COMPARED)
    near = near[np.arange(0.0, near.size, each).astype(np.int64)]
    places = _turned(local[near], other[2]) + other[:2]
    new = alone(places, world.descriptors[near], world.positions, world.descriptors, look)
    around = np.hypot(*(local[near][new][:, None] - ends).transpose(2, 0, 1)) < AROUND
    return each * around.sum(axis=0)


def _turned(points: Array, angle: float) -> Array:
    """Return points (n, 2) turned about the origin by an angle, rad, in their unit."""
    c, s = math.cos(angle), math.sin(angle)  # numpy's own depend on the processor
    return np.column_stack((c * points[:, 0] - s * points[:, 1], s * points[:, 0] + c * points[:, 1]))
