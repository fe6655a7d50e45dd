"""The reduced programs of a contact set: matrices shared by all directions.

Forces in units of the weight, f_i = B_i D_i x_i with B_i = [n t1 t2] (normal and two tangents), D_i = diag(1, mu, mu) /
sqrt(1 + mu^2), x_i in the second-order cone Q.
For a column b of B_i D_i at r = (x, y, z):

    a_i[k] = (b_x, b_y, b_z, x b_y - y b_x)       balance of forces and of the yaw moment
    h_i[k] = (x b_z - z b_x, y b_z - z b_y)       what the force adds to the position of the CoM

Lengths are relative to the centroid of the contacts, in units of the largest distance from it.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.kernels.jit import row_kernel

from .contacts import ContactSet

SPOT = 1e-9  # m; contacts that lie nearer together are at one point: what is left of their distances is rounding
RANK = 1e-10  # relative; smaller singular values are taken as zero
THIN = 1e-7  # m, or of the unit of length; narrower than that is a segment, shorter a point
CONE = 1e-12  # slack of the conditions on a cone
SMALL_MU = 1e-9  # below it friction is left out


class Reduced(NamedTuple):
    """Cone programs of a set of n contacts: min c'lam with a_i lam - h_i d in the cone, for any horizontal direction d.

    a, h: balance and position of the CoM by forces in cone coordinates; c: objective of the unknowns lam; origin,
    length: the scaled frame, its origin the centroid of the contacts (m), its unit of length in m.
    """

    a: Array  # (n, 3, 4)
    h: Array  # (n, 3, 2)
    c: Array  # (4,) objective of the unknowns
    origin: Array  # (3,) m, centroid
    length: float  # m, unit of length


class Subspace(NamedTuple):
    """Subspace of twists (v, w_z) that are the unknowns of contacts of which some have unlimited or no friction."""

    basis: Array  # (4, 4) twist = basis @ unknowns + offset @ direction
    offset: Array  # (4, 2)
    point: Array  # (2,) position of the CoM that belongs to zero x
    free: Array  # (4, 2k) columns of the free tangential forces in the balance
    moment: Array  # (2, 2k) what they add to the position of the CoM
    drift: Array  # (2k, 2) free forces without effect on the balance, per unit direction: unbounded if not zero
    sinking: Array | None  # (4,) twist that proves that the set is infeasible
    columns: Array  # (n, 3, 4) matrices of the balance before the subspace was taken


@row_kernel
def matrices(position: Array, normal: Array, mu: Array) -> tuple[Array, Array, Array, float, float]:
    """Return the matrices of the cone programs of n contacts, and the scaled frame in which they hold.

    Args:
        position: points of contact, (n, 3) m.
        normal: unit normals, (n, 3).
        mu: friction coefficients, (n,); inf counts as 0 here.

    Returns:
        a (n, 3, 4): force x, y, z and yaw moment of each cone coordinate (normal, two tangents); h (n, 3, 2): what each
        adds to the x, y of the CoM; origin (3,) m, the centroid; unit of length, m, largest distance from it along the
        horizontal or along z; largest horizontal distance from it, m.
    """
    n = mu.size
    origin = np.zeros(3)
    for i in range(n):
        for q in range(3):
            origin[q] += position[i, q] / n
    length, spread = 0.0, 0.0
    for i in range(n):
        d = math.hypot(position[i, 0] - origin[0], position[i, 1] - origin[1])
        spread = max(spread, d)
        length = max(length, max(d, abs(position[i, 2] - origin[2])))
    spot = length <= SPOT
    if spot:
        length, spread = 1.0, 0.0
    a, h = np.empty((n, 3, 4)), np.empty((n, 3, 2))
    for i in range(n):
        nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
        if abs(nz) >= 0.5:  # t1 = n x e_x or n x e_z, normalised; t2 = n x t1
            tx, ty, tz = 0.0, nz, -ny
        else:
            tx, ty, tz = ny, -nx, 0.0
        inv = 1.0 / math.sqrt(tx * tx + ty * ty + tz * tz)
        tx, ty, tz = tx * inv, ty * inv, tz * inv
        x, y = (position[i, 0] - origin[0]) / length, (position[i, 1] - origin[1]) / length
        z = (position[i, 2] - origin[2]) / length
        if spot:
            x, y, z = 0.0, 0.0, 0.0
        friction = mu[i] if math.isfinite(mu[i]) else 0.0
        size = 1.0 / math.sqrt(1.0 + friction * friction)
        t = friction * size
        for k in range(3):
            if k == 0:
                bx, by, bz = size * nx, size * ny, size * nz
            elif k == 1:
                bx, by, bz = t * tx, t * ty, t * tz
            else:
                bx, by, bz = t * (ny * tz - nz * ty), t * (nz * tx - nx * tz), t * (nx * ty - ny * tx)
            a[i, k, 0], a[i, k, 1], a[i, k, 2], a[i, k, 3] = bx, by, bz, x * by - y * bx
            h[i, k, 0], h[i, k, 1] = x * bz - z * bx, y * bz - z * by
    return a, h, origin, length, spread


def reduce(contacts: ContactSet) -> tuple[Reduced, Subspace | None]:
    """Return the cone programs of at least one contact in a scaled frame, and the subspace of their unknowns.

    The subspace is None unless a contact has unlimited friction or less than `SMALL_MU`, or all lie on a vertical line.
    """
    each = contacts.mu.tolist()
    least, most = min(each), max(each)
    mu = contacts.mu if least >= SMALL_MU else np.where(contacts.mu < SMALL_MU, 0.0, contacts.mu)
    a, h, origin, length, spread = matrices(contacts.position, contacts.normal, mu)
    reduced = Reduced(a, h, np.array([0.0, 0.0, 1.0, 0.0]), origin, length)
    if least >= SMALL_MU and most < math.inf and spread > RANK * length:
        return reduced, None
    return _special(reduced, contacts, np.isinf(mu))


def _special(reduced: Reduced, contacts: ContactSet, unlimited: NDArray[np.bool_]) -> tuple[Reduced, Subspace]:
    """Return programs and subspace where some contacts have unlimited or no friction, or all lie on a vertical line.

    Free tangential forces (`unlimited` (n,): contacts that have them) demand that the twist lam does not move their
    points tangentially: linear equations E lam = e d, d the direction, solved by lam = offset d + basis eta. Where they
    contradict each other the free forces can shift the CoM at will. Twists that no contact resists are removed as well.
    """
    a, h, c = reduced.a, reduced.h, reduced.c
    clone = ContactSet(contacts.position, contacts.normal, np.ones(len(contacts)))
    ea, eh = matrices(clone.position, clone.normal, clone.mu)[:2]
    rows = math.sqrt(2.0) * ea[unlimited, 1:].reshape(-1, 4)  # E, (2k, 4); undoes the size of the cone columns
    sides = math.sqrt(2.0) * eh[unlimited, 1:].reshape(-1, 2)  # e, (2k, 2)
    offset, null = np.zeros((4, 2)), np.eye(4)
    if len(rows):
        u, s, vt = np.linalg.svd(rows)
        rank = int(np.count_nonzero(s > RANK))
        offset = vt[:rank].T @ ((u[:, :rank].T @ sides) / s[:rank, None])
        null = vt[rank:].T  # (4, m)
    drift = sides - rows @ offset
    drift[np.abs(drift) < RANK] = 0.0
    felt = (a @ null).reshape(3 * len(a), null.shape[1])
    s, vt = np.linalg.svd(felt)[1:] if felt.size else (np.empty(0), np.empty((0, 0)))
    rank = int(np.count_nonzero(s > RANK))
    unfelt = null @ vt[rank:].T
    sinking: Array | None = None
    down = unfelt @ (unfelt.T @ c)
    if down[2] > RANK:
        sinking = -down / down[2]
    basis = np.zeros((4, 4))
    basis[:, :rank] = null @ vt[:rank].T
    point = offset.T @ c
    special = Reduced(
        np.ascontiguousarray(a @ basis),
        np.ascontiguousarray(h - a @ offset),
        basis.T @ c,
        reduced.origin,
        reduced.length,
    )
    return special, Subspace(basis, offset, point, rows.T, sides.T, drift, sinking, a)
