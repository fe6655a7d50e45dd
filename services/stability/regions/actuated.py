"""Region that the servos can hold: friction cones and torque limits, with the weight of the legs.

The joint torques of leg i are tau_i = G_i - J_i'F_i: G_i (3,) Nm holds the leg's own weight, J_i (3, 3) m/rad is the
Jacobian of its contact point, F_i (3,) N the force of the ground. So |tau_i| <= tau_max are six linear inequalities for
each leg of three joints. With forces in units of the weight, f_i = F_i / (m g) = B_i D_i x_i, x_i in the second-order
cone Q (x_i cone coordinates, B_i = [normal, two tangents], D_i their scale by friction):

    h(a) = max sum h_i(a)'x_i   s.t.  sum A_i'x_i = (0,0,1,0),  x_i in Q,
           G_ij - mg J_ij'B_i D_i x_i within +- tau_max_j

with A_i'x_i the force and yaw moment of contact i, h_i(a)'x_i what it adds to the CoM along a. Solved by clarabel, one
solver for all directions a. The posture is held fixed, as is the legs' weight: the region holds the places where a load
may bring the CoM (Orsolino et al.), near the present posture where the joints may.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.polygon import gap, half_planes, hull

from ..programs.clarabel_tools import clarabel_and_sparse
from ..programs.contacts import ContactSet, StabilityError, equally_spaced
from ..programs.reduced import SMALL_MU, THIN, matrices
from .model import Region, RegionStatus, Support, SupportStatus

GAP = 1e-7  # m, largest duality gap that is accepted
SIXTEEN = equally_spaced(16)  # they decide between point, segment and area


@dataclass(frozen=True, slots=True)
class ServoLegs:
    """Jacobians, torques and torque limits of the servos of n standing legs, world axes, and the robot's weight."""

    jacobian: Array
    """Derivatives of the contact points by the joint angles of their legs, (n, 3, 3) m/rad."""
    own: Array
    """Torques G_i with which the servos hold the weight of the legs themselves, (n, 3) Nm."""
    limit: Array
    """Largest torques of the servos of each standing leg, (n, 3) Nm."""
    weight: float
    """Weight of the robot, m g, N."""


class _Cones(NamedTuple):
    """Cone program of a contact set with torque limits, all but its objective: balance, limits and friction cones."""

    a: Array
    """Columns of the balance equations per cone coordinate, (n, 3, 4): force x, y, z, and yaw moment."""
    h: Array
    """Position x, y of the CoM per unit of each cone coordinate, (n, 3, 2), scaled frame."""
    origin: Array
    """Origin of the scaled frame, the centroid of the contacts, frame of the contacts, (3,) m."""
    length: float
    """Unit of length of the scaled frame, m: largest distance of a contact from the centroid."""
    rows: Any
    """Matrix of the constraints of clarabel, sparse (rows, unknowns)."""
    right: Array
    """Right sides of the constraints, (rows,), in the order of the matrix `rows`."""
    cones: list[Any]
    """Cones of the constraints, as objects of clarabel, in the order of `rows`."""


def _cones(contacts: ContactSet, legs: ServoLegs, clarabel: Any, sparse: Any) -> _Cones:
    """Return the cone program of contacts and legs; `clarabel` and `sparse` are the modules of that name."""
    n = len(contacts)
    unlimited = np.isinf(contacts.mu)  # the cone is a half-space: one normal and two free tangential forces
    mu = np.where(unlimited, 1.0, np.where(contacts.mu < SMALL_MU, 0.0, contacts.mu))
    a, h, origin, length, _ = matrices(contacts.position, contacts.normal, mu)
    by_cone = legs.weight * np.einsum("iqd,idj->ijq", a[:, :, :3], legs.jacobian)  # torque per cone coordinate
    scale = max(float(legs.limit.max()), 1e-9)
    torque = sparse.block_diag([m / scale for m in by_cone], format="csc")
    balance = sparse.csc_matrix(a.reshape(3 * n, 4).T)
    identity = sparse.identity(3 * n, format="csr")
    pushing = np.flatnonzero(np.repeat(unlimited, 3) & (np.arange(3 * n) % 3 == 0))
    limited = np.flatnonzero(np.repeat(~unlimited, 3))
    rows = sparse.vstack([balance, torque, -torque, -identity[pushing], -identity[limited]], format="csc")
    own, limit = legs.own.ravel() / scale, legs.limit.ravel() / scale
    right = np.concatenate(([0.0, 0.0, 1.0, 0.0], own + limit, limit - own, np.zeros(rows.shape[0] - 6 * n - 4)))
    cones = [clarabel.ZeroConeT(4), clarabel.NonnegativeConeT(6 * n + len(pushing))]
    cones += [clarabel.SecondOrderConeT(3)] * int((~unlimited).sum())
    return _Cones(a, h, origin, length, rows, right, cones)


def actuated_region(contacts: ContactSet, legs: ServoLegs, given: Array | None = None) -> Region:
    """Return the region of the centre of mass under friction and torque limits of the servos.

    Args:
        contacts: one for each standing leg.
        legs: Jacobians, torques and limits of the standing legs, in the order of the contacts.
        given: (k, 2) unit directions of the support values, beside the 16 that are always solved for; None = these 16
            alone.

    Returns:
        Region, m, whose inner polygon lies inside the true one by at most its gap; support values without certificates.

    Raises:
        StabilityError: sizes disagree, or clarabel finds no answer.
    """
    n, begin = len(contacts), 0 if given is None else len(SIXTEEN)
    if legs.jacobian.shape != (n, 3, 3) or legs.limit.shape != (n, 3) or legs.own.shape != (n, 3):
        raise StabilityError("shape", "legs", f"got {n} contacts and legs of shape {legs.jacobian.shape}")
    a_k = SIXTEEN if given is None else np.concatenate((SIXTEEN, given))
    value, point = np.full(len(a_k), np.nan), np.full((len(a_k), 2), np.nan)
    force, torque = np.full((len(a_k), n, 3), np.nan), np.full((len(a_k), n, 3), np.nan)
    worst = _solve(contacts, legs, a_k, value, point, force, torque) if n else None
    inner = outer = np.empty((0, 2))
    status: RegionStatus = "infeasible"
    if worst is not None:
        status, inner = _status(point), hull(np.ascontiguousarray(point))
        outer = inner
    if status == "ok":
        size = float(np.abs(value).max() + np.abs(inner).max())
        outer = hull(half_planes(np.ascontiguousarray(a_k), value.copy(), 8.0 * size + 1.0))
    widest = math.nan if worst is None else max(0.0, float(gap(inner, outer))) if status == "ok" else 0.0
    k = len(a_k) - begin
    kinds: tuple[SupportStatus, ...] = ("infeasible" if worst is None else "ok",) * k
    gaps = np.full(k, math.nan if worst is None else worst)
    support = Support(
        a_k[begin:], value[begin:], point[begin:], kinds, gaps, np.empty((k, 0)), force[begin:], torque[begin:]
    )
    return Region(contacts, status, inner, outer, support, widest, True, len(a_k))


def _solve(
    contacts: ContactSet, legs: ServoLegs, a_k: Array, value: Array, point: Array, force: Array, torque: Array
) -> float | None:
    """Write the answers for unit directions into the arrays; return the largest duality gap, m, or None if infeasible.

    Args:
        contacts: n contacts.
        legs: standing legs, in the order of the contacts.
        a_k: unit directions, (k, 2).
        value: support values, (k,) m; written.
        point: farthest positions of the CoM, (k, 2) m; written.
        force: contact forces there, (k, n, 3), in units of the weight; written.
        torque: joint torques there, (k, n, 3) Nm; written.

    Raises:
        StabilityError: clarabel finds no answer.
    """
    clarabel, sparse = clarabel_and_sparse()
    program, n = _cones(contacts, legs, clarabel, sparse), len(contacts)
    h, origin, length, columns = program.h, program.origin, program.length, program.a[:, :, :3]
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.presolve_enable = False, False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-9
    gain, worst = -(h @ a_k.T), 0.0  # (n, 3, k)
    first, empty = np.ascontiguousarray(gain[:, :, 0]).ravel(), sparse.csc_matrix((3 * n, 3 * n))
    solver = clarabel.DefaultSolver(empty, first, program.rows, program.right, program.cones, settings)
    for s in range(len(a_k)):
        solver.update(q=np.ascontiguousarray(gain[:, :, s]).ravel())
        found = solver.solve()
        name = str(found.status)
        if "PrimalInfeasible" in name:
            for each in (value, point, force, torque):
                each[:] = np.nan
            return None
        x, slack = np.array(found.x).reshape(n, 3), abs(float(found.obj_val) - float(found.obj_val_dual))
        if slack * length > GAP or name not in ("Solved", "AlmostSolved", "InsufficientProgress"):
            raise StabilityError("no_convergence", "contacts", f"clarabel ended with {name}, gap {slack:.1e}")
        worst = max(worst, slack * length)
        point[s] = origin[:2] + length * np.einsum("iqd,iq->d", h, x)
        value[s] = float(a_k[s] @ origin[:2]) - length * float(found.obj_val)
        force[s] = np.einsum("iqd,iq->id", columns, x)
        torque[s] = legs.own - legs.weight * np.einsum("idj,id->ij", legs.jacobian, force[s])
    return worst


def _status(point: Array) -> RegionStatus:
    """Return the shape of a region by the extent of its support points (k, 2) m."""
    centre = point - point.mean(axis=0)
    width = np.linalg.svd(centre, compute_uv=False) if len(point) > 1 else np.zeros(2)
    if width[0] <= THIN:
        return "point"
    return "segment" if width[1] <= THIN else "ok"
