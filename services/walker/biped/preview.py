"""Preview control of the cart-table: the CoM moves so that the ZMP follows a reference known in advance.

Kajita et al. (2003), "Biped walking pattern generation by using preview control of zero-moment point". Per axis
x = (c, c', c''), u = c''' (jerk), ZMP p = c - (z_c/g) c''. With the sum of the tracking error as a fourth state the
optimal jerk is u_k = -G_I sum_{i<=k} (p_i - p_ref,i) - G_x x_k - sum_{j=1..N} G_j p_ref,k+j.
"""

from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear import product, solve
from surefoot.kernels.jit import kernel

HORIZON = 160  # ticks of preview, 1.6 s
WEIGHT_ERROR = 1.0  # on the sum of the ZMP error
WEIGHT_JERK = 1e-6
DOUBLINGS = 40


class PreviewGains(NamedTuple):
    """Gains of the preview controller for one CoM height: jerk of the CoM, m/s^3, per unit of what each multiplies.

    `integral` multiplies the summed ZMP error, m; `state` CoM position, velocity and acceleration, SI; `preview` the
    ZMP references, m, of the next N ticks.
    """

    integral: float  # G_I
    state: Array  # (3,) G_x
    preview: Array  # (N,) G_1..G_N
    height: float  # m, z_c
    dt: float  # s


def preview_gains(height: float, dt: float) -> PreviewGains:
    """Return the gains of the preview controller: the discrete Riccati equation solved by doubling, then unrolled.

    Args:
        height: height of the CoM over the ground, m.
        dt: control tick, s.
    """
    a = np.array([[1.0, dt, dt * dt / 2.0], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
    b = np.array([[dt**3 / 6.0], [dt * dt / 2.0], [dt]])
    c = np.array([[1.0, 0.0, -height / GRAVITY]])
    aug_b, first = np.vstack((product(c, b), b)), np.array([[1.0], [0.0], [0.0], [0.0]])
    aug_f = np.vstack((product(c, a), a))
    aug_a = np.hstack((first, aug_f))
    q = np.diag([WEIGHT_ERROR, 0.0, 0.0, 0.0])
    k = riccati(aug_a, aug_b, q, WEIGHT_JERK)
    pull = product(aug_b.T, k)  # B'K, (1, 4)
    w = 1.0 / (WEIGHT_JERK + float(product(pull, aug_b)[0, 0]))
    integral = w * float(product(pull, first)[0, 0])
    state = w * product(pull, aug_f)[0]
    closed = aug_a - w * product(aug_b, product(pull, aug_a))
    preview = np.empty(HORIZON)
    preview[0] = -integral
    x = -product(closed.T, product(k, first))
    for j in range(1, HORIZON):
        preview[j] = w * float(product(aug_b.T, x)[0, 0])
        x = product(closed.T, x)
    preview[-1] -= state[0] + preview.sum()  # all that lies beyond the horizon: a shifted world needs no jerk
    return PreviewGains(integral, np.ascontiguousarray(state), preview, height, dt)


def riccati(a: Array, b: Array, q: Array, r: float) -> Array:
    """Return the stabilising K (n, n) of K = A'KA - A'KB (r + B'KB)^-1 B'KA + Q, by structured doubling.

    a, b, q: A (n, n), the step of a linear system x = A x + B u; B (n, 1), effect of the input u; Q (n, n), cost of the
    state. r: cost of the input.
    """
    n = len(a)
    ak, gk, hk = a.copy(), product(b, b.T) / r, q.copy()
    for _ in range(DOUBLINGS):
        both = solve(np.eye(n) + product(gk, hk), np.hstack((ak, product(gk, ak.T))))
        step = product(product(ak.T, hk), both[:, :n])
        gk = gk + product(ak, both[:, n:])
        ak = product(ak, both[:, :n])
        hk = hk + step
        if np.abs(step).max() <= 1e-14 * np.abs(hk).max():
            break
    return hk


@kernel
def preview_step(gains: PreviewGains, x: Array, error: Array, reference: Array, k: int) -> Array:
    """Advance the planned CoM by one tick in both axes: x and error are changed in place.

    Args:
        gains: gains of the preview controller.
        x: (3, 2) CoM position m, velocity m/s, acceleration m/s^2 (rows) in x and y (columns), odom.
        error: (2,) sums of the ZMP error in x and y, m.
        reference: ZMP (zero-moment point), (n, 2) m, odom, one row per tick; beyond its end the last row holds.
        k: row of the present tick.

    Returns:
        ZMP of the plan after the step, (2,) m, odom.
    """
    n, dt, lead = reference.shape[0], gains.dt, gains.height / GRAVITY
    zmp = np.empty(2)
    for i in range(2):
        p = x[0, i] - lead * x[2, i]
        error[i] += p - reference[min(k, n - 1), i]
        u = -gains.integral * error[i]
        for j in range(3):
            u -= gains.state[j] * x[j, i]
        for j in range(gains.preview.size):
            u -= gains.preview[j] * reference[min(k + 1 + j, n - 1), i]
        x[0, i] += dt * (x[1, i] + dt * (0.5 * x[2, i] + dt * u / 6.0))
        x[1, i] += dt * (x[2, i] + 0.5 * dt * u)
        x[2, i] += dt * u
        zmp[i] = x[0, i] - lead * x[2, i]
    return zmp
