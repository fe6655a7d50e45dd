"""Solutions by clarabel where the own solver gives up: one program, or the nearest edge of a region.

clarabel minimises q'z subject to A z + s = b, s in cones. Here z = (v, w_z), A = -stacked a_i, b = -stacked h_i(a):
only b depends on the direction, so one solver serves all directions of a set.
"""

from dataclasses import dataclass

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.linear import combined, dot, product

from .clarabel_tools import clarabel_and_sparse
from .contacts import StabilityError
from .fan import APPROACH, Fan, FanGoal, explore, insert, near_arcs, settled, with_room
from .interior import FAILED, NO_DUAL, NO_PRIMAL, SOLVED, solve_lanes
from .lanes import LANES
from .reduced import Reduced

LOOSE = 1e-6  # residual, relative to max(1, value), above which an "almost solved" answer is refused
MARGIN_TOLERANCE = 2e-9  # in units of the stance; the solver's own accuracy is 1e-9
MARGIN_DIRECTIONS = 160  # more change nothing: each round narrows the arc by a factor of nine


@dataclass(frozen=True, slots=True)
class ReferenceAnswer:
    """Solution of a cone program by clarabel: status, value, unknowns, forces; in the scaled frame of `reduced`."""

    status: int
    value: float
    unknown: Array  # (m,)
    force: Array  # (n, 3) cone coordinates
    error: float


class Reference:
    """Solver clarabel on the n friction cones of one contact set: min c'lam with A_i lam - b_i in the cone.

    Args:
        a: matrices A_i, (n, 3, m), no unit.
        c: objective, (m,), no unit.
        tolerance: largest residuals and gap of a solution, relative.
    """

    def __init__(self, a: Array, c: Array, tolerance: float = 1e-11) -> None:
        clarabel, sparse = clarabel_and_sparse()

        n, _, m = a.shape
        self._a, self._c, self._shape = a, c, (n, 3)
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.presolve_enable = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
        settings.tol_infeas_abs = settings.tol_infeas_rel = 1e-9
        matrix = sparse.csc_matrix(-a.reshape(3 * n, m))
        empty = sparse.csc_matrix((m, m))
        cones = [clarabel.SecondOrderConeT(3)] * n
        self._solver = clarabel.DefaultSolver(empty, self._c, matrix, np.zeros(3 * n), cones, settings)

    def solve(self, rhs: Array) -> ReferenceAnswer:
        """Solve for right-hand sides b_i, (n, 3), one vector per cone, in scaled lengths (no unit)."""
        self._solver.update(b=-np.ascontiguousarray(rhs).ravel())
        solution = self._solver.solve()
        z, x = np.array(solution.x), np.array(solution.z).reshape(self._shape)
        name, cost, gain = str(solution.status), dot(self._c, z), float(np.sum(rhs * x))
        if name in ("Solved", "AlmostSolved", "InsufficientProgress", "MaxIterations"):
            error = self._error(z, x, rhs)
            return ReferenceAnswer(SOLVED if error <= LOOSE else FAILED, cost, z, x, error)
        if "DualInfeasible" in name and cost < 0.0:  # of clarabel's primal = our twist: no forces exist
            return ReferenceAnswer(NO_PRIMAL, -np.inf, z / -cost, x, 0.0)
        if "PrimalInfeasible" in name and gain > 0.0:
            return ReferenceAnswer(NO_DUAL, np.inf, z, x / gain, 0.0)
        return ReferenceAnswer(FAILED, np.nan, z, x, np.inf)

    def answer(self, r: Reduced, fan: Fan, k: int) -> int:
        """Solve programs `r` for direction k of a fan, write the answer to row k of the fan, and return its status."""
        found = self.solve(product(r.h, fan.direction[k]))
        fan.status[k], fan.value[k], fan.error[k] = found.status, found.value, found.error
        fan.unknown[k], fan.force[k] = found.unknown, found.force
        fan.point[k] = combined(r.h, found.force).sum(axis=0)
        return found.status

    def _error(self, z: Array, x: Array, rhs: Array) -> float:
        s = product(self._a, z) - rhs  # (n, 3)
        outside = max(np.max(np.hypot(v[:, 1], v[:, 2]) - v[:, 0], initial=0.0) for v in (s, x))
        balance = np.abs(combined(self._a, x).sum(axis=0) - self._c).max(initial=0.0)
        cost = dot(self._c, z)
        return float(max(outside, balance, abs(cost - np.sum(rhs * x))) / max(1.0, abs(cost)))


def solve_one(a: Array, rhs: Array, c: Array) -> tuple[int, float, Array, Array, float]:
    """Solve min c'lam with A_i lam - b_i in the second-order cones; by clarabel where the own kernel gives up.

    Args:
        a: matrices A_i, (n, 3, m), no unit.
        rhs: right-hand sides b_i, (n, 3), no unit.
        c: objective, (m,), no unit.

    Returns:
        Status, value c'lam, lam (m,), forces x (n, 3), error.

    Raises:
        StabilityError: `no_convergence`, by field `contacts`.
    """
    n, m = a.shape[0], a.shape[2]
    lam, x = np.empty((m, 1)), np.empty((n, 3, 1))
    error, status = np.empty(1), np.empty(1, dtype=np.int64)
    solve_lanes(a, np.ascontiguousarray(rhs[:, :, None]), c, lam, x, error, status, 0.0)
    if status[0] == FAILED:
        answer = Reference(a, c).solve(rhs)
        if answer.status == FAILED:
            raise StabilityError("no_convergence", "contacts", "neither solver found an answer for this contact set")
        return answer.status, answer.value, answer.unknown, answer.force, answer.error
    return int(status[0]), dot(c, lam[:, 0]), lam[:, 0].copy(), x[:, :, 0].copy(), float(error[0])


def nearest_border(r: Reduced, fan: Fan, count: int, x: float, y: float) -> tuple[float, Array]:
    """Return the smallest h(a) - a'p over all unit directions a, and that direction (2,), in scaled lengths (no unit).

    h(a) is the support value of the region, p = (x, y): the value is the distance of p to the border, negative outside.

    Args:
        r: cone programs of the contact set.
        fan: answers of the region in its first `count` directions; it is not changed.
        count: number of answers.
        x: x of the point p.
        y: y of the point p.

    Raises:
        StabilityError: no_convergence, by field `contacts`.
    """
    limit, goal = count + MARGIN_DIRECTIONS, FanGoal(APPROACH, MARGIN_TOLERANCE, x, y)
    fan = with_room(fan, count, limit)
    count, _, outlook = explore(r, fan, count, count, goal, limit, LANES)
    if not settled(fan, count, outlook):  # one direction at a time by clarabel
        reference, pick = Reference(r.a, r.c), np.empty((LANES, 2))
        fan = with_room(fan, count, count + MARGIN_DIRECTIONS)
        while True:
            wanted, outlook = near_arcs(fan, count, goal, pick, 1)
            if not wanted or count == len(fan.value):
                break
            fan.direction[count] = pick[0]
            if reference.answer(r, fan, count) != SOLVED:
                break
            insert(fan, count, count + 1)
            count += 1
        if not settled(fan, count, outlook):
            raise StabilityError("no_convergence", "contacts", "neither solver found the nearest edge of this region")
    return outlook.best, fan.direction[outlook.arg].copy()
