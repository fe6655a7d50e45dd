"""Bins: what is merged equals what was learned at once, to the byte."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surefoot.services.footholds.models.lattice import Lattice, LatticeError, coordinates, faded, filled, merged


def cloud(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    x = np.column_stack((rng.uniform(-1, 1, count), rng.uniform(0, 0.4, count), rng.uniform(-0.3, 0.3, count)))
    return x, rng.exponential(0.1, count)


@given(st.integers(0, 1000), st.integers(0, 200), st.integers(0, 200))
def test_merged_equals_learned_at_once(seed: int, n: int, k: int) -> None:
    x, r = cloud(seed, n + k)
    lattice = Lattice()
    whole = filled(lattice, x, r)
    a, b = filled(lattice, x[:n], r[:n]), filled(lattice, x[n:], r[n:])
    assert merged(a, b) == whole == merged(b, a)
    assert list(merged(b, a)) == list(whole)


def test_moments_are_those_of_the_samples() -> None:
    x, r = cloud(3, 2000)
    lattice = Lattice()
    keys = lattice.keys(x)
    for key, found in filled(lattice, x, r).items():
        inside = r[(keys == key).all(axis=1)]
        assert (found.count, found.mean) == (len(inside), pytest.approx(inside.mean(), abs=1e-9))
        if len(inside) > 1:
            assert found.sd == pytest.approx(inside.std(ddof=1), rel=1e-4, abs=1e-6)
        low = np.array(lattice.origin) + np.array(key) * lattice.width
        assert (x[(keys == key).all(axis=1)] >= low - 1e-12).all()
        assert np.allclose(lattice.centres([key])[0], low + 0.5 * np.array(lattice.width))


def test_counted_re_learning_weighs_by_counts_and_the_papers_does_not() -> None:
    lattice = Lattice()
    x = np.tile([0.0, 0.1, 0.0], (11, 1))
    old, new = filled(lattice, x[:10], np.full(10, 0.1)), filled(lattice, x[:1], np.array([0.6]))
    (counted,), (paper,) = merged(old, new, 0.5).values(), faded(old, new, 0.5).values()
    assert (counted.mean, counted.count) == (pytest.approx((10 * 0.1 + 0.5 * 0.6) / 10.5), 10.5)
    assert paper.mean == pytest.approx((0.1 + 0.5 * 0.6) / 1.5)
    assert merged(old, new, 0.0) == old
    elsewhere = filled(lattice, x[:1] + 1.0, np.array([0.2]))
    assert len(faded(old, elsewhere, 0.1)) == 2


def test_coordinates_of_flat_ground_and_of_a_top_edge() -> None:
    cell = 0.005
    found = coordinates(np.array([0.0, 0.02]), np.array([0.0, 0.02]), np.array([0.0, -2.0]), cell)
    assert found.tolist() == [[0.0, 0.0, 0.0], [1.0, pytest.approx(0.5), -1.0]]


@pytest.mark.parametrize("width", [(0.0, 1.0, 1.0), (1.0, float("nan"), 1.0), (1.0, -1.0, 1.0)])
def test_a_lattice_needs_widths(width: tuple[float, float, float]) -> None:
    with pytest.raises(LatticeError):
        Lattice(width=width)
