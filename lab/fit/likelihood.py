"""How likely a run is under given noises: the product of the densities of the filter's innovations.

-2 ln L = sum over sightings of nu^T S^-1 nu + ln det S + 2 ln 2 pi, nu the innovation of range and bearing and S its
covariance, both by the unscented filter that the navigator runs (prediction error decomposition; Harvey 1989).
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import free_kernel
from surefoot.services.navigator.belief.common import fade, fill_gain
from surefoot.services.navigator.belief.ukf import innovation, predict_with, update_with

Array = NDArray[np.float64]

ALONG, ACROSS, HEADING, TURN_PLACE, TURN_HEADING = 0, 1, 2, 3, 4  # sd of a whole action, m and rad
RANGE, SHARE, BEARING, STANDING, TILT, DRIFT, WANDER = 5, 6, 7, 8, 9, 10, 11
FORWARD, TURNED, SWAY, PITCH = (
    12,
    13,
    14,
    15,
)  # SWAY m; PITCH rad, mean of the tilt; what becomes of a commanded way and turn, 1 = what was commanded
PARAMETERS = 16
LOG_2PI = math.log(2.0 * math.pi)


@free_kernel
def minus_log_likelihood(
    events: Array, actions: Array, start: Array, sd_start: Array, theta: Array, height: float, fades: Array
) -> float:
    """Return -ln L of one run.

    Args:
        events: (n, 6), see `events`.
        actions: forward (m), turn (rad) and 1 for a walk of each action, (A, 3).
        start: x, y, yaw, (3,).
        sd_start: standard deviations of position (m) and heading (rad) at the start, (2,).
        theta: parameters, (PARAMETERS,).
        height: of the camera, m.
        fades: time constants of tilt and sway, s, (2,); 0 = independent from frame to frame.
    """
    n = 7 if theta[TILT] > 0.0 or theta[SWAY] > 0.0 else 4
    mean, cov, gain, noise = np.zeros(n), np.zeros((n, n)), np.zeros((2, n - 4)), np.zeros(4)
    sds = np.array([theta[TILT], theta[TILT], theta[SWAY]])
    work, keeps = np.zeros((3 * n, max(n, 4))), np.zeros(3)
    mean[:3] = start
    cov[0, 0] = cov[1, 1] = sd_start[0] ** 2
    cov[2, 2] = sd_start[1] ** 2
    cov[3, 3] = theta[DRIFT] ** 2
    if n > 4:
        mean[4] = theta[PITCH]
    for i in range(4, n):
        cov[i, i] = sds[i - 4] ** 2
    total = 0.0
    for k in range(events.shape[0]):
        kind = events[k, 0]
        if kind == 0.0:
            a, share = int(events[k, 1]), events[k, 2]
            forward, turn = actions[a, 0] * theta[FORWARD], actions[a, 1] * theta[TURNED]
            if actions[a, 2] > 0.0:
                noise[0], noise[1] = theta[ALONG] ** 2 * share, theta[ACROSS] ** 2 * share
                noise[2], noise[3] = theta[HEADING] ** 2 * share, theta[WANDER] ** 2 * share
            else:
                noise[0] = noise[1] = theta[TURN_PLACE] ** 2 * share
                noise[2], noise[3] = theta[TURN_HEADING] ** 2 * share, 0.0
            walked = actions[a, 0] * share
            predict_with(mean, cov, forward * share, 0.0, turn * share, walked, noise, work)
        elif kind == 1.0:
            if n > 4:
                keeps[0] = keeps[1] = math.exp(-events[k, 1] / fades[0]) if fades[0] > 0.0 else 0.0
                keeps[2] = math.exp(-events[k, 1] / fades[1]) if fades[1] > 0.0 else 0.0
                fade(mean, cov, keeps, sds, theta[PITCH])
        else:
            r, b = events[k, 3], events[k, 4]
            scale = theta[STANDING] if events[k, 5] > 0.0 else 1.0
            var_r = scale * scale * (theta[RANGE] ** 2 + (theta[SHARE] * r) ** 2)
            var_b = (scale * theta[BEARING]) ** 2
            fill_gain(r, b, height, gain)
            _, _, s00, s01, s11 = innovation(mean, cov, events[k, 1], events[k, 2], r, b, var_r, var_b, gain)
            nis = update_with(mean, cov, events[k, 1], events[k, 2], r, b, var_r, var_b, gain, work)
            total += 0.5 * (nis + math.log(s00 * s11 - s01 * s01)) + LOG_2PI
    return total
