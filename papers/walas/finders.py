"""Searches for the terms of a slip model as in Walas & Belter (2011), section 3.2, and files of models found."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np

from surefoot.arrays import Array
from surefoot.services.footholds.learning.fit import Finder
from surefoot.services.footholds.models.bases import Basis, Gaussians
from surefoot.services.footholds.models.learned import LearnedModel

from .elementary import POWER, Elementary
from .evolution import evolve
from .searches import cost
from .swarm import swarm

WIDEST = 3.0
"""Largest rate lambda that a search tries, on inputs divided by their standard deviation, no unit."""


def finder(family: str, terms: int, evaluations: int, blind: bool = False) -> Finder:
    """Return a search for terms as in Walas & Belter: evolution of elementary terms, or a swarm of Gaussians.

    Args:
        family: elementary or gaussian.
        terms: number of terms.
        evaluations: number of evaluations of the cost.
        blind: leave cos K3 out, as in Fig. 8.
    """

    def find(v: Array, y: Array, w: Array, ridge: float, seed: int) -> Basis:
        def seen(basis: Basis) -> Basis:
            return _blind(basis) if blind else basis

        def of(basis: Basis) -> float:
            return cost(seen(basis).columns(v), y, w, ridge)

        m, spans, rates = min(terms, len(v)), (float(v.min()), float(v.max())), (0.0, WIDEST)
        if family == "gaussian":
            return seen(swarm(of, m, 3, spans, rates, evaluations, seed).basis)
        return seen(evolve(of, family, m, 3, spans, rates, evaluations, seed).basis)

    return find


def _blind(basis: Basis) -> Basis:
    """Return the Gaussian or elementary terms of a basis over two inputs as terms that ignore the third one."""
    if isinstance(basis, Gaussians):
        return replace(basis, widths=basis.widths * np.array([1.0, 1.0, 0.0]))
    assert isinstance(basis, Elementary)
    kinds, rates = basis.kinds.copy(), basis.rates.copy()
    kinds[:, 2], rates[:, 2] = POWER, 0.0
    return replace(basis, kinds=kinds, rates=rates)


def keep(model: LearnedModel, path: Path) -> str:
    """Write a slip model to a file, for the walks of a study in other processes; return the path."""
    path.write_bytes(pickle.dumps(model))
    return str(path)


def kept(path: str) -> LearnedModel:
    """Return the slip model in a file that `keep` has written."""
    return pickle.loads(Path(path).read_bytes())
