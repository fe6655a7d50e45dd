"""Variable projection: centres and widths of Gaussians by trust-region least squares, their weights eliminated.

With A = W V(theta) over sqrt(rho) I and b = W y over 0, the residual of the best weights is r = (I - Q Q') b, where Q
is an orthonormal basis of A. Kaufman (1975) leaves out the second part of its derivative:

    J = -(I - Q Q') (dA / dtheta) c,   d phi / d a = 2 lambda (u - a) phi,   d phi / d lambda = -(u - a)^2 phi.
"""

from dataclasses import dataclass

import numpy as np

from surefoot.arrays import Array
from surefoot.services.footholds.learning.solve import stack
from surefoot.services.footholds.models.bases import Gaussians

RIDGE = 1e-12
"""Ridge rho of the least squares, which keeps the search from ending when two terms become equal."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds of centres and widths in a search."""

    low: float = -3.0
    """Smallest centre a of a Gaussian, in scaled inputs, no unit."""
    high: float = 3.0
    """Largest centre a of a Gaussian, in scaled inputs, no unit."""
    width: float = 10.0
    """Largest rate lambda of a Gaussian, no unit; the smallest is 0, below which a term grows outside the data."""


@dataclass(frozen=True, eq=False)
class RefinedTerms:
    """Result of `refine`: Gaussians with weights at a minimum of the cost, and the number of evaluations."""

    basis: Gaussians
    weights: Array
    """Weights c of the m Gaussians, (m,), or (m + 1,) with that of the constant."""
    cost: float
    """Cost |W (V c - y)|^2 + rho |c|^2 at the minimum, in the unit of y squared."""
    evaluations: int


def refine(
    start: Gaussians, u: Array, y: Array, w: Array, bounds: Bounds, ridge: float = RIDGE, evaluations: int = 200
) -> RefinedTerms:
    """Return the Gaussians, with weights, at a local minimum of the cost near a start.

    Args:
        start: first Gaussians; centres and widths are cut to the bounds.
        u: inputs, (n, d), no unit.
        y: target, (n,), no unit.
        w: diagonal of W, (n,).
        bounds: bounds of centres and widths.
        ridge: weight rho of the penalty on the weights c.
        evaluations: largest number of evaluations of the residual.
    """
    from scipy.optimize import least_squares

    m, d = start.centres.shape
    problem = _Problem(u, y, w, ridge, (m, d), start.constant)
    low = np.concatenate((np.full(m * d, bounds.low), np.zeros(m * d)))
    high = np.concatenate((np.full(m * d, bounds.high), np.full(m * d, bounds.width)))
    begin = np.concatenate((start.centres.ravel(), start.widths.ravel()))
    begin = np.clip(begin, low + 1e-9 * (high - low), high - 1e-9 * (high - low))
    found = least_squares(
        problem.residual, begin,
        problem.jacobian,  # pyright: ignore[reportArgumentType] - scipy takes a function, too, but has no types
        bounds=(low, high), max_nfev=evaluations, x_scale="jac", ftol=1e-10, xtol=1e-10, gtol=1e-12,
    )  # fmt: skip
    basis = problem.basis(found.x)
    problem.residual(found.x)
    return RefinedTerms(basis, problem.c, 2.0 * float(found.cost), int(found.nfev))


class _Problem:
    """Residual and Jacobian of one data set; the factors of the last parameters are kept for the Jacobian."""

    def __init__(self, u: Array, y: Array, w: Array, ridge: float, shape: tuple[int, int], constant: bool) -> None:
        self.u, self.y, self.w, self.ridge, self.shape, self.constant = u, y, w, ridge, shape, constant
        self.c = np.zeros(shape[0] + constant)
        self._q, self._columns = np.zeros((0, 0)), np.zeros((0, 0))
        self._at: Array | None = None

    def basis(self, theta: Array) -> Gaussians:
        half = theta.size // 2
        return Gaussians(theta[:half].reshape(self.shape), theta[half:].reshape(self.shape), self.constant)

    def residual(self, theta: Array) -> Array:
        self._columns = self.basis(theta).columns(self.u)
        stacked, target = stack(self._columns, self.y, self.w, self.ridge)
        self._q, r = np.linalg.qr(stacked)
        along = self._q.T @ target
        self.c = np.asarray(np.linalg.lstsq(r, along, rcond=None)[0], dtype=np.float64)
        self._at = theta.copy()
        return target - self._q @ along

    def jacobian(self, theta: Array) -> Array:
        if self._at is None or not np.array_equal(theta, self._at):
            self.residual(theta)
        basis, (m, d) = self.basis(theta), self.shape
        away = self.u[:, None, :] - basis.centres[None]  # (n, m, d)
        common = (self.w[:, None] * self._columns[:, :m] * self.c[:m])[:, :, None]
        by_centre = 2.0 * basis.widths[None] * away * common
        by_width = -away * away * common
        rows = np.concatenate((by_centre.reshape(-1, m * d), by_width.reshape(-1, m * d)), axis=1)
        full = np.vstack((rows, np.zeros((m + self.constant, 2 * m * d))))
        return self._q @ (self._q.T @ full) - full
