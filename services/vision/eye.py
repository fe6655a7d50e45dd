"""Recognition of a map's landmarks in one image: faults of the image, picture from above, features, matches."""

from collections import deque
from dataclasses import dataclass, field
from statistics import median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import Refusal
from surefoot.schemas.hw import CameraImage

from .conditions import Greys, conditions
from .feature_map import FeatureMap
from .features import Extractor, FoundFeatures, nothing
from .recognise import Believed, Recognised, RecogniseParams, recognise, seen_from
from .view import FloorPose, Patch, from_above, greys, in_image

Counts = NDArray[np.int64]

FEW_FEATURES = 12
"""Number of features up to which an image counts as `featureless`: a floor without any detail."""
SCALES, SCALED = 8, 0.04
"""`SCALES`: number of recent images whose floor scale is compared with the map; `SCALED`: deviation of their median
from 1 above which the flag `scale` is raised."""
SOON, FAR = 3, 0.1
"""`SOON`: number of last images that raise the flag `scale` at once; `FAR`: deviation of the scale from 1, all to one
side, that each of them exceeds then."""
SCALE_FROM = 5
"""Least number of recognised landmarks of an image whose floor scale is used."""
BLIND_IMAGES, BLIND_SHARE, KNOWN_SHARE = 4, 0.025, 0.06
"""`BLIND_IMAGES`: number of images, 0.2 s apart, over which recognised features are counted; `BLIND_SHARE`: share of
those with a candidate up to which a known floor becomes unknown (by chance 0.01, or 0.034 if a belief follows it);
`KNOWN_SHARE`: share above which an unknown floor becomes known."""
HALF_MAPPED, HALF_SEEN, MAPPED = 0.25, 0.05, 40
"""Conditions of the flag `half_blind`. `HALF_MAPPED`: least share of the visible map features in a half of the image;
`HALF_SEEN`: largest share of the found features there; `MAPPED`: least number of either in the image."""
ELSEWHERE_EVERY = 3
"""Number of images in a row without a landmark at the believed pose, the last of which is compared with the whole
map."""

NONE = np.zeros((0, 2)), np.zeros(0, dtype=np.int64)
"""Result without recognised landmarks: places (0, 2) m and indices in the map (0,)."""


class Seen(NamedTuple):
    """Result of one image: recognised landmarks, counts of features and matches, faults."""

    places: Array
    """Positions of the recognised landmarks, forward and left of base_link at the middle of the exposure, (k, 2) m."""
    landmarks: NDArray[np.int64]
    """Index in the map of each recognised landmark, (k,)."""
    features: int
    """Number of features found in the image."""
    compared: int
    """Number of the image's features with a candidate in the map."""
    recognised: int
    """Number of map landmarks found in the image; `landmarks` holds those with the most similar descriptors."""
    anywhere: bool
    """True if the whole map was searched, False if only the surroundings of the believed pose."""
    flags: tuple[str, ...]
    """Names of the faults of the image; empty = none."""


@dataclass
class Eye:
    """Recogniser of map landmarks in the images of one camera, with a memory of the last images to detect faults.

    Attributes:
        extractor: finds features in a picture.
        world: map of features; None = only the image's condition is found.
        patch: part of the floor that is evaluated.
        params: limits of recognition.
    """

    extractor: Extractor
    world: FeatureMap | None
    patch: Patch = field(default_factory=Patch)
    params: RecogniseParams = field(default_factory=RecogniseParams)
    _before: Greys | None = None
    _scales: deque[float] = field(default_factory=lambda: deque[float](maxlen=SCALES))
    _blind: int = 0
    _found: deque[tuple[int, int]] = field(default_factory=lambda: deque[tuple[int, int]](maxlen=BLIND_IMAGES))
    """Numbers of features recognised, and of features with a candidate, in each of the last images."""
    _known: bool = False
    """True if the floor counts as that of the map, False if it is unknown."""
    _halves: deque[tuple[Counts, Counts]] = field(
        default_factory=lambda: deque[tuple[Counts, Counts]](maxlen=BLIND_IMAGES)
    )
    """Numbers of found features and of map features in the left, right, upper and lower half of each of the last
    images."""

    def features(self, image: CameraImage, base: FloorPose) -> tuple[FoundFeatures, tuple[str, ...]]:
        """Return the features of an image, in pixels of the picture from above, and the faults of the image by name.

        `base`: roll, pitch and height of base_link at the exposure.

        Raises:
            Refusal: what came is no image, or the camera does not look at the floor.
        """
        pixels = greys(image)
        flags, self._before = conditions(pixels, self._before), pixels
        if set(flags) & {"frozen", "dark"}:
            return nothing(self.extractor.kind), flags
        found = self.extractor.find(*from_above(image, pixels, base, self.patch))
        return found, flags if len(found.pixels) > FEW_FEATURES else (*flags, "featureless")

    def look(self, image: CameraImage, base: FloorPose, belief: Believed | None) -> Seen:
        """Return the landmarks recognised in an image; faults are flags, not errors.

        Args:
            image: image of the camera.
            base: roll, pitch and height of base_link at its exposure.
            belief: believed pose at the image; None = lost.
        """
        try:
            found, flags = self.features(image, base)
        except Refusal as error:
            return self._unread(0, error.code)
        count = len(found.pixels)
        if self.world is None or not count:
            return self._unread(count, *flags, *(() if self.world is not None else ("no_map",)))
        places = self.patch.place(found.pixels)
        try:
            seen = self._recognised(places, found, self.world, belief)
        except Refusal as error:
            return self._unread(count, *flags, error.code)
        if len(seen.features) >= SCALE_FROM:
            self._scales.append(seen.scale)
        self._blind = 0 if len(seen.features) else self._blind + 1
        flags = (*flags, *self._unknown(seen), *self._half_blind(image, base, belief, places))
        if self._scaled():
            return Seen(*NONE, count, seen.compared, 0, seen.anywhere, (*flags, "scale"))
        return Seen(places[seen.features], seen.landmarks, count, seen.compared, seen.agreed, seen.anywhere, flags)

    def _unread(self, count: int, *flags: str) -> Seen:
        """Return the result of an image that was compared with no map: `count` features found, and its faults.

        Comparison of the halves of an image begins anew, as it needs images in a row, unless the image is a frozen one.
        """
        if "frozen" not in flags:
            self._halves.clear()
        return Seen(*NONE, count, 0, 0, False, flags)

    def _scaled(self) -> bool:
        """Return True if the floor looks larger or smaller than its map in the last images."""
        off = [scale - 1.0 for scale in self._scales]
        far = len(off) >= SOON and (min(off[-SOON:]) > FAR or max(off[-SOON:]) < -FAR)
        return far or (len(off) == SCALES and abs(median(off)) > SCALED)

    def _unknown(self, seen: Recognised) -> tuple[str, ...]:
        """Return the flag `unrecognised` if the last images show a floor that is not that of the map, else none."""
        self._found.append((seen.agreed, seen.compared))
        if len(self._found) < BLIND_IMAGES:
            return ()
        agreed, compared = (sum(each) for each in zip(*self._found, strict=True))
        self._known = agreed > (BLIND_SHARE if self._known else KNOWN_SHARE) * compared
        return () if self._known else ("unrecognised",)

    def _half_blind(
        self, image: CameraImage, base: FloorPose, belief: Believed | None, places: Array
    ) -> tuple[str, ...]:
        """Return the flag `half_blind` if half of the image shows nothing where the map has features, else none.

        Args:
            image: image of the camera.
            base: roll, pitch and height of base_link.
            belief: believed pose; None = lost.
            places: places of the features found in the image, forward and left of base_link, (n, 2) m.
        """
        if self.world is None or belief is None:
            self._halves.clear()
            return ()
        p = self.patch
        mapped = seen_from(self.world.positions, belief.pose)
        ahead = (mapped[:, 0] >= p.nearest) & (mapped[:, 0] <= p.farthest) & (np.abs(mapped[:, 1]) <= p.beside)
        counts = [_by_half(image, in_image(image, base, p, each)) for each in (places, mapped[ahead])]
        self._halves.append((counts[0], counts[1]))
        if len(self._halves) < BLIND_IMAGES:
            return ()
        found, there = (np.add.reduce(each) for each in zip(*self._halves, strict=True))
        blind = (there >= HALF_MAPPED * (there[0] + there[1])) & (found <= HALF_SEEN * (found[0] + found[1]))
        return ("half_blind",) if min(there[0] + there[1], found[0] + found[1]) >= MAPPED and blind.any() else ()

    def _recognised(
        self, places: Array, found: FoundFeatures, world: FeatureMap, belief: Believed | None
    ) -> Recognised:
        seen = recognise(places, found.descriptors, world, belief, self.params)
        if belief is None or len(seen.features) or (self._blind + 1) % ELSEWHERE_EVERY:
            return seen
        return recognise(places, found.descriptors, world, None, self.params)


def _by_half(image: CameraImage, pixels: Array) -> Counts:
    """Return the number of places, (n, 2) px, in the left, right, upper and lower half of an image, (4,)."""
    u, v = pixels.T
    inside = (u >= 0.0) & (u < image.width) & (v >= 0.0) & (v < image.height)
    left, upper = u < 0.5 * image.width, v < 0.5 * image.height
    return np.array([np.count_nonzero(inside & half) for half in (left, ~left, upper, ~upper)])
