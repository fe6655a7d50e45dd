"""Tracking of the robot's pose in the map: motions predict, landmarks correct.

State (x, y, theta, b): pose in m and rad, frame map; b the drift in rad per m walked. A camera with unknown tilt
and a body that sways beside its path add three more, errors common to the landmarks of a frame (`common_errors`).
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from surefoot.arrays import Array

from . import ukf
from .common_errors import ERRORS, TYPICAL, CommonErrors, fade, fill_gain
from .landmarks import FloorLandmarks
from .matching import Detections, Matches, MatchLimits, SightNoise, match
from .strain import MapStrain

Control = Literal["commands", "odometry"]

STATES = 4
USED_S = 30.0
"""Time constant with which previous uses of a landmark stop lowering its weight in the filter, s."""
ALL = 50.0
"""Largest growth of a log variance that is counted, nats: it leaves nothing of the earlier information."""


@dataclass(frozen=True)
class Motion:
    """Motion of the body over one step of prediction, with the variances that it adds to the belief."""

    forward: float = 0.0
    """Distance forward, along the heading half-way through the turn, m."""
    left: float = 0.0
    """Distance to the left of the heading half-way through the turn, m."""
    turn: float = 0.0
    """Change of heading, rad, left positive."""
    walked: float = 0.0
    """Distance over which the heading drift per metre acts, m."""
    along: float = 0.0
    """Variance of the position along the heading that the motion adds, m^2."""
    across: float = 0.0
    """Variance of the position across the heading that the motion adds, m^2."""
    heading: float = 0.0
    """Variance of the heading that the motion adds, rad^2."""
    drifting: float = 0.0
    """Variance of the heading drift per metre that the motion adds, rad^2 per m^2."""

    def part(self, share: float) -> "Motion":
        """Return a share of the motion (1 = all of it), with variances in proportion."""
        return Motion(*(share * value for value in vars(self).values()))


@dataclass(frozen=True)
class StartUncertainty:
    """Standard deviations of a pose stated by a user, and of the drift."""

    position: float = 0.05
    """Standard deviation of x and of y of a stated pose, m."""
    heading: float = math.radians(5.0)
    """Standard deviation of the heading of a stated pose, rad."""
    drift: float = 0.76
    """Standard deviation of the heading drift per metre walked, rad/m."""


@dataclass(frozen=True)
class FrameResult:
    """Result of correcting the belief with one frame of the camera."""

    seen: int
    """Number of landmarks that the camera detected in the frame."""
    matched: int
    """Number of detections of the frame matched with landmarks of the map."""
    nis: float
    """Mean normalised innovation squared of the matched landmarks, per degree of freedom; 0 without matches."""
    matches: Matches | None = None
    """Match of each detection with a landmark; None without a map or detections."""


class PoseTracker:
    """Estimator of the robot's pose in the map: motions predict it, landmarks correct it.

    Args:
        start: uncertainty of a stated pose.
        noise: noise of the camera while walking.
        standing: noise of the camera while the robot stands.
        shared: errors that the landmarks of a frame have in common; None = there are none.
        limits: limits of matching detections with landmarks; None = the defaults.
    """

    def __init__(
        self,
        start: StartUncertainty,
        noise: SightNoise,
        standing: SightNoise,
        shared: CommonErrors | None = None,
        limits: MatchLimits | None = None,
    ) -> None:
        self.shared = shared or CommonErrors()
        self.start = start
        self.noise, self.standing = self.shared.widen(noise), self.shared.widen(standing)
        self.limits = limits or MatchLimits()
        self.n = STATES + (ERRORS if self.shared.any else 0)
        self.mean, self.cov = np.zeros(self.n), np.zeros((self.n, self.n))
        self._work = ukf.work_space(self.n)
        self._gain = np.zeros((2, self.n - STATES))
        self._noise = np.zeros(4)
        self._sds, self._keeps = self.shared.array(), np.zeros(3)
        self._faded_at = 0.0
        self.world: FloorLandmarks | None = None
        self._used_of: FloorLandmarks | None = None
        self._used = np.zeros((0, 5))
        """Use of each landmark, (n, 5): number of range and of bearing uses that the belief still holds, time of the
        last use, s, and `_lost` at that time (2)."""
        self._lost = np.zeros(2)
        """Information on position and on pose that the belief has lost to motion and `loosen` so far, (2,): growth of
        the log variance, nats."""
        self.strain: MapStrain | None = None
        """Check whether the map is strained or the camera turned; None = no check."""
        self.frames = 0
        self.place((0.0, 0.0, 0.0))

    def place(self, pose: tuple[float, float, float], cov: Array | None = None, *, keep_drift: bool = False) -> None:
        """Restart the estimate at a stated pose.

        Args:
            pose: x, y in m, heading in rad, frame map.
            cov: covariance of `pose`, (3, 3); None = as in `start`.
            keep_drift: the estimated drift of the heading, rad per m walked, is kept.
        """
        drift, variance = float(self.mean[3]), float(self.cov[3, 3])
        self.mean[:], self.cov[:] = 0.0, 0.0
        self.mean[:3] = pose[0], pose[1], ukf.wrap(pose[2])
        if cov is None:
            s = self.start
            self.cov[0, 0] = self.cov[1, 1] = s.position**2
            self.cov[2, 2] = s.heading**2
        else:
            self.cov[:3, :3] = cov
        self.mean[3], self.cov[3, 3] = (drift, variance) if keep_drift else (0.0, self.start.drift**2)
        if self.n > STATES:
            self.mean[STATES] = self.shared.pitch
        for i in range(STATES, self.n):
            self.cov[i, i] = float(self._sds[i - STATES]) ** 2
        self._used[:] = 0.0
        if self.strain is not None:
            self.strain.place()

    def widen(self, factor: float) -> None:
        """Multiply the standard deviations of x, y and heading by a factor; correlations stay."""
        before = log_variances(self.cov)
        self.cov[:3, :] *= factor
        self.cov[:, :3] *= factor
        self._lose(before)

    def loosen(self, tilt: float, aside: float) -> None:
        """Enlarge the covariance of the pose for a camera that was tilted and turned aside by these angles, rad."""
        h, before = self.shared.height, log_variances(self.cov)
        self.cov[[0, 1], [0, 1]] += (tilt * (h * h + TYPICAL**2) / h) ** 2
        self.cov[2, 2] += aside**2
        self._lose(before)

    def _lose(self, before: tuple[float, float]) -> None:
        """Add the information lost since the log variances of position and pose, nats, were `before`."""
        now = log_variances(self.cov)
        for i in range(2):
            if before[i] < now[i]:
                self._lost[i] += min(now[i] - before[i], ALL)

    @property
    def pose(self) -> tuple[float, float, float]:
        """Believed x, y in m and heading in rad, frame map."""
        return (float(self.mean[0]), float(self.mean[1]), float(self.mean[2]))

    def body_covariance(self) -> Array:
        """Return the covariance of base_link, (3, 3) in m and rad: the pose's and that of the sway."""
        cov = self.cov[:3, :3].copy()
        c, s, variance = math.cos(float(self.mean[2])), math.sin(float(self.mean[2])), self.shared.sway**2
        cov[0, 0] += s * s * variance
        cov[1, 1] += c * c * variance
        cov[0, 1] -= s * c * variance
        cov[1, 0] -= s * c * variance
        return cov

    @property
    def entropy(self) -> float:
        """Differential entropy of the pose in m and rad, nats."""
        return float(ukf.entropy(self.cov))

    def move(self, motion: Motion) -> None:
        """Predict the belief over a motion of the body."""
        before, sure = self.pose, log_variances(self.cov)
        self._carry(self.mean, self.cov, motion)
        self._lose(sure)
        if self.strain is not None:
            way = float(self.mean[0]) - before[0], float(self.mean[1]) - before[1]
            heading = motion.heading + float(self.cov[3, 3]) * motion.walked**2
            self.strain.moved(way, max(motion.along, motion.across), heading)

    def after(self, motion: Motion) -> tuple[Array, Array]:
        """Return the belief predicted over a motion; the tracker does not change.

        Returns:
            Mean (4,): x, y (m), heading (rad), frame map, drift (rad per m walked); its covariance (4, 4).
        """
        mean, cov = self.mean.copy(), self.cov.copy()
        self._carry(mean, cov, motion)
        return mean[:STATES], cov[:STATES, :STATES].copy()

    def _carry(self, mean: Array, cov: Array, m: Motion) -> None:
        self._noise[:] = m.along, m.across, m.heading, m.drifting
        ukf.predict(mean, cov, m.forward, m.left, m.turn, m.walked, self._noise, self._work)

    def look(self, seen: Detections, time: float, *, standing: bool, trusted: bool = True) -> FrameResult:
        """Correct the belief with the landmarks detected in one camera frame.

        Args:
            seen: landmarks detected in the frame.
            time: time of the exposure's end, s.
            standing: the robot stands, so the camera's noise is that of a standing robot.
            trusted: the belief is corrected; else the frame is only compared with it.

        Raises:
            DetectionError: descriptors of another length than the map's.
        """
        if self.world is None or not len(seen):
            return FrameResult(len(seen), 0, 0.0)
        self._fade(time, standing)
        noise = self.standing if standing else self.noise
        self.frames += 1
        found = match(self.mean, self.cov, seen, self.world, noise, self.limits, seed=self.frames)
        if not trusted:
            return FrameResult(len(seen), 0, 0.0, found)
        before, total = self.mean[:3].copy(), 0.0
        for detection, landmark in zip(found.detections, found.landmarks, strict=True):
            r, a = float(seen.ranges[detection]), float(seen.bearings[detection])
            x, y = self.world.positions[landmark]
            self._linearise(x, y)
            own = float(self.world.sd[landmark]) ** 2
            var_r, var_a = noise.range_sd**2 + (noise.range_share * r) ** 2, noise.bearing_sd**2
            if own > 0.0:
                var_r, var_a = self._of_sight(self.world, landmark, time, (var_r, var_a), (own, own / (r * r)))
            sighting = ukf.LandmarkSighting(x, y, r, a, var_r, var_a)
            total += ukf.update(self.mean, self.cov, sighting, self._gain, self._work)
        if self.strain is not None:
            change = self.mean[:3] - before
            change[2] = ukf.wrap(change[2])
            self.strain.corrected(change)
        count = len(found.detections)
        return FrameResult(len(seen), count, 0.5 * total / count if count else 0.0, found)

    def _of_sight(
        self, world: FloorLandmarks, landmark: int, time: float, own: tuple[float, float], common: tuple[float, float]
    ) -> tuple[float, float]:
        """Count a use of a landmark, and return the variances of range, m^2, and bearing, rad^2, to take for it.

        Args:
            world: landmarks; those of another map begin without uses.
            landmark: row of `world`.
            time: time of the frame, s.
            own: variances of range and bearing in one sighting by itself, m^2 and rad^2.
            common: variances by the error of the landmark's place in the map, equal in every sighting, m^2 and rad^2.
        """
        if world is not self._used_of:
            self._used_of, self._used = world, np.zeros((len(world), 5))
        used = self._used[landmark]
        old, last, taken = used[:2].tolist(), float(used[2]), (self._lost - used[3:]).tolist()
        forgotten = math.exp(-max(0.0, time - last) / USED_S)
        counts = [1.0 + held(forgotten * old[i], common[i] / own[i] if own[i] else 0.0, taken[i]) for i in range(2)]
        used[:2], used[2], used[3:] = counts, time, self._lost
        return of_sight(own[0], common[0], counts[0]), of_sight(own[1], common[1], counts[1])

    def _linearise(self, x: float, y: float) -> None:
        """Write how tilt and sway change the range and bearing of a landmark at (x, y) m, frame map.

        It is seen from the believed pose: the measured bearing is noisy and not used.
        """
        dx, dy = x - float(self.mean[0]), y - float(self.mean[1])
        bearing = ukf.wrap(math.atan2(dy, dx) - float(self.mean[2]))
        fill_gain(math.hypot(dx, dy), bearing, self.shared.height, self._gain)

    def _fade(self, time: float, standing: bool) -> None:
        if self.n > STATES:
            self._keeps[:] = self.shared.kept(max(0.0, time - self._faded_at), standing=standing)
            self._faded_at = time
            fade(self.mean, self.cov, self._keeps, self._sds, self.shared.pitch)


def of_sight(variance: float, common: float, n: float) -> float:
    """Return the measurement variance of the n-th sighting of a landmark whose map error is common to all sightings.

    n sights with a variance v each and c in common have the variance v / n + c: the newest adds the information n / (v
    + n c) - (n - 1) / (v + (n - 1) c) = v / ((v + n c) (v + (n - 1) c)).

    Args:
        variance: v, of one sighting by itself, m^2 or rad^2.
        common: c, by the error in the map, in the unit of v.
        n: number of sightings, this one included.
    """
    if common == 0.0 or variance == 0.0:
        return variance + common
    return (variance + n * common) * (variance + (n - 1.0) * common) / variance


def held(n: float, ratio: float, lost: float) -> float:
    """Return the number of sightings that hold the information that the belief still has of n sightings of a landmark.

    n sights have n / (1 + n c) in units of one sight, c = `ratio` the variance in common over that of one sight. Growth
    of the belief's variance by a factor leaves 1 / factor of it: for one landmark alone, a variance q added between two
    sights leaves 1 / (1 / n + q), as exact.

    Args:
        n: number of sightings.
        ratio: c.
        lost: growth of the log variance of the belief since, nats.
    """
    share = math.exp(-max(0.0, lost))
    return n * share / (1.0 + n * ratio * (1.0 - share))


def log_variances(cov: Array) -> tuple[float, float]:
    """Return the log of the geometric mean variance of position, and of pose, nats; -inf: a variance is zero.

    A motion without noise leaves both. `cov`: covariance of x, y (m) and heading (rad), (3, 3) or larger.
    """
    area = float(cov[0, 0] * cov[1, 1] - cov[0, 1] * cov[1, 0])
    pose = float(ukf.entropy(cov)) - ukf.ENTROPY_OF_UNIT
    return (0.5 * math.log(area) if area > 0.0 else -math.inf), pose / 1.5
