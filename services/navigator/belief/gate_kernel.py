"""Kernels of data association: the gate of a detection, and the landmark in it that looks most like it.

A detection z = (range r, bearing phi) from pose (x, y, theta) of a landmark at l has

    q = |l - (x, y)|,  H = [-(l_x - x)/q, -(l_y - y)/q, 0; (l_y - y)/q^2, -(l_x - x)/q^2, -1]
    nu = (r - q, wrap(phi - atan2(l_y - y, l_x - x) + theta)),  S = H Sigma H^T + R

and passes the gate if nu^T S^-1 nu < 9.21 = chi^2_2(.99). R holds the noise of one detection and the error that all
detections of a frame have in common, which a tilt of the trunk that is not known makes.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import row_kernel

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# what became of a detection
MATCHED, INVALID, FAR, UNLIKE, AMBIGUOUS, DOUBLED, OUTLIER, SURPLUS = 0, 1, 2, 3, 4, 5, 6, 7

# indices of the noise vector
RANGE_SD, RANGE_SHARE, BEARING_SD, COMMON_RANGE_SD, COMMON_BEARING_SD = 0, 1, 2, 3, 4

# indices of the limits vector
GATE, LOOK, RATIO, SHORTEST, LONGEST, SPREAD, PAIRS, MOST = 0, 1, 2, 3, 4, 5, 6, 7


@row_kernel
def wrapped(angle: float) -> float:
    """Return the same angle in [-pi, pi), rad."""
    turns = math.floor((angle + math.pi) / (2.0 * math.pi))
    return angle - 2.0 * math.pi * turns


@row_kernel
def variances(distance: float, noise: Array) -> tuple[float, float]:
    """Variances of range (m^2) and bearing (rad^2) of a detection at `distance` m, with what a frame has in common."""
    own = noise[RANGE_SD] * noise[RANGE_SD] + (noise[RANGE_SHARE] * distance) ** 2
    return own + noise[COMMON_RANGE_SD] ** 2, noise[BEARING_SD] ** 2 + noise[COMMON_BEARING_SD] ** 2


@row_kernel
def gated(
    mean: Array, cov: Array, place_x: float, place_y: float, distance: float, bearing: float, r: float, b: float
) -> float:
    """Normalised innovation squared of a detection against a landmark, 2 degrees of freedom; inf at the landmark.

    Args:
        mean: x, y in m, heading in rad, (3,) or longer.
        cov: its covariance, (3, 3) or larger.
        place_x: of the landmark, m, frame map.
        place_y: of the landmark, m, frame map.
        distance: detected, m.
        bearing: detected, rad.
        r: variance of the range, m^2.
        b: variance of the bearing, rad^2.
    """
    dx, dy = place_x - mean[0], place_y - mean[1]
    q2 = dx * dx + dy * dy
    if q2 < 1e-12:
        return math.inf
    q = math.sqrt(q2)
    nr = distance - q
    nb = wrapped(bearing - math.atan2(dy, dx) + mean[2])
    ax, ay, bx, by = -dx / q, -dy / q, dy / q2, -dx / q2
    srr = ax * ax * cov[0, 0] + 2.0 * ax * ay * cov[0, 1] + ay * ay * cov[1, 1] + r
    sbb = bx * bx * cov[0, 0] + 2.0 * bx * by * cov[0, 1] + by * by * cov[1, 1]
    sbb += cov[2, 2] - 2.0 * (bx * cov[0, 2] + by * cov[1, 2]) + b
    srb = ax * bx * cov[0, 0] + (ax * by + ay * bx) * cov[0, 1] + ay * by * cov[1, 1]
    srb -= ax * cov[0, 2] + ay * cov[1, 2]
    det = srr * sbb - srb * srb
    if det <= 0.0:
        return math.inf
    return (nr * nr * sbb - 2.0 * nr * nb * srb + nb * nb * srr) / det


@row_kernel
def largest_variance(cov: Array) -> float:
    """Larger eigenvalue of the covariance of x and y, m^2; cov (3, 3) or larger."""
    half, apart = 0.5 * (cov[0, 0] + cov[1, 1]), 0.5 * (cov[0, 0] - cov[1, 1])
    return half + math.sqrt(apart * apart + cov[0, 1] * cov[0, 1])


@row_kernel
def reach_of(mean: Array, cov: Array, distance: float, r: float, b: float, gate: float) -> float:
    """Radius in m about the place where a detection falls that holds every landmark in its gate.

    |nu_r| < g sqrt(S_rr) and |nu_phi| < g sqrt(S_phiphi), g^2 = gate; the variance of the position is at most the
    larger eigenvalue of its block of Sigma.
    """
    largest, g = largest_variance(cov), math.sqrt(gate)
    along = g * math.sqrt(r + largest)
    nearest = distance - along
    if nearest < 0.05:
        return along + 2.0 * distance
    turn = math.sqrt(cov[2, 2]) + math.sqrt(largest) / nearest
    angle = min(math.pi, g * math.sqrt(b + turn * turn))
    return along + 2.0 * distance * math.sin(0.5 * angle)


@row_kernel
def apart2(a: Array, b: Array, enough: float) -> float:
    """Square of the distance of two descriptors (k,), or something >= `enough` as soon as it is that large."""
    total = 0.0
    for i in range(a.size):
        d = a[i] - b[i]
        total += d * d
        if total >= enough:
            return total
    return total


@row_kernel
def nearest_look(
    mean: Array,
    cov: Array,
    distance: float,
    bearing: float,
    look: Array,
    positions: Array,
    looks: Array,
    grid: Array,
    starts: Index,
    members: Index,
    noise: Array,
    limits: Array,
) -> tuple[int, int, float, float]:
    """Landmark in the gate of one detection that looks most like it.

    Returns:
        Landmark or -1, what became of it (MATCHED, FAR, UNLIKE or AMBIGUOUS), normalised innovation squared, square
        of the distance of the descriptors.
    """
    r, b = variances(distance, noise)
    gate = limits[GATE]
    reach = reach_of(mean, cov, distance, r, b, gate)
    at_x = mean[0] + distance * math.cos(mean[2] + bearing)
    at_y = mean[1] + distance * math.sin(mean[2] + bearing)
    edge, rows, cols = grid[2], int(grid[3]), int(grid[4])
    # the limits are taken before they become whole numbers: a wide belief reaches beyond any index
    low_c = int(min(max(math.floor((at_x - reach - grid[0]) / edge), 0.0), cols + 0.0))
    high_c = int(max(min(math.floor((at_x + reach - grid[0]) / edge), cols - 1.0), -1.0))
    low_r = int(min(max(math.floor((at_y - reach - grid[1]) / edge), 0.0), rows + 0.0))
    high_r = int(max(min(math.floor((at_y + reach - grid[1]) / edge), rows - 1.0), -1.0))
    best, best_nis, first, second = -1, 0.0, math.inf, math.inf
    reach2 = reach * reach
    along = math.sqrt(gate * (r + largest_variance(cov)))  # nu^T S^-1 nu >= nu_r^2/S_rr: cheaper, asked first
    nearest2, farthest2 = max(0.0, distance - along) ** 2, (distance + along) ** 2
    for row in range(low_r, high_r + 1):
        for at in range(starts[row * cols + low_c], starts[row * cols + high_c + 1]) if low_c <= high_c else range(0):
            i = members[at]
            dx, dy = positions[i, 0] - at_x, positions[i, 1] - at_y
            if dx * dx + dy * dy > reach2:
                continue
            dx, dy = positions[i, 0] - mean[0], positions[i, 1] - mean[1]
            if not nearest2 <= dx * dx + dy * dy <= farthest2:
                continue
            nis = gated(mean, cov, positions[i, 0], positions[i, 1], distance, bearing, r, b)
            if not nis < gate:
                continue
            gap = apart2(look, looks[i], second)
            if gap < first or (gap == first and best >= 0 and i < best):
                second = first
                best, best_nis, first = i, nis, gap
            elif gap < second:
                second = gap
    if best < 0:
        return -1, FAR, 0.0, 0.0
    if first > limits[LOOK] * limits[LOOK]:
        return -1, UNLIKE, best_nis, first
    if second < math.inf and first >= limits[RATIO] * limits[RATIO] * second:
        return -1, AMBIGUOUS, best_nis, first
    return best, MATCHED, best_nis, first
