"""Result of a derivative-free search for the terms of a slip model, and the cost of a set of terms."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from surefoot.arrays import Array
from surefoot.services.footholds.learning.solve import stack
from surefoot.services.footholds.models.bases import Basis

Cost = Callable[[Basis], float]
"""Function that returns the cost of a basis with its best weights, the least weighted sum of squares."""


@dataclass(frozen=True, eq=False)
class Searched:
    """Result of a derivative-free search: the best basis with its cost."""

    basis: Basis
    cost: float
    """Cost of the best basis: weighted sum of squares with its best weights."""
    evaluations: int
    """Number of evaluations of the cost."""


def cost(columns: Array, y: Array, w: Array, ridge: float) -> float:
    """Return the smallest |W (V c - y)|^2 + ridge |c|^2 over all c, in the unit of y squared.

    `columns`: V, (n, m), no unit; `y`: target, (n,); `w`: diagonal of W, (n,), no unit.
    """
    stacked, target = stack(columns, y, w, ridge)
    found = np.linalg.lstsq(stacked, target, rcond=1e-13)[0]
    rest = target - stacked @ found
    return float(rest @ rest)
