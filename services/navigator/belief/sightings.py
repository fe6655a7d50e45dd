"""Sightings of a robot that stands or turns on the spot: detections averaged over frames, in a memory of bounded size.

Detections that look alike and lie alike are one sighting, a running mean over at most `LONGEST` detections. A sighting
that was not seen for `FORGET_S` is dropped, and a full memory replaces the one seen least.
"""

import math
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Ints
from surefoot.kernels.jit import row_kernel

from .association import likeness
from .gate import apart2, variances
from .matching import Detections, MatchLimits, SightNoise

MOST = 256
"""Largest number of distinct sightings of landmarks that are kept."""
LONGEST = 30
"""Number of detections over which a sighting is averaged; more count as this many, so that recent ones keep weight."""
FORGET_S = 90.0
"""Time after which a sighting that was not detected again is dropped, s: longer than a turn once around takes."""
WIDE = 13.8
"""Squared normalised residual, chi^2_2(.999), above which a landmark does not explain a sighting."""


class SightingTables(NamedTuple):
    """Memory of the landmarks that a lost robot has sighted, each averaged over frames, in one frame of reference."""

    place: Array
    """Mean positions of the n sightings in the robot's reference frame, (n, 2) m."""
    spread: Array
    """Mean covariances (xx, xy, yy) of one detection of each sighting, (n, 3) m^2."""
    mean: Array
    """Mean descriptors (k numbers that describe how a landmark looks) of the sightings, (n, k), no unit."""
    times: Ints
    """Number of detections of each sighting, at most 30; 0 = an unused row, (n,)."""
    at: Array
    """Time of the last detection of each sighting, s, (n,)."""


@row_kernel
def _row_of(memory: SightingTables, x: float, y: float, cov: Array, look: Array, limit: float, time: float) -> int:
    """Return the row of the memory that a detection belongs to; a row for a new sighting is emptied (times = 0).

    Rows that were not seen for 90 s are emptied, too; a full memory gives up the sighting seen least.

    Args:
        memory: sightings, changed in place.
        x: x of the detection, m, frame of the memory.
        y: y of the detection, m, frame of the memory.
        cov: covariance of its place (xx, xy, yy), (3,) m^2.
        look: descriptor of the detection, (k,), no unit.
        limit: largest squared distance of two descriptors of one landmark.
        time: time of the detection, s.
    """
    best, nearest, free = -1, limit, 0
    for i in range(memory.times.size):
        if memory.times[i] > 0 and time - memory.at[i] > FORGET_S:
            memory.times[i] = 0
        less, same = memory.times[i] < memory.times[free], memory.times[i] == memory.times[free]
        if less or (same and memory.at[i] < memory.at[free]):
            free = i
        if memory.times[i] == 0:
            continue
        gap = apart2(look, memory.mean[i], nearest)
        if gap < nearest:
            dx, dy, more = x - memory.place[i, 0], y - memory.place[i, 1], 1.0 + 1.0 / memory.times[i]
            det = more * more * (cov[0] * cov[2] - cov[1] * cov[1])
            if more * (cov[2] * dx * dx - 2.0 * cov[1] * dx * dy + cov[0] * dy * dy) < 1.5 * WIDE * det:
                best, nearest = i, gap
    if best < 0:
        best = free
        memory.times[best] = 0
    return best


@row_kernel
def gather(
    memory: SightingTables,
    ranges: Array,
    bearings: Array,
    looks: Array,
    pose: Array,
    noise: SightNoise,
    look: float,
    time: float,
) -> None:
    """Enter the detections of one frame into the memory, which is changed in place.

    Noise of the bearing phi draws the mean of r (cos phi, sin phi) towards the robot by exp(-sigma_phi^2/2): undone
    here.

    Args:
        memory: sightings.
        ranges: ranges of the m detections along the floor, m, (m,).
        bearings: bearings of the detections, rad, left of the heading positive, (m,).
        looks: descriptors of the detections, (m, k), no unit.
        pose: pose of base_link then, x, y in m and heading in rad, frame of the memory, (3,).
        noise: standard deviations of range and bearing.
        look: largest distance of two descriptors of one landmark, no unit.
        time: time of the frame, s.
    """
    cov = np.empty(3)
    for d in range(ranges.size):
        r, b = variances(ranges[d], noise)
        out = ranges[d] * math.exp(0.5 * b)
        r, b = r + 0.5 * (out * b) ** 2, b * out * out
        c, s = math.cos(pose[2] + bearings[d]), math.sin(pose[2] + bearings[d])
        x, y = pose[0] + out * c, pose[1] + out * s
        cov[0], cov[1], cov[2] = c * c * r + s * s * b, c * s * (r - b), s * s * r + c * c * b
        i = _row_of(memory, x, y, cov, looks[d], 1.3 * look * look, time)
        memory.times[i] = min(memory.times[i] + 1, LONGEST)
        memory.at[i] = time
        part = 1.0 / memory.times[i]
        memory.place[i, 0] += part * (x - memory.place[i, 0])
        memory.place[i, 1] += part * (y - memory.place[i, 1])
        for j in range(looks.shape[1]):
            memory.mean[i, j] += part * (looks[d, j] - memory.mean[i, j])
        for j in range(3):
            memory.spread[i, j] += part * (cov[j] - memory.spread[i, j])


@row_kernel
def candidates(looks: Array, columns: Array, look: float, ratio: float, most: int) -> tuple[Ints, Ints]:
    """Return the landmarks of the map that each sighting may show: those about as similar as the most similar one.

    A sighting with more than `most` of them gets none.

    Args:
        looks: mean descriptor of each of s sightings, (s, k), no unit.
        columns: descriptors of n landmarks, a column each, (k, n), no unit.
        look: largest distance of two descriptors of one landmark, no unit.
        ratio: distance to the most alike landmark over the largest distance to a candidate.
        most: candidates of a sighting; one with more of them gets none.

    Returns:
        Places (s + 1,) at which the candidates of each sighting begin in the second array, and their indices.
    """
    s, n = looks.shape[0], columns.shape[1]
    starts, members, gap = np.zeros(s + 1, dtype=np.int64), np.empty(s * most, dtype=np.int64), np.empty(n)
    for i in range(s):
        likeness(looks[i], columns, gap)
        least = gap[0]
        for j in range(n):
            least = min(least, gap[j])
        limit, at = min(look * look, max(least / (ratio * ratio), 1e-12)), starts[i]
        for j in range(n):
            if gap[j] <= limit:
                if at - starts[i] == most:
                    at = starts[i]
                    break
                members[at] = j
                at += 1
        starts[i + 1] = at
    return starts, members[: starts[s]]


class SightingMemory:
    """Memory of the sightings of a lost robot, each averaged over several frames.

    Args:
        noise: noise of the camera, with the errors that are common to a frame.
        length: elements of a descriptor.
    """

    def __init__(self, noise: SightNoise, length: int) -> None:
        self.noise, self.length = noise, length
        self.tables = SightingTables(
            np.zeros((MOST, 2)), np.zeros((MOST, 3)), np.zeros((MOST, length)), np.zeros(MOST, dtype=np.int64),
            np.zeros(MOST),
        )  # fmt: skip

    def add(
        self, seen: Detections, pose: tuple[float, float, float], time: float, noise: SightNoise | None = None
    ) -> None:
        """Enter the detections of a frame; those that are not finite or out of range are left out.

        Args:
            seen: detections of the frame.
            pose: pose of base_link then, x, y in m and heading in rad, frame of the memory; nothing is entered where
                it is not finite.
            time: time of the frame, s.
            noise: noise of the camera in this frame; None = that of the constructor.
        """
        shortest, longest = MatchLimits().shortest, MatchLimits().longest
        good = np.isfinite(seen.ranges) & np.isfinite(seen.bearings) & np.isfinite(seen.looks).all(axis=1)
        good &= (seen.ranges >= shortest) & (seen.ranges <= longest)
        if good.any() and all(map(math.isfinite, pose)):
            look = MatchLimits().look(self.noise, self.length)
            # errors common to a frame do not average out: added by `seen_from`
            own = (noise or self.noise)._replace(common_range_sd=0.0, common_bearing_sd=0.0)
            gather(
                self.tables, seen.ranges[good], seen.bearings[good], seen.looks[good], np.array(pose), own, look, time
            )

    def seen_from(self, pose: tuple[float, float, float], most: int) -> tuple[Array, Array, Array, Ints, int]:
        """Return the sightings seen most often, as they lie from a pose in the frame of the memory.

        Args:
            pose: x, y in m and heading in rad, frame of the memory.
            most: largest number of sightings.

        Returns:
            Places (s, 2) m and their covariances (xx, xy, yy) (s, 3) m^2 in the axes of the pose, descriptors (s, k),
            number of detections of each (s,), number of detections of all sightings of the memory.
        """
        t, (c, s) = self.tables, (math.cos(pose[2]), math.sin(pose[2]))
        order = np.argsort(-t.times, kind="stable")[: min(most, int((t.times > 0).sum()))]
        dx, dy = t.place[order, 0] - pose[0], t.place[order, 1] - pose[1]
        x, y, count = c * dx + s * dy, c * dy - s * dx, t.times[order]
        xx, xy, yy = (t.spread[order] / count[:, None]).T
        spread = np.empty((count.size, 3))
        spread[:, 0] = c * c * xx + 2.0 * c * s * xy + s * s * yy
        spread[:, 1] = c * s * (yy - xx) + (c * c - s * s) * xy
        spread[:, 2] = s * s * xx - 2.0 * c * s * xy + c * c * yy
        r2, noise = np.maximum(x * x + y * y, 1e-6), self.noise
        along, across = noise.common_range_sd**2 / r2, noise.common_bearing_sd**2
        spread[:, 0] += along * x * x + across * y * y
        spread[:, 1] += (along - across) * x * y
        spread[:, 2] += along * y * y + across * x * x
        return np.column_stack((x, y)), spread, t.mean[order], count, int(t.times.sum())
