"""Forces that hold the CoM at a place: is there any, which are the smallest, how much friction do they need."""

import math
from dataclasses import dataclass

import numpy as np

from services.stability.clarabel_tools import clarabel_and_sparse
from services.stability.contacts import Array, ContactSet, StabilityError
from services.stability.interior import NO_PRIMAL, SOLVED
from services.stability.oracle import solve_one
from services.stability.reduced import SMALL_MU, matrices

FRICTION_STEPS = 24  # halvings: the share of friction is found to 6e-8


@dataclass(frozen=True, slots=True)
class Equilibrium:
    """Whether the contacts can hold the CoM at a place."""

    held: bool
    force: Array | None
    """(n, 3) forces in units of the weight, well inside the cones; None if not held."""
    twist: Array | None
    """(6,) twist (v m, Om) about the origin with n'u >= mu |u_t| at every contact and v_z + (Om x c)_z < 0: the CoM
    sinks; proves that it is not held. None if it is."""


def equilibrium(contacts: ContactSet, com: Array) -> Equilibrium:
    """Solve sum f = e_z, sum r x f = c x e_z over the cones: six unknowns, the whole twist.

    Args:
        contacts: with limited friction (unlimited friction is taken as 1e4).
        com: (2,) m.
    """
    if len(contacts) == 0:
        return Equilibrium(False, None, np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0]))
    mu = np.where(contacts.mu < SMALL_MU, 0.0, np.minimum(contacts.mu, 1e4))
    a, _, origin, length, _ = matrices(contacts.position, contacts.normal, mu)
    arm = (contacts.position - origin) / length
    full = np.concatenate((a[:, :, :3], np.cross(arm[:, None, :], a[:, :, :3])), axis=2)
    x, y = (com - origin[:2]) / length
    status, _, lam, cone, _ = solve_one(full, np.zeros((len(mu), 3)), np.array([0.0, 0.0, 1.0, y, -x, 0.0]))
    if status == SOLVED:
        return Equilibrium(True, np.einsum("iqd,iq->id", a[:, :, :3], cone), None)
    if status != NO_PRIMAL:
        raise StabilityError("no_convergence", "contacts", "the solver found no answer for this contact set")
    velocity = length * lam[:3] - np.cross(lam[3:], origin)
    return Equilibrium(False, None, np.concatenate((velocity, lam[3:])))


def friction_needed(contacts: ContactSet, com: Array) -> float | None:
    """Smallest share s of every friction coefficient with which the CoM is still held, 0 to 1; None if not held at all.

    min over force distributions of the largest share of its friction that a contact uses (min-max).
    """
    if not _holds(contacts, com, 1.0):
        return None
    low, high = 0.0, 1.0
    if _holds(contacts, com, 0.0):
        return 0.0
    for _ in range(FRICTION_STEPS):
        share = 0.5 * (low + high)
        if _holds(contacts, com, share):
            high = share
        else:
            low = share
    return high


def _holds(contacts: ContactSet, com: Array, share: float) -> bool:
    """Whether that share of the friction is enough; no, where it is so close that no solver can tell."""
    unlimited = np.isinf(contacts.mu)
    mu = np.where(unlimited, math.inf if share > 0.0 else 0.0, np.where(unlimited, 1.0, contacts.mu) * share)
    try:
        return equilibrium(ContactSet(contacts.position, contacts.normal, mu), com).held
    except StabilityError:
        return False


def least_forces(contacts: ContactSet, com: Array) -> Array | None:
    """Forces (n, 3) with the smallest sum of squares, in units of the weight; None if the CoM is not held.

    A quadratic program over cones, solved by clarabel; what a force controller would command.
    """
    if not equilibrium(contacts, com).held:
        return None
    clarabel, sparse = clarabel_and_sparse()

    n = len(contacts)
    mu = np.where(contacts.mu < SMALL_MU, 0.0, np.minimum(contacts.mu, 1e4))
    a, _, origin, length, _ = matrices(contacts.position, contacts.normal, mu)
    columns = a[:, :, :3]  # (n, 3, 3): force = sum of column k times cone coordinate k
    arm = (contacts.position - origin) / length
    wrench = np.concatenate((columns, np.cross(arm[:, None, :], columns)), axis=2).reshape(3 * n, 6)
    x, y = (com - origin[:2]) / length
    balance = np.array([0.0, 0.0, 1.0, y, -x, 0.0])
    weight = sparse.block_diag([2.0 * c @ c.T for c in columns], format="csc")
    rows = sparse.csc_matrix(np.vstack((wrench.T, -np.eye(3 * n))))
    right = np.concatenate((balance, np.zeros(3 * n)))
    cones = [clarabel.ZeroConeT(6)] + [clarabel.SecondOrderConeT(3)] * n
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solution = clarabel.DefaultSolver(
        sparse.triu(weight, format="csc"), np.zeros(3 * n), rows, right, cones, settings
    ).solve()
    if "Solved" not in str(solution.status):
        raise StabilityError("no_convergence", "contacts", f"clarabel ended with {solution.status}")
    return np.einsum("iqd,iq->id", columns, np.array(solution.x).reshape(n, 3))
