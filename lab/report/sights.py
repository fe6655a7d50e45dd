"""Images of a run with what was recognised in them: features, matches with the map, and the gate of each match.

One image is kept of each action, the last one, with the belief that restricted the search in it.
"""

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from numpy.typing import NDArray

from surefoot.errors import SurefootError
from surefoot.services.vision.features import Extractor
from surefoot.services.vision.messages import places_of
from surefoot.services.vision.motion import OdometryAt, since
from surefoot.services.vision.recognise import RecogniseParams, gate_radius
from surefoot.services.vision.view import FloorPose, Patch, from_above, greys, homography

from .drawing import GREEN, ORANGE, PAPER

Array = NDArray[np.float64]

MOST_ACTIONS, COUNT = 4, 250
"""Actions of which an image is shown; most features of an image."""
IMAGES, MOMENTS = 6, 100
"""Images and messages of odometry that are kept until the landmarks of an image come."""
ROUND = np.linspace(0.0, 2.0 * math.pi, 25)
COLUMNS = 2


class SeenImage(NamedTuple):
    """One image and what was recognised in it."""

    time: float
    """s, middle of the exposure."""
    image: Any
    """Message `hw/image`."""
    base: FloorPose
    places: Array
    """Recognised landmarks in heading axes of base_link at that time, (k, 2) m."""
    seen: Any
    """Message `state/landmarks`."""
    reach: Array
    """Gate of each landmark, (k,) m; NaN where the whole map was compared."""
    entropy: float
    """Of the pose, nats."""


@dataclass
class SightKeeper:
    """Gathers the sights of a run from its messages.

    Attributes:
        by_action: last sight of each action.
    """

    by_action: dict[str, SeenImage] = field(default_factory=dict[str, SeenImage])
    _images: deque[Any] = field(default_factory=lambda: deque[Any](maxlen=IMAGES))
    _moments: deque[tuple[OdometryAt, FloorPose]] = field(
        default_factory=lambda: deque[tuple[OdometryAt, FloorPose]](maxlen=MOMENTS)
    )
    _belief: Any = None

    def image(self, message: Any) -> None:
        """Take a message `hw/image`."""
        self._images.append(message)

    def believed(self, message: Any) -> None:
        """Take a message `state/pose`."""
        self._belief = message

    def moved(self, stamp_ns: int, position: tuple[float, float, float], yaw: float, rot_odom_from_base: Array) -> None:
        """Take the pose of base_link in odom, whose floor is at height 0."""
        c, s = math.cos(yaw), math.sin(yaw)
        rot = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ rot_odom_from_base
        self._moments.append((OdometryAt(stamp_ns, (*position[:2], yaw), rot), FloorPose(rot, position[2])))

    def landmarks(self, message: Any, action: str) -> None:
        """Take a message `state/landmarks` while an action is under way."""
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
        """Return the radius within which features of the map were candidates, (k,) m."""
        if self._belief is None:
            return np.full(len(places), math.nan)
        return gate_radius(places, np.array(self._belief.covariance).reshape(3, 3), RecogniseParams())


def in_image(places: Array, sight: SeenImage) -> Array:
    """Return where an image shows points of the floor, heading axes of base_link, (n, 2) px."""
    patch = Patch()
    above = np.stack(
        ((patch.beside - places[:, 1]) / patch.pixel - 0.5, (patch.farthest - places[:, 0]) / patch.pixel - 0.5), axis=1
    )
    found = np.hstack((above, np.ones((len(places), 1)))) @ homography(sight.image, sight.base, patch).T
    return found[:, :2] / found[:, 2:]


def features(sight: SeenImage, pixels: NDArray[np.uint8]) -> Array:
    """Return the features of an image, (n, 2) px; none without OpenCV."""
    try:
        found = Extractor("orb", COUNT).find(*from_above(sight.image, pixels, sight.base, Patch()))
    except SurefootError:
        return np.zeros((0, 2))
    return in_image(Patch().place(found.pixels), sight)


def figure_of(sights: dict[str, SeenImage]) -> Figure:
    """Return the images of actions: features, matches with their gates, entropy of the pose."""
    rows = -(-len(sights) // COLUMNS)
    figure = Figure(figsize=(7.6, 3.1 * rows), layout="constrained", facecolor=PAPER)
    FigureCanvasSVG(figure)
    for i, (action, sight) in enumerate(sights.items()):
        _draw(figure.add_subplot(rows, COLUMNS, i + 1), action, sight)
    return figure


def _draw(axes: Axes, action: str, sight: SeenImage) -> None:
    axes.set_axis_off()
    seen, where = sight.seen, "whole map" if sight.seen.anywhere else "gates"
    axes.set_title(
        f"{action or 'no action'}, {sight.time:.1f} s: {seen.features} features, {len(seen.landmarks)} matches "
        f"({where}),\nentropy {sight.entropy:.1f} nats{', ' if seen.flags else ''}{', '.join(seen.flags)}",
        fontsize=8.0,
    )
    try:
        pixels = greys(sight.image)
    except SurefootError as error:
        axes.text(0.5, 0.5, str(error), ha="center", wrap=True, transform=axes.transAxes)
        return
    height, width = pixels.shape
    axes.imshow(pixels, cmap="gray", vmin=0, vmax=255, extent=(0.0, width, height, 0.0))
    axes.set(xlim=(0.0, width), ylim=(height, 0.0))
    try:
        axes.plot(*features(sight, pixels).T, ".", color=ORANGE, markersize=2.0)
        axes.plot(*in_image(sight.places, sight).T, "o", color=GREEN, markersize=4.0, fillstyle="none")
        for place, reach in zip(sight.places, sight.reach, strict=True):
            gate = place + reach * np.stack((np.cos(ROUND), np.sin(ROUND)), axis=1)
            axes.plot(*in_image(gate, sight).T, color=GREEN, linewidth=0.5, alpha=0.6)
    except SurefootError:  # the camera does not look at the floor
        return
