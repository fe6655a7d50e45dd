"""Weights of terms by least squares with a ridge, without the Gram matrix."""

import numpy as np

from surefoot.arrays import Array


def weights(columns: Array, y: Array, w: Array, ridge: float) -> Array:
    """Return c = argmin |W (V c - y)|^2 + ridge |c|^2, (m,), in the unit of y.

    Equations (7)-(9) of Walas & Belter form G = V'V, which squares the condition number. The singular values of the
    stacked matrix do not.

    Args:
        columns: V, values of m terms at n points, (n, m), no unit.
        y: target, such as slips, (n,).
        w: diagonal of W, weights of the points, (n,), no unit.
        ridge: rho, >= 0.
    """
    stacked, target = stack(columns, y, w, ridge)
    return np.asarray(np.linalg.lstsq(stacked, target, rcond=1e-13)[0], dtype=np.float64)


def stack(columns: Array, y: Array, w: Array, ridge: float) -> tuple[Array, Array]:
    """Return the matrix [W V; sqrt(ridge) I], (n + m, m), and the vector [W y; 0], (n + m,), of a fit with a ridge.

    `columns`: V, (n, m), no unit; `y`: target, (n,); `w`: diagonal of W, (n,), no unit.
    """
    m = columns.shape[1]
    return np.vstack((w[:, None] * columns, np.sqrt(ridge) * np.eye(m))), np.concatenate((w * y, np.zeros(m)))
