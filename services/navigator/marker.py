"""The marker that a goal docks on, and its place in base_link as a standing robot measures it from several frames.

Sightings are ranges and bearings from base_link. Of n of them the medians count, with the standard deviations 1.25 s /
sqrt(n) of a median, s the larger of the camera's stated noise and of the spread of the sightings; a tilt of the camera
that all frames share errs by (h^2 + r^2) / h of it along the range and does not average out.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from surefoot.schemas.hw import LandmarkDetections, Sighting

from .belief.common_errors import CommonErrors
from .belief.landmarks import FloorLandmarks
from .belief.matching import MatchLimits, SightNoise
from .belief.tracker import PoseTracker
from .belief.ukf import wrap
from .planning.grid import Point

MEDIAN = 1.2533
"""Standard deviation of the median of many normal values over that of their mean, no unit."""
GATE_M = 0.3
"""Distance from where map and belief have a landmark within which a detection that looks alike is it, m; three standard
deviations of the believed position are added."""


@dataclass
class Dock:
    """Marker that a goal docks on, where it is to lie at the end, and the progress of the docking."""

    place: Point
    """Place of the marker, x, y in m, frame map; only to find it by, and exact to a few decimetres."""
    offset: Point
    """Wanted place of the marker in base_link, m forward and left."""
    landmark: int | None = None
    """Row of the landmark in the map; None = the marker of the goal, which the camera knows as such."""
    yaw: float | None = None
    """Wanted heading at the end, rad, frame map; None = any."""
    xy_tolerance: float = 0.03
    """Largest distance of the marker from its wanted place at a success, m."""
    yaw_tolerance: float = math.radians(3.0)
    """Largest error of its bearing, and of a wanted heading, at a success, rad."""
    begun: bool = False
    """True from the arrival near the marker on."""
    moves: int = 0
    """Number of approaches so far."""
    blind: int = 0
    """Number of looks in a row that did not show the marker."""
    seen: Point | None = None
    """Place of the marker in base_link by the last look, m; None = not seen yet."""


class Measured(NamedTuple):
    """Place of a marker in base_link with its uncertainty."""

    forward: float
    """Distance along the heading, m."""
    left: float
    """Distance to the left, m."""
    sd: float
    """Larger one of the standard deviations along and across the range, m."""
    sightings: int
    """Number of sightings that it comes from."""


class MarkerSight:
    """Sightings of a goal's marker by a robot that stands."""

    def __init__(self) -> None:
        self.seen: list[tuple[float, float]] = []
        """Range, m, and bearing, rad, of each sighting."""

    def take(self, frame: LandmarkDetections, dock: Dock, tracker: PoseTracker) -> None:
        """Take the marker from a frame of the camera, if it shows the marker.

        Args:
            frame: detections.
            dock: the marker.
            tracker: belief, which decides between landmarks that look alike, with their map.
        """
        found = frame.goal if dock.landmark is None else landmark_in(frame, dock.landmark, tracker)
        if found is not None and math.isfinite(found.range + found.bearing):
            self.seen.append((found.range, found.bearing))

    def measured(self, noise: SightNoise, shared: CommonErrors) -> Measured | None:
        """Return the marker's place by the sightings; None without any.

        Args:
            noise: standard deviations of a sighting of a standing robot.
            shared: errors of a frame that frames have in common: the camera's tilt and height.
        """
        if not self.seen:
            return None
        ranges, bearings = np.array(self.seen).T
        middle = bearings[0] + np.median(np.array([wrap(b - bearings[0]) for b in bearings]))
        r, n = float(np.median(ranges)), len(ranges)
        scatter = [float(np.std(x, ddof=1)) if n > 2 else 0.0 for x in (ranges, bearings - middle)]
        along = max(math.hypot(noise.range_sd, noise.range_share * r), scatter[0])
        across = r * max(noise.bearing_sd, scatter[1])
        h = shared.height
        tilt = shared.tilt * (h * h + r * r) / h
        sd = MEDIAN / math.sqrt(n) * max(along, across)
        return Measured(r * math.cos(middle), r * math.sin(middle), math.hypot(sd, tilt), n)


def landmark_in(frame: LandmarkDetections, row: int, tracker: PoseTracker) -> Sighting | None:
    """Return the detection of a landmark of the map in a frame; None if there is none or more than one may be it.

    `row`: of the landmark in the map of `tracker`, whose belief states about where it lies.
    """
    world: FloorLandmarks | None = tracker.world
    if world is None or row >= len(world):
        return None
    look, (x, y, heading) = world.descriptors[row], tracker.pose
    dx, dy = world.positions[row] - (x, y)
    away, bearing = math.hypot(dx, dy), math.atan2(dy, dx) - heading
    ahead, left = away * math.cos(bearing), away * math.sin(bearing)
    gate = GATE_M + 3.0 * math.sqrt(float(np.trace(tracker.cov[:2, :2])))
    gate += 3.0 * away * math.sqrt(float(tracker.cov[2, 2]))
    alike = MatchLimits().look(tracker.standing, len(look))
    found = [
        mark
        for mark in frame.landmarks
        if len(mark.descriptor) == len(look)
        and math.sqrt(math.fsum((own - its) ** 2 for own, its in zip(mark.descriptor, look, strict=True))) <= alike
        and math.hypot(mark.range * math.cos(mark.bearing) - ahead, mark.range * math.sin(mark.bearing) - left) <= gate
    ]
    return found[0] if len(found) == 1 else None
