"""Other ways to the same numbers, sharing no code with the service."""

import clarabel
import numpy as np
from scipy import sparse
from scipy.linalg import block_diag
from scipy.optimize import linprog

from surefoot.services.stability.programs.contacts import ContactSet
from surefoot.services.stability.regions.actuated import ServoLegs


def cone_rays(contacts: ContactSet, sides: int, outside: bool) -> list[np.ndarray]:
    """Per contact the rays (sides, 3) of a pyramid in or around its cone."""
    rays = []
    for normal, mu in zip(contacts.normal, contacts.mu, strict=True):
        helper = np.eye(3)[int(np.argmin(np.abs(normal)))]
        t1 = np.cross(normal, helper)
        t1 /= np.linalg.norm(t1)
        t2 = np.cross(normal, t1)
        angle = 2.0 * np.pi * np.arange(sides) / sides
        reach = mu / np.cos(np.pi / sides) if outside else mu
        rays.append(normal + reach * (np.cos(angle)[:, None] * t1 + np.sin(angle)[:, None] * t2))
    return rays


def pyramid_support(
    contacts: ContactSet, direction: np.ndarray, sides: int, outside: bool, legs: ServoLegs | None = None
) -> float:
    """max a'c by linear programming over pyramids, a lower (inside) or upper bound; inf, or nan if infeasible.

    legs: servos whose torques have limits; None = no limits.
    """
    rays = cone_rays(contacts, sides, outside)
    force = np.concatenate(rays).T  # (3, k)
    moment = np.concatenate(
        [np.cross(np.broadcast_to(r, ray.shape), ray) for r, ray in zip(contacts.position, rays, strict=True)]
    ).T
    lift = np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 0.0]])  # - c x e_z of (21), columns c_x, c_y
    equal = np.block([[force, np.zeros((3, 2))], [moment, lift]])
    right = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    cost = np.concatenate((np.zeros(force.shape[1]), -direction))
    bounds = [(0, None)] * force.shape[1] + [(None, None)] * 2
    rows = bound = None
    if legs is not None:
        blocks = [legs.weight * ray @ legs.jacobian[i] for i, ray in enumerate(rays)]  # (sides, 3) torques of each ray
        torque = np.hstack((block_diag(*(block.T for block in blocks)), np.zeros((3 * len(rays), 2))))
        rows = np.vstack((torque, -torque))
        bound = np.concatenate(((legs.own + legs.limit).ravel(), (legs.limit - legs.own).ravel()))
    found = linprog(cost, A_ub=rows, b_ub=bound, A_eq=equal, b_eq=right, bounds=bounds, method="highs")
    if found.status == 3:
        return np.inf
    return float(-found.fun) if found.status == 0 else np.nan


def literal_matrices(contacts: ContactSet, mass: float = 2.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A1 (6, 3n), A2 (6, 2) and t (6,) of (23): A1 F + A2 y = t, F in N, y in m."""

    def cross(v: np.ndarray) -> np.ndarray:
        return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])

    mg = mass * np.array([0.0, 0.0, -9.81])
    a1 = np.hstack([np.vstack((np.eye(3), cross(r))) for r in contacts.position])
    a2 = np.vstack((np.zeros((3, 2)), -cross(mg)[:, :2]))
    return a1, a2, np.concatenate((-mg, np.zeros(3)))


def literal_support(contacts: ContactSet, direction: np.ndarray, mass: float = 2.0, tolerance: float = 1e-11) -> float:
    """(23) as printed but with one cone per contact, solved by clarabel: F in N, y in m."""
    n = len(contacts)
    a1, a2, t = literal_matrices(contacts, mass)
    rows, cones = [np.hstack((a1, a2))[:5], np.hstack((a1, a2))[5:]], [clarabel.ZeroConeT(6)]
    right = [t]
    for i in range(n):
        v = contacts.normal[i]
        block = np.zeros((4, 3 * n + 2))
        block[0, 3 * i : 3 * i + 3] = -contacts.mu[i] * v
        block[1:, 3 * i : 3 * i + 3] = -(np.eye(3) - np.outer(v, v))
        rows.append(block)
        right.append(np.zeros(4))
        cones.append(clarabel.SecondOrderConeT(4))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    cost = np.concatenate((np.zeros(3 * n), -direction))
    size = 3 * n + 2
    matrix = sparse.csc_matrix(np.vstack(rows))
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix((size, size)), cost, matrix, np.concatenate(right), cones, settings
    )
    found = solver.solve()
    return float(-found.obj_val) if "Solved" in str(found.status) else np.nan


def share_excess(contacts: ContactSet, com: np.ndarray, share: float) -> float:
    """Least t of forces f in world axes that hold the CoM with |f_t,i| <= share mu_i n'f_i + t, n'f_i >= 0.

    In units of the weight; above zero no forces hold with that share of the friction. Limited friction, clarabel 1e-12.
    """
    n = len(contacts)
    a1 = literal_matrices(contacts)[0]
    size = 3 * n + 1
    rows, cones = [np.hstack((a1, np.zeros((6, 1))))], [clarabel.ZeroConeT(6)]
    right = [np.array([0.0, 0.0, 1.0, com[1], -com[0], 0.0])]
    for i in range(n):
        v = contacts.normal[i]
        block = np.zeros((5, size))
        block[0, 3 * i : 3 * i + 3] = -v
        block[1, 3 * i : 3 * i + 3], block[1, -1] = -share * contacts.mu[i] * v, -1.0
        block[2:, 3 * i : 3 * i + 3] = -(np.eye(3) - np.outer(v, v))
        rows.append(block)
        right.append(np.zeros(5))
        cones += [clarabel.NonnegativeConeT(1), clarabel.SecondOrderConeT(4)]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    matrix = sparse.csc_matrix(np.vstack(rows))
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix((size, size)), np.eye(size)[-1], matrix, np.concatenate(right), cones, settings
    )
    return float(solver.solve().x[-1])
