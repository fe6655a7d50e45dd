"""Landmarks that have moved since the map was made, so that they stop counting as evidence against the believed pose.

While the pose is certain, a landmark of the map that is detected at another place is remembered with that place. If it
is detected there again a second later, it has moved, and its detections there count as outliers. A displaced robot
detects it at a third place, where it still counts. Both frames need more matches than landmarks at other places: just
after a displacement the pose still seems certain, but all matches are by chance.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array

from . import association
from .gate import FAR, OUTLIER, UNLIKE
from .landmarks import FloorLandmarks
from .matching import FATES, Detections, Matches, MatchLimits, SightNoise

AFTER_S = 1.0
"""Least time between the first and the confirming sighting of a landmark at another place, s; then it counts as
moved."""
HERE = 2
"""Least number of matches of a frame at which landmarks seen elsewhere count as moved, given a certain pose; they must
also outnumber these landmarks."""
NEAR_SDS = 3.0
"""Distance between two sightings of a landmark, in standard deviations, within which they show one place."""


class Sight(NamedTuple):
    """Believed pose, its covariance, noise of the camera and time at one frame of detections."""

    pose: tuple[float, float, float]
    """Believed x, y (m) and heading (rad) of base_link, frame map."""
    cov: Array
    """Covariance of the believed x, y (m) and heading (rad), (3, 3) or larger."""
    noise: SightNoise
    """Range, bearing and descriptor noise of the camera."""
    time: float
    """Time of the camera frame, s."""


class SeenElsewhere(NamedTuple):
    """Detection of a landmark away from its place in the map."""

    detection: int
    """Index of the detection in its frame."""
    landmark: int
    """Index of the landmark in the map."""
    x: float
    """x of the place at which the landmark was detected, m, frame map."""
    y: float
    """y of the place at which the landmark was detected, m, frame map."""
    slack: float
    """Largest distance between two sightings of one landmark that show the same place, m."""


class MovedLandmarks:
    """Memory of the places at which landmarks were detected away from their place in the map."""

    def __init__(self, world: FloorLandmarks) -> None:
        self.world = world
        self._seen = np.full((len(world), 3), np.nan)  # x, y, m, frame map, and time of the first sight there, s
        self._known = np.zeros(len(world), dtype=bool)  # seen there again
        self._gaps = np.empty(len(world))

    def left_out(self, matches: Matches, seen: Detections, sight: Sight, *, sure: bool) -> Matches:
        """Return the matches of a frame with the detections of moved landmarks counted as outliers.

        Args:
            matches: matches of the frame at the believed pose.
            seen: detections of the frame.
            sight: believed pose, its covariance, noise of the camera and time at the frame.
            sure: the pose is certain, so that other places are remembered.
        """
        away = np.flatnonzero((matches.fates == FAR) | (matches.fates == UNLIKE)).tolist()
        places = [place for place in (self._place(seen, d, sight) for d in away) if place is not None]
        gone = [place.detection for place in places if self._again(place) and self._known[place.landmark]]
        here, others = len(matches.detections), len(places) - len(gone)
        if sure and here >= HERE and here > others:
            gone = [place.detection for place in places if self._learned(place, sight.time)]
        if not gone:
            return matches
        fates = matches.fates.copy()
        fates[gone] = OUTLIER
        counts = np.bincount(fates, minlength=len(FATES)).tolist()
        return replace(matches, fates=fates, counts=dict(zip(FATES, counts, strict=True)))

    def _place(self, seen: Detections, d: int, sight: Sight) -> SeenElsewhere | None:
        """Return the place at which detection d shows a known landmark; None = it resembles no landmark."""
        noise, (x, y, heading) = sight.noise, sight.pose
        association.likeness(seen.looks[d], self.world.columns, self._gaps)
        landmark = int(self._gaps.argmin())
        if self._gaps[landmark] >= MatchLimits().look(noise, self.world.descriptor_length) ** 2:
            return None
        r, bearing = float(seen.ranges[d]), heading + float(seen.bearings[d])
        own = noise.range_sd**2 + (noise.range_share * r) ** 2 + (r * noise.bearing_sd) ** 2
        slack = NEAR_SDS * math.sqrt(2.0 * own + float(sight.cov[0, 0] + sight.cov[1, 1]))
        return SeenElsewhere(d, landmark, x + r * math.cos(bearing), y + r * math.sin(bearing), slack)

    def _again(self, place: SeenElsewhere) -> bool:
        """Return True if a landmark is, within the slack, where it was first seen away from the map."""
        before = self._seen[place.landmark].tolist()
        return math.dist(before[:2], (place.x, place.y)) < place.slack

    def _learned(self, place: SeenElsewhere, time: float) -> bool:
        """Return True if a landmark has been seen at a new place for a second or more; remember the place if it is new.

        `time`: of the frame, s.
        """
        if not self._again(place):
            self._seen[place.landmark], self._known[place.landmark] = (place.x, place.y, time), False
        elif time - self._seen[place.landmark, 2] >= AFTER_S:
            self._known[place.landmark] = True
        return bool(self._known[place.landmark])
