"""Odds that a robot is at another place than believed, by landmarks that agree on that place.

A single detection that fits another place is often false; two or more whose arrangement fits one other place rarely
are. The last frames are searched for such places, by the method for a lost robot (`places`). With E_p
the evidence of place p for a robot that may be anywhere, N the normal density of its offset from the believed pose,
Sigma the sum of the covariances of both, and L the evidence of the sightings one by one at the believed pose,

    odds of the frames = sum_p E_p / max(sum_p E_p 2 pi area N(p - pose; Sigma), L)

A sighting similar to m landmarks is false with the odds `false` view m / area, view the area that the camera overlooks.
Frames are kept while they favour another place, for `KEPT_S` at most.
"""

import math

import numpy as np

from surefoot.arrays import Array

from .landmarks import FloorLandmarks
from .matching import Detections, SightNoise
from .moved import Sight
from .places import COV, EVIDENCE, FILLED, Assignment, Evidence, associate, evidence, search
from .relocalise import RelocaliseLimits, Relocaliser, between, placed
from .ukf import Pose

_ORIGIN: Pose = (0.0, 0.0, 0.0)

KEPT_S = 10.0
"""Longest time between the first and the last frame that are searched together for another pose, s."""
LARGEST = 32_000
"""Largest work of one search for another pose, in sightings compared with a pose or pairs of candidates: about 1 ms. A
search that needs more counts as no evidence."""
LEAST_FALSE = 0.005
"""Lower bound of the odds that a sighting is false, however few landmarks look like it."""
RATE = 1e-4
"""Rate at which a robot is moved to another place unnoticed, 1/s: low, as a false alarm costs a goal and a few frames
of a displaced robot soon supply the evidence."""


class OtherPlaces:
    """Evidence of the last frames of a camera that the robot is at another place than the believed one.

    Args:
        world: landmarks of the map.
        noise: standard deviations of range, bearing and descriptor of the camera.
    """

    def __init__(self, world: FloorLandmarks, noise: SightNoise) -> None:
        self.world, self.noise = world, noise
        self.limits = RelocaliseLimits(sightings=24)
        self.begin()

    def begin(self) -> None:
        """Discard all frames, because the pose was stated by a user or found again."""
        self._log, self._first, self._last = 0.0, -math.inf, -math.inf
        self._frames: Relocaliser | None = None
        self._moved = _ORIGIN  # map, as believed now, in the map as believed at the first sight
        self._prior = Sight(_ORIGIN, np.eye(3), self.noise, 0.0)
        self._apart = 10.0

    @property
    def probability(self) -> float:
        """Probability that the robot is at another place than believed; 0 while no frame favours one."""
        odds = math.exp(min(50.0, self._log)) * RATE * self._apart if self._log > 0.0 else 0.0
        return odds / (1.0 + odds)

    def look(self, seen: Detections, sight: Sight, after: Pose) -> None:
        """Update the evidence with one frame of the camera.

        Args:
            seen: landmarks detected in it.
            sight: believed pose before the frame corrected it, with its covariance, noise and time.
            after: believed pose after the correction, x, y (m) and heading (rad), frame map.
        """
        if self._frames is None or sight.time - self._first > KEPT_S:
            self._frames, self._log = Relocaliser(self.world, self.noise, self.limits), 0.0
            self._first, self._prior, self._moved = sight.time, sight, _ORIGIN
            self._apart = min(max(sight.time - self._last, 0.01), 10.0)
        here = placed(self._moved, sight.pose)
        self._moved, self._last = between(here, after), sight.time
        self._frames.add(seen, here, sight.time, sight.noise)
        found = self._frames.begun(self._prior.pose)
        if found.places is not None:
            count = np.diff(found.evidence.starts)
            odds = self.limits.false * self.limits.view * count / found.evidence.area
            odds = np.clip(odds, LEAST_FALSE, self.limits.false)
            sightings = found.evidence._replace(false=odds / (1.0 + odds))
            if search(sightings, found.places, found.cursor, self.limits.tries, LARGEST):
                places = found.places.places[: int(found.cursor[FILLED])]
                self._log = self._odds(sightings, places[np.isfinite(places[:, EVIDENCE])])
        if self._log <= 0.0:
            self._frames = None

    def _odds(self, seen: Evidence, places: Array) -> float:
        """Return the log odds, nats, that the robot is at one of several other places rather than at the believed pose.

        Args:
            seen: sightings of the last frames, with the landmarks that may explain them.
            places: found places, (p, 14): x, y (m), heading (rad), log evidence, explained sightings, covariance (9).
        """
        if not len(places):
            return 0.0
        prior = self._prior.cov[:3, :3]
        common = np.diag([self.noise.common_range_sd**2] * 2 + [self.noise.common_bearing_sd**2])
        cov, off = prior + common + places[:, COV:].reshape(-1, 3, 3), places[:, :3] - self._prior.pose
        off[:, 2] -= 2.0 * math.pi * np.round(off[:, 2] / (2.0 * math.pi))
        square, det = _square(cov, off)
        logs = np.array([math.log(each) for each in det])  # numpy's own logarithm depends on the processor
        near = math.log(seen.area) - 0.5 * (math.log(2.0 * math.pi) + logs + square)
        every = places[:, EVIDENCE]
        right = max(float(np.logaddexp.reduce(every + near)), _one_by_one(seen, self._prior))
        return float(np.logaddexp.reduce(every)) - right


def _square(cov: Array, off: Array) -> tuple[Array, Array]:
    """Return off^T cov^-1 off, (p,), and det cov, (p,), of p covariances `cov` (p, 3, 3) and p vectors `off` (p, 3)."""
    (a, b, c), (_, d, e), (_, _, f) = cov.transpose(1, 2, 0)
    x, y, z = off.T
    det = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
    own = (d * f - e * e) * x * x + (a * f - c * c) * y * y + (a * d - b * b) * z * z
    crossed = (c * e - b * f) * x * y + (b * e - c * d) * x * z + (b * c - a * e) * y * z
    return (own + 2.0 * crossed) / det, det


def _one_by_one(seen: Evidence, prior: Sight) -> float:
    """Return the log evidence, nats, of the sightings one by one at the believed pose, widened by its covariance."""
    n, (c, s) = len(seen.place), (math.cos(prior.pose[2]), math.sin(prior.pose[2]))
    by_pose = np.zeros((n, 2, 3))  # of a sighting in heading axes
    by_pose[:, 0, :2], by_pose[:, 1, :2] = (c, s), (-s, c)
    by_pose[:, 0, 2], by_pose[:, 1, 2] = -seen.place[:, 1], seen.place[:, 0]
    more = (by_pose[:, :, None, :, None] * prior.cov[:3, :3] * by_pose[:, None, :, None, :]).sum(axis=(3, 4))
    wide = seen._replace(spread=seen.spread + more.reshape(n, 4)[:, [0, 1, 3]])
    chosen = Assignment(np.full(n, -1), np.zeros(n))
    associate(np.array(prior.pose), 0.0, 1.0, wide, chosen)
    return float(evidence(wide, chosen))
