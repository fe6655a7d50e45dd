"""Own solver of the reduced dual: a homogeneous primal-dual interior-point method on eight lanes.

Program of a lane, m unknowns and n cones of dimension 3:

    min c'lam   s.t.  A_i lam - b_i in Q          (the dual: lam is a virtual twist, the certificate)
    max sum b_i'x_i   s.t.  sum A_i'x_i = c, x_i in Q     (the primal: x_i are the contact forces)

Embedding: s = A lam - b tau, A'x = c tau, kappa = b'x - c'lam, all in their cones; tau > 0 at the end solves both,
kappa > 0 proves that one of them has no solution. Newton steps are reduced to the m x m normal equations.
"""

import math

import numpy as np

from surefoot.arrays import Array, Ints
from surefoot.kernels.jit import row_kernel

from .lanes import (
    ACTIVE,
    AXIS,
    BLOCK,
    COLUMNS,
    COST,
    D_KAPPA,
    D_TAU,
    DEN,
    DUAL_RES,
    ETA,
    GAIN,
    GAP,
    I_ETA,
    I_W0,
    KAPPA,
    LAMBDA,
    LENGTH,
    MASK,
    MATRIX,
    MAX_UNKNOWNS,
    MU,
    P1,
    P2,
    PRIMAL_RES,
    REACH,
    RES,
    RESIDUAL,
    RHS,
    RHS_S,
    SCALED,
    SECOND,
    SIGMA,
    SIZE,
    TAU,
    S,
    X,
)
from .newton import add_dot, add_gram, add_products, factor, move, solve, step, subtract_combination

FAILED, SOLVED, NO_PRIMAL, NO_DUAL = 0, 1, 2, 3
"""Status of a program. `FAILED`: no answer; `SOLVED`; `NO_PRIMAL`: no forces exist, lam proves it; `NO_DUAL`: the gain
b'x has no bound, x proves it."""

TOLERANCE = 1e-9  # of residuals and gap; lengths ~ 1, weight 1, relative to the value where that is larger
ACCEPTABLE = 1e-7  # taken when no better one came
MAX_ITERATIONS = 60
STEP_SHARE = 0.99  # of the way to the boundary


@row_kernel
def aligned(size: int) -> Array:
    """Return `size` uninitialised numbers, (size,), no unit, from a cache line on: no row of eight lies across two."""
    room = np.empty(size + 8)
    skip = -(room.ctypes.data // 8) % 8
    return room[skip : skip + size]


@row_kernel
def solve_lanes(a: Array, rhs: Array, c: Array, lam: Array, x: Array, error: Array, status: Ints, share: float) -> int:
    """Solve up to eight programs min c'lam, A_i lam - b_i in the second-order cone Q, that differ in b_i only.

    Args:
        a: (n, 3, m) matrices A_i of n contacts.
        rhs: (n, 3, lanes) right-hand sides b_i, last index = program, at most 8.
        c: objective, (m,).
        lam: (m, lanes) start and result: the twist; with NO_PRIMAL a ray with c'lam = -1.
        x: (n, 3, lanes) start and result: forces in cone coordinates; with NO_DUAL a ray with b'x = 1.
        error: (lanes,) result: largest of residuals and gap, relative to max(1, value).
        status: (lanes,) result: FAILED 0, SOLVED 1, NO_PRIMAL 2 (no forces exist) or NO_DUAL 3 (gain without bound).
        share: weight of the pair lam, x in the start, 0 .. 1, the rest is the cones' centre; 0: they are not read.

    Returns:
        Number of iterations.
    """
    n, m, lanes = a.shape[0], c.size, rhs.shape[2]
    room = aligned(SIZE + n * BLOCK)
    g, w = room[:SIZE], room[SIZE:]  # one block: where two arrays lie apart by chance, the time varies by half
    for i in range(n):
        start(w, i * BLOCK, lanes)
        for q in range(3):
            for k in range(lanes):
                w[i * BLOCK + RHS + 8 * q + k] = rhs[i, q, k]
    for j in range(8 * MAX_UNKNOWNS):
        g[LAMBDA + j] = 0.0
    for k in range(lanes):
        g[TAU + k] = g[KAPPA + k] = g[ACTIVE + k] = 1.0
        status[k], error[k] = FAILED, ACCEPTABLE
    if share > 0.0:
        _start_near(a, lam, x, w, g, share)
    for iteration in range(MAX_ITERATIONS):
        _residuals(a, c, w, g, lanes)
        if not _keep_best(c, w, g, lam, x, error, status) or iteration == MAX_ITERATIONS - 1:
            return iteration
        _factorise(a, c, w, g, lanes)
        for k in range(lanes):
            g[SIGMA + k] = 0.0
        step(c, w, g, n, lanes, False)
        for k in range(lanes):
            t = 1.0 - 1.0 / g[REACH + k]
            g[SIGMA + k] = t * t * t
        step(c, w, g, n, lanes, True)
        for k in range(lanes):
            t = min(1.0, STEP_SHARE / g[REACH + k]) * g[ACTIVE + k]
            g[LENGTH + k] = t
            g[TAU + k] += t * g[D_TAU + k]
            g[KAPPA + k] += t * g[D_KAPPA + k]
        for j in range(m):
            for k in range(lanes):
                g[LAMBDA + 8 * j + k] += g[LENGTH + k] * (g[P1 + 8 * j + k] + g[D_TAU + k] * g[P2 + 8 * j + k])
        for i in range(n):
            move(w, i * BLOCK, g, lanes)
    return MAX_ITERATIONS


@row_kernel
def start(w: Array, o: int, lanes: int) -> None:
    """Write s = x = (1, 0, 0), the centre of the cone, for the contact whose block of 432 numbers begins at w[o]."""
    o &= MASK
    for k in range(lanes):
        w[o + S + k] = w[o + X + k] = 1.0
        w[o + S + 8 + k] = w[o + S + 16 + k] = w[o + X + 8 + k] = w[o + X + 16 + k] = 0.0


@row_kernel
def _start_near(a: Array, lam: Array, x: Array, w: Array, g: Array, share: float) -> None:
    """Mix the centre of the cones with a feasible pair in w and g: a start nearer to the solution, and off the borders.

    Args:
        a: matrix of each contact, (n, 3, m).
        lam: dual solution of each program, (m, lanes).
        x: primal forces, cone coordinates, (n, 3, lanes).
        w, g: (432 n,) state of the contacts, (488,) of the programs, layout in `lanes.py`, written.
        share: weight of the pair, 0 to 1.
    """
    n, m, lanes = a.shape[0], lam.shape[0], lam.shape[1]
    rest = 1.0 - share
    for k in range(lanes):
        g[KAPPA + k] = rest
    for j in range(m):
        for k in range(lanes):
            g[LAMBDA + 8 * j + k] = share * lam[j, k]
    for i in range(n):
        for q in range(3):
            o = (i * BLOCK + 8 * q) & MASK
            e = rest if q == 0 else 0.0
            for k in range(lanes):
                w[o + X + k] = share * x[i, q, k] + e
                w[o + S + k] = e - share * w[o + RHS + k]
            for j in range(m):
                b = a[i, q, j]
                for k in range(lanes):
                    w[o + S + k] += b * g[LAMBDA + 8 * j + k]


@row_kernel
def _residuals(a: Array, c: Array, w: Array, g: Array, lanes: int) -> None:
    """Write RES = s - A lam + b tau, RESIDUAL = c tau - A'x, GAP = kappa + c'lam - b'x, MU = mean complementarity.

    x forces, s dual slack, lam virtual twist, b right-hand side, tau and kappa of the embedding, and what is written:
    rows of w (contacts) or g (programs), layout in `lanes.py`; a (n, 3, m) = A; c (m,): objective.
    """
    n, m = a.shape[0], c.size
    for k in range(lanes):
        g[MU + k] = g[TAU + k] * g[KAPPA + k]
        g[DUAL_RES + k] = g[PRIMAL_RES + k] = g[COST + k] = g[GAIN + k] = 0.0
    for j in range(m):
        for k in range(lanes):
            g[RESIDUAL + 8 * j + k] = c[j] * g[TAU + k]
            g[COST + k] += c[j] * g[LAMBDA + 8 * j + k]
    for i in range(n):
        o = i * BLOCK
        residual(w, o, g, lanes)
        residual_columns(w, o, a, i, g, m, lanes)
    for j in range(m):
        for k in range(lanes):
            g[PRIMAL_RES + k] = max(g[PRIMAL_RES + k], abs(g[RESIDUAL + 8 * j + k]))
    for k in range(lanes):
        g[GAP + k] = g[KAPPA + k] + g[COST + k] - g[GAIN + k]
        g[MU + k] /= n + 1


@row_kernel
def residual(w: Array, o: int, g: Array, lanes: int) -> None:
    """Set RES, three rows of the contact whose block begins at w[o], to s + b tau; add b'x to GAIN and s'x to MU in g.

    s dual slack, x force, b right-hand side: rows of w (432 per contact); tau: row of g (488,). A row has 8 programs.
    """
    o &= MASK
    for k in range(lanes):
        tau = g[TAU + k]
        b0, b1, b2 = w[o + RHS + k], w[o + RHS + 8 + k], w[o + RHS + 16 + k]
        s0, s1, s2 = w[o + S + k], w[o + S + 8 + k], w[o + S + 16 + k]
        x0, x1, x2 = w[o + X + k], w[o + X + 8 + k], w[o + X + 16 + k]
        w[o + RES + k], w[o + RES + 8 + k], w[o + RES + 16 + k] = s0 + b0 * tau, s1 + b1 * tau, s2 + b2 * tau
        g[GAIN + k] += b0 * x0 + b1 * x1 + b2 * x2
        g[MU + k] += s0 * x0 + s1 * x1 + s2 * x2


@row_kernel
def residual_columns(w: Array, o: int, a: Array, i: int, g: Array, unknowns: int, lanes: int) -> None:
    """Subtract A lam from RES of the contact whose block is at w[o], A'x from RESIDUAL in g, A = a[i] (3, unknowns).

    lam, x: twist, force; DUAL_RES in g becomes max(DUAL_RES, abs(RES)). Rows of 8 programs; w (432 n,), g (488,).
    """
    o &= MASK
    if unknowns == 4:
        a00, a01, a02, a03 = a[i, 0, 0], a[i, 0, 1], a[i, 0, 2], a[i, 0, 3]
        a10, a11, a12, a13 = a[i, 1, 0], a[i, 1, 1], a[i, 1, 2], a[i, 1, 3]
        a20, a21, a22, a23 = a[i, 2, 0], a[i, 2, 1], a[i, 2, 2], a[i, 2, 3]
        for k in range(lanes):
            x0, x1, x2 = w[o + X + k], w[o + X + 8 + k], w[o + X + 16 + k]
            g[RESIDUAL + k] -= a00 * x0 + a10 * x1 + a20 * x2
            g[RESIDUAL + 8 + k] -= a01 * x0 + a11 * x1 + a21 * x2
            g[RESIDUAL + 16 + k] -= a02 * x0 + a12 * x1 + a22 * x2
            g[RESIDUAL + 24 + k] -= a03 * x0 + a13 * x1 + a23 * x2
            y0, y1, y2, y3 = g[LAMBDA + k], g[LAMBDA + 8 + k], g[LAMBDA + 16 + k], g[LAMBDA + 24 + k]
            w[o + RES + k] -= a00 * y0 + a01 * y1 + a02 * y2 + a03 * y3
            w[o + RES + 8 + k] -= a10 * y0 + a11 * y1 + a12 * y2 + a13 * y3
            w[o + RES + 16 + k] -= a20 * y0 + a21 * y1 + a22 * y2 + a23 * y3
    else:
        for j in range(unknowns):
            a0, a1, a2, y, r = a[i, 0, j], a[i, 1, j], a[i, 2, j], (LAMBDA + 8 * j) & MASK, (RESIDUAL + 8 * j) & MASK
            for k in range(lanes):
                t = g[y + k]
                g[r + k] -= a0 * w[o + X + k] + a1 * w[o + X + 8 + k] + a2 * w[o + X + 16 + k]
                w[o + RES + k] -= a0 * t
                w[o + RES + 8 + k] -= a1 * t
                w[o + RES + 16 + k] -= a2 * t
    for k in range(lanes):
        r = max(abs(w[o + RES + k]), max(abs(w[o + RES + 8 + k]), abs(w[o + RES + 16 + k])))
        g[DUAL_RES + k] = max(g[DUAL_RES + k], r)


@row_kernel
def _keep_best(c: Array, w: Array, g: Array, lam: Array, x: Array, error: Array, status: Ints) -> bool:
    """Keep the best answer of each program and retire those that are done; return True if one is left.

    Args:
        c: objective of the program, (m,).
        w, g: (432 n,) state of the contacts, (488,) of the programs, see `lanes.py`; ACTIVE becomes 0 where done.
        lam: dual solutions, (m, lanes), written.
        x: primal forces, cone coordinates, (n, 3, lanes), written.
        error: largest of residuals and gap, relative to max(1, value), (lanes,), written.
        status: FAILED, SOLVED, NO_PRIMAL or NO_DUAL, (lanes,), written.
    """
    n, m, left = x.shape[0], c.size, False
    for k in range(status.size):
        if g[ACTIVE + k] == 0.0:
            continue
        tau, cost, gain = g[TAU + k], g[COST + k], g[GAIN + k]
        worst = max(max(g[PRIMAL_RES + k], g[DUAL_RES + k]), abs(cost - gain)) / max(tau, abs(cost))
        if worst < error[k]:
            status[k], error[k] = SOLVED, worst
            _save(m, w, g, k, 1.0 / tau, lam, x)
        if math.isnan(worst) or worst <= TOLERANCE:  # NaN: numerically at the end, the best one stays
            g[ACTIVE + k] = 0.0
            continue
        if cost < 0.0 and status[k] == FAILED:
            worst = 0.0  # of s - A lam
            for i in range(n):
                for q in range(3):
                    o = i * BLOCK + 8 * q + k
                    worst = max(worst, abs(w[o + RES] - w[o + RHS] * tau))
            if worst <= -TOLERANCE * cost:
                status[k], error[k] = NO_PRIMAL, -worst / cost
        if gain > 0.0 and status[k] == FAILED:
            worst = 0.0  # of A'x
            for j in range(m):
                worst = max(worst, abs(g[RESIDUAL + 8 * j + k] - c[j] * tau))
            if worst <= TOLERANCE * gain:
                status[k], error[k] = NO_DUAL, worst / gain
        if status[k] > SOLVED:
            g[ACTIVE + k] = 0.0
            _save(m, w, g, k, -1.0 / cost if status[k] == NO_PRIMAL else 1.0 / gain, lam, x)
            continue
        left = True
    return left


@row_kernel
def _save(m: int, w: Array, g: Array, k: int, factor_: float, lam: Array, x: Array) -> None:
    for j in range(m):
        lam[j, k] = g[LAMBDA + 8 * j + k] * factor_
    for i in range(x.shape[0]):
        for q in range(3):
            x[i, q, k] = w[i * BLOCK + X + 8 * q + k] * factor_


@row_kernel
def _factorise(a: Array, c: Array, w: Array, g: Array, lanes: int) -> None:
    """Scale by W (Nesterov-Todd), factor M = A'W^-2 A, solve for the part of the step along dtau (P2, SECOND, DEN).

    They are rows of w (contacts) and g (programs), layout in `lanes.py`; a (n, 3, m) = A, c (m,) the objective.
    """
    n, m = a.shape[0], c.size
    for j in range(4 * m * (m + 1)):
        g[MATRIX + j] = 0.0
    for j in range(m):
        for k in range(lanes):
            g[P2 + 8 * j + k] = -c[j]
    for i in range(n):
        o = i * BLOCK
        scale(w, o, lanes)
        copy_rhs(w, o, lanes)
        scale_columns(w, o, a, i, m, lanes)
        add_products(w, o, RHS_S, g, P2, m, lanes)
        add_gram(w, o, g, m, lanes)
    factor(g, m, lanes)
    solve(g, m, P2, lanes)
    for k in range(lanes):
        g[DEN + k] = -g[KAPPA + k] / g[TAU + k]
    for j in range(m):
        for k in range(lanes):
            g[DEN + k] += c[j] * g[P2 + 8 * j + k]
    for i in range(n):
        o = i * BLOCK
        subtract_combination(w, o, SECOND, g, P2, m, lanes)
        add_dot(g, DEN, -1.0, w, o + RHS_S, o + SECOND, lanes)


@row_kernel
def scale(w: Array, o: int, lanes: int) -> None:
    """Write the Nesterov-Todd scaling W of the contact whose block begins at w[o]: W x = W^-1 s, s dual slack, x force.

    Written in its rows of 8 programs: axis and size of W, SCALED = W x, RHS_S = W^-1 b; RES becomes W^-1 RES.
    """
    o &= MASK
    for k in range(lanes):
        s0, s1, s2 = w[o + S + k], w[o + S + 8 + k], w[o + S + 16 + k]
        x0, x1, x2 = w[o + X + k], w[o + X + 8 + k], w[o + X + 16 + k]
        gs, gx = math.sqrt(s1 * s1 + s2 * s2), math.sqrt(x1 * x1 + x2 * x2)
        ns, nx = math.sqrt((s0 - gs) * (s0 + gs)), math.sqrt((x0 - gx) * (x0 + gx))
        i_s, i_x = 1.0 / ns, 1.0 / nx
        s0, s1, s2, x0, x1, x2 = s0 * i_s, s1 * i_s, s2 * i_s, x0 * i_x, x1 * i_x, x2 * i_x
        h = 0.5 / math.sqrt(0.5 * (1.0 + s0 * x0 + s1 * x1 + s2 * x2))
        w0, w1, w2 = (s0 + x0) * h, (s1 - x1) * h, (s2 - x2) * h
        eta = math.sqrt(ns * i_x)
        r = 1.0 / (1.0 + w0)
        t = w1 * x1 + w2 * x2
        f, c = eta * nx, x0 + t * r
        w[o + SCALED + k], w[o + SCALED + 8 + k] = f * (w0 * x0 + t), f * (x1 + w1 * c)
        w[o + SCALED + 16 + k] = f * (x2 + w2 * c)
        w[o + AXIS + k], w[o + AXIS + 8 + k], w[o + AXIS + 16 + k], w[o + ETA + k] = w0, w1, w2, eta
        f = 1.0 / eta
        w[o + I_ETA + k], w[o + I_W0 + k] = f, r
        v0, v1, v2 = w[o + RHS + k], w[o + RHS + 8 + k], w[o + RHS + 16 + k]
        t = w1 * v1 + w2 * v2
        c = t * r - v0
        w[o + RHS_S + k], w[o + RHS_S + 8 + k] = f * (w0 * v0 - t), f * (v1 + w1 * c)
        w[o + RHS_S + 16 + k] = f * (v2 + w2 * c)
        v0, v1, v2 = w[o + RES + k], w[o + RES + 8 + k], w[o + RES + 16 + k]
        t = w1 * v1 + w2 * v2
        c = t * r - v0
        w[o + RES + k], w[o + RES + 8 + k], w[o + RES + 16 + k] = (
            f * (w0 * v0 - t),
            f * (v1 + w1 * c),
            f * (v2 + w2 * c),
        )


@row_kernel
def scale_columns(w: Array, o: int, a: Array, i: int, unknowns: int, lanes: int) -> None:
    """Write W^-1 A, A = a[i] (3, unknowns), to COLUMNS of the contact whose block begins at w[o], by its scaling W."""
    o &= MASK
    for j in range(unknowns):
        v0, v1, v2, out = a[i, 0, j], a[i, 1, j], a[i, 2, j], (o + COLUMNS + 24 * j) & MASK
        for k in range(lanes):
            w0, w1, w2, f = w[o + AXIS + k], w[o + AXIS + 8 + k], w[o + AXIS + 16 + k], w[o + I_ETA + k]
            t = w1 * v1 + w2 * v2
            c = t * w[o + I_W0 + k] - v0
            w[out + k], w[out + 8 + k], w[out + 16 + k] = f * (w0 * v0 - t), f * (v1 + w1 * c), f * (v2 + w2 * c)


@row_kernel
def copy_rhs(w: Array, o: int, lanes: int) -> None:
    """Copy RHS_S, the scaled right-hand side, to SECOND, rows of 8 programs, for the contact whose block is at w[o]."""
    o &= MASK
    for k in range(lanes):
        w[o + SECOND + k] = w[o + RHS_S + k]
        w[o + SECOND + 8 + k] = w[o + RHS_S + 8 + k]
        w[o + SECOND + 16 + k] = w[o + RHS_S + 16 + k]
