"""Newton steps of the interior-point method, and linear algebra over lanes: programs that are solved side by side.

Steps are taken in scaled variables and added to the slacks s and the unknowns x as increments: recomputing s and x
from the scaled point loses eight digits near the boundary. The normal equations of a lane have as many unknowns as its
program.
"""

import math

from surefoot.arrays import Array
from surefoot.kernels.jit import row_kernel

from .lanes import (
    AXIS,
    BLOCK,
    COLUMNS,
    D_KAPPA,
    D_TAU,
    DEN,
    ETA,
    FIRST,
    GAP,
    I_ETA,
    I_W0,
    KAPPA,
    LENGTH,
    MASK,
    MATRIX,
    MU,
    NUM,
    P1,
    PIVOT,
    REACH,
    RES,
    RESIDUAL,
    RHS_S,
    SCALED,
    SECOND,
    SIGMA,
    STEP,
    TARGET,
    TAU,
    S,
    X,
)


@row_kernel
def step(c: Array, w: Array, g: Array, n: int, lanes: int, correct: bool) -> None:
    """Compute a Newton step of up to eight programs: predictor (sigma = 0), or corrector with its second-order terms.

    Args:
        c: objective of the programs, (m,), no unit.
        w: state of n contacts, (432 n,), blocks of rows of 8 programs; their rows STEP are written.
        g: state of the programs, (488,), rows of 8: written are the step P1 of the unknowns, D_TAU and D_KAPPA of tau
            and kappa, and REACH, 1 / the longest step that stays in all cones.
        n: number of contacts.
        lanes: number of programs, at most 8.
        correct: True = corrector, after the predictor's step.
    """
    m = c.size
    for j in range(m):
        for k in range(lanes):
            g[P1 + 8 * j + k] = (g[SIGMA + k] - 1.0) * g[RESIDUAL + 8 * j + k]
    for i in range(n):
        o = i * BLOCK
        if correct:
            corrector(w, o, g, lanes)
        else:
            predictor(w, o, lanes)
        add_products(w, o, FIRST, g, P1, m, lanes)
    solve(g, m, P1, lanes)
    for k in range(lanes):
        second = g[D_TAU + k] * g[D_KAPPA + k] if correct else 0.0
        g[D_KAPPA + k] = g[SIGMA + k] * g[MU + k] - g[KAPPA + k] * g[TAU + k] - second
        g[NUM + k] = (g[SIGMA + k] - 1.0) * g[GAP + k] - g[D_KAPPA + k] / g[TAU + k]
    for j in range(m):
        for k in range(lanes):
            g[NUM + k] -= c[j] * g[P1 + 8 * j + k]
    for i in range(n):
        o = i * BLOCK
        subtract_combination(w, o, FIRST, g, P1, m, lanes)
        add_dot(g, NUM, 1.0, w, o + RHS_S, o + FIRST, lanes)
    for k in range(lanes):
        t = g[NUM + k] / g[DEN + k]
        u = (g[D_KAPPA + k] - g[KAPPA + k] * t) / g[TAU + k]
        g[D_TAU + k], g[D_KAPPA + k] = t, u
        g[REACH + k] = max(1.0, max(-t / g[TAU + k], -u / g[KAPPA + k]))
    for i in range(n):
        direction(w, i * BLOCK, g, lanes)


@row_kernel
def predictor(w: Array, o: int, lanes: int) -> None:
    """Write the target of a plain Newton step (complementarity 0 at once) for the contact whose block begins at w[o].

    Three rows each, of 8 programs: TARGET = - SCALED, FIRST = TARGET + RES, with SCALED the point W x (W the scaling of
    the cone, x the force) and RES the scaled residual. w is (432 n,), no unit.
    """
    o &= MASK
    for k in range(lanes):
        q0, q1, q2 = -w[o + SCALED + k], -w[o + SCALED + 8 + k], -w[o + SCALED + 16 + k]
        w[o + TARGET + k], w[o + TARGET + 8 + k], w[o + TARGET + 16 + k] = q0, q1, q2
        w[o + FIRST + k], w[o + FIRST + 8 + k] = q0 + w[o + RES + k], q1 + w[o + RES + 8 + k]
        w[o + FIRST + 16 + k] = q2 + w[o + RES + 16 + k]


@row_kernel
def corrector(w: Array, o: int, g: Array, lanes: int) -> None:
    """Write the target of Mehrotra's corrector for the contact whose block begins at w[o], from the predictor's STEP.

    TARGET = p^-1 * (sigma mu e - p * p - dx * ds), FIRST = TARGET + (1 - sigma) RES: * the product of the cone's
    algebra, e = (1, 0, 0), p the scaled point, dx = STEP and ds = -p - STEP the predictor's steps, RES the scaled
    residual; sigma, mu (centring, mean complementarity): rows of g (488,). Rows hold 8 programs; w is (432 n,), no
    unit.
    """
    o &= MASK
    for k in range(lanes):
        p0, p1, p2 = w[o + SCALED + k], w[o + SCALED + 8 + k], w[o + SCALED + 16 + k]
        d0, d1, d2 = w[o + STEP + k], w[o + STEP + 8 + k], w[o + STEP + 16 + k]
        e0, e1, e2 = -p0 - d0, -p1 - d1, -p2 - d2
        sigma = g[SIGMA + k]
        f0 = sigma * g[MU + k] - (p0 * p0 + p1 * p1 + p2 * p2) - (d0 * e0 + d1 * e1 + d2 * e2)
        f1 = -2.0 * p0 * p1 - (d0 * e1 + e0 * d1)
        f2 = -2.0 * p0 * p2 - (d0 * e2 + e0 * d2)
        norm = math.sqrt(p1 * p1 + p2 * p2)
        det = 1.0 / ((p0 - norm) * (p0 + norm))
        z, inv = p1 * f1 + p2 * f2, 1.0 / p0
        t = (z * inv - f0) * det
        q0, q1, q2 = (p0 * f0 - z) * det, f1 * inv + t * p1, f2 * inv + t * p2
        rest = 1.0 - sigma
        w[o + TARGET + k], w[o + TARGET + 8 + k], w[o + TARGET + 16 + k] = q0, q1, q2
        w[o + FIRST + k], w[o + FIRST + 8 + k] = q0 + rest * w[o + RES + k], q1 + rest * w[o + RES + 8 + k]
        w[o + FIRST + 16 + k] = q2 + rest * w[o + RES + 16 + k]


@row_kernel
def direction(w: Array, o: int, g: Array, lanes: int) -> None:
    """Write STEP = FIRST + SECOND dtau, the scaled step of the force, for the contact whose block begins at w[o].

    REACH, a row of g, grows to 1 / (longest step that keeps force and slack in their cones). dtau = row D_TAU of g;
    rows hold 8 programs; w (432 n,), g (488,), no unit.
    """
    o &= MASK
    for k in range(lanes):
        t = g[D_TAU + k]
        d0, d1 = w[o + FIRST + k] + t * w[o + SECOND + k], w[o + FIRST + 8 + k] + t * w[o + SECOND + 8 + k]
        d2 = w[o + FIRST + 16 + k] + t * w[o + SECOND + 16 + k]
        w[o + STEP + k], w[o + STEP + 8 + k], w[o + STEP + 16 + k] = d0, d1, d2
        e0, e1, e2 = w[o + TARGET + k] - d0, w[o + TARGET + 8 + k] - d1, w[o + TARGET + 16 + k] - d2
        p0, p1, p2 = w[o + SCALED + k], w[o + SCALED + 8 + k], w[o + SCALED + 16 + k]
        norm = math.sqrt(p1 * p1 + p2 * p2)
        inv = 1.0 / math.sqrt((p0 - norm) * (p0 + norm))
        p0, p1, p2 = p0 * inv, p1 * inv, p2 * inv
        c = 1.0 / (1.0 + p0)
        r0 = p0 * d0 - p1 * d1 - p2 * d2
        f = (r0 + d0) * c
        r1, r2 = d1 - f * p1, d2 - f * p2
        a = (math.sqrt(r1 * r1 + r2 * r2) - r0) * inv
        r0 = p0 * e0 - p1 * e1 - p2 * e2
        f = (r0 + e0) * c
        r1, r2 = e1 - f * p1, e2 - f * p2
        b = (math.sqrt(r1 * r1 + r2 * r2) - r0) * inv
        g[REACH + k] = max(g[REACH + k], max(a, b))


@row_kernel
def move(w: Array, o: int, g: Array, lanes: int) -> None:
    """Move force x and dual slack s of the contact whose block begins at w[o] along their step by the fraction LENGTH.

    x += LENGTH W^-1 STEP, s += LENGTH W (TARGET - STEP), W the scaling of the cone; LENGTH is a row of g (488,), the
    others are rows of w (432 n,), each with 8 programs, no unit.
    """
    o &= MASK
    for k in range(lanes):
        d0, d1, d2 = w[o + STEP + k], w[o + STEP + 8 + k], w[o + STEP + 16 + k]
        e0, e1, e2 = w[o + TARGET + k] - d0, w[o + TARGET + 8 + k] - d1, w[o + TARGET + 16 + k] - d2
        w0, w1, w2, eta = w[o + AXIS + k], w[o + AXIS + 8 + k], w[o + AXIS + 16 + k], w[o + ETA + k]
        r = w[o + I_W0 + k]
        f = g[LENGTH + k] * w[o + I_ETA + k]
        t = w1 * d1 + w2 * d2
        c = t * r - d0
        w[o + X + k] += f * (w0 * d0 - t)
        w[o + X + 8 + k] += f * (d1 + w1 * c)
        w[o + X + 16 + k] += f * (d2 + w2 * c)
        f = g[LENGTH + k] * eta
        t = w1 * e1 + w2 * e2
        c = t * r + e0
        w[o + S + k] += f * (w0 * e0 + t)
        w[o + S + 8 + k] += f * (e1 + w1 * c)
        w[o + S + 16 + k] += f * (e2 + w2 * c)


@row_kernel
def factor(g: Array, unknowns: int, lanes: int) -> None:
    """Replace MATRIX of g by its Cholesky factor L, for up to eight programs; diagonal 1 / l_jj, 0 if it is null.

    MATRIX: lower triangle of a matrix (unknowns, unknowns), row by row, 8 programs per entry; g (488,), no unit.
    """
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
    """Solve L L'y = v for up to eight programs at once, L the Cholesky factor in MATRIX of g, y in the place of v.

    v: index in g (488,) where the right-hand side begins, `unknowns` rows of 8 programs; no unit.
    """
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
    """Add sign * a'b to the row g[out:] of 8 programs: two 3-vectors whose rows begin at w[a] and w[b], 8 numbers each.

    w (432 n,) and g (488,) are the states of contacts and programs of the solver, no unit.
    """
    out, a, b = out & MASK, a & MASK, b & MASK
    for k in range(lanes):
        g[out + k] += sign * (w[a + k] * w[b + k] + w[a + 8 + k] * w[b + 8 + k] + w[a + 16 + k] * w[b + 16 + k])


@row_kernel
def add_products(w: Array, o: int, v: int, g: Array, out: int, unknowns: int, lanes: int) -> None:
    """Add A'u to `unknowns` rows from g[out] on: A (3, unknowns) the scaled columns of the contact at w[o].

    u is the 3-vector of that contact at w[o + v]. Rows hold 8 programs; w (432 n,), g (488,), no unit.
    """
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
    """Subtract A y from the 3-vector at w[o + v]: A the scaled columns of the contact whose block begins at w[o].

    A is (3, unknowns), y the `unknowns` rows from g[y] on. Rows hold 8 programs; w (432 n,), g (488,), no unit.
    """
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
    """Add A'A to MATRIX of g: A the scaled columns, (3, unknowns), of the contact whose block begins at w[o].

    MATRIX holds the lower triangle, row by row, 8 programs per entry; w (432 n,), g (488,), no unit.
    """
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
