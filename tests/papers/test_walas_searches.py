"""Terms, their weights and the three ways to find them."""

import numpy as np
import pytest

from surefoot.papers.walas.elementary import DECAY, POWER, SINE, Elementary
from surefoot.papers.walas.evolution import evolve
from surefoot.papers.walas.finders import finder
from surefoot.papers.walas.searches import cost
from surefoot.papers.walas.swarm import swarm
from surefoot.papers.walas.varpro import Bounds, _Problem, refine
from surefoot.services.footholds.learning.solve import weights
from surefoot.services.footholds.models.bases import Basis, Gaussians, warped
from tests.services.footholds.learning.made import random_start

BOX = (-1.0, 1.0)


def cloud(count: int = 80, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 3))


def bumps(u: np.ndarray) -> np.ndarray:
    """Two Gaussians."""
    a = np.exp(-1.5 * ((u - 0.3) ** 2).sum(axis=1))
    return 2.0 * a - 0.7 * np.exp(-0.8 * (u[:, 0] + 0.5) ** 2 - 2.0 * u[:, 2] ** 2)


def test_terms_are_those_of_the_equations() -> None:
    u = np.array([[0.5, -0.2, 0.1]])
    kinds = np.array([[POWER, SINE, DECAY]])
    basis = Elementary(kinds, np.array([[0.1, 0.3, 9.0]]), np.array([[1.6, 2.0, 0.7]]))
    assert basis.columns(u)[0, 0] == pytest.approx((0.5 - 0.1) ** 2 * np.sin(2.0 * -0.2 - 0.3) * np.exp(-0.07))
    gauss = Gaussians(np.array([[0.1, 0.0, 0.2]]), np.array([[2.0, 0.0, 1.0]]), constant=True)
    assert gauss.columns(u)[0] == pytest.approx([np.exp(-2.0 * 0.16 - 0.01), 1.0])
    far = Elementary(np.full((1, 3), POWER), np.zeros((1, 3)), np.full((1, 3), 9.0))
    assert np.isfinite(far.columns(np.full((1, 3), 1e200))).all()


def test_warps_are_monotone_and_the_logarithm_wants_positive_inputs() -> None:
    x = np.sort(np.abs(cloud(20)), axis=0) + 0.01
    for warp in ("identity", "log", "asinh"):
        assert (np.diff(warped(x, (warp,) * 3, np.full(3, 0.3)), axis=0) > 0.0).all()
    with pytest.raises(ValueError, match="log"):
        warped(-x, ("log",) * 3, np.ones(3))


def test_weights_solve_the_normal_equations_and_survive_equal_columns() -> None:
    u = cloud()
    columns, y = random_start(np.random.default_rng(1), 5, 3, BOX, (0.1, 2.0)).columns(u), bumps(u)
    w = np.linspace(0.5, 2.0, len(u))
    c = weights(columns, y, w, 1e-3)
    v = w[:, None] * columns
    np.testing.assert_allclose(v.T @ (v @ c - w * y) + 1e-3 * c, 0.0, atol=1e-10)
    twice = weights(np.column_stack((columns, columns[:, 0])), y, w, 1e-9)
    assert np.abs(twice).max() < 1e6


def test_kaufmans_jacobian_gives_the_gradient() -> None:
    u, rng = cloud(), np.random.default_rng(2)
    start = random_start(rng, 3, 3, BOX, (0.2, 2.0), constant=True)
    problem = _Problem(u, bumps(u), np.linspace(0.5, 1.5, len(u)), 1e-6, (3, 3), True)
    theta = np.concatenate((start.centres.ravel(), start.widths.ravel()))
    gradient = problem.jacobian(theta).T @ problem.residual(theta)
    for k in range(theta.size):
        step = np.zeros_like(theta)
        step[k] = 1e-6
        up, down = (0.5 * float(r @ r) for r in (problem.residual(theta + step), problem.residual(theta - step)))
        # what Kaufman leaves out of the Jacobian does not change the gradient
        assert gradient[k] == pytest.approx((up - down) / 2e-6, rel=1e-4, abs=1e-7)


def test_variable_projection_finds_the_gaussians() -> None:
    u = cloud(200)
    y, w = bumps(u), np.ones(200)
    found = min(
        (refine(random_start(np.random.default_rng(s), 2, 3, BOX, (0.1, 2.0)), u, y, w, Bounds()) for s in range(4)),
        key=lambda each: each.cost,
    )
    np.testing.assert_allclose(found.basis.columns(u) @ found.weights, y, atol=1e-4)
    assert (found.basis.widths >= 0.0).all()


@pytest.mark.parametrize("family", ["gaussian", "elementary"])
def test_evolution_improves_within_its_budget_and_repeats(family: str) -> None:
    u = cloud()
    asked: list[float] = []

    def objective(basis: Basis) -> float:
        asked.append(cost(basis.columns(u), bumps(u), np.ones(len(u)), 1e-9))
        return asked[-1]

    found = evolve(objective, family, 3, 3, BOX, (0.0, 2.0), 300, 5)
    assert found.evaluations == len(asked) == 300
    assert found.cost == min(asked) < 0.7 * min(asked[:30])
    again = evolve(objective, family, 3, 3, BOX, (0.0, 2.0), 300, 5)
    assert again.cost == found.cost


def test_swarm_improves_within_its_budget_and_bounds() -> None:
    u = cloud()

    def objective(basis: Basis) -> float:
        return cost(basis.columns(u), bumps(u), np.ones(len(u)), 1e-9)

    short, long = (swarm(objective, 2, 3, BOX, (0.0, 2.0), n, 5) for n in (30, 600))
    assert (short.evaluations, long.evaluations) == (30, 600)
    assert long.cost < 0.5 * short.cost
    assert isinstance(long.basis, Gaussians)
    assert ((long.basis.centres >= -1.0) & (long.basis.centres <= 1.0)).all()
    assert ((long.basis.widths >= 0.0) & (long.basis.widths <= 2.0)).all()


def test_a_search_leaves_the_third_coefficient_out_where_it_is_blind() -> None:
    rng = np.random.default_rng(0)
    v, y = rng.normal(size=(60, 3)), rng.random(60)
    for family in ("gaussian", "elementary"):
        basis = finder(family, 5, 60, blind=True)(v, y, np.ones(60), 1e-6, 0)
        other = v * np.array([1.0, 1.0, -1.0])
        np.testing.assert_allclose(basis.columns(v), basis.columns(other), atol=1e-12)
