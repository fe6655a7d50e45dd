"""Camera images of a run with what was recognised in them: features, and matches with the map.

The last image of each of the first `MOST_ACTIONS` = 4 actions is kept, with the gate (search radius) of each match,
which the believed pose set; there is no gate where the whole map was searched.
"""

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import SurefootError
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.services.vision import view
from surefoot.services.vision.features import Extractor
from surefoot.services.vision.messages import places_of
from surefoot.services.vision.motion import OdometryAt, since
from surefoot.services.vision.recognise import RecogniseParams, gate_radius
from surefoot.services.vision.view import FloorPose, Patch, from_above

MOST_ACTIONS, COUNT = 4, 250
"""`MOST_ACTIONS`: largest number of actions with an image shown; `COUNT`: largest number of features per image."""
IMAGES, MOMENTS = 6, 100
"""`IMAGES`: number of latest images kept until the landmarks of an image arrive; `MOMENTS`: number of latest odometry
messages kept for that."""
ROUND = np.linspace(0.0, 2.0 * math.pi, 25)


class SeenImage(NamedTuple):
    """Camera image of a run, with the landmarks that were recognised in it."""

    time: float
    """Simulated time of the middle of the exposure, s."""
    image: Any
    """Decoded message of `hw/image` with the image."""
    base: FloorPose
    places: Array
    """Recognised landmarks, heading axes of base_link at the time of the image, (k, 2) m."""
    seen: Any
    """Decoded message of `state/landmarks` on the image."""
    reach: Array
    """Radius of the search region of each recognised landmark, (k,) m; NaN where the whole map was searched."""
    entropy: float
    """Entropy of the believed pose, nats; NaN = no belief was received."""


@dataclass
class SightKeeper:
    """Collector of the camera images of a run and of what was recognised in them, from its messages.

    Attributes:
        by_action: last image with landmarks of each action.
    """

    by_action: dict[str, SeenImage] = field(default_factory=dict[str, SeenImage])
    _images: deque[Any] = field(default_factory=lambda: deque[Any](maxlen=IMAGES))
    _moments: deque[tuple[OdometryAt, FloorPose]] = field(
        default_factory=lambda: deque[tuple[OdometryAt, FloorPose]](maxlen=MOMENTS)
    )
    _belief: Any = None

    def image(self, message: Any) -> None:
        """Keep the camera image of an `hw/image` message until its landmarks arrive."""
        self._images.append(message)

    def believed(self, message: Any) -> None:
        """Keep the estimated pose of a message `state/pose`."""
        self._belief = message

    def moved(self, message: Any) -> None:
        """Keep the pose of base_link of a message `state/odometry`; the floor is at height 0."""
        (x, y, z), yaw = message.position, message.yaw
        c, s = math.cos(yaw), math.sin(yaw)
        level = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        rot = level @ matrix_from_quat(np.array(message.quat_wxyz))
        self._moments.append((OdometryAt(message.stamp_ns, (x, y, yaw), rot), FloorPose(rot, z)))

    def landmarks(self, message: Any, action: str) -> None:
        """Keep the landmarks of a message `state/landmarks`, with their image, as the last of an action."""
        image = next((each for each in self._images if each.stamp_ns == message.image_stamp_ns), None)
        if not message.fresh or image is None or not self._moments:
            return
        if action not in self.by_action and len(self.by_action) == MOST_ACTIONS:
            return
        then, base = min(self._moments, key=lambda each: abs(each[0].stamp_ns - image.stamp_ns))
        now = min(self._moments, key=lambda each: abs(each[0].stamp_ns - message.stamp_ns))[0]
        places = since(places_of(message), now, then)
        entropy = math.nan if self._belief is None else self._belief.entropy
        reach = np.full(len(places), math.nan) if message.anywhere else self._reach(places)
        sight = SeenImage(image.stamp_ns * 1e-9, image, base, places, message, reach, entropy)
        self.by_action[action] = sight

    def _reach(self, places: Array) -> Array:
        """Return the search radius, (k,) m, within which map features were candidates at places (k, 2) m."""
        if self._belief is None:
            return np.full(len(places), math.nan)
        return gate_radius(places, np.array(self._belief.covariance).reshape(3, 3), RecogniseParams())


def in_image(places: Array, sight: SeenImage) -> Array:
    """Return where an image shows points of the floor, (n, 2) px; `places`: heading axes of base_link, (n, 2) m."""
    return view.in_image(sight.image, sight.base, Patch(), places)


def features(sight: SeenImage, pixels: NDArray[np.uint8]) -> Array:
    """Return the positions of the features of an image (h, w), (n, 2) px; none without OpenCV."""
    try:
        found = Extractor("orb", COUNT).find(*from_above(sight.image, pixels, sight.base, Patch()))
    except SurefootError:
        return np.zeros((0, 2))
    return in_image(Patch().place(found.pixels), sight)


def gates(sight: SeenImage) -> list[Array]:
    """Return the outline of the search region of each match, (25, 2) px; none where the whole map was compared."""
    ring = np.stack((np.cos(ROUND), np.sin(ROUND)), axis=1)
    pairs = zip(sight.places, sight.reach, strict=True)
    return [in_image(place + reach * ring, sight) for place, reach in pairs if math.isfinite(reach)]


def words(sight: SeenImage) -> str:
    """Return a sentence on an image: time, features, matches, entropy of the pose, flags."""
    seen, where = sight.seen, "whole map" if sight.seen.anywhere else "gates"
    entropy = f", entropy {sight.entropy:.1f} nats" if math.isfinite(sight.entropy) else ""  # of no believed pose
    flags = "".join(f", {flag}" for flag in seen.flags)
    return f"{sight.time:.1f} s: {seen.features} features, {len(seen.landmarks)} matches ({where}){entropy}{flags}"
