"""Forces that hold the CoM at a place: existence, smallest forces, least friction."""

import math
from dataclasses import dataclass

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.linear_kernels import inverse3

from ..programs.clarabel_tools import clarabel_and_sparse
from ..programs.contacts import ContactSet, StabilityError
from ..programs.interior import NO_PRIMAL, SOLVED
from ..programs.reduced import SMALL_MU, SPOT, matrices
from ..programs.reference import solve_one

FELT = 1e-8  # relative; twists that contacts feel less are not felt, and a smaller part of the load is none
CLOSE = 1e-9  # to that the least share of friction is found
NOTHING = 1e-10  # of the weight; less friction than that in excess is none
LARGEST_GAP = 1e-7  # of clarabel's answer, by which it is accepted
EXACT = 1e-12  # of the weight; forces that miss the load by more do not hold it
ROBUST = 1e4  # condition number, no unit, of moments of inertia up to that they are inverted
MOST_LOAD = 100.0  # weights, on all contacts together: the harder one presses between two walls, the less the share


@dataclass(frozen=True, slots=True)
class Equilibrium:
    """Forces with which contacts hold the CoM at a place, or a twist that proves that none do."""

    held: bool
    force: Array | None
    """Contact forces in units of the weight, well inside the cones, (n, 3); None if the robot is not held."""
    twist: Array | None
    """Twist (v m, Om) about the origin, (6,), with n'u >= mu |u_t| at every contact and v_z + (Om x c)_z < 0: the CoM
    sinks; proves that the robot is not held. None if it is."""


@dataclass(frozen=True, slots=True)
class LeastFriction:
    """Distribution of contact forces that is farthest from slipping: it needs the smallest share of the friction."""

    share: float
    """Smallest factor on every friction coefficient with which the CoM is held, 0 to 1; unlimited friction stays.

    The normal forces of all contacts together stay within 100 weights (twice those of some forces that hold the CoM,
    where these are more): between two walls every share above 0 holds, if only the robot presses hard enough."""
    force: Array
    """Contact forces with |f_t,i| <= share mu_i n'f_i, in units of the weight, (n, 3); not unique."""
    most: float
    """Limit of the sum of all normal forces, in units of the weight."""


def equilibrium(contacts: ContactSet, com: Array) -> Equilibrium:
    """Return forces in the friction cones that hold the CoM, or a twist as a proof that there are none.

    The balance is sum f = e_z, sum r x f = c x e_z, f contact forces in units of the weight, r contact points, c the
    CoM; its dual has a twist of six unknowns. Unlimited friction demands u_t = 0 of the twist (no tangential velocity
    at that point), and contacts at one point or on one line do not resist some twists: the program is solved in the
    remaining twists, and free tangential forces carry the rest.

    Args:
        contacts: any number, also none, with any friction.
        com: x, y of the CoM, (2,) m, frame of the contacts.

    Raises:
        StabilityError: no_convergence, by field `contacts`.
    """
    n = len(contacts)
    if n == 0:
        return Equilibrium(False, None, np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0]))
    column, wrench, origin, length = _wrenches(contacts)
    x, y = (com - origin[:2]) / length
    load = np.array([0.0, 0.0, 1.0, y, -x, 0.0])
    free = wrench[np.isinf(contacts.mu), 1:].reshape(-1, 6).T  # (6, 2k)
    cones = wrench.copy()
    cones[np.isinf(contacts.mu), 1:] = 0.0
    null = _image(free)[1]  # (6, m) twists that no free force works against
    felt, unfelt = _image((cones @ null).reshape(3 * n, null.shape[1]).T)
    down = null @ (unfelt @ (unfelt.T @ (null.T @ load)))
    if float(np.abs(down).max(initial=0.0)) > FELT * max(1.0, abs(x), abs(y)):
        return Equilibrium(False, None, _moved(-down, length, origin))
    basis, cone = null @ felt, np.zeros((n, 3))
    if basis.shape[1]:
        status, _, lam, cone, _ = solve_one(np.ascontiguousarray(cones @ basis), np.zeros((n, 3)), basis.T @ load)
        if status == NO_PRIMAL:
            return Equilibrium(False, None, _moved(basis @ lam, length, origin))
        if status != SOLVED:
            raise StabilityError("no_convergence", "contacts", "the solver found no answer for this contact set")
    if free.size:
        rest = load - np.einsum("iqj,iq->j", cones, cone)
        u, s, vt = np.linalg.svd(free, full_matrices=False)
        held = s > FELT
        amount = vt[held].T @ ((u[:, held].T @ rest) / s[held])
        cone[np.isinf(contacts.mu), 1:] = amount.reshape(-1, 2)
    return Equilibrium(True, np.einsum("iqd,iq->id", column, cone), None)


def _wrenches(contacts: ContactSet) -> tuple[Array, Array, Array, float]:
    """Return what the cone coordinates (normal, two tangents) of n contacts give: forces and wrenches, and their frame.

    Forces (n, 3, 3) and wrenches (n, 3, 6), force and moment about the origin, last index = axis; origin (3,) m, the
    contacts' centroid, and the unit of length of arms, m. With unlimited friction the three vectors have length 1, else
    the normal and the tangents of length mu are divided by sqrt(1 + mu^2).
    """
    unlimited = np.isinf(contacts.mu)
    mu = np.where(unlimited, 1.0, np.where(contacts.mu < SMALL_MU, 0.0, contacts.mu))
    a, _, origin, length, _ = matrices(contacts.position, contacts.normal, mu)
    column = a[:, :, :3].copy()
    column[unlimited] *= math.sqrt(2.0)
    arm = (contacts.position - origin) / length
    if np.abs(contacts.position - origin).max() <= SPOT:
        arm[:] = 0.0
    return column, np.concatenate((column, np.cross(arm[:, None, :], column)), axis=2), origin, length


def _image(columns: Array) -> tuple[Array, Array]:
    """Return orthonormal bases of what columns (m, k) span, (m, r), and of the rest of the space, (m, m - r)."""
    if not columns.size:
        return np.zeros((len(columns), 0)), np.eye(len(columns))
    u, s, _ = np.linalg.svd(columns)
    rank = int(np.count_nonzero(s > FELT))
    if rank == len(columns):
        return np.eye(rank), np.zeros((rank, 0))
    return u[:, :rank], u[:, rank:]


def _moved(scaled: Array, length: float, origin: Array) -> Array:
    """Return a twist (v m, Om), (6,), about the frame's origin from one in units of `length` about `origin` (3,) m."""
    return np.concatenate((length * scaled[:3] - np.cross(scaled[3:], origin), scaled[3:]))


def least_friction(contacts: ContactSet, com: Array) -> LeastFriction | None:
    """Return forces whose largest share of friction is the smallest (min-max); None if the CoM is not held.

    For a share s of every friction coefficient mu_i let t(s) = min t such that contact forces f_i hold the CoM and
    |f_t,i| <= mu_i (s n'f_i + t), n'f_i and f_t,i being normal and tangential parts: t is not above zero where the
    share is enough, and the program has an inside even where forces of that share are just possible. The root of t is
    found by Newton's method within a bracket. The normal forces sum up to 100 weights at the most (to twice those of
    the forces of `equilibrium`, where these are more), so between walls the share is that of so much pressing.

    Args:
        contacts: n, with any friction.
        com: x, y of the CoM, (2,) m, frame of the contacts.

    Raises:
        StabilityError: no_convergence, by field `contacts`.
    """
    some = equilibrium(contacts, com).force
    if some is None:
        return None
    most = max(MOST_LOAD, 2.0 * float(np.einsum("id,id->", contacts.normal, some)))
    low, high, share, force = 0.0, 1.0, 0.0, some
    while high - low > CLOSE:
        excess, slope, found = _excess(contacts, com, share, most)
        if abs(excess) <= CLOSE * slope:
            return LeastFriction(share, found, most)
        if excess > NOTHING:
            low = share
        else:  # also where t stays 0 for more: a contact that must not be loaded
            high, force = share, found
        newton = share + excess / slope if slope > CLOSE else low
        share = newton if low < newton < high else 0.5 * (low + high)
    return LeastFriction(high, force, most)


def _excess(contacts: ContactSet, com: Array, share: float, most: float) -> tuple[float, float, Array]:
    """Return t, its slope and forces (n, 3) for a share s of friction: min t with |f_t,i| <= mu_i (s n'f_i + t).

    The forces f_i (f_t,i tangential, n'f_i normal) hold the CoM, `com` (2,) m, and are in units of the weight, as is t;
    their normal parts sum up to at most `most`. The slope is -dt/ds = sum z_i n'f_i by the multipliers z.
    """
    clarabel, sparse = clarabel_and_sparse()
    n, limited = len(contacts), (contacts.mu >= SMALL_MU) & np.isfinite(contacts.mu)
    a, _, origin, length, _ = matrices(contacts.position, contacts.normal, np.ones(n))
    columns = math.sqrt(2.0) * a[:, :, :3]  # (n, 3, 3): unit normal, two tangents that are mu_i long
    columns[:, 1:] *= np.where(limited, contacts.mu, np.isinf(contacts.mu))[:, None, None]
    arm = (contacts.position - origin) / length
    wrench = np.concatenate((columns, np.cross(arm[:, None, :], columns)), axis=2)  # (n, 3, 6)
    x, y = (com - origin[:2]) / length
    identity = np.eye(3 * n + 1)  # unknowns: forces along the columns, t
    load = identity[0 : 3 * n : 3]
    rows = [np.pad(wrench.reshape(3 * n, 6).T, ((0, 0), (0, 1))), -load, load.sum(axis=0)[None], -identity[-1:]]
    right = np.concatenate(([0.0, 0.0, 1.0, y, -x, 0.0], np.zeros(n), [most, 1.0], np.zeros(3 * int(limited.sum()))))
    for i in np.flatnonzero(limited):
        rows.append(-np.vstack((share * load[i] + identity[-1], identity[3 * i + 1 : 3 * i + 3])))
    cones = [clarabel.ZeroConeT(6), clarabel.NonnegativeConeT(n + 2)]
    cones += [clarabel.SecondOrderConeT(3)] * int(limited.sum())
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.presolve_enable = False, False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    size, matrix = 3 * n + 1, sparse.csc_matrix(np.vstack(rows))
    found = clarabel.DefaultSolver(
        sparse.csc_matrix((size, size)), identity[-1], matrix, right, cones, settings
    ).solve()
    unknown, multiplier = np.array(found.x), np.array(found.z)[n + 8 :: 3]
    gap = abs(float(found.obj_val) - float(found.obj_val_dual))
    if not gap <= LARGEST_GAP:
        raise StabilityError("no_convergence", "contacts", f"clarabel ended with {found.status}, gap {gap:.1e}")
    cone = unknown[:-1].reshape(n, 3)
    slope = float(multiplier @ cone[limited, 0])
    cone[:, 0] = np.maximum(cone[:, 0], 0.0)  # what rounding puts outside: much of the share where the load is nil
    used, allowed = np.hypot(cone[:, 1], cone[:, 2]), share * cone[:, 0]
    outside = limited & (used > allowed)
    cone[outside, 1:] *= (allowed[outside] / used[outside])[:, None]
    return float(unknown[-1]), slope, np.einsum("iqd,iq->id", columns, cone)


def least_forces(contacts: ContactSet, com: Array) -> Array | None:
    """Return forces (n, 3) with the smallest sum of squares, in units of the weight; None if the CoM is not held.

    A force controller would command these: the least of all forces where those lie in the cones, as they mostly do on
    level ground, else a quadratic program over cones, solved by clarabel. `com`: x, y, (2,) m, frame of the contacts.

    Raises:
        StabilityError: no_convergence, by field `contacts`.
    """
    least = _least_of_all(contacts, com)
    if least is not None:
        return least
    if not equilibrium(contacts, com).held:
        return None
    clarabel, sparse = clarabel_and_sparse()

    n, unlimited = len(contacts), np.isinf(contacts.mu)
    column, wrench, origin, length = _wrenches(contacts)
    x, y = (com - origin[:2]) / length
    weight = sparse.block_diag([2.0 * c @ c.T for c in column], format="csc")
    identity = np.eye(3 * n)
    rows = [wrench.reshape(3 * n, 6).T, -identity[0 : 3 * n : 3][unlimited]]
    rows += [-identity[3 * i : 3 * i + 3] for i in np.flatnonzero(~unlimited)]
    matrix = sparse.csc_matrix(np.vstack(rows))
    right = np.concatenate(([0.0, 0.0, 1.0, y, -x, 0.0], np.zeros(matrix.shape[0] - 6)))
    cones = [clarabel.ZeroConeT(6), clarabel.NonnegativeConeT(int(unlimited.sum()))]
    cones += [clarabel.SecondOrderConeT(3)] * int((~unlimited).sum())
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solution = clarabel.DefaultSolver(
        sparse.triu(weight, format="csc"), np.zeros(3 * n), matrix, right, cones, settings
    ).solve()
    if "Solved" not in str(solution.status):
        raise StabilityError("no_convergence", "contacts", f"clarabel ended with {solution.status}")
    return np.einsum("iqd,iq->id", column, np.array(solution.x).reshape(n, 3))


def _least_of_all(contacts: ContactSet, com: Array) -> Array | None:
    """Return the balancing forces of least sum of squares, (n, 3), in units of the weight; None unless in the cones.

    `com`: x, y of the CoM, (2,) m, frame of the contacts.
    """
    n = len(contacts)
    if n == 0:
        return None
    arm = contacts.position - (float(com[0]), float(com[1]), 0.0)
    force = _least_balance(arm / max(float(np.abs(arm).max()), SPOT))
    if force is None:
        return None
    press = np.add.reduce(contacts.normal * force, axis=1)
    across = force - press[:, None] * contacts.normal
    most = np.multiply(contacts.mu, press, out=np.full(n, np.inf), where=np.isfinite(contacts.mu))
    inside = (press >= 0.0) & (np.add.reduce(across * across, axis=1) <= most * np.abs(most))
    return force if bool(inside.all()) else None


def _least_balance(arm: Array) -> Array | None:
    """Return forces f, (n, 3), of least sum of squares with sum f = e_z, sum r x f = 0; None: none hold to `EXACT`.

    They are f = e_z / n + w x q with q = r - c, c the mean of the arms r: orthogonal to all forces that balance to
    zero, as these do no work in a rigid motion. J w = e_z x c, with J = sum(|q|^2 I - q q'), balances the moment. Where
    J is near to singular, as for contacts on a line or close together, the forces are found by singular values.

    Args:
        arm: r, from the CoM, (n, 3), in any unit in which the longest is near 1.
    """
    n = len(arm)
    middle = np.add.reduce(arm) / n
    away = arm - middle
    spread = away.T @ away
    inertia = (spread[0, 0] + spread[1, 1] + spread[2, 2]) * np.eye(3) - spread
    turn = np.array([-middle[1], middle[0], 0.0])
    inverse, condition = inverse3(inertia)
    if condition < ROBUST:
        x, y, z = inverse @ turn
        force = away @ np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
        force[:, 2] += 1.0 / n
        if _unbalanced(arm, force) < EXACT:
            return force
    x, y, z = arm.T
    sums = np.zeros((6, n, 3))
    for axis in range(3):
        sums[axis, :, axis] = 1.0
    sums[3, :, 1], sums[3, :, 2] = -z, y
    sums[4, :, 0], sums[4, :, 2] = z, -x
    sums[5, :, 0], sums[5, :, 1] = -y, x
    force = np.linalg.lstsq(sums.reshape(6, 3 * n), np.eye(6)[2], rcond=None)[0].reshape(n, 3)
    return force if _unbalanced(arm, force) < EXACT else None


def _unbalanced(arm: Array, force: Array) -> float:
    """Return the largest part by which forces f miss sum f = e_z and sum r x f = 0; `arm` r, `force` f: (n, 3)."""
    (x, y, z), (a, b, c) = arm.T, force.T
    sums = [np.add.reduce(part) for part in (a, b, c, y * c - z * b, z * a - x * c, x * b - y * a)]
    return float(np.abs(np.array(sums) - np.eye(6)[2]).max())
