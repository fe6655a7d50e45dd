"""The filter of `ekf` as one numba kernel over a whole log, for replay and studies; equal to it to 1e-9 (tested)."""

import numpy as np
from numpy.typing import NDArray

from services.estimator.inertial import propagate, propagate_covariance
from surefoot.jit import kernel

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@kernel
def correct(g: Array, v: Array, p: Array, measured: Array, sigma: float) -> tuple[Array, Array, Array]:
    """Equations (32)-(37), P in Joseph's form as filterpy has it: g (3,), v (3,), P (6, 6)."""
    s = p[3:, 3:].copy()
    for i in range(3):
        s[i, i] += sigma * sigma
    gain = np.ascontiguousarray(p[:, 3:]) @ np.linalg.inv(s)
    r = measured - v
    step = gain @ r
    i_kh = np.eye(6)
    for i in range(6):
        for k in range(3):
            i_kh[i, 3 + k] -= gain[i, k]
    p_next = i_kh @ p @ i_kh.T + gain @ gain.T * (sigma * sigma)
    return g + step[:3], v + step[3:], 0.5 * (p_next + p_next.T)


@kernel
def run(
    g: Array,
    p: Array,
    w: Array,
    q: Array,
    d: Array,
    measured: Array,
    has: Flags,
    sigma_v: Array,
    noise: Array,
    exact: bool,
) -> tuple[Array, Array, Array]:
    """Filter a log.

    Args:
        g: start of g, (3,) m/s^2; v starts at 0.
        p: start of P, (6, 6).
        w: gyro, (n, 3) rad/s.
        q: accelerometer, (n, 3) m/s^2.
        d: time step before each row, (n,) s.
        measured: v^KG, (n, 3) m/s.
        has: rows with a measurement, (n,); the correction follows the prediction of its row.
        sigma_v: standard deviation of each measurement, (n,) m/s.
        noise: (sigma_w, sigma_q).
        exact: F with the rotation that (24) drops.

    Returns:
        g (n, 3), v (n, 3) after each row, and the last P (6, 6).
    """
    n = w.shape[0]
    out_g, out_v = np.empty((n, 3)), np.empty((n, 3))
    v = np.zeros(3)
    for k in range(n):
        p = propagate_covariance(p, g, v, w[k], d[k], noise, exact)
        g, v = propagate(g, v, w[k], q[k], d[k])
        if has[k]:
            g, v, p = correct(g, v, p, measured[k], sigma_v[k])
        out_g[k], out_v[k] = g, v
    return out_g, out_v, p


def warm() -> None:
    """Compile every kernel of this module."""
    g, rows = np.array([0.0, 0.0, 9.81]), np.zeros((1, 3))
    run(g, np.eye(6), rows, rows, np.ones(1), rows, np.ones(1, dtype=np.bool_), np.ones(1), np.ones(2), False)
