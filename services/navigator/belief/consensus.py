"""Consensus of the matches of a frame on one rigid motion of the robot; kernels of data association."""

import math
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Flags, Ints, Record, named
from surefoot.geometry.linear_kernels import inverse3, solve3
from surefoot.kernels.jit import row_kernel

from .gate import FrameTables, MatchLimits, SightNoise, variances
from .ukf import THETA, X, Y, wrap

RAY = named("distance cos sin bearing")


class Matched(NamedTuple):
    """Matched detections of one frame and their landmarks in the map, a match a row."""

    places: Array
    """Positions of the matched landmarks, (k, 2) m, frame map."""
    rays: Record
    """Rays from base_link to the matched detections, (k,) records: distance (m), cosine, sine of the bearing, bearing
    (rad)."""


@row_kernel
def draw(state: int, n: int) -> tuple[int, int]:
    """Return the next state of a linear congruential generator (modulo 2^31) and a number from 0 to n - 1.

    `state`: of the generator, 0 to 2^31 - 1.
    """
    state = (1103515245 * state + 12345) % 2147483648
    return state, (state >> 8) % n


@row_kernel
def matched_of(chosen: Ints, landmark: Ints, frame: FrameTables, positions: Array) -> Matched:
    """Return the places of landmarks, frame map, and the rays to them for the chosen detections of a frame.

    Args:
        chosen: indices of detections, (k,).
        landmark: index in the map of the landmark of each detection, (m,).
        frame: the m detections: ranges, bearings, descriptors.
        positions: landmarks of the map, (n, 2) m, frame map.
    """
    k = chosen.size
    found = Matched(np.empty((k, 2)), np.empty(k, RAY))
    for m in range(k):
        d = int(chosen[m])
        ray, found.places[m] = found.rays[m], positions[landmark[d]]
        ray.distance, ray.bearing = frame.ranges[d], frame.bearings[d]
        ray.cos, ray.sin = math.cos(ray.bearing), math.sin(ray.bearing)
    return found


@row_kernel
def misfit(x: float, y: float, c: float, s: float, place: Array, ray: Record, r: float, b: float) -> float:
    """Return the squared residual of a detection at an assumed pose over its variances, 2 degrees of freedom.

    Radial and tangential part of the vector from the detection to the landmark, in heading axes: no angles, no roots.

    Args:
        x: x of the pose, m, frame map.
        y: y of the pose, m, frame map.
        c: cosine of its heading.
        s: sine of its heading.
        place: place of the landmark, (2,) m, frame map.
        ray: one record RAY: distance (m), cosine and sine of the bearing, bearing (rad).
        r: variance of the range, m^2.
        b: variance of the bearing, rad^2.
    """
    dx, dy = place[0] - x, place[1] - y
    ax, ay = c * dx + s * dy, c * dy - s * dx
    radial = ray.cos * ax + ray.sin * ay - ray.distance
    tangential = ray.cos * ay - ray.sin * ax
    return radial * radial / r + tangential * tangential / (b * ray.distance * ray.distance)


@row_kernel
def motion_of(
    mean: Array, cov: Array, i: int, j: int, found: Matched, noise: SightNoise
) -> tuple[float, float, float, float]:
    """Return the pose by matches i and j, x and y in m and heading in rad, and the variance of its heading, rad^2.

    The heading is the mean of the one that two points give and the believed one, weighted by their variances: two
    points close together determine it poorly.

    Args:
        mean: believed x, y (m), heading (rad), frame map, (3,) or longer.
        cov: covariance of `mean`, (3, 3) or larger.
        i: index of a match.
        j: index of another match.
        found: matches: places of landmarks and rays to them.
        noise: standard deviations of range and bearing of a detection.
    """
    one, other, places = found.rays[i], found.rays[j], found.places
    ax, ay = one.distance * one.cos, one.distance * one.sin
    bx, by = other.distance * other.cos, other.distance * other.sin
    ux, uy = places[j, 0] - places[i, 0], places[j, 1] - places[i, 1]
    length2 = max(ux * ux + uy * uy, 1e-12)
    ra, ba = variances(one.distance, noise)
    rb, bb = variances(other.distance, noise)
    blur = 0.5 * (ra + rb + ba * one.distance * one.distance + bb * other.distance * other.distance)
    of_pair = blur / length2
    turn = wrap(math.atan2(uy, ux) - math.atan2(by - ay, bx - ax) - mean[THETA])
    weight = cov[THETA, THETA] / (cov[THETA, THETA] + of_pair) if of_pair < math.inf else 0.0
    heading = mean[THETA] + weight * turn
    c, s = math.cos(heading), math.sin(heading)
    mx, my = 0.5 * (ax + bx), 0.5 * (ay + by)
    x = 0.5 * (places[i, 0] + places[j, 0]) - c * mx + s * my
    y = 0.5 * (places[i, 1] + places[j, 1]) - s * mx - c * my
    return x, y, heading, weight * of_pair


@row_kernel
def agreeing(inlier: Flags, pose: Array, found: Matched, noise: SightNoise, wide: float, v: float, gate: float) -> None:
    """Set in `inlier` which matches agree with a pose: their squared residual over the variances is below `gate`.

    Args:
        inlier: written, (k,) bool.
        pose: x and y in m and heading in rad, frame map, (3,).
        found: k matches: places of landmarks and rays to them.
        noise: standard deviations of range and bearing of a detection.
        wide: factor of the variances of range and bearing.
        v: variance that is added to that of the bearing, rad^2.
        gate: largest squared residual over the variances.
    """
    c, s = math.cos(pose[THETA]), math.sin(pose[THETA])
    for m in range(inlier.size):
        r, b = variances(found.rays[m].distance, noise)
        off = misfit(pose[X], pose[Y], c, s, found.places[m], found.rays[m], wide * r, wide * b + v)
        inlier[m] = off < gate


@row_kernel
def refined(pose: Array, mean: Array, information: Array, inlier: Flags, found: Matched, noise: SightNoise) -> Array:
    """Return the least-squares pose by inliers and belief, (3,): x and y in m, heading in rad, frame map.

    Three steps of Gauss and Newton.

    Args:
        pose: where the steps begin, x and y in m and heading in rad, (3,).
        mean: believed x, y (m), heading (rad), frame map, (3,) or longer.
        information: inverse of the covariance of the belief, (3, 3).
        inlier: True for matches that count, (k,).
        found: k matches: places of landmarks and rays to them.
        noise: standard deviations of range and bearing of a detection.
    """
    for _ in range(3):
        a, v = information.copy(), np.zeros(3)
        turn = wrap(mean[THETA] - pose[THETA])
        for i in range(3):
            v[i] = information[i, 0] * (mean[X] - pose[X]) + information[i, 1] * (mean[Y] - pose[Y])
            v[i] += information[i, 2] * turn
        for m in range(inlier.size):
            if not inlier[m]:
                continue
            distance, bearing = found.rays[m].distance, found.rays[m].bearing
            dx, dy = found.places[m, 0] - pose[X], found.places[m, 1] - pose[Y]
            q2 = max(dx * dx + dy * dy, 1e-12)
            q = math.sqrt(q2)
            r, b = variances(distance, noise)
            h = np.array([[-dx / q, -dy / q, 0.0], [dy / q2, -dx / q2, -1.0]])
            nu = (distance - q, wrap(bearing - math.atan2(dy, dx) + pose[THETA]))
            for k in range(2):
                w = 1.0 / r if k == 0 else 1.0 / b
                for i in range(3):
                    v[i] += w * h[k, i] * nu[k]
                    for j in range(3):
                        a[i, j] += w * h[k, i] * h[k, j]
        pose = pose + solve3(a, v)
    return pose


@row_kernel
def _best_motion(
    mean: Array, cov: Array, found: Matched, noise: SightNoise, limits: MatchLimits, seed: int
) -> tuple[Array, float]:
    """Return the pose of the best motion through two matches, and the variance of its heading, rad^2.

    The pose is x and y in m and heading in rad, frame map, (3,). The best one has the least sum over all matches of
    their bounded squared residuals.

    Args:
        mean: believed x, y (m), heading (rad), frame map, (3,) or longer.
        cov: covariance of `mean`, (3, 3) or larger.
        found: k matches: places of landmarks and rays to them.
        noise: standard deviations of range and bearing of a detection.
        limits: largest residual (gate) and number of pairs that are tried.
        seed: seed of the pairs that are tried.
    """
    k = found.places.shape[0]
    pairs, most, gate = k * (k - 1) // 2, limits.pairs, limits.gate
    every = pairs <= most
    best, state, i, j = math.inf, seed % 2147483648, 0, 0
    pose, loose = np.zeros(3), 0.0
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
        x, y, heading, v = motion_of(mean, cov, i, j, found, noise)
        total, c, s = 0.0, math.cos(heading), math.sin(heading)
        looseness = math.log1p(v / (2.0 * variances(0.0, noise)[1]))
        for m in range(k):
            r, b = variances(found.rays[m].distance, noise)
            off = misfit(x, y, c, s, found.places[m], found.rays[m], 2.0 * r, 2.0 * b + v)
            total += min(gate, off + looseness)
            if total >= best:
                break
        if total < best:
            best, loose = total, v
            pose[X], pose[Y], pose[THETA] = x, y, heading
    return pose, loose


@row_kernel
def consensus(mean: Array, cov: Array, found: Matched, noise: SightNoise, limits: MatchLimits, seed: int) -> Flags:
    """Return True, (k,), for the matches that agree with the best rigid motion through two of them; one alone agrees.

    The best motion has the least sum over all matches of min(misfit, gate) + ln(b'/b) (MSAC; b' is the variance of the
    bearing with that of the motion's heading: a loose motion explains everything). It is refined by least squares over
    its inliers and the belief; matches that then differ by less than `limits.spread` times the variances stay. All
    pairs are tried if they are at most `limits.pairs`, else as many drawn at random.

    Args:
        mean: believed x, y (m), heading (rad), frame map, (3,) or longer.
        cov: covariance of `mean`, (3, 3) or larger.
        found: k matches.
        noise: standard deviations of range and bearing of a detection.
        limits: limits of gate, spread and pairs.
        seed: seed of the random pairs.
    """
    inlier = np.ones(found.places.shape[0], dtype=np.bool_)
    if inlier.size < 2:
        return inlier
    pose, loose = _best_motion(mean, cov, found, noise, limits, seed)
    agreeing(inlier, pose, found, noise, 2.0, loose, limits.gate)
    information = inverse3(cov)[0]  # of the pose: it reads the first three rows and columns
    for _ in range(2):
        pose = refined(pose, mean, information, inlier, found, noise)
        agreeing(inlier, pose, found, noise, limits.spread, 0.0, limits.gate)
    return inlier
