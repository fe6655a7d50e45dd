"""Products and inverses of small matrices for kernels, every sum taken in index order.

numba hands `@` and `np.linalg` to the BLAS and LAPACK of scipy, which choose their order of summation by the processor;
see `surefoot.geometry.linear`.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import row_kernel

Array = NDArray[np.float64]


@row_kernel
def times(a: Array, b: Array) -> Array:
    """Return a b, (n, m), of (n, k) and (k, m)."""
    out = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[i, k] * b[k, j]
    return out


@row_kernel
def times_transposed(a: Array, b: Array) -> Array:
    """Return a b^T, (n, m), of (n, k) and (m, k)."""
    out = np.zeros((a.shape[0], b.shape[0]))
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            for k in range(a.shape[1]):
                out[i, j] += a[i, k] * b[j, k]
    return out


@row_kernel
def inverse3(m: Array) -> tuple[Array, float]:
    """Inverse of a 3x3 matrix by the adjugate, and its condition number in the Frobenius norm (inf: not inverted)."""
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
    """Solution x of m x = v, (3,); zero where m (3, 3) has no inverse."""
    inv, out = inverse3(m)[0], np.zeros(3)
    for i in range(3):
        for k in range(3):
            out[i] += inv[i, k] * v[k]
    return out
