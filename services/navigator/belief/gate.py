"""Gate of a detection, and the landmark in it that looks most like the detection; kernels of data association.

A detection z = (range r, bearing phi) from pose (x, y, theta) of a landmark at l has

    q = |l - (x, y)|,  H = [-(l_x - x)/q, -(l_y - y)/q, 0; (l_y - y)/q^2, -(l_x - x)/q^2, -1]
    nu = (r - q, wrap(phi - atan2(l_y - y, l_x - x) + theta)),  S = H Sigma H^T + R

and passes the gate if nu^T S^-1 nu < 9.21 = chi^2_2(.99). R holds the noise of one detection and the error that all
detections of a frame have in common, caused by an unknown tilt of the trunk.
"""

import math
from typing import NamedTuple

from surefoot.arrays import Array, Ints
from surefoot.errors import Refusal
from surefoot.kernels.jit import row_kernel

from .ukf import THETA, X, Y, wrap

# fates of a detection
MATCHED, INVALID, FAR, UNLIKE, AMBIGUOUS, DOUBLED, OUTLIER, SURPLUS = 0, 1, 2, 3, 4, 5, 6, 7


class DetectionError(Refusal):
    """Error for detections that cannot be used; `field` names the wrong one."""


class _Deviations(NamedTuple):
    range_sd: float = 0.0
    """Standard deviation of the constant part of the range noise, m."""
    range_share: float = 0.03
    """Standard deviation of the range noise proportional to the range, as a part of it, no unit."""
    bearing_sd: float = math.radians(1.5)
    """Standard deviation of the bearing noise, rad."""
    common_range_sd: float = 0.0
    """Standard deviation of the range error common to all detections of a frame, m, e.g. by an unknown tilt."""
    common_bearing_sd: float = 0.0
    """Standard deviation of the bearing error common to all detections of a frame, rad."""
    look_sd: float = 0.05
    """Standard deviation of the noise of each element of a descriptor, no unit."""


class SightNoise(_Deviations):
    """Noise of a camera that measures range and bearing of landmarks on the floor; standard deviations.

    Raises:
        DetectionError: a number is negative or not finite, or a whole measurement has no noise.
    """

    __slots__ = ()

    def __new__(cls, *numbers: float, **named: float) -> "SightNoise":
        self = super().__new__(cls, *map(float, numbers), **{name: float(value) for name, value in named.items()})
        for name, value in self._asdict().items():
            if not (math.isfinite(value) and value >= 0.0):
                raise DetectionError("bad_noise", f"{name} is finite and >= 0, got {value!r}", name)
        if self.range_sd + self.range_share == 0.0 or self.bearing_sd == 0.0 or self.look_sd == 0.0:
            text = "range_sd or range_share, bearing_sd and look_sd are > 0"
            raise DetectionError("bad_noise", f"{text}, got {self._asdict()}", "bearing_sd")
        return self

    def wider(self, factor: float) -> "SightNoise":
        """Return the noise with the standard deviations of range and bearing multiplied by a factor.

        Raises:
            DetectionError: the factor is negative, 0 or not finite.
        """
        *lengths, look_sd = self
        return SightNoise(*(factor * each for each in lengths), look_sd)


class MatchLimits(NamedTuple):
    """Limits within which a detection of a camera is matched with a landmark of the map."""

    gate: float = 9.21
    """Normalised innovation squared from which on a landmark is no match, chi^2_2(.99)."""
    look_sds: float = 2.0
    """Largest distance of two matching descriptors of k elements, over sqrt(k) times `SightNoise.look_sd`, the standard
    deviation of an element; 2 passes 99.99 % of true pairs at k = 8."""
    ratio: float = 0.8
    """Largest distance to the nearest descriptor over that to the second nearest in the gate; above it a match is
    ambiguous."""
    shortest: float = 0.02
    """Least range of a detection, m; nearer ones are invalid."""
    longest: float = 50.0
    """Largest range of a detection, m; farther ones are invalid."""
    spread: float = 1.3
    """Factor on the variances of a detection in the limit of an inlier: its residual at the refined motion varies
    more."""
    pairs: int = 190
    """Largest number of pairs of matches from which a rigid motion is tried: 190 = all pairs of 20 matches."""
    most: int = 10
    """Largest number of matches of a frame; further ones are dropped."""

    def look(self, noise: SightNoise, length: int) -> float:
        """Return the largest distance of two descriptors of one landmark, no unit; `length`: elements of each."""
        return self.look_sds * noise.look_sd * math.sqrt(length)


class FrameTables(NamedTuple):
    """Landmarks detected in one camera frame as arrays for kernels, seen from base_link, x along the heading."""

    ranges: Array
    """Distances of the m detections from base_link along the floor, m, (m,)."""
    bearings: Array
    """Bearings of the m detections from the heading, rad, left positive, (m,)."""
    looks: Array
    """Descriptors (numbers that describe how a landmark looks) of the detections, (m, k), no unit."""


class MapTables(NamedTuple):
    """Landmarks of a map as arrays for kernels, with an index: a grid of cells that lists the landmarks in each."""

    positions: Array
    """Positions of the landmarks, (n, 2) m, frame map."""
    looks: Array
    """Descriptors (numbers that describe how a landmark looks) of the landmarks, (n, k), no unit."""
    grid: Array
    """Grid of the index, (5,): x, y of the lower-left corner of cell [0, 0] (m, frame map), cell edge (m), rows,
    columns."""
    starts: Ints
    """Index in `members` of the first landmark of each grid cell, (rows * columns + 1,): cell c holds
    `members[starts[c]:starts[c + 1]]`."""
    members: Ints
    """Indices of the landmarks sorted by grid cell, then by index, (n,)."""


@row_kernel
def variances(distance: float, noise: SightNoise) -> tuple[float, float]:
    """Return the variances of range, m^2, and bearing, rad^2, of a detection at `distance` m, common errors included.

    `noise`: standard deviations of a detection and of the errors that all detections of a frame have in common.
    """
    own = noise.range_sd * noise.range_sd + (noise.range_share * distance) ** 2
    return own + noise.common_range_sd**2, noise.bearing_sd**2 + noise.common_bearing_sd**2


@row_kernel
def gated(
    mean: Array, cov: Array, place_x: float, place_y: float, distance: float, bearing: float, r: float, b: float
) -> float:
    """Return the normalised innovation squared nu^T S^-1 nu of a detection against a landmark, 2 degrees of freedom.

    nu: range and bearing detected less those expected from the believed pose; S its covariance. It is inf where the
    robot stands on the landmark or S is not positive definite.

    Args:
        mean: believed x, y (m), heading (rad), frame map, (3,) or longer.
        cov: covariance of `mean`, (3, 3) or larger.
        place_x: x of the landmark, m, frame map.
        place_y: y of the landmark, m, frame map.
        distance: detected, m.
        bearing: detected, rad, left of the heading positive.
        r: variance of the range, m^2.
        b: variance of the bearing, rad^2.
    """
    dx, dy = place_x - mean[X], place_y - mean[Y]
    q2 = dx * dx + dy * dy
    if q2 < 1e-12:
        return math.inf
    q = math.sqrt(q2)
    nr = distance - q
    nb = wrap(bearing - math.atan2(dy, dx) + mean[THETA])
    ax, ay, bx, by = -dx / q, -dy / q, dy / q2, -dx / q2
    srr = ax * ax * cov[X, X] + 2.0 * ax * ay * cov[X, Y] + ay * ay * cov[Y, Y] + r
    sbb = bx * bx * cov[X, X] + 2.0 * bx * by * cov[X, Y] + by * by * cov[Y, Y]
    sbb += cov[THETA, THETA] - 2.0 * (bx * cov[X, THETA] + by * cov[Y, THETA]) + b
    srb = ax * bx * cov[X, X] + (ax * by + ay * bx) * cov[X, Y] + ay * by * cov[Y, Y]
    srb -= ax * cov[X, THETA] + ay * cov[Y, THETA]
    det = srr * sbb - srb * srb
    if det <= 0.0:
        return math.inf
    return (nr * nr * sbb - 2.0 * nr * nb * srb + nb * nb * srr) / det


@row_kernel
def largest_variance(cov: Array) -> float:
    """Return the larger eigenvalue of the covariance of x and y, m^2; `cov` (3, 3) or larger: of x, y (m) first."""
    half, apart = 0.5 * (cov[X, X] + cov[Y, Y]), 0.5 * (cov[X, X] - cov[Y, Y])
    return half + math.sqrt(apart * apart + cov[X, Y] * cov[X, Y])


@row_kernel
def reach_of(cov: Array, distance: float, r: float, b: float, gate: float) -> float:
    """Return the radius, m, of a circle about the place of a detection that holds every landmark in its gate.

    In the gate |nu_r| < g sqrt(S_rr) and |nu_phi| < g sqrt(S_phiphi), with nu the innovation of range and bearing, S
    its covariance, g^2 = gate; the variance of the position is at most the larger eigenvalue of its block of Sigma.

    Args:
        cov: covariance Sigma of believed x, y (m) and heading (rad), (3, 3) or larger.
        distance: detected, m.
        r: variance of the range, m^2.
        b: variance of the bearing, rad^2.
        gate: largest normalised innovation squared nu^T S^-1 nu, 2 degrees of freedom.
    """
    largest, g = largest_variance(cov), math.sqrt(gate)
    along = g * math.sqrt(r + largest)
    nearest = distance - along
    if nearest < 0.05:
        return along + 2.0 * distance
    turn = math.sqrt(cov[THETA, THETA]) + math.sqrt(largest) / nearest
    angle = min(math.pi, g * math.sqrt(b + turn * turn))
    return along + 2.0 * distance * math.sin(0.5 * angle)


@row_kernel
def apart2(a: Array, b: Array, enough: float) -> float:
    """Return the squared distance of descriptors `a`, `b` (k,), no unit; the sum ends early once it is >= `enough`."""
    total = 0.0
    for i in range(a.size):
        d = a[i] - b[i]
        total += d * d
        if total >= enough:
            return total
    return total


@row_kernel
def _cells(grid: Array, x: float, y: float, reach: float) -> tuple[int, int, int, int]:
    """Return first and last column, first and last row of the grid cells that a square of half side `reach` m touches.

    The result is empty if last < first. The limits apply before the numbers become whole ones: a wide belief reaches
    beyond any grid.

    Args:
        grid: (5,): x and y of the lower-left corner, m, frame map, edge of a cell, m, number of rows and of columns.
        x: x of the middle of the square, m, frame map.
        y: y of the middle, m, frame map.
        reach: half the side, m.
    """
    edge, rows, cols = grid[2], int(grid[3]), int(grid[4])
    low_c = int(min(max(math.floor((x - reach - grid[0]) / edge), 0.0), cols + 0.0))
    high_c = int(max(min(math.floor((x + reach - grid[0]) / edge), cols - 1.0), -1.0))
    low_r = int(min(max(math.floor((y - reach - grid[1]) / edge), 0.0), rows + 0.0))
    high_r = int(max(min(math.floor((y + reach - grid[1]) / edge), rows - 1.0), -1.0))
    return low_c, high_c, low_r, high_r


@row_kernel
def nearest_look(
    mean: Array,
    cov: Array,
    distance: float,
    bearing: float,
    look: Array,
    world: MapTables,
    noise: SightNoise,
    limits: MatchLimits,
) -> tuple[int, int, float, float]:
    """Return the landmark in the gate of one detection with the most similar descriptor, and whether it is a match.

    Args:
        mean: believed x, y (m, frame map) and heading (rad), (3,) or longer.
        cov: covariance of `mean`, (3, 3) or larger.
        distance, bearing: detected, m and rad, left of the heading positive.
        look: descriptor of the detection, (k,), no unit.
        world: landmarks of the map with their index of places.
        noise, limits: standard deviations of range, bearing and descriptor; limits of gate and likeness.

    Returns:
        Landmark or -1; fate MATCHED, FAR (none in the gate), UNLIKE or AMBIGUOUS (0, 2, 3, 4); normalised innovation
        squared; squared distance of the descriptors.
    """
    r, b = variances(distance, noise)
    gate, alike = limits.gate, limits.look_sds * noise.look_sd * math.sqrt(look.size)
    reach = reach_of(cov, distance, r, b, gate)
    at_x = mean[X] + distance * math.cos(mean[THETA] + bearing)
    at_y = mean[Y] + distance * math.sin(mean[THETA] + bearing)
    low_c, high_c, low_r, high_r = _cells(world.grid, at_x, at_y, reach)
    cols, starts, positions = int(world.grid[4]), world.starts, world.positions
    best, best_nis, first, second = -1, 0.0, math.inf, math.inf
    reach2 = reach * reach
    along = math.sqrt(gate * (r + largest_variance(cov)))  # nu^T S^-1 nu >= nu_r^2/S_rr: cheaper, checked first
    nearest2, farthest2 = max(0.0, distance - along) ** 2, (distance + along) ** 2
    for row in range(low_r, high_r + 1):
        for at in range(starts[row * cols + low_c], starts[row * cols + high_c + 1]) if low_c <= high_c else range(0):
            i = world.members[at]
            dx, dy = positions[i, 0] - at_x, positions[i, 1] - at_y
            if dx * dx + dy * dy > reach2:
                continue
            dx, dy = positions[i, 0] - mean[X], positions[i, 1] - mean[Y]
            if not nearest2 <= dx * dx + dy * dy <= farthest2:
                continue
            nis = gated(mean, cov, positions[i, 0], positions[i, 1], distance, bearing, r, b)
            if not nis < gate:
                continue
            gap = apart2(look, world.looks[i], second)
            if gap < first or (gap == first and best >= 0 and i < best):
                second = first
                best, best_nis, first = i, nis, gap
            elif gap < second:
                second = gap
    if best < 0:
        return -1, FAR, 0.0, 0.0
    if first > alike * alike:
        return -1, UNLIKE, best_nis, first
    if second < math.inf and first >= limits.ratio * limits.ratio * second:
        return -1, AMBIGUOUS, best_nis, first
    return best, MATCHED, best_nis, first
