"""Evolutionary search of Walas & Belter (2011), section 3.2: a gene is one term of the sum.

Mutation draws the terms of one gene again, crossover exchanges the genes between two points, and the best half of
parents and children survives. Walas & Belter select by the sum of distances and solve for the weights by least
squares; here both steps use the same norm.
"""

import numpy as np

from surefoot.arrays import Array
from surefoot.services.footholds.models.bases import Basis, Gaussians

from .elementary import DECAY, MAX_POWER, POWER, SINE, Elementary
from .searches import Cost, Searched

POPULATION = 30
CROSSED = 0.7
"""Share of children that are made from two parents by crossover; the others are mutated copies of one parent."""
NEAR = 0.5
"""Probability that a mutation moves a gene a little; otherwise it replaces the gene by a random one."""


def evolve(
    cost: Cost, family: str, m: int, d: int, centres: tuple[float, float], rates: tuple[float, float],
    evaluations: int, seed: int,
) -> Searched:  # fmt: skip
    """Return the best basis that an evolutionary search finds within a number of evaluations.

    Each term is a product of a function of each input, with a centre a and a rate lambda: e.g. exp(-lambda (u - a)^2).

    Args:
        cost: cost of a basis.
        family: `gaussian` or `elementary`.
        m: number of terms.
        d: number of inputs.
        centres: smallest and largest a that is drawn.
        rates: smallest and largest lambda that is drawn.
        evaluations: number of costs to compute, at least one population.
        seed: equal seeds give equal results.
    """
    rng = np.random.default_rng(seed)
    genes = [_drawn(rng, family, m, d, centres, rates) for _ in range(POPULATION)]
    costs = [cost(basis_of(each, family)) for each in genes]
    used = POPULATION
    while used < evaluations:
        children: list[Array] = []
        for _ in range(min(POPULATION, evaluations - used)):
            mother, father = (_tournament(rng, costs) for _ in range(2))
            child = genes[mother].copy()
            if m > 1 and rng.random() < CROSSED:
                first, last = np.sort(rng.integers(0, m + 1, 2))
                child[first:last] = genes[father][first:last]
            _mutate(rng, child, family, centres, rates)
            children.append(child)
        genes += children
        costs += [cost(basis_of(each, family)) for each in children]
        used += len(children)
        order = np.argsort(costs, kind="stable")[:POPULATION]
        genes, costs = [genes[k] for k in order], [costs[k] for k in order]
    best = int(np.argmin(costs))
    return Searched(basis_of(genes[best], family), float(costs[best]), used)


def basis_of(genes: Array, family: str) -> Basis:
    """Return the basis of a genome (m, 3, d), no unit: kind, centre and rate of each of m terms by each of d inputs.

    `family`: `gaussian` or `elementary`.
    """
    if family == "gaussian":
        return Gaussians(genes[:, 1], np.maximum(genes[:, 2], 0.0))
    return Elementary(genes[:, 0].astype(np.int64), genes[:, 1], genes[:, 2])


def _drawn(
    rng: np.random.Generator, family: str, m: int, d: int, centres: tuple[float, float], rates: tuple[float, float]
) -> Array:
    """Return m random genes: kind, centre and rate of each of m terms by each of d inputs, (m, 3, d), no unit."""
    genes = np.empty((m, 3, d))
    genes[:, 0] = rng.choice((POWER, SINE, DECAY), (m, d))
    genes[:, 1] = rng.uniform(*centres, (m, d))
    genes[:, 2] = rng.uniform(*rates, (m, d))
    if family == "elementary":
        power, sine = genes[:, 0] == POWER, genes[:, 0] == SINE
        genes[:, 2][power] = rng.integers(0, MAX_POWER + 1, (m, d))[power]
        genes[:, 1][sine] = rng.uniform(0.0, 2.0 * np.pi, (m, d))[sine]
    return genes


def _tournament(rng: np.random.Generator, costs: list[float]) -> int:
    a, b = rng.integers(0, len(costs), 2)
    return int(a if costs[a] <= costs[b] else b)


def _mutate(
    rng: np.random.Generator, genes: Array, family: str, centres: tuple[float, float], rates: tuple[float, float]
) -> None:
    """Mutate one gene of genes (m, 3, d), as `_drawn` makes them, in place: move it a little, or draw it again."""
    m, _, d = genes.shape
    gene = int(rng.integers(m))
    if rng.random() < NEAR:
        genes[gene, 1] += 0.1 * (centres[1] - centres[0]) * rng.standard_normal(d)
        genes[gene, 2] = np.maximum(genes[gene, 2] + 0.1 * (rates[1] - rates[0]) * rng.standard_normal(d), 0.0)
    else:
        genes[gene] = _drawn(rng, family, 1, d, centres, rates)[0]
