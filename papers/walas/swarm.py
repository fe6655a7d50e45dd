"""Particle swarm (Kennedy & Eberhart 1995) over centres and widths of Gaussians.

v <- w v + c1 r1 (p - x) + c2 r2 (g - x), x <- x + v, with p the best place of a particle and g that of all; a particle
that leaves the bounds stops there.
"""

import numpy as np

from surefoot.services.footholds.models.bases import Gaussians

from .searches import Cost, Searched

PARTICLES = 30
INERTIA = 0.729
PULL = 1.49
"""Acceleration factors c1 = c2 towards a particle's own best place and the best place of all, no unit."""


def swarm(
    cost: Cost, m: int, d: int, centres: tuple[float, float], widths: tuple[float, float], evaluations: int, seed: int
) -> Searched:
    """Return the best Gaussians found within a number of evaluations.

    Args:
        cost: cost of a basis.
        m: number of terms.
        d: number of inputs.
        centres: bounds of a.
        widths: bounds of lambda, >= 0.
        evaluations: number of costs to compute, at least one swarm.
        seed: equal seeds give equal results.
    """
    rng = np.random.default_rng(seed)
    low = np.concatenate((np.full(m * d, centres[0]), np.full(m * d, widths[0])))
    high = np.concatenate((np.full(m * d, centres[1]), np.full(m * d, widths[1])))

    def basis(x: np.ndarray) -> Gaussians:
        return Gaussians(x[: m * d].reshape(m, d), x[m * d :].reshape(m, d))

    x = rng.uniform(low, high, (PARTICLES, 2 * m * d))
    v = 0.1 * (high - low) * rng.uniform(-1.0, 1.0, x.shape)
    best = x.copy()
    costs = np.array([cost(basis(each)) for each in x])
    used = PARTICLES
    while used < evaluations:
        leader = best[int(np.argmin(costs))]
        r1, r2 = rng.random(x.shape), rng.random(x.shape)
        v = INERTIA * v + PULL * r1 * (best - x) + PULL * r2 * (leader - x)
        moved = x + v
        x = np.clip(moved, low, high)
        v[moved != x] = 0.0
        for k in range(min(PARTICLES, evaluations - used)):
            found = cost(basis(x[k]))
            used += 1
            if found < costs[k]:
                costs[k], best[k] = found, x[k]
    k = int(np.argmin(costs))
    return Searched(basis(best[k]), float(costs[k]), used)
