"""Region that the servos can hold: friction cones and torque limits, with the weight of the legs.

The torque of leg i is tau_i = G_i - J_i' F_i, so |tau_i| <= tau_max are six linear inequalities for
each leg of three joints. With forces in units of the weight, f_i = F_i / (m g), and the constraints of `reduced`:

    h(a) = max sum h_i(a)'x_i   s.t.  sum G_i'x_i = (0,0,1,0),  x_i in Q,
           G_ij - mg J_ij'B_i D_i x_i within +- tau_max_j

solved by clarabel, one solver for all directions. The posture is held fixed, as is the legs' weight: the region tells
where a load may bring the CoM (Orsolino et al.), near the present posture where the joints may bring it.
"""

import math
from dataclasses import dataclass

import numpy as np

from surefoot.geometry.polygon import hull

from ..programs.clarabel_tools import clarabel_and_sparse
from ..programs.contacts import Array, ContactSet, StabilityError
from ..programs.directions import equally_spaced
from ..programs.reduced import SMALL_MU, matrices
from .region import RegionStatus

THIN = 1e-7  # m
GAP = 1e-7  # m, largest duality gap that is accepted


@dataclass(frozen=True, slots=True)
class Legs:
    """What the servos of the standing legs can do, world axes."""

    jacobian: Array
    """(n, 3, 3) d contact point / d joints."""
    own: Array
    """(n, 3) G_i, Nm: torques that hold the legs' own weight."""
    limit: Array
    """(n, 3) Nm."""
    weight: float
    """m g, N."""


@dataclass(frozen=True, slots=True)
class ActuatedRegion:
    """Where the centre of mass may be with limited torques."""

    status: RegionStatus
    inner: Array
    """(p, 2) m."""
    outer_value: Array
    """(k,) m, h(a) for each direction (NaN where there is none)."""
    point: Array
    """(k, 2) m."""
    direction: Array
    """(k, 2)."""
    torque: Array
    """(k, n, 3) Nm at each point."""
    force: Array
    """(k, n, 3) in units of the weight."""
    gap: float
    """m, largest duality gap."""


def actuated_region(contacts: ContactSet, legs: Legs, directions: Array | None = None) -> ActuatedRegion:
    """Region under friction and torque limits.

    Args:
        contacts: one for each standing leg.
        legs: in the same order.
        directions: (k, 2) unit; None = 16.

    Raises:
        StabilityError: sizes disagree, or clarabel finds no answer.
    """
    clarabel, sparse = clarabel_and_sparse()

    n, a_k = len(contacts), equally_spaced(16) if directions is None else directions
    if legs.jacobian.shape != (n, 3, 3) or legs.limit.shape != (n, 3) or legs.own.shape != (n, 3):
        raise StabilityError("shape", "legs", f"got {n} contacts and legs of shape {legs.jacobian.shape}")
    k = len(a_k)
    nothing = np.empty((0, 2))
    empty = ActuatedRegion(
        "infeasible", nothing, np.full(k, np.nan), np.full((k, 2), np.nan), a_k, np.full((k, n, 3), np.nan),
        np.full((k, n, 3), np.nan), math.nan,
    )  # fmt: skip
    if n == 0:
        return empty
    unlimited = np.isinf(contacts.mu)  # the cone is a half-space: one normal and two free tangential forces
    mu = np.where(unlimited, 1.0, np.where(contacts.mu < SMALL_MU, 0.0, contacts.mu))
    a, h, origin, length, _ = matrices(contacts.position, contacts.normal, mu)
    columns = a[:, :, :3]  # (n, 3 cone coordinates, 3 force)
    by_cone = legs.weight * np.einsum("iqd,idj->ijq", columns, legs.jacobian)  # torque per cone coordinate
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
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.presolve_enable = False, False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-9
    gain = -(h @ a_k.T)  # (n, 3, k)
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix((3 * n, 3 * n)), np.ascontiguousarray(gain[:, :, 0]).ravel(), rows, right, cones, settings
    )
    value, point = np.empty(k), np.empty((k, 2))
    force, used, worst = np.empty((k, n, 3)), np.empty((k, n, 3)), 0.0
    for s in range(k):
        solver.update(q=np.ascontiguousarray(gain[:, :, s]).ravel())
        found = solver.solve()
        name = str(found.status)
        if "PrimalInfeasible" in name:
            return empty
        x, gap = np.array(found.x).reshape(n, 3), abs(float(found.obj_val) - float(found.obj_val_dual))
        if gap * length > GAP or name not in ("Solved", "AlmostSolved", "InsufficientProgress"):
            raise StabilityError("no_convergence", "contacts", f"clarabel ended with {name}, gap {gap:.1e}")
        worst = max(worst, gap * length)
        offset = np.einsum("iqd,iq->d", h, x)
        point[s] = origin[:2] + length * offset
        value[s] = float(a_k[s] @ origin[:2]) - length * float(found.obj_val)
        force[s] = np.einsum("iqd,iq->id", columns, x)
        used[s] = legs.own - legs.weight * np.einsum("idj,id->ij", legs.jacobian, force[s])
    inner = hull(np.ascontiguousarray(point))
    return ActuatedRegion(_status(point), inner, value, point, a_k, used, force, worst)


def _status(point: Array) -> RegionStatus:
    centre = point - point.mean(axis=0)
    width = np.linalg.svd(centre, compute_uv=False) if len(point) > 1 else np.zeros(2)
    if width[0] <= THIN:
        return "point"
    return "segment" if width[1] <= THIN else "ok"
