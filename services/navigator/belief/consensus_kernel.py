"""Kernels of data association: which matches of a frame agree with one rigid motion of the robot."""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.linear_kernels import inverse3, solve3
from surefoot.kernels.jit import row_kernel

from .gate_kernel import GATE, PAIRS, SPREAD, variances, wrapped

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@row_kernel
def draw(state: int, n: int) -> tuple[int, int]:
    """Next state of a linear congruential generator (modulo 2^31) and a number below n."""
    state = (1103515245 * state + 12345) % 2147483648
    return state, (state >> 8) % n


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
    a, b = int(chosen[i]), int(chosen[j])
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
            d = int(chosen[m])
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
        d = int(chosen[m])
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
    information = inverse3(cov)[0]  # of the pose: it reads the first three rows and columns
    for _ in range(2):
        pose = refined(pose, mean, information, chosen, inlier, landmark, ranges, bearings, positions, noise)
        agreeing(inlier, pose, places, rays, noise, limits[SPREAD], 0.0, gate)
    return inlier
