"""Kernels of data association: gate, nearest look, two-point rigid motions.

A detection z = (range r, bearing phi) from pose (x, y, theta) of a landmark at l has

    q = |l - (x, y)|,  H = [-(l_x - x)/q, -(l_y - y)/q, 0; (l_y - y)/q^2, -(l_x - x)/q^2, -1]
    nu = (r - q, wrap(phi - atan2(l_y - y, l_x - x) + theta)),  S = H Sigma H^T + R

and passes the gate if nu^T S^-1 nu < 9.21 = chi^2_2(.99). R holds the noise of one detection and the error that all
detections of a frame have in common, which a tilt of the trunk that is not known makes.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.linear_kernels import inverse3, solve3
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


@row_kernel
def order_of(keys: Array, ties: Index) -> Index:
    """Indices that sort by key, equal keys by tie, (n,)."""
    n = keys.size
    ranked = np.arange(n)
    for i in range(1, n):  # by insertion: n is a few dozen
        this, j = ranked[i], i
        while j > 0 and (
            keys[ranked[j - 1]] > keys[this] or (keys[ranked[j - 1]] == keys[this] and ties[ranked[j - 1]] > ties[this])
        ):
            ranked[j] = ranked[j - 1]
            j -= 1
        ranked[j] = this
    return ranked


@row_kernel
def misfit(x: float, y: float, c: float, s: float, place: Array, ray: Array, r: float, b: float) -> float:
    """Squared residual of a detection at an assumed pose over its variances, 2 degrees of freedom.

    Radial and tangential part of the vector from the detection to the landmark, in heading axes: no angles, no roots.

    Args:
        x: of the pose, m, frame map.
        y: likewise.
        c: cosine of its heading.
        s: its sine.
        place: of the landmark, (2,) m, frame map.
        ray: distance (m), cosine and sine of the bearing, (3,).
        r: variance of the range, m^2.
        b: variance of the bearing, rad^2.
    """
    dx, dy = place[0] - x, place[1] - y
    ax, ay = c * dx + s * dy, c * dy - s * dx
    radial = ray[1] * ax + ray[2] * ay - ray[0]
    tangential = ray[1] * ay - ray[2] * ax
    return radial * radial / r + tangential * tangential / (b * ray[0] * ray[0])


@row_kernel
def motion_of(
    mean: Array,
    cov: Array,
    i: int,
    j: int,
    chosen: Index,
    landmark: Index,
    ranges: Array,
    bearings: Array,
    positions: Array,
    noise: Array,
) -> tuple[float, float, float, float]:
    """Pose by two matches, (x, y, heading) in m and rad, and the variance of its heading.

    The heading is the mean of the one two points give and the believed one, weighted by their variances: two points
    that are close together say little about it.
    """
    a, b = chosen[i], chosen[j]
    ax, ay = ranges[a] * math.cos(bearings[a]), ranges[a] * math.sin(bearings[a])
    bx, by = ranges[b] * math.cos(bearings[b]), ranges[b] * math.sin(bearings[b])
    p, q = landmark[a], landmark[b]
    ux, uy = positions[q, 0] - positions[p, 0], positions[q, 1] - positions[p, 1]
    length2 = max(ux * ux + uy * uy, 1e-12)
    ra, ba = variances(ranges[a], noise)
    rb, bb = variances(ranges[b], noise)
    blur = 0.5 * (ra + rb + ba * ranges[a] * ranges[a] + bb * ranges[b] * ranges[b])
    of_pair = blur / length2
    turn = wrapped(math.atan2(uy, ux) - math.atan2(by - ay, bx - ax) - mean[2])
    weight = cov[2, 2] / (cov[2, 2] + of_pair) if of_pair < math.inf else 0.0
    heading = mean[2] + weight * turn
    c, s = math.cos(heading), math.sin(heading)
    mx, my = 0.5 * (ax + bx), 0.5 * (ay + by)
    x = 0.5 * (positions[p, 0] + positions[q, 0]) - c * mx + s * my
    y = 0.5 * (positions[p, 1] + positions[q, 1]) - s * mx - c * my
    return x, y, heading, weight * of_pair


@row_kernel
def draw(state: int, n: int) -> tuple[int, int]:
    """Next state of a linear congruential generator (modulo 2^31) and a number below n."""
    state = (1103515245 * state + 12345) % 2147483648
    return state, (state >> 8) % n


@row_kernel
def agreeing(
    inlier: NDArray[np.bool_], pose: Array, places: Array, rays: Array, noise: Array, wide: float, v: float, gate: float
) -> None:
    """Set which matches agree with a pose (3,), for `wide` times their variances and v rad^2 more of the bearing."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for m in range(inlier.size):
        r, b = variances(rays[m, 0], noise)
        inlier[m] = misfit(pose[0], pose[1], c, s, places[m], rays[m], wide * r, wide * b + v) < gate


@row_kernel
def refined(
    pose: Array,
    mean: Array,
    information: Array,
    chosen: Index,
    inlier: NDArray[np.bool_],
    landmark: Index,
    ranges: Array,
    bearings: Array,
    positions: Array,
    noise: Array,
) -> Array:
    """Pose (3,) of least squares by the inliers and the belief, from a first one; three steps of Gauss and Newton."""
    for _ in range(3):
        a, v = information.copy(), np.zeros(3)
        turn = wrapped(mean[2] - pose[2])
        for i in range(3):
            v[i] = information[i, 0] * (mean[0] - pose[0]) + information[i, 1] * (mean[1] - pose[1])
            v[i] += information[i, 2] * turn
        for m in range(chosen.size):
            if not inlier[m]:
                continue
            d = chosen[m]
            dx, dy = positions[landmark[d], 0] - pose[0], positions[landmark[d], 1] - pose[1]
            q2 = max(dx * dx + dy * dy, 1e-12)
            q = math.sqrt(q2)
            r, b = variances(ranges[d], noise)
            h = np.array([[-dx / q, -dy / q, 0.0], [dy / q2, -dx / q2, -1.0]])
            nu = (ranges[d] - q, wrapped(bearings[d] - math.atan2(dy, dx) + pose[2]))
            for k in range(2):
                w = 1.0 / r if k == 0 else 1.0 / b
                for i in range(3):
                    v[i] += w * h[k, i] * nu[k]
                    for j in range(3):
                        a[i, j] += w * h[k, i] * h[k, j]
        step = solve3(a, v)
        pose = pose + step
    return pose


@row_kernel
def consensus(
    mean: Array,
    cov: Array,
    chosen: Index,
    landmark: Index,
    ranges: Array,
    bearings: Array,
    positions: Array,
    noise: Array,
    limits: Array,
    seed: int,
) -> NDArray[np.bool_]:
    """Which of the chosen matches (k,) agree with the best rigid motion through two of them.

    The best motion has the least sum over all matches of min(misfit, gate) + ln(b'/b) (MSAC; b' is the variance of the
    bearing with that of the motion's heading: a loose motion explains everything). It is refined by least squares over
    its inliers and the belief; what then differs by less than limits[SPREAD] times the variances stays. All pairs are
    tried if they are at most limits[PAIRS], else as many drawn at random.
    """
    k = chosen.size
    inlier = np.ones(k, dtype=np.bool_)
    if k < 2:
        return inlier
    pairs, most, gate = k * (k - 1) // 2, int(limits[PAIRS]), limits[GATE]
    every = pairs <= most
    best, state, i, j = math.inf, seed % 2147483648, 0, 0
    pose, loose = np.zeros(3), 0.0
    places, rays = np.empty((k, 2)), np.empty((k, 3))
    for m in range(k):
        d = chosen[m]
        places[m] = positions[landmark[d]]
        rays[m, 0], rays[m, 1], rays[m, 2] = ranges[d], math.cos(bearings[d]), math.sin(bearings[d])
    for _ in range(pairs if every else most):
        if every:
            j += 1
            if j == k:
                i += 1
                j = i + 1
        else:
            state, i = draw(state, k)
            state, j = draw(state, k - 1)
            j += 1 if j >= i else 0
        x, y, heading, v = motion_of(mean, cov, i, j, chosen, landmark, ranges, bearings, positions, noise)
        total, c, s = 0.0, math.cos(heading), math.sin(heading)
        looseness = math.log1p(v / (2.0 * variances(0.0, noise)[1]))
        for m in range(k):
            r, b = variances(rays[m, 0], noise)
            total += min(gate, misfit(x, y, c, s, places[m], rays[m], 2.0 * r, 2.0 * b + v) + looseness)
            if total >= best:
                break
        if total < best:
            best, loose = total, v
            pose[0], pose[1], pose[2] = x, y, heading
    agreeing(inlier, pose, places, rays, noise, 2.0, loose, gate)
    information = inverse3(np.ascontiguousarray(cov[:3, :3]))[0]
    for _ in range(2):
        pose = refined(pose, mean, information, chosen, inlier, landmark, ranges, bearings, positions, noise)
        agreeing(inlier, pose, places, rays, noise, limits[SPREAD], 0.0, gate)
    return inlier


@row_kernel
def match(
    mean: Array,
    cov: Array,
    ranges: Array,
    bearings: Array,
    looks: Array,
    positions: Array,
    map_looks: Array,
    grid: Array,
    starts: Index,
    members: Index,
    noise: Array,
    limits: Array,
    seed: int,
) -> tuple[Index, Index, Array, Array, Index]:
    """Associate the detections of one frame with landmarks.

    Args:
        mean: believed x, y (m, frame map) and heading (rad), (3,) or longer.
        cov: its covariance, (3, 3) or larger.
        ranges: m, (m,).
        bearings: rad, (m,).
        looks: descriptors of the detections, (m, k).
        positions: of the landmarks, (n, 2) m, frame map.
        map_looks: descriptors of the landmarks, (n, k).
        grid: of the index of places, (5,), see `landmarks.Buckets`.
        starts: of the index.
        members: of the index.
        noise: see the indices in this module, (5,).
        limits: likewise, (8,).
        seed: of the random pairs.

    Returns:
        Landmark of each detection or -1, what became of each (MATCHED ...), normalised innovation squared, square of
        the distance of the descriptors, all (m,), and the matched detections, those first that look most alike.
    """
    m = ranges.size
    landmark, fate = np.full(m, -1), np.full(m, INVALID)
    nis, gap = np.zeros(m), np.zeros(m)
    for d in range(m):
        finite = math.isfinite(ranges[d]) and math.isfinite(bearings[d])
        for i in range(looks.shape[1]):
            finite = finite and math.isfinite(looks[d, i])
        if finite and limits[SHORTEST] <= ranges[d] <= limits[LONGEST]:
            landmark[d], fate[d], nis[d], gap[d] = nearest_look(
                mean, cov, ranges[d], bearings[d], looks[d], positions, map_looks, grid, starts, members, noise, limits
            )
    chosen = np.flatnonzero(fate == MATCHED)
    chosen = chosen[order_of(gap[chosen], landmark[chosen])]
    kept = 0
    for a in range(chosen.size):  # of several detections of one landmark the one that looks most like it
        d = chosen[a]
        for b in range(kept):
            if landmark[chosen[b]] == landmark[d]:
                fate[d] = DOUBLED
        if fate[d] == MATCHED:
            chosen[kept] = d
            kept += 1
    chosen = chosen[:kept]
    inlier = consensus(mean, cov, chosen, landmark, ranges, bearings, positions, noise, limits, seed)
    most, kept = int(limits[MOST]), 0
    for a in range(chosen.size):
        d = chosen[a]
        if not inlier[a]:
            fate[d] = OUTLIER
        elif kept >= most:
            fate[d] = SURPLUS
        else:
            chosen[kept] = d
            kept += 1
    for d in range(m):
        if fate[d] != MATCHED:
            landmark[d] = -1
    return landmark, fate, nis, gap, chosen[:kept]


@row_kernel
def likeness(look: Array, columns: Array, out: Array) -> None:
    """Square of the distance of a descriptor (k,) to each of a map (k, n) into out (n,), every sum in index order."""
    for i in range(out.size):
        out[i] = 0.0
    for j in range(look.size):
        for i in range(out.size):
            d = columns[j, i] - look[j]
            out[i] += d * d


@row_kernel
def known_anywhere(looks: Array, wanted: Index, columns: Array, look: float) -> int:
    """Count of wanted detections that look like some landmark of the map.

    Args:
        looks: descriptors of the detections, (m, k).
        wanted: detections to look up, (w,).
        columns: descriptors of the landmarks, (k, n).
        look: largest distance of two descriptors of one landmark.
    """
    found, gap = 0, np.empty(columns.shape[1])
    for w in wanted:
        likeness(looks[w], columns, gap)
        for i in range(gap.size):
            if gap[i] < look * look:
                found += 1
                break
    return found
