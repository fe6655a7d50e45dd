"""Own solver of the reduced dual: a homogeneous primal-dual interior-point method on eight lanes.

Program of a lane, m unknowns and n cones of dimension 3:

    min c'lam   s.t.  A_i lam - b_i in Q          (the dual: lam is a virtual twist, the certificate)
    max sum b_i'x_i   s.t.  sum A_i'x_i = c, x_i in Q     (the primal: x_i are the contact forces)

Embedding: s = A lam - b tau, A'x = c tau, kappa = b'x - c'lam, all in their cones; tau > 0 at the end solves both,
kappa > 0 proves that one of them has no solution. Newton steps are reduced to the m x m normal equations.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import row_kernel

from . import cones
from .lanes import (
    ACTIVE,
    BLOCK,
    COST,
    D_KAPPA,
    D_TAU,
    DEN,
    DUAL_RES,
    FIRST,
    GAIN,
    GAP,
    KAPPA,
    LAMBDA,
    LENGTH,
    MASK,
    MATRIX,
    MAX_UNKNOWNS,
    MU,
    NUM,
    P1,
    P2,
    PRIMAL_RES,
    REACH,
    RES,
    RESIDUAL,
    RHS,
    RHS_S,
    SECOND,
    SIGMA,
    SIZE,
    TAU,
    Array,
    S,
    X,
    add_dot,
    add_gram,
    add_products,
    factor,
    solve,
    subtract_combination,
)

Ints = NDArray[np.int64]

FAILED, SOLVED, NO_PRIMAL, NO_DUAL = 0, 1, 2, 3
"""Outcome of a lane. NO_PRIMAL: no forces exist, lam proves it. NO_DUAL: the gain has no bound, x proves it."""

TOLERANCE = 1e-9  # of residuals and gap; lengths ~ 1, weight 1, relative to the value where that is larger
ACCEPTABLE = 1e-7  # taken when no better one came
MAX_ITERATIONS = 60
STEP_SHARE = 0.99  # of the way to the boundary


@row_kernel
def aligned(size: int) -> Array:
    """Uninitialised numbers that begin on a cache line, so that no row of eight lies across two."""
    room = np.empty(size + 8)
    skip = -(room.ctypes.data // 8) % 8
    return room[skip : skip + size]


@row_kernel
def solve_lanes(a: Array, rhs: Array, c: Array, lam: Array, x: Array, error: Array, status: Ints, share: float) -> int:
    """Solve up to eight programs that share the matrix.

    Args:
        a: (n, 3, m) matrices A_i.
        rhs: (n, 3, 8) right-hand sides b_i, last index = lane.
        c: objective, (m,).
        lam: (m, 8) result: the twist; with NO_PRIMAL a ray with c'lam = -1.
        x: (n, 3, 8) result: forces in cone coordinates; with NO_DUAL a ray with b'x = 1.
        error: (8,) result: largest of residuals and gap, relative to max(1, value).
        status: (8,) result: FAILED, SOLVED, NO_PRIMAL or NO_DUAL.
        share: of a feasible pair given in lam and x, that the start is made of; the rest is the centre.

    Returns:
        Number of iterations.
    """
    n, m, lanes = a.shape[0], c.size, rhs.shape[2]
    room = aligned(SIZE + n * BLOCK)
    g, w = room[:SIZE], room[SIZE:]  # one block: where two arrays lie apart by chance, the time varies by half
    for i in range(n):
        cones.start(w, i * BLOCK, lanes)
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
        if not _judge(c, w, g, lam, x, error, status) or iteration == MAX_ITERATIONS - 1:
            return iteration
        _factorise(a, c, w, g, lanes)
        for k in range(lanes):
            g[SIGMA + k] = 0.0
        _step(c, w, g, n, lanes, False)
        for k in range(lanes):
            t = 1.0 - 1.0 / g[REACH + k]
            g[SIGMA + k] = t * t * t
        _step(c, w, g, n, lanes, True)
        for k in range(lanes):
            t = min(1.0, STEP_SHARE / g[REACH + k]) * g[ACTIVE + k]
            g[LENGTH + k] = t
            g[TAU + k] += t * g[D_TAU + k]
            g[KAPPA + k] += t * g[D_KAPPA + k]
        for j in range(m):
            for k in range(lanes):
                g[LAMBDA + 8 * j + k] += g[LENGTH + k] * (g[P1 + 8 * j + k] + g[D_TAU + k] * g[P2 + 8 * j + k])
        for i in range(n):
            cones.move(w, i * BLOCK, g, lanes)
    return MAX_ITERATIONS


@row_kernel
def _start_near(a: Array, lam: Array, x: Array, w: Array, g: Array, share: float) -> None:
    """Mix the centre with a feasible pair: less of the way is left, and no cone is near."""
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
    """RES = s - A lam + b tau, RESIDUAL = c tau - A'x, GAP = kappa + c'lam - b'x, MU = mean complementarity."""
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
        cones.residual(w, o, g, lanes)
        cones.residual_columns(w, o, a, i, g, m, lanes)
    for j in range(m):
        for k in range(lanes):
            g[PRIMAL_RES + k] = max(g[PRIMAL_RES + k], abs(g[RESIDUAL + 8 * j + k]))
    for k in range(lanes):
        g[GAP + k] = g[KAPPA + k] + g[COST + k] - g[GAIN + k]
        g[MU + k] /= n + 1


@row_kernel
def _judge(c: Array, w: Array, g: Array, lam: Array, x: Array, error: Array, status: Ints) -> bool:
    """Keep what has become better, retire what is done; tells whether a lane is left."""
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
    """Scale, factor M = A'W^-2 A, and solve for the part of the step that is proportional to dtau (P2, SECOND, DEN)."""
    n, m = a.shape[0], c.size
    for j in range(4 * m * (m + 1)):
        g[MATRIX + j] = 0.0
    for j in range(m):
        for k in range(lanes):
            g[P2 + 8 * j + k] = -c[j]
    for i in range(n):
        o = i * BLOCK
        cones.scale(w, o, lanes)
        cones.copy_rhs(w, o, lanes)
        cones.scale_columns(w, o, a, i, m, lanes)
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
def _step(c: Array, w: Array, g: Array, n: int, lanes: int, correct: bool) -> None:
    """Predictor (sigma = 0), or corrector with the second-order terms of the predictor's step."""
    m = c.size
    for j in range(m):
        for k in range(lanes):
            g[P1 + 8 * j + k] = (g[SIGMA + k] - 1.0) * g[RESIDUAL + 8 * j + k]
    for i in range(n):
        o = i * BLOCK
        if correct:
            cones.corrector(w, o, g, lanes)
        else:
            cones.predictor(w, o, lanes)
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
        cones.direction(w, i * BLOCK, g, lanes)
