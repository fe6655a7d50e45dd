"""Places of a map from which sightings would look as they did; kernels of relocalisation.

Sightings come from several frames, poses from pairs of sightings, and every pose gets the evidence for it. A sighting i
lies at a_i (reference frame of the robot) with covariance C_i. At a pose (t, theta) it is explained by one of its
candidates l in the map with density N(R(theta)^T (l - t); a_i, C_i), and otherwise false: uniform over the A m^2 that
the camera overlooks. With eps_i the share of false sightings,

    L(t, theta) = sum_i ln(eps_i + (1 - eps_i) A max_l N(...))
    evidence of a place = exp(L) (2 pi)^(3/2) sqrt(det Sigma) / (2 pi area of the map)

against 1 for "everything is false". Sigma is the covariance of the pose by the explained sightings (Laplace's method).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.linear_kernels import inverse3
from surefoot.kernels.jit import row_kernel

from .association import likeness, sort_by
from .gate import apart2, variances
from .ukf import wrap

Array = NDArray[np.float64]
Index = NDArray[np.int64]

WIDE = 13.8  # chi^2_2(.999): a candidate farther from its sighting does not explain it

BESIDE = 0.3  # m and rad, of a pose from a place that the same pair led to
SAME = 16.0  # squared standard deviations that coordinates of one place differ by at most

# columns of a place; COV is the first of nine, row by row
X, Y, HEADING, EVIDENCE, EXPLAINED, COV = 0, 1, 2, 3, 4, 5
PLACE = 14


class Evidence(NamedTuple):
    """Sightings and the landmarks that may explain them."""

    place: Array
    """Sightings in the reference frame of the robot, (s, 2) m."""
    spread: Array
    """Their covariances (xx, xy, yy), (s, 3) m^2."""
    false: Array
    """Share of false ones among such sightings, (s,)."""
    starts: Index
    """First candidate of each sighting, (s + 1,)."""
    members: Index
    """Candidates: landmarks."""
    positions: Array
    """Landmarks, (n, 2) m, frame map."""
    overlooked: float
    """Area that the camera overlooks, m^2."""
    area: float
    """Area of the map, m^2."""


class Assignment(NamedTuple):
    """Landmarks that explain the sightings at one pose."""

    chosen: Index
    """Landmark of each sighting, -1 = none, (s,)."""
    far: Array
    """Squared residual of each over the variances, (s,)."""


class PlaceList(NamedTuple):
    """The best places found so far."""

    places: Array
    """x, y (m), heading (rad), logarithm of the evidence, explained sightings, covariance, (p, PLACE)."""
    chosen: Index
    """Landmark of each sighting at each place, -1 = none, (p, s)."""


@row_kernel
def gather(
    ranges: Array, bearings: Array, looks: Array, poses: Array, noise: Array, look: float, most: int
) -> tuple[Array, Array, Array, Index]:
    """Join the detections of several frames that show the same thing.

    Noise of the bearing draws the mean of r (cos phi, sin phi) towards the robot by exp(-sigma_phi^2/2): undone here.

    Args:
        ranges: of all frames in order, m, (m,).
        bearings: rad, (m,).
        looks: descriptors, (m, k).
        poses: of base_link when each was taken, reference frame, x, y in m and heading in rad, (m, 3).
        noise: see the indices in `gate`, (5,).
        look: largest distance of two descriptors of one landmark.
        most: sightings that are kept.

    Returns:
        Mean place (s, 2) m, covariance of a place (xx, xy, yy) (s, 3) m^2, mean descriptor (s, k), detections (s,).
    """
    n, k = ranges.size, looks.shape[1]
    place, spread, mean = np.zeros((most, 2)), np.zeros((most, 3)), np.zeros((most, k))
    count, total = np.zeros(most, dtype=np.int64), 0
    for d in range(n):
        r, b = variances(ranges[d], noise)
        out = ranges[d] * math.exp(0.5 * b)
        r, b = r + 0.5 * (out * b) ** 2, b * out * out
        c, s = math.cos(poses[d, 2] + bearings[d]), math.sin(poses[d, 2] + bearings[d])
        x, y = poses[d, 0] + out * c, poses[d, 1] + out * s
        xx, xy, yy = c * c * r + s * s * b, c * s * (r - b), s * s * r + c * c * b
        best, nearest = -1, 1.3 * look * look
        for i in range(total):
            gap = apart2(looks[d], mean[i], nearest)
            if gap < nearest:
                dx, dy = x - place[i, 0], y - place[i, 1]
                more = 1.0 + 1.0 / count[i]
                det = more * more * (xx * yy - xy * xy)
                if more * (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) < 1.5 * WIDE * det:
                    best, nearest = i, gap
        if best < 0:
            if total == most:
                continue
            best = total
            total += 1
        count[best] += 1
        part = 1.0 / count[best]
        place[best, 0] += part * (x - place[best, 0])
        place[best, 1] += part * (y - place[best, 1])
        for j in range(k):
            mean[best, j] += part * (looks[d, j] - mean[best, j])
        spread[best, 0] += part * (xx - spread[best, 0])
        spread[best, 1] += part * (xy - spread[best, 1])
        spread[best, 2] += part * (yy - spread[best, 2])
    return place[:total], spread[:total], mean[:total], count[:total]


@row_kernel
def candidates(looks: Array, columns: Array, look: float, ratio: float, most: int) -> tuple[Index, Index]:
    """Return the candidates of each sighting: landmarks about as alike as the most alike one; none if too many.

    Args:
        looks: mean descriptors, (s, k).
        columns: descriptors of the landmarks, (k, n).
        look: largest distance of two descriptors of one landmark.
        ratio: of the distance to the most alike over that to a candidate.
        most: of one sighting.

    Returns:
        Starts (s + 1,) and landmarks (starts[s],).
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


@row_kernel
def associate(pose: Array, loose: float, wide: float, seen: Evidence, to: Assignment) -> int:
    """Choose the nearest candidate of each sighting at a pose; return the number of explained sightings.

    Args:
        pose: of the reference frame in the map, (3,).
        loose: variance of its heading, rad^2, beside `wide`.
        wide: factor of every covariance.
        seen: sightings.
        to: the choice, written.
    """
    c, s, explained = math.cos(pose[HEADING]), math.sin(pose[HEADING]), 0
    chosen, far = to
    for i in range(chosen.size):
        x, y, spread = seen.place[i, 0], seen.place[i, 1], seen.spread
        xx, xy, yy = wide * spread[i, 0], wide * spread[i, 1], wide * spread[i, 2]
        if loose > 0.0:
            xx, xy, yy = xx + loose * y * y, xy - loose * x * y, yy + loose * x * x
        det = xx * yy - xy * xy
        chosen[i], far[i] = -1, WIDE
        mx, my = pose[X] + c * x - s * y, pose[Y] + s * x + c * y
        for at in range(seen.starts[i], seen.starts[i + 1]):
            mark = seen.members[at]
            vx, vy = seen.positions[mark, 0] - mx, seen.positions[mark, 1] - my
            ex, ey = c * vx + s * vy, c * vy - s * vx
            m = (yy * ex * ex - 2.0 * xy * ex * ey + xx * ey * ey) / det
            if m < far[i]:
                chosen[i], far[i] = mark, m
        for j in range(i):  # a landmark explains the sighting nearest to it
            if chosen[i] >= 0 and chosen[j] == chosen[i]:
                loser = i if far[i] >= far[j] else j
                chosen[loser], far[loser] = -1, WIDE
    for i in range(chosen.size):
        explained += chosen[i] >= 0
    return explained


@row_kernel
def improve(pose: Array, seen: Evidence, chosen: Index) -> tuple[Array, float]:
    """Take one step of least squares over the explained sightings, in place.

    Returns:
        Covariance of the pose (3, 3), and the logarithm of its determinant (inf: it does not follow from these).
    """
    c, s = math.cos(pose[HEADING]), math.sin(pose[HEADING])
    a, v, jx, jy, spread = np.zeros((3, 3)), np.zeros(3), np.empty(3), np.empty(3), seen.spread
    for i in range(chosen.size):
        if chosen[i] < 0:
            continue
        dx, dy = seen.positions[chosen[i], 0] - pose[X], seen.positions[chosen[i], 1] - pose[Y]
        ax, ay = c * dx + s * dy, c * dy - s * dx
        ex, ey = ax - seen.place[i, 0], ay - seen.place[i, 1]
        det = spread[i, 0] * spread[i, 2] - spread[i, 1] * spread[i, 1]
        wxx, wxy, wyy = spread[i, 2] / det, -spread[i, 1] / det, spread[i, 0] / det
        jx[0], jx[1], jx[2] = -c, -s, ay  # of ex by the pose
        jy[0], jy[1], jy[2] = s, -c, -ax
        for p in range(3):
            gx, gy = wxx * jx[p] + wxy * jy[p], wxy * jx[p] + wyy * jy[p]
            v[p] -= gx * ex + gy * ey
            for q in range(3):
                a[p, q] += gx * jx[q] + gy * jy[q]
    cov, condition = inverse3(a)
    if not condition < 1e10 or cov[0, 0] <= 0.0 or cov[1, 1] <= 0.0 or cov[2, 2] <= 0.0:
        return cov, math.inf
    for p in range(3):
        pose[p] += cov[p, 0] * v[0] + cov[p, 1] * v[1] + cov[p, 2] * v[2]
    pose[HEADING] = wrap(pose[HEADING])
    det = cov[0, 0] * (cov[1, 1] * cov[2, 2] - cov[1, 2] * cov[2, 1])
    det -= cov[0, 1] * (cov[1, 0] * cov[2, 2] - cov[1, 2] * cov[2, 0])
    det += cov[0, 2] * (cov[1, 0] * cov[2, 1] - cov[1, 1] * cov[2, 0])
    return cov, math.log(det) if det > 0.0 else math.inf


@row_kernel
def evidence(seen: Evidence, to: Assignment) -> float:
    """Return L of the sightings with their nearest candidates, see the module, nats."""
    total = 0.0
    for i in range(to.chosen.size):
        p = 0.0
        if to.chosen[i] >= 0:
            det = seen.spread[i, 0] * seen.spread[i, 2] - seen.spread[i, 1] * seen.spread[i, 1]
            p = seen.overlooked * math.exp(-0.5 * to.far[i]) / (2.0 * math.pi * math.sqrt(det))
        total += math.log(seen.false[i] + (1.0 - seen.false[i]) * p)
    return total


@row_kernel
def agree(one: Array, other: Array) -> bool:
    """Return whether two places (PLACE,) are one within their covariances: no coordinate is 4 deviations off."""
    for k in range(3):
        d = one[k] - other[k] if k < 2 else wrap(one[k] - other[k])
        if d * d > SAME * (one[COV + 4 * k] + other[COV + 4 * k]):
            return False
    return True


@row_kernel
def keep(found: PlaceList, filled: int, row: Array, chosen: Index) -> int:
    """Enter a place into the list of the best; return how many are filled.

    A place that explains half of its sightings by the landmarks of another, within the covariances, is the same place.
    """
    places, same = found.places, -1
    for p in range(filled):
        shared = 0
        for i in range(chosen.size):
            shared += chosen[i] >= 0 and chosen[i] == found.chosen[p, i]
        if 2 * shared > min(row[EXPLAINED], places[p, EXPLAINED]) and agree(row, places[p]):
            if places[p, EVIDENCE] >= row[EVIDENCE]:
                return filled
            if same < 0:
                same = p
            else:  # it unites two
                places[p, EVIDENCE] = -math.inf
    if same < 0 and filled < places.shape[0]:
        same = filled
        filled += 1
    if same < 0:
        least = 0
        for p in range(filled):
            if places[p, EVIDENCE] < places[least, EVIDENCE]:
                least = p
        if places[least, EVIDENCE] >= row[EVIDENCE]:
            return filled
        same = least
    for k in range(row.size):
        places[same, k] = row[k]
    for i in range(chosen.size):
        found.chosen[same, i] = chosen[i]
    return filled


@row_kernel
def _pose_of_pair(seen: Evidence, i: int, j: int, p: int, q: int, pose: Array) -> None:
    """Write the pose (3,) at which sightings i and j are landmarks p and q."""
    place, positions = seen.place, seen.positions
    ux, uy = place[j, 0] - place[i, 0], place[j, 1] - place[i, 1]
    wx, wy = positions[q, 0] - positions[p, 0], positions[q, 1] - positions[p, 1]
    heading = wrap(math.atan2(wy, wx) - math.atan2(uy, ux))
    c, s = math.cos(heading), math.sin(heading)
    mx, my = 0.5 * (place[i, 0] + place[j, 0]), 0.5 * (place[i, 1] + place[j, 1])
    pose[X] = 0.5 * (positions[p, 0] + positions[q, 0]) - c * mx + s * my
    pose[Y] = 0.5 * (positions[p, 1] + positions[q, 1]) - s * mx - c * my
    pose[HEADING] = heading


@row_kernel
def _found_already(found: PlaceList, filled: int, pose: Array, i: int, j: int, p: int, q: int) -> bool:
    """Return whether a place close to a pose explains sightings i and j by landmarks p and q."""
    for r in range(filled):
        if found.chosen[r, i] == p and found.chosen[r, j] == q:
            beside = abs(wrap(pose[HEADING] - found.places[r, HEADING])) < BESIDE
            if beside and abs(pose[X] - found.places[r, X]) + abs(pose[Y] - found.places[r, Y]) < BESIDE:
                return True
    return False


@row_kernel
def _settle(seen: Evidence, pose: Array, loose: float, to: Assignment, row: Array) -> bool:
    """Refine a pose by all sightings and write its place (PLACE,); return whether they determine one."""
    explained, log_det, cov = 0, 0.0, np.zeros((3, 3))
    for step in range(4):
        explained = associate(pose, loose if step == 0 else 0.0, 2.0 if step == 0 else 1.0, seen, to)
        if explained < 2 or log_det == math.inf:
            break
        cov, log_det = improve(pose, seen, to.chosen)
    if explained < 2 or log_det == math.inf:
        return False
    row[X], row[Y], row[HEADING] = pose[X], pose[Y], pose[HEADING]
    row[EVIDENCE] = evidence(seen, to)
    row[EVIDENCE] += min(0.0, 0.5 * (log_det + math.log(2.0 * math.pi)) - math.log(seen.area))
    row[EXPLAINED] = explained
    for k in range(9):
        row[COV + k] = cov[k // 3, k % 3]
    return True


@row_kernel
def _few_first(starts: Index) -> Index:
    """Return the sightings sorted by their number of candidates."""
    n = starts.size - 1
    few, count = np.empty(n, dtype=np.int64), np.empty(n)
    for i in range(n):
        few[i], count[i] = i, starts[i + 1] - starts[i]
    sort_by(few, count, starts)
    return few


@row_kernel
def search(seen: Evidence, most: int, tries: int) -> tuple[Array, int]:
    """Find the places of a map from which the sightings would look as they did.

    Args:
        seen: sightings and their candidates.
        most: number of places that are returned at most.
        tries: number of poses that are tried at most.

    Returns:
        Places, see `PlaceList`, and the number of poses that were tried.
    """
    n, place, spread, positions = seen.place.shape[0], seen.place, seen.spread, seen.positions
    found = PlaceList(np.zeros((most, PLACE)), np.full((most, n), -1))
    filled, tried, few = 0, 0, _few_first(seen.starts)
    pose, to, row = np.zeros(3), Assignment(np.full(n, -1), np.zeros(n)), np.zeros(PLACE)
    for second in range(1, n):
        for first in range(second):
            i, j = few[first], few[second]
            ux, uy = place[j, 0] - place[i, 0], place[j, 1] - place[i, 1]
            length2 = ux * ux + uy * uy
            largest = spread[i, 0] + spread[i, 2] + spread[j, 0] + spread[j, 2]
            if length2 < largest:
                continue
            length = math.sqrt(length2)
            slack = 3.0 * math.sqrt(largest)
            for a in range(seen.starts[i], seen.starts[i + 1]):
                for b in range(seen.starts[j], seen.starts[j + 1]):
                    p, q = seen.members[a], seen.members[b]
                    wx, wy = positions[q, 0] - positions[p, 0], positions[q, 1] - positions[p, 1]
                    reach2 = wx * wx + wy * wy
                    if p == q or reach2 > (length + slack) ** 2 or reach2 < max(0.0, length - slack) ** 2:
                        continue
                    _pose_of_pair(seen, i, j, p, q, pose)
                    if _found_already(found, filled, pose, i, j, p, q):
                        continue
                    if tried == tries:
                        return found.places[:filled], tried
                    tried += 1
                    if _settle(seen, pose, 0.5 * largest / length2, to, row):
                        filled = keep(found, filled, row, to.chosen)
    return found.places[:filled], tried
