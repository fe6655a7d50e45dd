"""Products and inverses of small matrices for compiled kernels, with bit-identical results on all processors.

Every sum is taken in index order. numba would pass `@` and `np.linalg` to the BLAS and LAPACK of scipy, which choose
their order of summation by the processor; see `surefoot.geometry.linear`.
"""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.kernels.jit import row_kernel


@row_kernel
def times(a: Array, b: Array) -> Array:
    """Return the matrix product a b, (n, m), of a (n, k) and b (k, m), in the product of their units."""
    out = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[i, k] * b[k, j]
    return out


@row_kernel
def times_transposed(a: Array, b: Array) -> Array:
    """Return the matrix product a b^T, (n, m), of a (n, k) and b (m, k), in the product of their units."""
    out = np.zeros((a.shape[0], b.shape[0]))
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            for k in range(a.shape[1]):
                out[i, j] += a[i, k] * b[j, k]
    return out


@row_kernel
def congruence(a: Array, p: Array) -> Array:
    """Return a p a^T, (n, n), of a (n, m) and p (m, m), any units: the covariance p after the linear map a."""
    return times_transposed(times(a, p), a)


@row_kernel
def turned(m: Array, v: Array) -> Array:
    """Return m v, (3,), of a matrix m (3, 3) and a vector v (3,), in the product of their units."""
    out = np.empty(3)
    for i in range(3):
        out[i] = m[i, 0] * v[0] + m[i, 1] * v[1] + m[i, 2] * v[2]
    return out


@row_kernel
def times_vector(a: Array, v: Array) -> Array:
    """Return a v, (n,), of a matrix a (n, k) and a vector v (k,), in the product of their units."""
    out = np.zeros(a.shape[0])
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            out[i] += a[i, k] * v[k]
    return out


@row_kernel
def quadratic(z: Array, m: Array) -> float:
    """Return the quadratic form z^T m z of a vector z (n,) and a matrix m (n, n), in the product of their units."""
    total = 0.0
    for i in range(z.size):
        for k in range(z.size):
            total += z[i] * m[i, k] * z[k]
    return total


@row_kernel
def add_outer(p: Array, row: int, column: int, a: Array, b: Array) -> None:
    """Add a b^T, of a (n,) and b (m,), to the block of p whose first element is p[row, column], in place.

    `p`: matrix that holds the block, in the product of the units of a and b; changed.
    """
    for i in range(a.size):
        for j in range(b.size):
            p[row + i, column + j] += a[i] * b[j]


@row_kernel
def joseph(p: Array, gain: Array, h: Array, variance: float) -> Array:
    """Return the covariance, (n, n), after a Kalman correction, in Joseph's form, made symmetric.

    It is (I - K H) P (I - K H)^T + variance K K^T.

    Args:
        p: covariance P before, (n, n), any units.
        gain: Kalman gain K, (n, m), state per measured unit.
        h: measurement matrix H, (m, n), measured per state unit.
        variance: of each of the m measured numbers, measured unit squared.
    """
    rest = np.eye(p.shape[0])
    rest -= times(gain, h)
    out, noise = congruence(rest, p), times_transposed(gain, gain)
    for i in range(p.shape[0]):
        for j in range(i + 1):
            out[i, j] = out[j, i] = 0.5 * (out[i, j] + out[j, i]) + variance * noise[i, j]
    return out


@row_kernel
def inverse3(m: Array) -> tuple[Array, float]:
    """Return the inverse of m (3, 3) in 1/unit of m, and its condition number (product of Frobenius norms), no unit.

    A singular matrix gives zeros and inf.
    """
    inv = np.empty((3, 3))
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            c, d = (j + 1) % 3, (j + 2) % 3
            inv[j, i] = m[a, c] * m[b, d] - m[a, d] * m[b, c]
    det = m[0, 0] * inv[0, 0] + m[0, 1] * inv[1, 0] + m[0, 2] * inv[2, 0]
    if abs(det) < 1e-300:
        return np.zeros((3, 3)), math.inf
    size, inverse_size = 0.0, 0.0
    for i in range(3):
        for j in range(3):
            inv[i, j] /= det
            size += m[i, j] * m[i, j]
            inverse_size += inv[i, j] * inv[i, j]
    return inv, math.sqrt(size * inverse_size)


@row_kernel
def solve3(m: Array, v: Array) -> Array:
    """Return the solution x (3,) of m x = v for m (3, 3) and v (3,), any units; zero where m has no inverse."""
    return times_vector(inverse3(m)[0], v)
