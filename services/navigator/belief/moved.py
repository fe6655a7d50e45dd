"""Landmarks that stand elsewhere than the map has them.

A robot that is sure of its pose and sees a landmark of the map at another place remembers that place. Seen there again
a second later, the landmark has moved: it counts no more as one that belongs elsewhere, which a displaced robot sees
everywhere. A displaced robot sees it at a third place, where it counts.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import association
from .gate import FAR, OUTLIER, UNLIKE
from .landmarks import FloorLandmarks
from .matching import FATES, Detections, Matches, MatchLimits, SightNoise

Array = NDArray[np.float64]

AFTER_S = 1.0
"""Least time between the first sight of a landmark at another place and the one that shows that it has moved, s."""
HERE = 2
"""Least matches of a frame in which a robot is sure of its pose."""
NEAR_SDS = 3.0
"""Standard deviations of the way between two sights within which they show one place."""


class Sight(NamedTuple):
    """Circumstances of a frame."""

    pose: tuple[float, float, float]
    """Believed x, y, m, and heading, rad, frame map."""
    cov: Array
    """Covariance of the pose, (3, 3) or larger."""
    noise: SightNoise
    """Noise of the camera."""
    time: float
    """Time of the frame, s."""


class MovedLandmarks:
    """Places where landmarks were seen that are elsewhere in the map.

    Args:
        world: the map.
    """

    def __init__(self, world: FloorLandmarks) -> None:
        self.world = world
        self._seen = np.full((len(world), 3), np.nan)  # x, y, m, frame map, and time of the first sight there, s
        self._gaps = np.empty(len(world))

    def left_out(self, matches: Matches, seen: Detections, sight: Sight, *, sure: bool) -> Matches:
        """Return the matches of a frame with the detections of moved landmarks counted as outliers.

        Args:
            matches: of the frame at the believed pose.
            seen: its detections.
            sight: its circumstances.
            sure: the pose is certain: other places are remembered.
        """
        away = np.flatnonzero((matches.fates == FAR) | (matches.fates == UNLIKE))
        learns = sure and len(matches.detections) >= HERE
        gone = [d for d in away.tolist() if self._has_moved(seen, d, sight, learns)]
        if not gone:
            return matches
        fates = matches.fates.copy()
        fates[gone] = OUTLIER
        counts = np.bincount(fates, minlength=len(FATES)).tolist()
        return replace(matches, fates=fates, counts=dict(zip(FATES, counts, strict=True)))

    def _has_moved(self, seen: Detections, d: int, sight: Sight, learns: bool) -> bool:
        """Return whether detection d shows a landmark again where it was seen before; remember where it is seen."""
        noise, (x, y, heading) = sight.noise, sight.pose
        association.likeness(seen.looks[d], self.world.columns, self._gaps)
        landmark = int(self._gaps.argmin())
        if self._gaps[landmark] >= MatchLimits().look(noise, self.world.descriptor_length) ** 2:
            return False
        r, bearing = float(seen.ranges[d]), heading + float(seen.bearings[d])
        there = (x + r * math.cos(bearing), y + r * math.sin(bearing))
        before = self._seen[landmark].tolist()
        own = noise.range_sd**2 + (noise.range_share * r) ** 2 + (r * noise.bearing_sd) ** 2
        if math.dist(before[:2], there) < NEAR_SDS * math.sqrt(2.0 * own + float(sight.cov[0, 0] + sight.cov[1, 1])):
            return sight.time - before[2] >= AFTER_S
        if learns:
            self._seen[landmark] = (*there, sight.time)
        return False
