"""What the two searches without derivatives share: budgets in evaluations, and their result."""

from collections.abc import Callable
from dataclasses import dataclass

from ..models.bases import Basis

Cost = Callable[[Basis], float]
"""The weighted residual norm of a basis with its best weights."""


@dataclass(frozen=True, eq=False)
class Searched:
    """The best basis of a search."""

    basis: Basis
    cost: float
    evaluations: int
    """Costs that were computed."""
