"""Points of a region beyond the chords between its support points, without the solver.

The mean of the forces at
two support points holds the CoM in the middle of their chord. Where the border bulges between them, the forces of some
contacts differ in direction, and the mean lies inside these friction cones. From there one step of an affine-scaling
method leads outwards: with P_i = x_i x_i' - (x_i'J x_i) J / 2, J = diag(1, -1, -1), the inverse Hessian of the cone's
barrier -log x'Jx, the step d = P (g - A lam) gains most along the outward normal, g_i = h_i(normal), among all of its
length that keep the balance, A'd = 0; it ends where it meets a cone. Its end is a place of the CoM that forces hold,
as certain as a support point, for a fraction of its price.
"""

import math

import numpy as np

from surefoot.arrays import Array, Ints
from surefoot.kernels.jit import row_kernel

from .lanes import PIVOT
from .reduced import Reduced

LEAST = 1e-4  # of the area; smaller triangles over a chord are left out
BALANCED = 1e-10  # of the weight, largest error that a step may add to the balance


@row_kernel
def beyond_chords(
    r: Reduced, order: Ints, place: Array, force: Array, over: Array, tolerance: float, size: float
) -> Array:
    """Return points of a support region, (p, 2), up to three beyond each chord where its bounds are still apart.

    A chord joins two neighbouring support points; the region lies within the triangle over it that their outer bounds
    make. The scaled frame has its origin at the centroid of the n contacts, and their largest distance from it as unit.

    Args:
        r: cone programs of the contact set.
        order: indices of the support points by rising angle of their directions; its first `count` are used.
        place: (k, 2) support points, scaled frame.
        force: (k, n, 3) forces that hold the CoM at them, in units of the weight, cone coordinates (normal, two
            tangents).
        over: (count, 2) height and area of the triangle over each chord, in that order, scaled frame.
        tolerance: height up to which triangles are left out, scaled frame.
        size: area of the inner polygon, scaled frame; triangles below 1e-4 of it are left out.
    """
    h, n, count, found = r.h, r.h.shape[0], over.shape[0], 0
    point, equations = np.empty((3 * count, 2)), np.empty((4, 5))
    middle, side, step = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    for i in range(count):
        k, m = order[i], order[(i + 1) % count]
        if over[i, 0] <= tolerance or over[i, 1] <= LEAST * size:
            continue
        x, y, dx, dy = place[k, 0], place[k, 1], place[m, 0], place[m, 1]
        if not _outward(r, force[k], force[m], dy - y, x - dx, middle, step, equations):
            continue
        mx, my = _place(h, middle)
        point[found, 0], point[found, 1] = mx, my
        found += 1
        if _outward(r, force[k], middle, my - y, x - mx, side, step, equations):
            point[found, 0], point[found, 1] = _place(h, side)
            found += 1
        if _outward(r, middle, force[m], dy - my, mx - dx, side, step, equations):
            point[found, 0], point[found, 1] = _place(h, side)
            found += 1
    return point[:found]


@row_kernel
def _place(h: Array, x: Array) -> tuple[float, float]:
    """Return x, y of the CoM, scaled, that forces x (n, 3) in cone coordinates hold: sum of h_i'x_i, h (n, 3, 2)."""
    px, py = 0.0, 0.0
    for i in range(x.shape[0]):
        for q in range(3):
            px += h[i, q, 0] * x[i, q]
            py += h[i, q, 1] * x[i, q]
    return px, py


@row_kernel
def _outward(
    r: Reduced, first: Array, second: Array, nx: float, ny: float, x: Array, step: Array, equations: Array
) -> bool:
    """Write forces x (n, 3) that hold the CoM as far along (nx, ny) as one step from two feasible forces leads.

    Args:
        r: cone programs of the n contacts.
        first: forces (n, 3), in units of the weight, cone coordinates.
        second: forces (n, 3); the step begins at the mean of both.
        nx: x of the direction of gain, scaled frame, any length.
        ny: y of it.
        x: result, forces (n, 3), in units of the weight, cone coordinates.
        step: memory for the step, (n, 3).
        equations: memory for A'PA lam = A'P g, (4, 5): A balance, P inverse Hessian of the cones' barrier, g gain.

    Returns:
        False where no step can be trusted; x is then the mean.
    """
    a, h, n = r.a, r.h, x.shape[0]
    equations[:] = 0.0
    for i in range(n):
        for q in range(3):
            x[i, q] = 0.5 * (first[i, q] + second[i, q])
        for j in range(5):
            if j < 4:
                p0, p1, p2 = _weighed(x[i], a[i, 0, j], a[i, 1, j], a[i, 2, j])
            else:
                g0, g1, g2 = (
                    nx * h[i, 0, 0] + ny * h[i, 0, 1],
                    nx * h[i, 1, 0] + ny * h[i, 1, 1],
                    nx * h[i, 2, 0] + ny * h[i, 2, 1],
                )
                p0, p1, p2 = _weighed(x[i], g0, g1, g2)
            for k in range(min(j + 1, 4)):
                equations[k, j] += a[i, 0, k] * p0 + a[i, 1, k] * p1 + a[i, 2, k] * p2
    l0, l1, l2, l3 = _solved(equations)
    need, e0, e1, e2, e3 = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        for q in range(3):
            gain = nx * h[i, q, 0] + ny * h[i, q, 1]
            step[i, q] = gain - (a[i, q, 0] * l0 + a[i, q, 1] * l1 + a[i, q, 2] * l2 + a[i, q, 3] * l3)
        v0, v1, v2 = step[i, 0], step[i, 1], step[i, 2]
        # (x + t P v)'J(x + t P v) = x'Jx (1 + p t + w t^2): the step leaves the cone at the first zero
        p = x[i, 0] * v0 + x[i, 1] * v1 + x[i, 2] * v2
        w = 0.5 * _half(x[i]) * (v0 * v0 - v1 * v1 - v2 * v2)
        if p * p >= 4.0 * w:
            need = max(need, 0.5 * (math.sqrt(p * p - 4.0 * w) - p))
        d0, d1, d2 = _weighed(x[i], v0, v1, v2)
        step[i, 0], step[i, 1], step[i, 2] = d0, d1, d2
        e0 += a[i, 0, 0] * d0 + a[i, 1, 0] * d1 + a[i, 2, 0] * d2
        e1 += a[i, 0, 1] * d0 + a[i, 1, 1] * d1 + a[i, 2, 1] * d2
        e2 += a[i, 0, 2] * d0 + a[i, 1, 2] * d1 + a[i, 2, 2] * d2
        e3 += a[i, 0, 3] * d0 + a[i, 1, 3] * d1 + a[i, 2, 3] * d2
    if not max(max(abs(e0), abs(e1)), max(abs(e2), abs(e3))) < BALANCED * need:
        return False
    for i in range(n):
        for q in range(3):
            x[i, q] += step[i, q] / need
    return True


@row_kernel
def _half(x: Array) -> float:
    """Return x'Jx / 2, at least 0, of a force x (3,) in cone coordinates (normal, tangents), J = diag(1, -1, -1)."""
    side = math.sqrt(x[1] * x[1] + x[2] * x[2])
    return max(0.0, 0.5 * (x[0] - side) * (x[0] + side))


@row_kernel
def _weighed(x: Array, v0: float, v1: float, v2: float) -> tuple[float, float, float]:
    """Return P v, P the inverse Hessian of the cone's barrier at the force x (3,): x (x'v) - (x'Jx) J v / 2.

    J = diag(1, -1, -1); v = (v0, v1, v2); both in cone coordinates.
    """
    half, along = _half(x), x[0] * v0 + x[1] * v1 + x[2] * v2
    return x[0] * along - half * v0, x[1] * along + half * v1, x[2] * along + half * v2


@row_kernel
def _solved(equations: Array) -> tuple[float, float, float, float]:
    """Return the solution of four linear equations with a symmetric matrix, 0 in null directions.

    `equations` (4, 5): upper triangle of the matrix, right-hand side in the last column; overwritten.
    """
    floor = 0.0
    for j in range(4):
        floor = max(floor, PIVOT * equations[j, j])
    for j in range(4):
        pivot = 1.0 / equations[j, j] if equations[j, j] > floor else 0.0
        for k in range(j + 1, 4):
            share = equations[j, k] * pivot
            for c in range(k, 5):
                equations[k, c] -= share * equations[j, c]
        equations[j, j] = pivot
    l3 = equations[3, 4] * equations[3, 3]
    l2 = (equations[2, 4] - equations[2, 3] * l3) * equations[2, 2]
    l1 = (equations[1, 4] - equations[1, 2] * l2 - equations[1, 3] * l3) * equations[1, 1]
    l0 = (equations[0, 4] - equations[0, 1] * l1 - equations[0, 2] * l2 - equations[0, 3] * l3) * equations[0, 0]
    return l0, l1, l2, l3
