"""Likelihood of a recording under given noises: the product of the densities of the filter's innovations.

-2 ln L = sum over sightings of nu^T S^-1 nu + ln det S + 2 ln 2 pi, nu the innovation of range and bearing and S its
covariance, both by the unscented filter that the navigator runs (prediction error decomposition; Harvey 1989). The
effect of a tilt is computed at the predicted position of a landmark; at the observed one, whose noise a mean tilt
scales, the fitted noise of ranges would be 12 % too small for 2 deg.
"""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.kernels.jit import free_kernel
from surefoot.services.navigator.belief.common_errors import ERRORS, fade, fill_gain
from surefoot.services.navigator.belief.ukf import NUISANCE, LandmarkSighting, predict, update, wrap

from .events import MOVE, SEE

ALONG, ACROSS, HEADING, TURN_PLACE, TURN_HEADING = 0, 1, 2, 3, 4  # sd of a whole action, m and rad
RANGE, SHARE, BEARING, STANDING, TILT, DRIFT, WANDER = 5, 6, 7, 8, 9, 10, 11
FORWARD, TURNED = 12, 13  # way and turn as parts of the commanded ones
SWAY, PITCH = 14, 15  # m; rad, mean of the tilt
ARC_ALONG, ARC_ACROSS, ARC_HEADING, ARC_FORWARD, ARC_TURNED = 16, 17, 18, 19, 20  # as above, of arcs
PARAMETERS = 21
ON_THE_SPOT, STRAIGHT, ARC = 0, 1, 2  # groups of actions
LOG_2PI = math.log(2.0 * math.pi)


@free_kernel
def _move(event: Array, actions: Array, theta: Array, mean: Array, cov: Array, noise: Array, work: Array) -> None:
    """Predict the filter's mean and covariance over a share of an action, in place.

    Args:
        event: motion, (6,): kind, index of the action, share of the action, then unused columns.
        actions: forward distance (m), turn (rad), group (0 on the spot, 1 straight, 2 arc) of each action, (A, 3).
        theta: parameters, (21,), SI: noises, factors and biases at the indices of this module.
        mean: belief, (n,): x, y m, heading rad (map), drift rad/m, then errors of pitch, roll (rad) and sway (m).
        cov: covariance of the belief, (n, n).
        noise: scratch, (4,).
        work: scratch, (3 n, max(n, 4)).
    """
    a, share = int(event[1]), event[2]
    forward, turn, group = actions[a, 0], actions[a, 1], int(actions[a, 2])
    if group == ON_THE_SPOT:
        noise[0] = noise[1] = theta[TURN_PLACE] ** 2 * share
        noise[2], noise[3] = theta[TURN_HEADING] ** 2 * share, 0.0
        turn *= theta[TURNED]
    else:
        first = ARC_ALONG if group == ARC else ALONG
        noise[0], noise[1] = theta[first] ** 2 * share, theta[first + 1] ** 2 * share
        noise[2], noise[3] = theta[first + 2] ** 2 * share, theta[WANDER] ** 2 * share
        forward *= theta[ARC_FORWARD] if group == ARC else theta[FORWARD]
        turn *= theta[ARC_TURNED] if group == ARC else 1.0
    predict(mean, cov, forward * share, 0.0, turn * share, actions[a, 0] * share, noise, work)


@free_kernel
def _see(event: Array, theta: Array, height: float, mean: Array, cov: Array, gain: Array, work: Array) -> float:
    """Correct the belief with a sighting of a landmark, in place; return -ln of the sighting's density.

    Args:
        event: sighting, (6,): kind, x and y of the landmark (m, map), range (m), bearing (rad), 1 if standing.
        theta: parameters, (21,), SI: noises, factors and biases at the indices of this module.
        height: height of the camera above the ground, m.
        mean: belief, (n,): x, y m, heading rad (map), drift rad/m, then errors of pitch, roll (rad) and sway (m).
        cov: covariance of the belief, (n, n).
        gain: scratch for the effect of pitch, roll and sway errors on range and bearing, (2, n - 4).
        work: scratch, (3 n, max(n, 4)).
    """
    n, r = mean.size, event[3]
    scale = theta[STANDING] if event[5] > 0.0 else 1.0
    var_r = scale * scale * (theta[RANGE] ** 2 + (theta[SHARE] * r) ** 2)
    var_b = (scale * theta[BEARING]) ** 2
    dx, dy = event[1] - mean[0], event[2] - mean[1]
    fill_gain(math.sqrt(dx * dx + dy * dy), wrap(math.atan2(dy, dx) - mean[2]), height, gain)
    nis = update(mean, cov, LandmarkSighting(event[1], event[2], r, event[4], var_r, var_b), gain, work)
    s00, s01, s11 = 0.0, 0.0, 0.0  # of the sigma points, which the update left in rows n .. 2 n - 1
    for j in range(n, 2 * n):
        s00 += work[j, 0] * work[j, 0] + work[j, 2] * work[j, 2]
        s01 += work[j, 0] * work[j, 1] + work[j, 2] * work[j, 3]
        s11 += work[j, 1] * work[j, 1] + work[j, 3] * work[j, 3]
    s00, s01, s11 = s00 / (2.0 * n) + var_r, s01 / (2.0 * n), s11 / (2.0 * n) + var_b
    return 0.5 * (nis + math.log(s00 * s11 - s01 * s01)) + LOG_2PI


@free_kernel
def minus_log_likelihood(
    events: Array, actions: Array, start: Array, sd_start: Array, theta: Array, height: float, fades: Array
) -> float:
    """Return the negative log-likelihood of the sightings of one recording under given parameters, nats.

    Args:
        events: motions (0, action, share), frames (1, s since the last), sightings (2, landmark x, y (m, map), range
            (m), bearing (rad), 1 if standing), (n, 6).
        actions: forward (m), turn (rad) and group (0 on the spot, 1 straight, 2 arc) of each action, (A, 3).
        start: x, y (m) and yaw (rad) at the start, map, (3,).
        sd_start: standard deviations of position (m) and heading (rad) at the start, (2,).
        theta: parameters, (21,), SI: noises, factors and biases at the indices of this module.
        height: height of the camera above the ground, m.
        fades: time constants of tilt and sway errors, s, (2,); 0 = independent from frame to frame.
    """
    n = NUISANCE + ERRORS if theta[TILT] > 0.0 or theta[SWAY] > 0.0 else NUISANCE
    mean, cov, gain, noise = np.zeros(n), np.zeros((n, n)), np.zeros((2, n - NUISANCE)), np.zeros(4)
    sds = np.array([theta[TILT], theta[TILT], theta[SWAY]])
    work, keeps = np.zeros((3 * n, max(n, 4))), np.zeros(3)
    mean[:3] = start
    cov[0, 0] = cov[1, 1] = sd_start[0] ** 2
    cov[2, 2] = sd_start[1] ** 2
    cov[3, 3] = theta[DRIFT] ** 2
    if n > NUISANCE:
        mean[NUISANCE] = theta[PITCH]
    for i in range(NUISANCE, n):
        cov[i, i] = sds[i - NUISANCE] ** 2
    total = 0.0
    for k in range(events.shape[0]):
        kind = events[k, 0]
        if kind == MOVE:
            _move(events[k], actions, theta, mean, cov, noise, work)
        elif kind == SEE:
            total += _see(events[k], theta, height, mean, cov, gain, work)
        elif n > NUISANCE:
            keeps[0] = keeps[1] = math.exp(-events[k, 1] / fades[0]) if fades[0] > 0.0 else 0.0
            keeps[2] = math.exp(-events[k, 1] / fades[1]) if fades[1] > 0.0 else 0.0
            fade(mean, cov, keeps, sds, theta[PITCH])
    return total


@free_kernel
def minus_log_likelihoods(
    events: Array, actions: Array, start: Array, sd_start: Array, thetas: Array, height: float, fades: Array
) -> Array:
    """Return the negative log-likelihood of one recording, nats, under each of m sets of parameters, (m,).

    Args:
        events: motions (0, action, share), frames (1, s since the last), sightings (2, landmark x, y (m, map), range
            (m), bearing (rad), 1 if standing), (n, 6).
        actions: forward (m), turn (rad) and group (0 on the spot, 1 straight, 2 arc) of each action, (A, 3).
        start: x, y (m) and yaw (rad) at the start, map, (3,).
        sd_start: standard deviations of position (m) and heading (rad) at the start, (2,).
        thetas: parameter vectors, (m, 21), SI: noises, factors and biases at the indices of this module.
        height: height of the camera above the ground, m.
        fades: time constants of tilt and sway errors, s, (2,); 0 = independent from frame to frame.
    """
    out = np.empty(thetas.shape[0])
    for i in range(thetas.shape[0]):
        out[i] = minus_log_likelihood(events, actions, start, sd_start, thetas[i], height, fades)
    return out
