"""The error of a camera's tilt that it does not know: common to the landmarks of a frame, fading from frame to frame.

Two states behind the drift, errors p of pitch and q of roll in rad. A landmark at distance r and bearing a, seen from
height h, is taken for one at r + (h^2 + r^2)/h (p cos a + q sin a) and a + h/r (q cos a - p sin a), to first order. The
errors are first-order Gauss-Markov: after a time t the share exp(-t / fade) of them is left, and noise makes up for it.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import row_kernel
from surefoot.services.navigator.belief.ukf import NUISANCE

Array = NDArray[np.float64]

TILTS = 2
NEAREST = 0.1
"""m, distances are taken to be at least this."""


@row_kernel
def fade(mean: Array, cov: Array, keep: float, sd: float) -> None:
    """Let the share `keep` of the tilt's error stay and add noise so that its standard deviation tends to sd, in place.

    Args:
        mean: state, (n,), n > 4.
        cov: covariance, (n, n).
        keep: 0 to 1.
        sd: rad.
    """
    n = mean.size
    for i in range(NUISANCE, n):
        mean[i] *= keep
        for j in range(n):
            cov[i, j] *= keep
        for j in range(n):
            cov[j, i] *= keep
        cov[i, i] += (1.0 - keep * keep) * sd * sd


@row_kernel
def fill_gain(range_: float, bearing: float, height: float, gain: Array) -> None:
    """Write what the tilt's error adds to range (row 0, m per rad) and bearing (row 1), (2, 2); (2, 0) stays empty.

    Args:
        range_: distance of the landmark, m.
        bearing: direction of it, rad.
        height: of the camera, m.
        gain: result.
    """
    if gain.shape[1] == 0:
        return
    stretch, swing = (height * height + range_ * range_) / height, height / max(range_, NEAREST)
    c, s = math.cos(bearing), math.sin(bearing)
    gain[0, 0], gain[0, 1] = stretch * c, stretch * s
    gain[1, 0], gain[1, 1] = -swing * s, swing * c
