"""The part of an interior-point step that belongs to one contact's cone, for all lanes.

Cone Q = {(x0, x1, x2): x0 >= norm(x1, x2)}. Scaling of Nesterov and Todd: W x = W^-1 s = the scaled point, with
W = eta [w0, w1'; w1, I + w1 w1'/(1 + w0)]. Steps are taken in the scaled space and added to s and x as increments:
recomputing s and x from the scaled point loses eight digits near the boundary.
"""

import math

from surefoot.kernels.jit import row_kernel

from .lanes import (
    AXIS,
    COLUMNS,
    D_TAU,
    DUAL_RES,
    ETA,
    FIRST,
    GAIN,
    I_ETA,
    I_W0,
    LAMBDA,
    LENGTH,
    MASK,
    MU,
    REACH,
    RES,
    RESIDUAL,
    RHS,
    RHS_S,
    SCALED,
    SECOND,
    SIGMA,
    STEP,
    TARGET,
    TAU,
    Array,
    S,
    X,
)


@row_kernel
def start(w: Array, o: int, lanes: int) -> None:
    """s = x = (1, 0, 0), the centre."""
    o &= MASK
    for k in range(lanes):
        w[o + S + k] = w[o + X + k] = 1.0
        w[o + S + 8 + k] = w[o + S + 16 + k] = w[o + X + 8 + k] = w[o + X + 16 + k] = 0.0


@row_kernel
def residual(w: Array, o: int, g: Array, lanes: int) -> None:
    """RES = s + b tau; adds b'x to GAIN and s'x to MU."""
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
    """RES -= A lam, RESIDUAL -= A'x for the contact's matrix a[i] (3, m); DUAL_RES = max(DUAL_RES, abs(RES))."""
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
def scale(w: Array, o: int, lanes: int) -> None:
    """Scaling of (s, x); the scaled point; right-hand side and residual in the scaled space."""
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
    """COLUMNS = W^-1 A for the contact's matrix a[i] (3, m)."""
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
    """SECOND = RHS_S."""
    o &= MASK
    for k in range(lanes):
        w[o + SECOND + k] = w[o + RHS_S + k]
        w[o + SECOND + 8 + k] = w[o + RHS_S + 8 + k]
        w[o + SECOND + 16 + k] = w[o + RHS_S + 16 + k]


@row_kernel
def predictor(w: Array, o: int, lanes: int) -> None:
    """TARGET = - scaled point (complementarity zero at once); FIRST = TARGET + RES."""
    o &= MASK
    for k in range(lanes):
        q0, q1, q2 = -w[o + SCALED + k], -w[o + SCALED + 8 + k], -w[o + SCALED + 16 + k]
        w[o + TARGET + k], w[o + TARGET + 8 + k], w[o + TARGET + 16 + k] = q0, q1, q2
        w[o + FIRST + k], w[o + FIRST + 8 + k] = q0 + w[o + RES + k], q1 + w[o + RES + 8 + k]
        w[o + FIRST + 16 + k] = q2 + w[o + RES + 16 + k]


@row_kernel
def corrector(w: Array, o: int, g: Array, lanes: int) -> None:
    """TARGET = p \\ (sigma mu e - p o p - dx o ds), p the scaled point (Mehrotra); FIRST = TARGET + (1 - sigma) RES."""
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
    """STEP = FIRST + SECOND dtau; raises REACH to 1 / (longest step that stays in both cones)."""
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
    """x += length W^-1 STEP, s += length W (TARGET - STEP)."""
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
