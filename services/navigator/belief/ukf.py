"""Unscented Kalman filter of a pose in the map, as kernels on arrays that are changed in place.

State mean (n,): x, y in m and heading theta in rad, frame map; from n = 4 on also the drift b in rad per m walked. The
states behind the fourth are nuisances, errors that observations have in common (an unknown tilt of the camera, for
example). cov (n, n) is its covariance. Sigma points are Julier's with kappa 0: L L^T = n cov, mean + and - each column
of L, all of weight 1 / (2 n); they are drawn anew for every prediction and every landmark. L is a lower triangle, so
only its first two columns move the position: five positions stand for all 2 n points of a landmark.

A motion carries the state over:

    theta' = theta + turn + b walked
    (x, y)' = (x, y) + R(theta + (turn + b walked) / 2) (forward, left)

and a landmark at l is seen, with z the nuisances, at

    r = |l - (x, y)| + gain[0] z,    phi = wrap(atan2(l_y - y, l_x - x) - theta + gain[1] z)

Equal to filterpy's UnscentedKalmanFilter with JulierSigmaPoints(n, kappa=0), Q = 0 and the noise added by hand.
"""

import math
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.kernels.jit import row_kernel

Pose = tuple[float, float, float]
"""x and y in m, heading in rad, frame map."""

X, Y, THETA, DRIFT, NUISANCE = 0, 1, 2, 3, 4  # parts of the state
ALONG, ACROSS, HEADING, DRIFTING = 0, 1, 2, 3  # parts of the noise
TURN = 2.0 * math.pi
ENTROPY_OF_UNIT = 1.5 * math.log(2.0 * math.pi * math.e)  # nats, of three independent unit variances


class LandmarkSighting(NamedTuple):
    """Landmark of the map with the range and bearing that a camera measured."""

    x: float
    """x of the landmark, m, frame map."""
    y: float
    """y of the landmark, m, frame map."""
    range: float
    """Measured distance of the landmark from base_link along the floor, m."""
    bearing: float
    """Measured bearing of the landmark, rad, left of the heading positive."""
    var_range: float
    """Variance of the measured range, m^2."""
    var_bearing: float
    """Variance of the measured bearing, rad^2."""


@row_kernel
def wrap(angle: float) -> float:
    """Return an angle wrapped to [-pi, pi), rad."""
    return angle - TURN * math.floor((angle + math.pi) / TURN)


def work_space(n: int) -> Array:
    """Return the scratch array that the kernels for n states need: (3 n, max(n, 4)) zeros, no unit."""
    return np.zeros((3 * n, max(n, 4)))


@row_kernel
def spread(cov: Array, low: Array) -> None:
    """Write the lower triangle L with L L^T = n cov into the first n rows of `low`, (n or more, n or more).

    cov (n, n): covariance of x, y (m), heading (rad) and more; L has the units of the states. A state without variance
    gets zeros.
    """
    n = cov.shape[0]
    for j in range(n):
        pivot = n * cov[j, j]
        for k in range(j):
            pivot -= low[j, k] * low[j, k]
        root = math.sqrt(pivot) if pivot > 0.0 else 0.0
        low[j, j] = root
        for i in range(j):
            low[i, j] = 0.0
        for i in range(j + 1, n):
            rest = n * cov[i, j]
            for k in range(j):
                rest -= low[i, k] * low[j, k]
            low[i, j] = rest / root if root > 0.0 else 0.0


@row_kernel
def _displace(
    mean: Array, change: float, forward: float, left: float, walked: float, work: Array
) -> tuple[float, float]:
    """Return the mean displacement of x and y, m, of the 2 n sigma points over a motion; `work` keeps each point's own.

    Args:
        mean: x, y (m), heading (rad), frame map, from n = 4 on drift (rad per m walked), then other states, (n,).
        change: change of the mean's heading over the motion, drift included, rad.
        forward: distance along the heading half-way through the turn, m.
        left: distance to the left of that heading, m.
        walked: distance over which the drift acts, m.
        work: (3 n, max(n, 4)). Read: rows 0 .. n - 1, the lower triangle L with L L^T = n cov. Written: new x and y
            less their old means, m, of the points mean + column of L (rows n .. 2 n - 1) and mean - column (the last n
            rows); row 2 of L, the heading, gets the turn that the column's drift adds.
    """
    n = mean.size
    drifts = n > DRIFT
    middle = mean[THETA] + 0.5 * change
    cos_m, sin_m = math.cos(middle), math.sin(middle)
    mean_x, mean_y = 0.0, 0.0
    for j in range(n):
        d_theta = work[THETA, j]
        d_change = work[DRIFT, j] * walked if drifts else 0.0
        c, s = math.cos(d_theta + 0.5 * d_change), math.sin(d_theta + 0.5 * d_change)
        for half in range(2):
            sign = 1.0 - 2.0 * half
            cos_p, sin_p = cos_m * c - sign * sin_m * s, sin_m * c + sign * cos_m * s
            row = n + n * half + j
            work[row, X] = sign * work[X, j] + forward * cos_p - left * sin_p
            work[row, Y] = sign * work[Y, j] + forward * sin_p + left * cos_p
            mean_x += work[row, X]
            mean_y += work[row, Y]
        work[THETA, j] += d_change
    return mean_x / (2.0 * n), mean_y / (2.0 * n)


@row_kernel
def _offsets(work: Array, n: int, i: int, j: int, mean: float) -> tuple[float, float]:
    """Return how far element i of the state lies from its mean, in its unit, at the two sigma points of column j of L.

    Args:
        work: (3 n, max(n, 4)): lower triangle L with L L^T = n cov in the first n rows, then x and y displacements, m,
            of the n points mean + column and of the n points mean - column.
        n: number of states.
        i: element of the state: 0 x, 1 y, 2 heading, 3 drift, 4 and more errors that observations share.
        j: column of L.
        mean: mean displacement of x or y, m; used for i < 2 only.
    """
    if i < THETA:
        return work[n + j, i] - mean, work[2 * n + j, i] - mean
    return work[i, j], -work[i, j]


@row_kernel
def predict(
    mean: Array, cov: Array, forward: float, left: float, turn: float, walked: float, noise: Array, work: Array
) -> None:
    """Predict the belief over a motion: `mean` and `cov` are replaced.

    Args:
        mean: x, y (m), heading (rad), frame map, from n = 4 on drift (rad per m walked), then other states, (n,).
        cov: covariance, (n, n).
        forward: distance ahead, m, along the heading half-way through the turn.
        left: distance to the left of that heading, m.
        turn: commanded or measured change of heading, rad.
        walked: distance over which the drift acts, m; 0 where the heading is measured.
        noise: variances (4,) of the motion along and across (m^2) the heading half-way, of the heading (rad^2) and of
            the drift (rad^2 per m^2), added after the transform.
        work: scratch, (3 n, max(n, 4)).
    """
    n = mean.size
    spread(cov, work)
    drifts = n > DRIFT
    change = turn + (mean[DRIFT] * walked if drifts else 0.0)
    middle = mean[THETA] + 0.5 * change
    cos_m, sin_m = math.cos(middle), math.sin(middle)
    mean_x, mean_y = _displace(mean, change, forward, left, walked, work)
    for i in range(n):
        for k in range(i + 1):
            total = 0.0
            for j in range(n):
                above_i, below_i = _offsets(work, n, i, j, mean_x if i == X else mean_y)
                above_k, below_k = _offsets(work, n, k, j, mean_x if k == X else mean_y)
                total += above_i * above_k + below_i * below_k
            cov[i, k] = total / (2.0 * n)
    cov[X, X] += noise[ALONG] * cos_m * cos_m + noise[ACROSS] * sin_m * sin_m
    cov[Y, X] += (noise[ALONG] - noise[ACROSS]) * cos_m * sin_m
    cov[Y, Y] += noise[ALONG] * sin_m * sin_m + noise[ACROSS] * cos_m * cos_m
    cov[THETA, THETA] += noise[HEADING]
    if drifts:
        cov[DRIFT, DRIFT] += noise[DRIFTING]
    for i in range(n):
        for k in range(i):
            cov[k, i] = cov[i, k]
    mean[X] += mean_x
    mean[Y] += mean_y
    mean[THETA] = wrap(mean[THETA] + change)


@row_kernel
def innovation(
    mean: Array, cov: Array, seen: LandmarkSighting, gain: Array, work: Array
) -> tuple[float, float, float, float, float]:
    """Return the innovation of range (m) and bearing (rad, wrapped), and its covariance (m^2, m rad, rad^2).

    Innovation: what is seen less what the belief expects. Rows n .. 2 n - 1 of `work` hold range and bearing of the
    sigma points mean + column less their means (columns 0, 1) and those of mean - column (2, 3). The belief stays as it
    is.

    Args:
        mean: x, y (m), heading (rad), frame map, drift (rad per m), errors z that sightings share, (n,).
        cov: covariance, (n, n).
        seen: place of the landmark in the map, range and bearing at which it is seen, their variances.
        gain: change of range (row 0) and bearing (row 1) by each of z, (2, n - 4), or (2, 0) for n <= 4.
        work: scratch, (3 n, max(n, 4)).
    """
    n = mean.size
    spread(cov, work)
    dx, dy = seen.x - mean[X], seen.y - mean[Y]
    r_mean, a_mean = math.sqrt(dx * dx + dy * dy), math.atan2(dy, dx)
    sum_r, sum_a = 0.0, 0.0  # of the points, range less that of the mean, bearing less that of the mean
    for j in range(n):
        d_theta = work[THETA, j]
        dr, da = 0.0, 0.0
        for m in range(n - NUISANCE):
            dr += gain[0, m] * work[NUISANCE + m, j]
            da += gain[1, m] * work[NUISANCE + m, j]
        for half in range(2):
            sign = 1.0 - 2.0 * half
            r, a = 0.0, 0.0
            if j < THETA:
                px, py = dx - sign * work[X, j], dy - sign * work[Y, j]
                r = math.sqrt(px * px + py * py) - r_mean
                a = math.atan2(py, px) - a_mean
            r += sign * dr
            a = wrap(a - sign * (d_theta - da))
            work[n + j, 2 * half] = r
            work[n + j, 2 * half + 1] = a
            sum_r += r
            sum_a += a
    sum_r /= 2.0 * n
    sum_a /= 2.0 * n
    s00, s01, s11 = 0.0, 0.0, 0.0
    for j in range(n):
        for half in range(2):
            work[n + j, 2 * half] -= sum_r
            work[n + j, 2 * half + 1] -= sum_a
            r, a = work[n + j, 2 * half], work[n + j, 2 * half + 1]
            s00 += r * r
            s01 += r * a
            s11 += a * a
    s00 = s00 / (2.0 * n) + seen.var_range
    s01 = s01 / (2.0 * n)
    s11 = s11 / (2.0 * n) + seen.var_bearing
    r, a = r_mean + sum_r, a_mean - mean[THETA] + sum_a
    for m in range(n - NUISANCE):
        r += gain[0, m] * mean[NUISANCE + m]
        a += gain[1, m] * mean[NUISANCE + m]
    return seen.range - r, wrap(seen.bearing - a), s00, s01, s11


@row_kernel
def update(mean: Array, cov: Array, seen: LandmarkSighting, gain: Array, work: Array) -> float:
    """Correct the belief with one detected landmark: `mean` and `cov` are replaced.

    Args:
        mean: x, y (m), heading (rad), frame map, drift (rad per m), errors z that sightings share, (n,).
        cov: covariance, (n, n).
        seen: place of the landmark in the map, range and bearing at which it is seen, their variances.
        gain: change of range (row 0) and bearing (row 1) by each of z, (2, n - 4), or (2, 0) for n <= 4.
        work: scratch, (3 n, max(n, 4)).

    Returns:
        Normalised innovation squared before the correction, 2 degrees of freedom.
    """
    n = mean.size
    v0, v1, s00, s01, s11 = innovation(mean, cov, seen, gain, work)
    det = s00 * s11 - s01 * s01
    i00, i01, i11 = s11 / det, -s01 / det, s00 / det
    for i in range(n):
        c0, c1 = 0.0, 0.0
        for j in range(min(i + 1, n)):
            c0 += work[i, j] * (work[n + j, 0] - work[n + j, 2])
            c1 += work[i, j] * (work[n + j, 1] - work[n + j, 3])
        c0 /= 2.0 * n
        c1 /= 2.0 * n
        work[2 * n + i, 0] = c0  # cross covariance of state and observation
        work[2 * n + i, 1] = c1
        work[2 * n + i, 2] = c0 * i00 + c1 * i01  # gain of the filter
        work[2 * n + i, 3] = c0 * i01 + c1 * i11
    for i in range(n):
        mean[i] += work[2 * n + i, 2] * v0 + work[2 * n + i, 3] * v1
        for k in range(i + 1):
            cov[i, k] -= work[2 * n + i, 2] * work[2 * n + k, 0] + work[2 * n + i, 3] * work[2 * n + k, 1]
            cov[k, i] = cov[i, k]
    mean[THETA] = wrap(mean[THETA])
    return v0 * (i00 * v0 + i01 * v1) + v1 * (i01 * v0 + i11 * v1)


@row_kernel
def entropy(cov: Array) -> float:
    """Return the differential entropy h = 1/2 ln((2 pi e)^3 det S) of a pose, nats; -inf where S is singular.

    cov: covariance of x, y (m), heading (rad) and more, (3, 3) or larger; S is its first 3x3 block.
    """
    l00 = cov[0, 0]
    if l00 <= 0.0:
        return -math.inf
    l11 = cov[1, 1] - cov[1, 0] * cov[1, 0] / l00
    if l11 <= 0.0:
        return -math.inf
    m = cov[2, 1] - cov[2, 0] * cov[1, 0] / l00
    l22 = cov[2, 2] - cov[2, 0] * cov[2, 0] / l00 - m * m / l11
    if l22 <= 0.0:
        return -math.inf
    return ENTROPY_OF_UNIT + 0.5 * (math.log(l00) + math.log(l11) + math.log(l22))
