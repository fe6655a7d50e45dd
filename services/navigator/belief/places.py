"""Places of a map that explain the sightings (averaged detections) of a lost robot; kernels of relocalisation.

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

from surefoot.arrays import Array, Ints
from surefoot.geometry.linear_kernels import inverse3
from surefoot.kernels.jit import row_kernel

from .association import sort_by
from .sightings import WIDE
from .ukf import wrap

BESIDE = 0.3  # m and rad, of a pose from a place that the same pair led to
SAME = 16.0  # squared standard deviations that coordinates of one place differ by at most

# elements of the cursor of a search: sightings by their number of candidates, their candidates, poses tried, places
SECOND, FIRST, A, B, TRIED, FILLED = 0, 1, 2, 3, 4, 5
CURSOR = 6

# columns of a place; COV is the first of nine, row by row
X, Y, HEADING, EVIDENCE, EXPLAINED, COV = 0, 1, 2, 3, 4, 5
PLACE = 14


class Evidence(NamedTuple):
    """Sightings (averaged detections) of a lost robot and the landmarks of the map that may explain them."""

    place: Array
    """Positions of the s sightings in the robot's reference frame, x forward, y left, (s, 2) m."""
    spread: Array
    """Covariances (xx, xy, yy) of the sightings' positions, (s, 3) m^2."""
    false: Array
    """Prior probability of each sighting that it is false, (s,)."""
    starts: Ints
    """Index in `members` of the first candidate of each sighting, and the length of `members` last, (s + 1,)."""
    members: Ints
    """Indices of the landmarks that a sighting may be (its candidates), sighting by sighting, (starts[s],)."""
    positions: Array
    """Positions of the landmarks, (n, 2) m, frame map."""
    overlooked: float
    """Area of floor that the camera sees at once, m^2."""
    area: float
    """Area of the map, m^2."""


class Assignment(NamedTuple):
    """Landmarks that explain the sightings at one pose."""

    chosen: Ints
    """Index of the landmark that explains each sighting, -1 = none, (s,)."""
    far: Array
    """Squared normalised residual of each sighting, 2 degrees of freedom, (s,); 13.8 where no landmark explains it."""


class PlaceList(NamedTuple):
    """List of the best candidate poses found so far in the search for a lost robot's pose."""

    places: Array
    """Candidate poses, one a row, (p, 14): pose, log evidence, number of explained sightings, covariance.

    Pose: x, y (m), heading (rad) of the robot's reference frame in the map; evidence in nats; covariance of x, y,
    heading row by row (9)."""
    chosen: Ints
    """Index of the landmark that explains each sighting at each candidate pose, -1 = none, (p, s)."""


@row_kernel
def associate(pose: Array, loose: float, wide: float, seen: Evidence, to: Assignment) -> int:
    """Choose the nearest candidate of each sighting at a pose; return the number of explained sightings.

    Args:
        pose: pose of the robot's reference frame in the map, x and y in m and heading in rad, (3,).
        loose: variance of its heading, rad^2, added to the spread of the sightings; 0 = none.
        wide: factor of every covariance of a sighting.
        seen: sightings and their candidates.
        to: written: landmark of each sighting and its residual; a landmark explains only the sighting nearest to it.
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
def improve(pose: Array, seen: Evidence, chosen: Ints) -> tuple[Array, float]:
    """Do one least-squares step of a pose over the explained sightings; `pose` is changed in place.

    Args:
        pose: x, y (m), heading (rad) of the robot's reference frame in the map, (3,).
        seen: sightings.
        chosen: landmark of each sighting, (s,), below 0 = unexplained.

    Returns:
        Covariance of the pose (3, 3), m and rad, and the log of its determinant (inf: the sightings do not determine
        the pose, which then stays).
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
    """Return the log likelihood ratio of the sightings with their chosen candidates against "all are false", nats.

    It is sum_i ln(eps_i + (1 - eps_i) A N_i), with eps_i the share of false sightings, A the area that the camera
    overlooks, m^2, and N_i the density of the chosen landmark, 1/m^2, 0 without one.
    """
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
    """Return True if two candidate poses are one: each coordinate differs by at most 4 standard deviations.

    one, other: (14,): x, y (m), heading (rad), log evidence, explained sightings, covariance (9, row by row).
    """
    for k in range(3):
        d = one[k] - other[k] if k < 2 else wrap(one[k] - other[k])
        if d * d > SAME * (one[COV + 4 * k] + other[COV + 4 * k]):
            return False
    return True


@row_kernel
def keep(found: PlaceList, filled: int, row: Array, chosen: Ints) -> int:
    """Enter a candidate pose into the list of the best; return the number of rows in use.

    A place that explains more than half of its sightings by the landmarks of another, and agrees with it within the
    covariances, is the same place: the one with more evidence stays. A full list loses the place with the least
    evidence.

    Args:
        found: the list, changed in place.
        filled: number of its places that are filled.
        row: (14,): x, y (m), heading (rad), log evidence, explained sightings, covariance (9, row by row).
        chosen: landmark of each sighting there, -1 = none, (s,).
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
    """Write to `pose` the x, y (m), heading (rad), (3,), at which sightings i and j are landmarks p and q of the map.

    The pose is that of the robot's reference frame in the map; the middles of the two pairs coincide.
    """
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
    """Return True if a place near a pose (0.3 m, 0.3 rad) explains sightings i and j by landmarks p and q.

    `found`, `filled`: list of places and how many are filled; `pose`: x, y (m), heading (rad), frame map, (3,).
    """
    for r in range(filled):
        if found.chosen[r, i] == p and found.chosen[r, j] == q:
            beside = abs(wrap(pose[HEADING] - found.places[r, HEADING])) < BESIDE
            if beside and abs(pose[X] - found.places[r, X]) + abs(pose[Y] - found.places[r, Y]) < BESIDE:
                return True
    return False


@row_kernel
def _settle(seen: Evidence, pose: Array, loose: float, to: Assignment, row: Array) -> bool:
    """Refine a pose by all sightings and write it to `row`; return True if at least two sightings determine it.

    Args:
        seen: sightings and their candidates.
        pose: x, y (m), heading (rad) of the robot's reference frame in the map, (3,), changed.
        loose: variance of its heading at the beginning, rad^2.
        to: landmark of each sighting at the pose, written.
        row: written, (14,): x, y, heading, log evidence, explained sightings, covariance (9).
    """
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
def _few_first(starts: Ints) -> Ints:
    """Return the indices of the sightings that have candidates, those with the fewest first, (k,).

    `starts`: where the candidates of each of s sightings begin in a list of all, and the length of it, (s + 1,).
    """
    n, kept = starts.size - 1, 0
    few, count = np.empty(n, dtype=np.int64), np.empty(n)
    for i in range(n):
        count[i] = starts[i + 1] - starts[i]
        if count[i] > 0.0:
            few[kept] = i
            kept += 1
    sort_by(few[:kept], count, starts)
    return few[:kept]


def place_list(seen: Evidence, most: int) -> PlaceList:
    """Return an empty list with room for the `most` best places of a search for these sightings."""
    return PlaceList(np.zeros((most, PLACE)), np.full((most, seen.place.shape[0]), -1))


@row_kernel
def _in_reach(seen: Evidence, i: int, j: int, p: int, q: int) -> float:
    """Return the variance of the heading, rad^2, if sightings i and j are landmarks p and q; 0 = they cannot be.

    They cannot be where the distance of the landmarks is not that of the sightings within 3 standard deviations.
    """
    place, spread, positions = seen.place, seen.spread, seen.positions
    ux, uy = place[j, 0] - place[i, 0], place[j, 1] - place[i, 1]
    length2 = ux * ux + uy * uy
    largest = spread[i, 0] + spread[i, 2] + spread[j, 0] + spread[j, 2]
    wx, wy = positions[q, 0] - positions[p, 0], positions[q, 1] - positions[p, 1]
    reach2, length, slack = wx * wx + wy * wy, math.sqrt(length2), 3.0 * math.sqrt(largest)
    if length2 < largest or p == q or reach2 > (length + slack) ** 2 or reach2 < max(0.0, length - slack) ** 2:
        return 0.0
    return 0.5 * largest / length2


@row_kernel
def _advance(cursor: Ints, few: Ints, starts: Ints) -> None:
    """Set the cursor of a search to the next pair of candidates, or to the next pair of sightings, in place.

    Args:
        cursor: two indices into `few`, two indices of candidates of these sightings, poses tried, places filled, (6,).
        few: sightings that have candidates, (k,).
        starts: where the candidates of each of s sightings begin in a list of all, and the length of it, (s + 1,).
    """
    i, j = int(few[int(cursor[FIRST])]), int(few[int(cursor[SECOND])])
    cursor[B] += 1
    if cursor[B] >= starts[j + 1] - starts[j]:
        cursor[A], cursor[B] = cursor[A] + 1, 0
    if cursor[A] >= starts[i + 1] - starts[i]:
        cursor[FIRST], cursor[A] = cursor[FIRST] + 1, 0
    if cursor[FIRST] >= cursor[SECOND]:
        cursor[SECOND], cursor[FIRST] = cursor[SECOND] + 1, 0


@row_kernel
def search(seen: Evidence, found: PlaceList, cursor: Ints, tries: int, work: int) -> bool:
    """Continue the search for poses that explain the sightings of a lost robot, by a bounded amount of work.

    Args:
        seen: sightings and their candidates.
        found: the best places so far, changed in place.
        cursor: pair of sightings (2), their candidates (2), poses tried, places filled, (6,), changed in place; a new
            search begins with zeros, but the first element 1.
        tries: number of poses that are tried at most in the whole search.
        work: sightings that are compared with a pose, or pairs of candidates that are looked at, in this call.

    Returns:
        True if the search has ended.
    """
    n, few, spent = seen.place.shape[0], _few_first(seen.starts), 0
    pose, to, row = np.zeros(3), Assignment(np.full(n, -1), np.zeros(n)), np.zeros(PLACE)
    while cursor[SECOND] < few.size and cursor[TRIED] < tries:
        if spent >= work:
            return False
        spent += 1
        i, j = int(few[int(cursor[FIRST])]), int(few[int(cursor[SECOND])])
        p = int(seen.members[int(seen.starts[i] + cursor[A])])
        q = int(seen.members[int(seen.starts[j] + cursor[B])])
        loose = _in_reach(seen, i, j, p, q)
        if loose > 0.0:
            _pose_of_pair(seen, i, j, p, q, pose)
            if not _found_already(found, cursor[FILLED], pose, i, j, p, q):
                cursor[TRIED] += 1
                spent += n
                if _settle(seen, pose, loose, to, row):
                    spent += 3 * n
                    cursor[FILLED] = keep(found, cursor[FILLED], row, to.chosen)
        _advance(cursor, few, seen.starts)
    return True
