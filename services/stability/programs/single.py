"""One support direction, as quickly as it goes: the solver of `interior` written out for one lane and four unknowns.

Rows of eight cost one program almost as much as eight: here each contact's numbers lie side by side and everything
that belongs to the program is a local variable. Same method, same tolerances, same outcomes (a test compares them).
"""

import math
from typing import NamedTuple

import numpy as np

from surefoot.kernels.jit import row_kernel
from surefoot.services.stability.programs.contacts import Array, ContactSet
from surefoot.services.stability.programs.interior import (
    ACCEPTABLE,
    FAILED,
    MAX_ITERATIONS,
    NO_DUAL,
    NO_PRIMAL,
    SOLVED,
    STEP_SHARE,
    TOLERANCE,
)
from surefoot.services.stability.programs.lanes import PIVOT
from surefoot.services.stability.programs.oracle import Oracle, SupportStatus
from surefoot.services.stability.programs.reduced import RANK, SMALL_MU, matrices

# columns of a contact's row, three for a vector
S, X, AXIS, ETA, P, BS, RS, SECOND, FIRST, TARGET, STEP, COLUMNS = 0, 3, 6, 9, 10, 13, 16, 19, 22, 25, 28, 31
WIDTH = 44


class SupportValue(NamedTuple):
    """How far the region reaches in one direction."""

    status: SupportStatus
    value: float
    """m, h(a); NaN unless status is ok."""
    point: Array
    """(2,) m, where it is reached."""
    twist: Array
    """(4,) certificate (v m, w_z) about the origin of the frame."""


def support_value(contacts: ContactSet, direction: Array) -> SupportValue:
    """h(a) for a unit direction (2,): the single SOCP of 4.3, without the region around it."""
    n = len(contacts)
    if n > 1 and contacts.mu.min() > SMALL_MU and contacts.mu.max() < math.inf:
        status, value, point, twist = _answer(
            contacts.position, contacts.normal, contacts.mu, float(direction[0]), float(direction[1])
        )
        if status == SOLVED:
            return SupportValue("ok", value, point, twist)
    return _careful(contacts, direction)


def _careful(contacts: ContactSet, direction: Array) -> SupportValue:
    """Walls, ceilings, no friction, nothing to stand on: the oracle's way."""
    nothing = np.full(2, np.nan)
    if len(contacts) == 0:
        return SupportValue("infeasible", math.nan, nothing, np.array([0.0, 0.0, -1.0, 0.0]))
    oracle = Oracle(contacts)
    if oracle.sinking is not None:
        return SupportValue("infeasible", math.nan, nothing, oracle.moved(oracle.sinking, np.zeros(2)))
    found = oracle.support(oracle.fan(direction[None], 1), np.zeros(1, dtype=np.int64))
    kind: SupportStatus = found.status[0]
    return SupportValue(kind, float(found.value[0]), found.point[0], found.twist[0])


@row_kernel
def _answer(position: Array, normal: Array, mu: Array, ax: float, ay: float) -> tuple[int, float, Array, Array]:
    a, h, origin, length, spread = matrices(position, normal, mu)
    n = mu.size
    lam, x = np.zeros(4), np.empty((n, 3))
    point, twist = np.zeros(2), np.empty(4)
    if spread <= RANK * length:
        return FAILED, math.nan, point, twist
    b = np.empty((n, 3))
    for i in range(n):
        for q in range(3):
            b[i, q] = ax * h[i, q, 0] + ay * h[i, q, 1]
    status = solve_single(a, b, lam, x)
    for i in range(n):
        for q in range(3):
            point[0] += h[i, q, 0] * x[i, q]
            point[1] += h[i, q, 1] * x[i, q]
    point[0], point[1] = origin[0] + length * point[0], origin[1] + length * point[1]
    w = lam[3]
    twist[0] = length * lam[0] - ax * origin[2] + w * origin[1]
    twist[1] = length * lam[1] - w * origin[0] - ay * origin[2]
    twist[2], twist[3] = length * lam[2] + ay * origin[1] + ax * origin[0], w
    return status, twist[2], point, twist


@row_kernel
def solve_single(a: Array, b: Array, lam_out: Array, x_out: Array) -> int:
    """min lam_2 s.t. A_i lam - b_i in Q, and its primal; see `interior.solve_lanes` for a (n, 3, 4), b (n, 3)."""
    n = b.shape[0]
    w = np.empty((n, WIDTH))
    for i in range(n):
        w[i, S] = w[i, X] = 1.0
        w[i, S + 1] = w[i, S + 2] = w[i, X + 1] = w[i, X + 2] = 0.0
    l0, l1, l2, l3, tau, kappa = 0.0, 0.0, 0.0, 0.0, 1.0, 1.0
    best, outcome = ACCEPTABLE, FAILED
    for iteration in range(MAX_ITERATIONS):
        # residuals
        mu, dual, gain = tau * kappa, 0.0, 0.0
        r0, r1, r2, r3 = 0.0, 0.0, tau, 0.0
        slack = 0.0  # of s - A lam, for the ray
        for i in range(n):
            s0, s1, s2 = w[i, S], w[i, S + 1], w[i, S + 2]
            x0, x1, x2 = w[i, X], w[i, X + 1], w[i, X + 2]
            gain += b[i, 0] * x0 + b[i, 1] * x1 + b[i, 2] * x2
            mu += s0 * x0 + s1 * x1 + s2 * x2
            r0 -= a[i, 0, 0] * x0 + a[i, 1, 0] * x1 + a[i, 2, 0] * x2
            r1 -= a[i, 0, 1] * x0 + a[i, 1, 1] * x1 + a[i, 2, 1] * x2
            r2 -= a[i, 0, 2] * x0 + a[i, 1, 2] * x1 + a[i, 2, 2] * x2
            r3 -= a[i, 0, 3] * x0 + a[i, 1, 3] * x1 + a[i, 2, 3] * x2
            e0 = s0 - (a[i, 0, 0] * l0 + a[i, 0, 1] * l1 + a[i, 0, 2] * l2 + a[i, 0, 3] * l3)
            e1 = s1 - (a[i, 1, 0] * l0 + a[i, 1, 1] * l1 + a[i, 1, 2] * l2 + a[i, 1, 3] * l3)
            e2 = s2 - (a[i, 2, 0] * l0 + a[i, 2, 1] * l1 + a[i, 2, 2] * l2 + a[i, 2, 3] * l3)
            slack = max(slack, max(abs(e0), max(abs(e1), abs(e2))))
            e0, e1, e2 = e0 + b[i, 0] * tau, e1 + b[i, 1] * tau, e2 + b[i, 2] * tau
            w[i, RS], w[i, RS + 1], w[i, RS + 2] = e0, e1, e2
            dual = max(dual, max(abs(e0), max(abs(e1), abs(e2))))
        primal = max(max(abs(r0), abs(r1)), max(abs(r2), abs(r3)))
        gap = kappa + l2 - gain
        mu /= n + 1
        # judge
        worst = max(max(primal, dual), abs(l2 - gain)) / max(tau, abs(l2))
        if worst < best:
            best, outcome = worst, SOLVED
            f = 1.0 / tau
            lam_out[0], lam_out[1], lam_out[2], lam_out[3] = l0 * f, l1 * f, l2 * f, l3 * f
            for i in range(n):
                x_out[i, 0], x_out[i, 1], x_out[i, 2] = w[i, X] * f, w[i, X + 1] * f, w[i, X + 2] * f
        if math.isnan(worst) or worst <= TOLERANCE:
            return outcome
        if outcome == FAILED:
            if l2 < 0.0 and slack <= -TOLERANCE * l2:
                return NO_PRIMAL
            free = max(max(abs(r0), abs(r1)), max(abs(r2 - tau), abs(r3)))  # of A'x
            if gain > 0.0 and free <= TOLERANCE * gain:
                return NO_DUAL
        if iteration == MAX_ITERATIONS - 1:
            return outcome
        # scale and factor
        m00, m10, m11, m20, m21, m22, m30, m31, m32, m33 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        q0, q1, q2, q3 = 0.0, 0.0, -1.0, 0.0
        for i in range(n):
            s0, s1, s2 = w[i, S], w[i, S + 1], w[i, S + 2]
            x0, x1, x2 = w[i, X], w[i, X + 1], w[i, X + 2]
            gs, gx = math.sqrt(s1 * s1 + s2 * s2), math.sqrt(x1 * x1 + x2 * x2)
            ns, nx = math.sqrt((s0 - gs) * (s0 + gs)), math.sqrt((x0 - gx) * (x0 + gx))
            f, g = 1.0 / ns, 1.0 / nx
            eta = math.sqrt(ns * g)
            s0, s1, s2, x0, x1, x2 = s0 * f, s1 * f, s2 * f, x0 * g, x1 * g, x2 * g
            g = 0.5 / math.sqrt(0.5 * (1.0 + s0 * x0 + s1 * x1 + s2 * x2))
            w0, w1, w2 = (s0 + x0) * g, (s1 - x1) * g, (s2 - x2) * g
            r = 1.0 / (1.0 + w0)
            t = w1 * x1 + w2 * x2
            f, g = eta * nx, x0 + t * r
            w[i, P], w[i, P + 1], w[i, P + 2] = f * (w0 * x0 + t), f * (x1 + w1 * g), f * (x2 + w2 * g)
            w[i, AXIS], w[i, AXIS + 1], w[i, AXIS + 2], w[i, ETA] = w0, w1, w2, eta
            f = 1.0 / eta
            t = w1 * b[i, 1] + w2 * b[i, 2]
            g = t * r - b[i, 0]
            v0, v1, v2 = f * (w0 * b[i, 0] - t), f * (b[i, 1] + w1 * g), f * (b[i, 2] + w2 * g)
            w[i, BS], w[i, BS + 1], w[i, BS + 2] = v0, v1, v2
            e0, e1, e2 = w[i, RS], w[i, RS + 1], w[i, RS + 2]
            t = w1 * e1 + w2 * e2
            g = t * r - e0
            w[i, RS], w[i, RS + 1], w[i, RS + 2] = f * (w0 * e0 - t), f * (e1 + w1 * g), f * (e2 + w2 * g)
            for j in range(4):
                e0, e1, e2 = a[i, 0, j], a[i, 1, j], a[i, 2, j]
                t = w1 * e1 + w2 * e2
                g = t * r - e0
                k = COLUMNS + 3 * j
                w[i, k], w[i, k + 1], w[i, k + 2] = f * (w0 * e0 - t), f * (e1 + w1 * g), f * (e2 + w2 * g)
            a0, a1, a2 = w[i, COLUMNS], w[i, COLUMNS + 1], w[i, COLUMNS + 2]
            b0, b1, b2 = w[i, COLUMNS + 3], w[i, COLUMNS + 4], w[i, COLUMNS + 5]
            c0, c1, c2 = w[i, COLUMNS + 6], w[i, COLUMNS + 7], w[i, COLUMNS + 8]
            d0, d1, d2 = w[i, COLUMNS + 9], w[i, COLUMNS + 10], w[i, COLUMNS + 11]
            m00 += a0 * a0 + a1 * a1 + a2 * a2
            m10 += a0 * b0 + a1 * b1 + a2 * b2
            m11 += b0 * b0 + b1 * b1 + b2 * b2
            m20 += a0 * c0 + a1 * c1 + a2 * c2
            m21 += b0 * c0 + b1 * c1 + b2 * c2
            m22 += c0 * c0 + c1 * c1 + c2 * c2
            m30 += a0 * d0 + a1 * d1 + a2 * d2
            m31 += b0 * d0 + b1 * d1 + b2 * d2
            m32 += c0 * d0 + c1 * d1 + c2 * d2
            m33 += d0 * d0 + d1 * d1 + d2 * d2
            q0 += a0 * v0 + a1 * v1 + a2 * v2
            q1 += b0 * v0 + b1 * v1 + b2 * v2
            q2 += c0 * v0 + c1 * v1 + c2 * v2
            q3 += d0 * v0 + d1 * v1 + d2 * v2
        floor = PIVOT * max(max(m00, m11), max(m22, m33))
        m00 = 1.0 / math.sqrt(m00) if m00 > floor else 0.0
        m10 *= m00
        m11 -= m10 * m10
        m11 = 1.0 / math.sqrt(m11) if m11 > floor else 0.0
        m20 *= m00
        m21 = (m21 - m10 * m20) * m11
        m22 -= m20 * m20 + m21 * m21
        m22 = 1.0 / math.sqrt(m22) if m22 > floor else 0.0
        m30 *= m00
        m31 = (m31 - m10 * m30) * m11
        m32 = (m32 - m20 * m30 - m21 * m31) * m22
        m33 -= m30 * m30 + m31 * m31 + m32 * m32
        m33 = 1.0 / math.sqrt(m33) if m33 > floor else 0.0
        q0 *= m00
        q1 = (q1 - m10 * q0) * m11
        q2 = (q2 - m20 * q0 - m21 * q1) * m22
        q3 = (q3 - m30 * q0 - m31 * q1 - m32 * q2) * m33
        q3 *= m33
        q2 = (q2 - m32 * q3) * m22
        q1 = (q1 - m21 * q2 - m31 * q3) * m11
        q0 = (q0 - m10 * q1 - m20 * q2 - m30 * q3) * m00
        den = q2 - kappa / tau
        for i in range(n):
            v0, v1, v2 = w[i, BS], w[i, BS + 1], w[i, BS + 2]
            c = COLUMNS
            e0 = v0 - (w[i, c] * q0 + w[i, c + 3] * q1 + w[i, c + 6] * q2 + w[i, c + 9] * q3)
            e1 = v1 - (w[i, c + 1] * q0 + w[i, c + 4] * q1 + w[i, c + 7] * q2 + w[i, c + 10] * q3)
            e2 = v2 - (w[i, c + 2] * q0 + w[i, c + 5] * q1 + w[i, c + 8] * q2 + w[i, c + 11] * q3)
            w[i, SECOND], w[i, SECOND + 1], w[i, SECOND + 2] = e0, e1, e2
            den -= v0 * e0 + v1 * e1 + v2 * e2
        # predictor, corrector
        sigma, dtau, dkappa, reach = 0.0, 0.0, 0.0, 1.0
        p0, p1, p2, p3 = 0.0, 0.0, 0.0, 0.0
        for phase in range(2):
            rest = 1.0 - sigma
            p0, p1, p2, p3 = -rest * r0, -rest * r1, -rest * r2, -rest * r3
            for i in range(n):
                y0, y1, y2 = w[i, P], w[i, P + 1], w[i, P + 2]
                if phase == 0:
                    t0, t1, t2 = -y0, -y1, -y2
                else:
                    d0, d1, d2 = w[i, STEP], w[i, STEP + 1], w[i, STEP + 2]
                    e0, e1, e2 = -y0 - d0, -y1 - d1, -y2 - d2
                    f0 = sigma * mu - (y0 * y0 + y1 * y1 + y2 * y2) - (d0 * e0 + d1 * e1 + d2 * e2)
                    f1 = -2.0 * y0 * y1 - (d0 * e1 + e0 * d1)
                    f2 = -2.0 * y0 * y2 - (d0 * e2 + e0 * d2)
                    norm = math.sqrt(y1 * y1 + y2 * y2)
                    det = 1.0 / ((y0 - norm) * (y0 + norm))
                    z, inv = y1 * f1 + y2 * f2, 1.0 / y0
                    t = (z * inv - f0) * det
                    t0, t1, t2 = (y0 * f0 - z) * det, f1 * inv + t * y1, f2 * inv + t * y2
                w[i, TARGET], w[i, TARGET + 1], w[i, TARGET + 2] = t0, t1, t2
                t0, t1, t2 = t0 + rest * w[i, RS], t1 + rest * w[i, RS + 1], t2 + rest * w[i, RS + 2]
                w[i, FIRST], w[i, FIRST + 1], w[i, FIRST + 2] = t0, t1, t2
                c = COLUMNS
                p0 += w[i, c] * t0 + w[i, c + 1] * t1 + w[i, c + 2] * t2
                p1 += w[i, c + 3] * t0 + w[i, c + 4] * t1 + w[i, c + 5] * t2
                p2 += w[i, c + 6] * t0 + w[i, c + 7] * t1 + w[i, c + 8] * t2
                p3 += w[i, c + 9] * t0 + w[i, c + 10] * t1 + w[i, c + 11] * t2
            p0 *= m00
            p1 = (p1 - m10 * p0) * m11
            p2 = (p2 - m20 * p0 - m21 * p1) * m22
            p3 = (p3 - m30 * p0 - m31 * p1 - m32 * p2) * m33
            p3 *= m33
            p2 = (p2 - m32 * p3) * m22
            p1 = (p1 - m21 * p2 - m31 * p3) * m11
            p0 = (p0 - m10 * p1 - m20 * p2 - m30 * p3) * m00
            dk = sigma * mu - kappa * tau - (dtau * dkappa if phase == 1 else 0.0)
            num = -rest * gap - dk / tau - p2
            for i in range(n):
                c = COLUMNS
                e0 = w[i, FIRST] - (w[i, c] * p0 + w[i, c + 3] * p1 + w[i, c + 6] * p2 + w[i, c + 9] * p3)
                e1 = w[i, FIRST + 1] - (w[i, c + 1] * p0 + w[i, c + 4] * p1 + w[i, c + 7] * p2 + w[i, c + 10] * p3)
                e2 = w[i, FIRST + 2] - (w[i, c + 2] * p0 + w[i, c + 5] * p1 + w[i, c + 8] * p2 + w[i, c + 11] * p3)
                w[i, FIRST], w[i, FIRST + 1], w[i, FIRST + 2] = e0, e1, e2
                num += w[i, BS] * e0 + w[i, BS + 1] * e1 + w[i, BS + 2] * e2
            dtau = num / den
            dkappa = (dk - kappa * dtau) / tau
            reach = max(1.0, max(-dtau / tau, -dkappa / kappa))
            for i in range(n):
                d0 = w[i, FIRST] + dtau * w[i, SECOND]
                d1 = w[i, FIRST + 1] + dtau * w[i, SECOND + 1]
                d2 = w[i, FIRST + 2] + dtau * w[i, SECOND + 2]
                w[i, STEP], w[i, STEP + 1], w[i, STEP + 2] = d0, d1, d2
                e0, e1, e2 = w[i, TARGET] - d0, w[i, TARGET + 1] - d1, w[i, TARGET + 2] - d2
                y0, y1, y2 = w[i, P], w[i, P + 1], w[i, P + 2]
                norm = math.sqrt(y1 * y1 + y2 * y2)
                inv = 1.0 / math.sqrt((y0 - norm) * (y0 + norm))
                y0, y1, y2 = y0 * inv, y1 * inv, y2 * inv
                g = 1.0 / (1.0 + y0)
                t = y0 * d0 - y1 * d1 - y2 * d2
                f = (t + d0) * g
                d1, d2 = d1 - f * y1, d2 - f * y2
                z = (math.sqrt(d1 * d1 + d2 * d2) - t) * inv
                t = y0 * e0 - y1 * e1 - y2 * e2
                f = (t + e0) * g
                e1, e2 = e1 - f * y1, e2 - f * y2
                reach = max(reach, max(z, (math.sqrt(e1 * e1 + e2 * e2) - t) * inv))
            if phase == 0:
                t = 1.0 - 1.0 / reach
                sigma = t * t * t
        # move
        size = min(1.0, STEP_SHARE / reach)
        tau, kappa = tau + size * dtau, kappa + size * dkappa
        l0, l1 = l0 + size * (p0 + dtau * q0), l1 + size * (p1 + dtau * q1)
        l2, l3 = l2 + size * (p2 + dtau * q2), l3 + size * (p3 + dtau * q3)
        for i in range(n):
            d0, d1, d2 = w[i, STEP], w[i, STEP + 1], w[i, STEP + 2]
            e0, e1, e2 = w[i, TARGET] - d0, w[i, TARGET + 1] - d1, w[i, TARGET + 2] - d2
            w0, w1, w2, eta = w[i, AXIS], w[i, AXIS + 1], w[i, AXIS + 2], w[i, ETA]
            r = 1.0 / (1.0 + w0)
            f = size / eta
            t = w1 * d1 + w2 * d2
            g = t * r - d0
            w[i, X] += f * (w0 * d0 - t)
            w[i, X + 1] += f * (d1 + w1 * g)
            w[i, X + 2] += f * (d2 + w2 * g)
            f = size * eta
            t = w1 * e1 + w2 * e2
            g = t * r + e0
            w[i, S] += f * (w0 * e0 + t)
            w[i, S + 1] += f * (e1 + w1 * g)
            w[i, S + 2] += f * (e2 + w2 * g)
    return outcome


def warm() -> None:
    """Compile the solver."""
    feet = np.array([[0.1, 0.1, 0.0], [0.1, -0.1, 0.02], [-0.1, 0.0, 0.0]])
    support_value(ContactSet(feet, np.tile([0.0, 0.0, 1.0], (3, 1)), np.full(3, 0.5)), np.array([1.0, 0.0]))
