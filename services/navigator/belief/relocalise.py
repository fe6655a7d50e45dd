"""Relocalisation: the pose of a standing robot anywhere in the map by its camera, or the reason why there is none.

Sightings that look alike in several places (copied textures) do no harm: every place that explains the sightings gets
its evidence, and a pose is returned only if one place has nearly all of it; see `places`.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array

from .landmarks import FloorLandmarks
from .matching import Detections, MatchLimits, SightNoise, check_length
from .places import (
    COV,
    CURSOR,
    EVIDENCE,
    EXPLAINED,
    FILLED,
    SECOND,
    TRIED,
    Evidence,
    PlaceList,
    place_list,
    search,
)
from .sightings import SightingMemory, candidates
from .ukf import Pose, wrap

ALIKE, LIKELY, MOST_ALIKE = 1e-3, 0.95, 4
"""`ALIKE`: part of the best pose's evidence that another pose has to exceed to be a candidate; `LIKELY`: least
probability of all candidates together, and `MOST_ALIKE`: largest number of them, for which they are reported."""
Reason = Literal["", "unseen", "unknown", "ambiguous", "unsure"]
"""Reason why a search returns no pose. unseen: fewer than two sightings resemble landmarks; unknown: no pose explains
them better than chance; ambiguous: another pose explains them as well, or not all were tried; unsure: too few
sightings, or too uncertain a heading."""


@dataclass(frozen=True)
class RelocaliseLimits:
    """Conditions under which the search for a lost robot's pose returns a pose."""

    sure: float = 0.999
    """Least probability of the best pose at which it is returned."""
    heading_sd: float = 0.15
    """Largest standard deviation of the best pose's heading, rad; above it no pose is returned, as one false sighting
    bends it."""
    least: int = 3
    """Least number of sightings that the best pose has to explain to be returned."""
    false: float = 0.1
    """Prior probability that a detection is false."""
    elsewhere: float = 0.05
    """Prior probability that the robot is not on the map at all."""
    view: float = 0.8
    """Area of floor that the camera sees at once, m^2."""
    ratio: float = 0.7
    """Descriptor distance to the most similar landmark over that to another one up to which the latter is no
    candidate."""
    candidates: int = 24
    """Largest number of landmarks that a sighting may be; a sighting that resembles more is left out."""
    sightings: int = 64
    """Largest number of sightings that a search uses; those detected most often are taken."""
    tries: int = 20_000
    """Largest number of poses that are tried; a search that reaches it returns no pose."""
    places: int = 16
    """Largest number of candidate poses that are compared."""


@dataclass(frozen=True, eq=False)
class Relocation:
    """Result of a search for the pose of a lost robot."""

    pose: Pose | None
    """Found pose of the reference frame, x, y (m) and heading (rad), frame map; None = no pose is certain enough."""
    covariance: Array
    """Covariance of x, y (m) and heading (rad) of the best candidate pose, (3, 3); zeros if there is none."""
    probability: float
    """Probability of the best candidate pose."""
    reason: Reason
    """Reason why there is no pose; empty = there is one."""
    sightings: int
    """Number of different sightings that resemble landmarks of the map."""
    reference: Pose = (0.0, 0.0, 0.0)
    """Pose of the robot that was searched for, x, y (m), heading (rad), in the frame of the poses given with the camera
    frames."""
    alike: tuple[Pose, ...] = ()
    """Candidate poses x, y (m), heading (rad), frame map, that explain the sightings about equally well; empty = none
    stands out."""


def between(pose: Pose, odom: Pose) -> Pose:
    """Return the pose of frame odom in frame map, x, y (m) and heading (rad).

    `pose`: of the robot in map; `odom`: of the robot in odom, at one time.
    """
    turn = float(wrap(pose[2] - odom[2]))
    c, s = math.cos(turn), math.sin(turn)
    return (pose[0] - c * odom[0] + s * odom[1], pose[1] - s * odom[0] - c * odom[1], turn)


def placed(frame: Pose, pose: Pose) -> Pose:
    """Return a pose, given in a frame, in the parent of that frame: x, y (m) and heading (rad).

    `frame`: pose of the frame in its parent.
    """
    c, s = math.cos(frame[2]), math.sin(frame[2])
    return (
        frame[0] + c * pose[0] - s * pose[1],
        frame[1] + s * pose[0] + c * pose[1],
        float(wrap(frame[2] + pose[2])),
    )


class Relocaliser:
    """Search for the pose of a lost robot, in portions that bound the time of a tick.

    Args:
        world: landmarks of the map.
        noise: standard deviations of range, bearing and descriptor of the camera of a standing robot.
        limits: conditions for a pose; None = the defaults.
    """

    def __init__(self, world: FloorLandmarks, noise: SightNoise, limits: RelocaliseLimits | None = None) -> None:
        self.world, self.noise, self.limits = world, noise, limits or RelocaliseLimits()
        self.sightings = SightingMemory(noise, world.descriptor_length)
        self._fresh = False
        self._search: PlaceSearch | None = None

    def add(self, seen: Detections, pose: Pose, time: float, noise: SightNoise | None = None) -> None:
        """Add the detections of one frame to the sightings.

        Args:
            seen: landmarks detected in it.
            pose: pose of base_link then, x, y (m) and heading (rad), in one coordinate frame for all camera frames.
            time: time of the frame, s.
            noise: noise of the camera in this frame; None = that of the constructor.

        Raises:
            DetectionError: descriptors of another length than the map's.
        """
        check_length(seen, self.world)
        self.sightings.add(seen, pose, time, noise)
        self._fresh = self._fresh or len(seen) > 0

    def step(self, here: Pose, work: int) -> Relocation | None:
        """Continue the search by a bounded amount of work; start one if frames were added since the last began.

        Args:
            here: pose of base_link now, x, y (m) and heading (rad), in the frame in which the poses of the added frames
                are.
            work: sightings that are compared with a pose, or pairs of candidates that are looked at, in this call.

        Returns:
            Result of a search that ends in this call; its `reference` is the pose that was searched for. Else None.
        """
        if self._search is None:
            if not self._fresh:
                return None
            self._fresh, self._search = False, self.begun(here)
        found, limits = self._search, self.limits
        if found.places is None:
            self._search = None
            return Relocation(None, np.zeros((3, 3)), 0.0, "unseen", found.known, reference=found.here)
        if not search(found.evidence, found.places, found.cursor, limits.tries, work):
            return None
        self._search, filled = None, int(found.cursor[FILLED])
        result = _decided(found.places.places[:filled], found.known, int(found.cursor[TRIED]), self.noise, limits)
        return replace(result, reference=found.here)

    def begun(self, here: Pose) -> "PlaceSearch":
        """Return a new search for the robot's pose in the map by the sightings so far.

        `here`: pose of base_link now, x, y (m) and heading (rad), in the frame in which the poses of the added frames
        are.
        """
        world, limits = self.world, self.limits
        place, spread, looks, count, total = self.sightings.seen_from(here, limits.sightings)
        look = MatchLimits().look(self.noise, world.descriptor_length)
        starts, members = candidates(looks, world.columns, look, limits.ratio, limits.candidates)
        known = np.flatnonzero(np.diff(starts) > 0)
        false = np.where(
            count > 1, limits.false, max(limits.false, min(0.9, limits.false * total / max(1, count.size)))
        )
        x0, y0, x1, y1 = world.bounds
        area = max((x1 - x0) * (y1 - y0), limits.view)
        evidence = Evidence(place, spread, false, starts, members, world.positions, limits.view, area)
        places = place_list(evidence, limits.places) if known.size >= 2 else None
        cursor = np.zeros(CURSOR, dtype=np.int64)
        cursor[SECOND] = 1
        return PlaceSearch(here, evidence, places, cursor, int(known.size))


@dataclass(frozen=True, eq=False)
class PlaceSearch:
    """Search for the pose of a lost robot that is under way, a part of it in each tick."""

    here: Pose
    """Pose of the robot that is searched for, x, y (m), heading (rad), in the frame of the poses given with the camera
    frames."""
    evidence: Evidence
    """Sightings of the search, and the landmarks that each may be (its candidates)."""
    places: PlaceList | None
    """Best candidate poses found so far; None = fewer than two sightings resemble landmarks of the map."""
    cursor: NDArray[np.int64]
    """Position of the search, (6,): pair of sightings (2), their candidates (2), poses tried, poses found."""
    known: int
    """Number of different sightings that resemble landmarks of the map."""


def _decided(places: Array, known: int, tried: int, noise: SightNoise, limits: RelocaliseLimits) -> Relocation:
    """Return the result of a search: the best pose if it holds nearly all evidence, else the reason for none.

    Args:
        places: found by the search, (p, 14): x, y (m), heading (rad), log evidence, explained sightings, covariance
            (9).
        known: number of sightings that look like landmarks of the map.
        tried: number of poses that were tried.
        noise: noise of the camera; its errors common to a frame are added to the covariance.
        limits: limits of a sure pose.
    """
    places = places[np.isfinite(places[:, EVIDENCE])]
    if not len(places):
        return Relocation(None, np.zeros((3, 3)), 0.0, "unknown", known)
    order = np.argsort(-places[:, EVIDENCE], kind="stable")
    places = places[order]
    chance = math.log(limits.elsewhere)
    logs = [math.log1p(-limits.elsewhere) + float(value) for value in places[:, EVIDENCE]]
    top = max(chance, logs[0])
    weights = [math.exp(value - top) for value in logs]
    whole = math.fsum(weights) + math.exp(chance - top)
    first, second = weights[0] / whole, weights[1] / whole if len(weights) > 1 else 0.0
    best = places[0]
    cov = best[COV:].reshape(3, 3).copy()
    cov[0, 0] += noise.common_range_sd**2
    cov[1, 1] += noise.common_range_sd**2
    cov[2, 2] += noise.common_bearing_sd**2
    pose = (float(best[0]), float(best[1]), float(best[2]))
    reason: Reason = ""
    if tried >= limits.tries:
        reason = "ambiguous"
    elif first < limits.sure or best[EXPLAINED] < limits.least or cov[2, 2] > limits.heading_sd**2:
        none = math.exp(chance - top) / whole
        reason = "ambiguous" if second > 0.5 * (1.0 - first) else "unknown" if none > first else "unsure"
    found = Relocation(None if reason else pose, cov, first, reason, known)
    least = ALIKE * weights[0]
    fit = [k for k in range(len(weights)) if weights[k] > least and places[k, EXPLAINED] >= limits.least]
    held = math.fsum(weights[k] for k in fit) / whole
    if found.pose is not None or held < LIKELY or len(fit) > MOST_ALIKE:
        return found
    return replace(found, alike=tuple((float(x), float(y), float(a)) for x, y, a in places[fit, :3]))
