"""Eight cone programs at once: memory layout and small linear algebra over lanes.

A lane is one program. Every quantity is a row of 8 numbers, one per lane, so that each inner loop is one vector
instruction: all lanes share the matrix of the contact set and differ in direction only.

Two arrays hold everything. The block of contact i begins at `BLOCK * i` of the cone array `w`, its rows at the offsets
`S` .. `COLUMNS`. The array `g` holds what belongs to a program as a whole. Offsets pass through `& MASK`, which tells
the compiler that they are not negative: without that the loops are not vectorised (a factor of three).
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import row_kernel

Array = NDArray[np.float64]

LANES = 8
MASK = 0xFFFFFF
MAX_UNKNOWNS = 6

# rows of a contact in w, three for a vector of the cone's space
S, X, SCALED, RHS, RHS_S, RES, TARGET, FIRST, SECOND, STEP = (24 * row for row in range(10))
# dual slack, primal force, scaled point, right-hand side, the same scaled, dual residual (scaled in place),
# right-hand side of complementarity, the two parts of the primal step, the step
AXIS, ETA, I_ETA, I_W0 = 240, 264, 272, 280  # Nesterov-Todd scaling point (unit), its length, 1 / ETA, 1 / (1 + w0)
COLUMNS = 288  # scaled columns of the matrix, 3 rows for each unknown
BLOCK = COLUMNS + 24 * MAX_UNKNOWNS

# rows of g
TAU, KAPPA, GAP, MU, D_TAU, D_KAPPA, REACH, SIGMA, DEN, NUM, ACTIVE, DUAL_RES, PRIMAL_RES, COST, GAIN, LENGTH = (
    8 * row for row in range(16)
)
LAMBDA, RESIDUAL, P1, P2, MATRIX = (128 + 48 * row for row in range(5))  # MATRIX: lower triangle, row by row
SIZE = MATRIX + 8 * (MAX_UNKNOWNS * (MAX_UNKNOWNS + 1) // 2)

PIVOT = 1e-15  # of the largest diagonal entry; below it the direction is left alone


@row_kernel
def factor(g: Array, unknowns: int, lanes: int) -> None:
    """Cholesky factor of MATRIX in place; the diagonal becomes 1/l, or 0 for a null direction."""
    if unknowns == 4:
        _factor4(g, lanes)
        return
    for k in range(lanes):
        g[NUM + k] = 0.0
    for j in range(unknowns):
        d = (MATRIX + 8 * (j * (j + 1) // 2 + j)) & MASK
        for k in range(lanes):
            g[NUM + k] = max(g[NUM + k], PIVOT * g[d + k])
    for j in range(unknowns):
        for i in range(j + 1):
            a = (MATRIX + 8 * (j * (j + 1) // 2 + i)) & MASK
            d = (MATRIX + 8 * (i * (i + 1) // 2 + i)) & MASK
            for p in range(i):
                b = (MATRIX + 8 * (j * (j + 1) // 2 + p)) & MASK
                c = (MATRIX + 8 * (i * (i + 1) // 2 + p)) & MASK
                for k in range(lanes):
                    g[a + k] -= g[b + k] * g[c + k]
            if i < j:
                for k in range(lanes):
                    g[a + k] *= g[d + k]
            else:
                for k in range(lanes):
                    g[a + k] = 1.0 / math.sqrt(g[a + k]) if g[a + k] > g[NUM + k] else 0.0


@row_kernel
def _factor4(g: Array, lanes: int) -> None:
    for k in range(lanes):
        p, q, r, s = g[MATRIX + k], g[MATRIX + 16 + k], g[MATRIX + 40 + k], g[MATRIX + 72 + k]
        floor = PIVOT * max(max(p, q), max(r, s))
        l00 = 1.0 / math.sqrt(p) if p > floor else 0.0
        l10 = g[MATRIX + 8 + k] * l00
        q -= l10 * l10
        l11 = 1.0 / math.sqrt(q) if q > floor else 0.0
        l20 = g[MATRIX + 24 + k] * l00
        l21 = (g[MATRIX + 32 + k] - l10 * l20) * l11
        r -= l20 * l20 + l21 * l21
        l22 = 1.0 / math.sqrt(r) if r > floor else 0.0
        l30 = g[MATRIX + 48 + k] * l00
        l31 = (g[MATRIX + 56 + k] - l10 * l30) * l11
        l32 = (g[MATRIX + 64 + k] - l20 * l30 - l21 * l31) * l22
        s -= l30 * l30 + l31 * l31 + l32 * l32
        l33 = 1.0 / math.sqrt(s) if s > floor else 0.0
        g[MATRIX + k], g[MATRIX + 8 + k], g[MATRIX + 16 + k], g[MATRIX + 24 + k] = l00, l10, l11, l20
        g[MATRIX + 32 + k], g[MATRIX + 40 + k], g[MATRIX + 48 + k], g[MATRIX + 56 + k] = l21, l22, l30, l31
        g[MATRIX + 64 + k], g[MATRIX + 72 + k] = l32, l33


@row_kernel
def solve(g: Array, unknowns: int, v: int, lanes: int) -> None:
    """Solve with the factor of MATRIX, in place at row offset `v` of g."""
    if unknowns == 4:
        _solve4(g, v, lanes)
        return
    for j in range(unknowns):
        a = (v + 8 * j) & MASK
        d = (MATRIX + 8 * (j * (j + 1) // 2 + j)) & MASK
        for p in range(j):
            b = (MATRIX + 8 * (j * (j + 1) // 2 + p)) & MASK
            c = (v + 8 * p) & MASK
            for k in range(lanes):
                g[a + k] -= g[b + k] * g[c + k]
        for k in range(lanes):
            g[a + k] *= g[d + k]
    for j in range(unknowns - 1, -1, -1):
        a = (v + 8 * j) & MASK
        d = (MATRIX + 8 * (j * (j + 1) // 2 + j)) & MASK
        for p in range(j + 1, unknowns):
            b = (MATRIX + 8 * (p * (p + 1) // 2 + j)) & MASK
            c = (v + 8 * p) & MASK
            for k in range(lanes):
                g[a + k] -= g[b + k] * g[c + k]
        for k in range(lanes):
            g[a + k] *= g[d + k]


@row_kernel
def _solve4(g: Array, v: int, lanes: int) -> None:
    v &= MASK
    for k in range(lanes):
        l10, l20, l21 = g[MATRIX + 8 + k], g[MATRIX + 24 + k], g[MATRIX + 32 + k]
        l30, l31, l32 = g[MATRIX + 48 + k], g[MATRIX + 56 + k], g[MATRIX + 64 + k]
        d0, d1, d2, d3 = g[MATRIX + k], g[MATRIX + 16 + k], g[MATRIX + 40 + k], g[MATRIX + 72 + k]
        y0 = g[v + k] * d0
        y1 = (g[v + 8 + k] - l10 * y0) * d1
        y2 = (g[v + 16 + k] - l20 * y0 - l21 * y1) * d2
        y3 = (g[v + 24 + k] - l30 * y0 - l31 * y1 - l32 * y2) * d3
        y3 *= d3
        y2 = (y2 - l32 * y3) * d2
        y1 = (y1 - l21 * y2 - l31 * y3) * d1
        g[v + k] = (y0 - l10 * y1 - l20 * y2 - l30 * y3) * d0
        g[v + 8 + k], g[v + 16 + k], g[v + 24 + k] = y1, y2, y3


@row_kernel
def add_dot(g: Array, out: int, sign: float, w: Array, a: int, b: int, lanes: int) -> None:
    """g[out] += sign * a'b for two 3-vectors of a block."""
    out, a, b = out & MASK, a & MASK, b & MASK
    for k in range(lanes):
        g[out + k] += sign * (w[a + k] * w[b + k] + w[a + 8 + k] * w[b + 8 + k] + w[a + 16 + k] * w[b + 16 + k])


@row_kernel
def add_products(w: Array, o: int, v: int, g: Array, out: int, unknowns: int, lanes: int) -> None:
    """out_j += column_j'v for the 3-vector at row `v` of the block at `o` and all scaled columns."""
    if unknowns != 4:
        for j in range(unknowns):
            add_dot(g, out + 8 * j, 1.0, w, o + COLUMNS + 24 * j, o + v, lanes)
        return
    v, o, out = (o + v) & MASK, (o + COLUMNS) & MASK, out & MASK
    for k in range(lanes):
        v0, v1, v2 = w[v + k], w[v + 8 + k], w[v + 16 + k]
        g[out + k] += w[o + k] * v0 + w[o + 8 + k] * v1 + w[o + 16 + k] * v2
        g[out + 8 + k] += w[o + 24 + k] * v0 + w[o + 32 + k] * v1 + w[o + 40 + k] * v2
        g[out + 16 + k] += w[o + 48 + k] * v0 + w[o + 56 + k] * v1 + w[o + 64 + k] * v2
        g[out + 24 + k] += w[o + 72 + k] * v0 + w[o + 80 + k] * v1 + w[o + 88 + k] * v2


@row_kernel
def subtract_combination(w: Array, o: int, v: int, g: Array, y: int, unknowns: int, lanes: int) -> None:
    """v -= sum of column_j y_j for the 3-vector at row `v` of the block at `o` and the rows y_j of g."""
    v, o, y = (o + v) & MASK, (o + COLUMNS) & MASK, y & MASK
    if unknowns != 4:
        for j in range(unknowns):
            a = (o + 24 * j) & MASK
            b = (y + 8 * j) & MASK
            for k in range(lanes):
                t = g[b + k]
                w[v + k] -= w[a + k] * t
                w[v + 8 + k] -= w[a + 8 + k] * t
                w[v + 16 + k] -= w[a + 16 + k] * t
        return
    for k in range(lanes):
        y0, y1, y2, y3 = g[y + k], g[y + 8 + k], g[y + 16 + k], g[y + 24 + k]
        w[v + k] -= w[o + k] * y0 + w[o + 24 + k] * y1 + w[o + 48 + k] * y2 + w[o + 72 + k] * y3
        w[v + 8 + k] -= w[o + 8 + k] * y0 + w[o + 32 + k] * y1 + w[o + 56 + k] * y2 + w[o + 80 + k] * y3
        w[v + 16 + k] -= w[o + 16 + k] * y0 + w[o + 40 + k] * y1 + w[o + 64 + k] * y2 + w[o + 88 + k] * y3


@row_kernel
def add_gram(w: Array, o: int, g: Array, unknowns: int, lanes: int) -> None:
    """MATRIX += A_i'A_i of the scaled columns of a block."""
    if unknowns != 4:
        for j in range(unknowns):
            for i in range(j + 1):
                a, b = o + COLUMNS + 24 * j, o + COLUMNS + 24 * i
                add_dot(g, MATRIX + 8 * (j * (j + 1) // 2 + i), 1.0, w, a, b, lanes)
        return
    o = (o + COLUMNS) & MASK
    for k in range(lanes):
        a0, a1, a2 = w[o + k], w[o + 8 + k], w[o + 16 + k]
        b0, b1, b2 = w[o + 24 + k], w[o + 32 + k], w[o + 40 + k]
        c0, c1, c2 = w[o + 48 + k], w[o + 56 + k], w[o + 64 + k]
        d0, d1, d2 = w[o + 72 + k], w[o + 80 + k], w[o + 88 + k]
        g[MATRIX + k] += a0 * a0 + a1 * a1 + a2 * a2
        g[MATRIX + 8 + k] += a0 * b0 + a1 * b1 + a2 * b2
        g[MATRIX + 16 + k] += b0 * b0 + b1 * b1 + b2 * b2
        g[MATRIX + 24 + k] += a0 * c0 + a1 * c1 + a2 * c2
        g[MATRIX + 32 + k] += b0 * c0 + b1 * c1 + b2 * c2
        g[MATRIX + 40 + k] += c0 * c0 + c1 * c1 + c2 * c2
        g[MATRIX + 48 + k] += a0 * d0 + a1 * d1 + a2 * d2
        g[MATRIX + 56 + k] += b0 * d0 + b1 * d1 + b2 * d2
        g[MATRIX + 64 + k] += c0 * d0 + c1 * d1 + c2 * d2
        g[MATRIX + 72 + k] += d0 * d0 + d1 * d1 + d2 * d2
