"""Errors of camera and floor that all images of a walk share, estimated from the features in the images.

A camera pitched by p and rolled by q too far, on a floor that leans by (f, g) about the axes of the map, turned aside
by s and set off by (u, v), shows a feature at

    z = d + T(d) ((p, q) + R^T (f, g)) + s J d + (u, v),        T(d) = h I + d d^T / h

in heading axes, d the true place there, h the height of the camera. With X the place of the feature in the map and a
pose of position t and rotation R, R z + t less its mean over the sightings of a feature is linear in the seven. A walk
there and back along one way shows all of them; a walk in one direction shows a tilt by features that seem to move while
the robot comes closer.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import InvalidField

HEIGHT = 0.45
"""Default height of a camera above the floor, m."""
LIKELY = (*np.radians((3.0, 3.0, 1.0, 1.0, 3.0)), 0.02, 0.02)
"""Prior standard deviations of seven errors: pitch and roll of the camera, lean of the floor about x and y of the map,
yaw of the camera, rad, and its shift along x and y, m."""
ALL, TILTS = 7, 4
"""`ALL`: number of errors of camera and floor that are estimated with exact poses; `TILTS`: with poses that drift
(pitch and roll of the camera, lean of the floor)."""
PLACE_SD, HUBER, ROUNDS = 0.01, 0.02, 5
"""`PLACE_SD`: standard deviation of a sighting, m; `HUBER`: residual, m, above which a sighting is weighted down;
`ROUNDS`: number of reweighted least-squares iterations."""


class FloorLook(NamedTuple):
    """Features of one image of the floor, and the pose it was taken from."""

    pose: tuple[float, float, float]
    """Pose of base_link, x, y in m and heading in rad, frame map or odom."""
    places: Array
    """Positions of the features on the floor, heading axes of base_link, (n, 2) m."""
    descriptors: NDArray[np.generic]
    """Descriptors of the features, (n, 32) uint8 of ORB, (n, 128) float32 of SIFT."""
    camera: tuple[float, float, float] = (0.0, 0.0, HEIGHT)
    """Position of the camera, heading axes of base_link, origin on the floor, m."""


def tilts(places: Array, camera: tuple[float, float, float]) -> Array:
    """Return the movement of points of the floor in an image by a pitch and a roll of one radian, (n, 2, 2) m/rad.

    Axes are point, x and y, then pitch and roll.

    Args:
        places: points in heading axes of base_link, (n, 2) m.
        camera: x, y and height, m, in the same axes.
    """
    d, h = places - camera[:2], camera[2]
    eye = h * np.eye(2)
    return eye + d[:, :, None] * d[:, None, :] / h


def effects(look: FloorLook, free: int = ALL) -> Array:
    """Return the derivative of an image's feature places by seven errors of camera and floor, (n, 2, 7), m/rad or 1.

    Places are in heading axes of base_link. The errors are pitch p and roll q of the camera, lean f, g of the floor,
    turn aside s, rad, shift u, v, m; columns beyond `free` are 0.
    """
    found, places = np.zeros((len(look.places), 2, ALL)), look.places
    found[:, :, :2] = tilts(places, look.camera)
    found[:, :, 2:4] = found[:, :, :2] @ turn_of(look.pose[2]).T
    found[:, 0, 4], found[:, 1, 4] = -places[:, 1], places[:, 0]
    found[:, 0, 5] = found[:, 1, 6] = 1.0
    found[:, :, free:] = 0.0
    return found


def turn_of(heading: float) -> Array:
    """Return rot_map_from_heading, (2, 2), the rotation from heading axes of base_link to the map; heading in rad."""
    c, s = math.cos(heading), math.sin(heading)
    return np.array([[c, -s], [s, c]])


def check_cameras(looks: list[FloorLook]) -> None:
    """Check that the cameras of the images of a walk are above the floor.

    Raises:
        InvalidField: one is not.
    """
    for number, look in enumerate(looks):
        if not 0.0 < look.camera[2] < math.inf:
            raise InvalidField("camera", f"got height {look.camera[2]:g} m in look {number}, allowed is > 0")


def camera_error(looks: list[FloorLook], tracks: NDArray[np.int64], free: int = ALL) -> Array:
    """Return the errors of a camera and of the floor that all images of a walk share, (7,).

    They are pitch p and roll q of the camera, lean f, g of the floor about the axes of the map, turn aside s, rad, and
    shift u, v, m.

    Args:
        looks: features and poses of the images of a walk.
        tracks: feature of each sighting in order, (n,); the poses of the sightings of one feature must be consistent.
        free: number of errors that are estimated, the first of the seven; the others are 0.

    Raises:
        InvalidField: a camera is not above the floor.
    """
    placed, moved = list[Array](), list[Array]()
    check_cameras(looks)
    for look in looks:
        rot = turn_of(look.pose[2])
        placed.append(look.places @ rot.T + look.pose[:2])
        moved.append(np.einsum("ij,njk->nik", rot, effects(look, free)))
    _, group, count = np.unique(tracks, return_inverse=True, return_counts=True)
    rows = _centred(np.concatenate(moved).reshape(len(group), -1), group, count).reshape(-1, ALL)
    right = _centred(np.concatenate(placed), group, count)
    found: Array = np.zeros(ALL)
    weight: Array = np.ones(len(group))
    for _ in range(ROUNDS):
        scaled = rows * np.repeat(weight / PLACE_SD**2, 2)[:, None]
        found = np.asarray(
            np.linalg.solve(rows.T @ scaled + np.diag(1.0 / np.square(LIKELY)), scaled.T @ right.ravel()),
            dtype=np.float64,
        )
        left = np.hypot(*(right - (rows @ found).reshape(-1, 2)).T)
        weight = np.minimum(1.0, HUBER / np.maximum(left, 1e-9))
    return found


def _centred(values: Array, group: NDArray[np.int64], count: NDArray[np.int64]) -> Array:
    """Return values (n, k) less the mean of their group, in their unit.

    `group`: of each row, (n,); `count`: rows of each group, (groups,).
    """
    means = np.stack([np.bincount(group, column) for column in values.T], axis=1) / count[:, None]
    return values - means[group]


def set_right(looks: list[FloorLook], error: Array) -> list[FloorLook]:
    """Return the features of a walk as a camera without errors would place them, on a level floor.

    `error` (7,): camera pitch and roll, lean of the floor (2), yaw error, rad, and shift (2), m.
    """
    return [look._replace(places=look.places - effects(look) @ error) for look in looks]
