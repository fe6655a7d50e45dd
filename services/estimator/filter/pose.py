"""Covariance of the published pose of base_link: that of the filter, and Q for errors that its noises leave out.

While the excess f, the factor of the inertial noise over that of the sensors, is above 1, legs and trunk bend. The
filter still takes the heading from the gyro and the position from the feet; so Q, of x, y, z and heading psi, grows:

    Q' = F Q F^T + (f^2 - 1) d diag(w^2, w^2, w^2/4, gyro^2),   F: dx = -v_y d dpsi, dy = v_x d dpsi

with w = `FIXED.pose_walk`. Slopes that are taken for level add errors of height and tilt (`slope`). The rows
of the covariance are those of nav_msgs: position of base_link in odom, then the rotation about the axes of odom.
"""

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.linear_kernels import congruence
from surefoot.kernels.jit import kernel

from .hypotheses import likeliest
from .layout import E, M, X
from .noise import FIXED, BestNoise
from .slope import add_to_pose
from .state import BestState

XX, XY, YY, XT, YT, TT, ZZ = range(M.pose_extra, M.pose_extra + 7)
"""Indices in `BestState.memory` of Q, covariance of the published pose beyond the filter's, by element; T: heading."""


@kernel
def grow_pose(state: BestState, d: float, noise: BestNoise) -> None:
    """Increase Q, the covariance of the published pose beyond the filter's, over a step of d s, in place.

    Args:
        state: state of the filter; Q in its memory is changed.
        d: length of the step, s.
        noise: noises and rates of the filter.
    """
    best, m = likeliest(state), state.memory
    memory, x = (m, state.x) if best < 0 else (state.mode_memory[best], state.mode_x[best])
    a, b = -d * x[X.vel + 1], d * x[X.vel]
    m[XX] += 2.0 * a * m[XT] + a * a * m[TT]
    m[XY] += a * m[YT] + b * m[XT] + a * b * m[TT]
    m[YY] += 2.0 * b * m[YT] + b * b * m[TT]
    m[XT] += a * m[TT]
    m[YT] += b * m[TT]
    more = (memory[M.excess] * memory[M.excess] - 1.0) * d
    m[XX] += more * FIXED.pose_walk**2
    m[YY] += more * FIXED.pose_walk**2
    m[ZZ] += more * FIXED.pose_walk**2 / 4.0
    m[TT] += more * noise.gyro**2


@kernel
def pose_covariance(state: BestState, arm: Array) -> Array:
    """Return the covariance (6, 6) of the pose of base_link: x, y, z, m, and rotation about these axes of odom, rad.

    The error of the place of base_link is that of the IMU, dp, and of its lever a: dp - xi_R x a, with xi_R the error
    of the attitude.

    Args:
        state: state of the filter.
        arm: lever a, from base_link to the IMU, odom axes, (3,) m.
    """
    by, block, m = np.zeros((6, 6)), np.empty((6, 6)), state.memory
    for i in range(3):
        by[i, i] = by[3 + i, 3 + i] = 1.0
    by[0, 4], by[0, 5] = -arm[2], arm[1]
    by[1, 5], by[1, 3] = -arm[0], arm[2]
    by[2, 3], by[2, 4] = -arm[1], arm[0]
    for i in range(6):
        for k in range(6):
            block[i, k] = state.cov[_row(i), _row(k)]
    out = congruence(by, block)
    for i in range(6):
        for k in range(i):
            out[i, k] = out[k, i] = 0.5 * (out[i, k] + out[k, i])
    out[0, 0] += m[XX]
    out[1, 1] += m[YY]
    out[2, 2] += m[ZZ]
    out[5, 5] += m[TT]
    for i, k, at in ((0, 1, XY), (0, 5, XT), (1, 5, YT)):
        out[i, k] += m[at]
        out[k, i] += m[at]
    add_to_pose(m, out)
    return out


@kernel
def _row(i: int) -> int:
    """Return the row of the filter's error of pose component i: 0 to 2 position, 3 to 5 rotation, odom axes."""
    return E.pos + i if i < 3 else E.rot + i - 3
