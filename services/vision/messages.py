"""Conversion between vision results and messages on the bus."""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.linear import product
from surefoot.geometry.rotations import wrap_angle
from surefoot.schemas.hw import Landmark, LandmarkDetections
from surefoot.schemas.navigation import PoseBelief
from surefoot.schemas.state import SeenLandmarks

from .eye import Seen
from .motion import OdometryAt
from .recognise import Believed

UNSURE = (0.5, 0.6)
"""Standard deviations of position, m, and heading, rad, above which a believed pose is ignored and the whole map is
searched."""


def belief_of(message: PoseBelief | None, then: OdometryAt) -> Believed | None:
    """Return the navigator's believed pose at the time of an image; None = lost, or too uncertain to restrict a search.

    `message`: the newest belief; None = there is none. `then`: odometry at the time of the image.
    """
    if message is None or message.lost:
        return None
    covariance = np.array(message.covariance).reshape(3, 3)
    if max(covariance[0, 0], covariance[1, 1]) > UNSURE[0] ** 2 or covariance[2, 2] > UNSURE[1] ** 2:
        return None
    x, y, turn = message.map_from_odom
    c, s = math.cos(turn), math.sin(turn)
    place = product(np.array([[c, -s], [s, c]]), np.array(then.pose[:2]))
    return Believed(np.array([x + place[0], y + place[1], wrap_angle(turn + then.pose[2])]), covariance)


def places_of(message: LandmarkDetections) -> Array:
    """Return the positions of the landmarks in a message, forward and left of base_link at its stamp, (k, 2) m."""
    return np.array(
        [(m.range * math.cos(m.bearing), m.range * math.sin(m.bearing)) for m in message.landmarks]
    ).reshape(-1, 2)  # fmt: skip


def landmarks_message(places: Array, seen: Seen, codes: Array, stamp_ns: int, flags: tuple[str, ...]) -> SeenLandmarks:
    """Return the message of the landmarks recognised in an image.

    Args:
        places: places of the image's landmarks, forward and left of base_link now, (k, 2) m.
        seen: result of the image.
        codes: descriptors by which the navigator knows the map's features, (n, 8) unit vectors.
        stamp_ns: middle of the exposure, simulated time, ns.
        flags: faults of the camera, beside those of the image.
    """
    marks = tuple(
        Landmark(range=math.hypot(x, y), bearing=math.atan2(y, x), descriptor=tuple(codes[k].tolist()))
        for (x, y), k in zip(places.tolist(), seen.landmarks.tolist(), strict=True)
    )
    return SeenLandmarks(
        landmarks=marks, fresh=True, image_stamp_ns=stamp_ns, features=seen.features, compared=seen.compared,
        recognised=seen.recognised, anywhere=seen.anywhere, flags=tuple(dict.fromkeys((*flags, *seen.flags))),
    )  # fmt: skip
