"""Linear algebra with bit-identical results on all processors, for code outside of compiled kernels.

BLAS and LAPACK choose their order of summation by the processor, and numpy its vector code for exp, sin and the like;
the last bits of results, and so the hash of a run, would depend on that. Computations of a control tick use these
functions instead: every sum is taken in index order, every elementary function comes from the C library.
"""

import math
from collections.abc import Callable

import numpy as np

from surefoot.arrays import Array

SWEEPS = 12
"""Largest number of sweeps of Jacobi's method over a symmetric 3x3 matrix in search of its eigenvalues; six usually
suffice."""


def product(a: Array, b: Array) -> Array:
    """Return a @ b for a (k,) or (..., n, k) and b (k,) or (..., k, m), in the product of their units, without BLAS."""
    if b.ndim == 1:
        return np.add.reduce(a * b, axis=-1)
    if a.ndim == 1:
        return np.add.reduce(a[:, None] * b, axis=-2)
    return np.add.reduce(a[..., :, :, None] * b[..., None, :, :], axis=-2)


def combined(columns: Array, amount: Array) -> Array:
    """Return the linear combinations sum_q amount[i, q] columns[i, q, :], one row for each i, (n, d).

    Args:
        columns: k vectors of d numbers for each i, (n, k, d), any unit.
        amount: weight of each vector, (n, k).
    """
    return np.add.reduce(columns * amount[:, :, None], axis=1)


def dot(a: Array, b: Array) -> float:
    """Return the scalar product of two vectors, (k,) each, in the product of their units."""
    return float(np.add.reduce(a * b))


def norm(a: Array) -> float:
    """Return the Euclidean length of a vector, (k,), in its unit."""
    return math.sqrt(dot(a, a))


def exp(x: Array) -> Array:
    """Return e**x of every element of x, of any shape, no unit, by the C library."""
    return _each(math.exp, x)


def angle_of(y: Array, x: Array) -> Array:
    """Return atan2(y, x) of every pair of elements, (n,) rad, by the C library; y and x (n,), same unit."""
    return np.array([math.atan2(b, a) for b, a in zip(y.tolist(), x.tolist(), strict=True)], dtype=np.float64)


def _each(function: Callable[[float], float], x: Array) -> Array:
    """Return `function` of every element of x, of any shape, in its shape."""
    return np.array([function(value) for value in x.ravel().tolist()], dtype=np.float64).reshape(x.shape)


def solve(a: Array, b: Array) -> Array:
    """Return the solution x (n, m) of a x = b for a (n, n) and b (n, m), any units, by elimination with row pivots.

    Raises:
        ZeroDivisionError: a is singular.
    """
    n = len(a)
    rows = np.concatenate((a, b), axis=1)
    for i in range(n):
        pivot = i + int(np.abs(rows[i:, i]).argmax())
        if rows[pivot, i] == 0.0:
            raise ZeroDivisionError("singular matrix")
        rows[[i, pivot]] = rows[[pivot, i]]
        rows[i] /= rows[i, i]
        for k in range(n):
            if k != i:
                rows[k] -= rows[k, i] * rows[i]
    return rows[:, n:]


def eigen3(m: Array) -> tuple[Array, Array]:
    """Return eigenvalues (3,), largest first, and unit eigenvectors as rows (3, 3) of a symmetric matrix m (3, 3).

    Eigenvalues are in the unit of m. Jacobi's method: rotations in the planes of two axes that make the off-diagonal
    elements zero in turn.
    """
    a, v = m.copy(), np.eye(3)
    for _ in range(SWEEPS):
        for p, q in ((0, 1), (0, 2), (1, 2)):
            twice, apart = 2.0 * a[p, q], a[q, q] - a[p, p]
            if twice == 0.0:
                continue
            t = twice / (apart + math.copysign(math.hypot(apart, twice), apart))
            c = 1.0 / math.sqrt(t * t + 1.0)
            turn = np.eye(3)
            turn[p, p], turn[q, q], turn[p, q], turn[q, p] = c, c, t * c, -t * c
            a = product(product(turn.T, a), turn)
            v = product(v, turn)
    order = np.argsort(-np.diag(a), kind="stable")
    return np.diag(a)[order], v.T[order]
