"""Products, solutions and eigenvalues without BLAS, beside numpy's; all on seeded random matrices."""

import math

import numpy as np
import pytest

from surefoot.geometry import linear, linear_kernels

SEEDS = range(20)
SHAPES = (((3,), (3,)), ((3,), (3, 4)), ((2, 3), (3,)), ((5, 3), (3, 2)), ((4, 3, 3), (3, 3)), ((3, 3), (6, 3, 3)))


@pytest.mark.parametrize("shapes", SHAPES)
def test_products(shapes):
    rng = np.random.default_rng(0)
    a, b = (rng.normal(size=shape) for shape in shapes)
    np.testing.assert_allclose(linear.product(a, b), a @ b, rtol=1e-13, atol=1e-13)


def test_sums_are_taken_in_index_order():
    a, b = np.array([1e16, 1.0, -1e16]), np.ones(3)
    assert linear.dot(a, b) == (1e16 + 1.0) - 1e16


@pytest.mark.parametrize("seed", SEEDS)
def test_solve(seed):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(4, 4)), rng.normal(size=(4, 3))
    np.testing.assert_allclose(linear.solve(a, b), np.linalg.solve(a, b), rtol=1e-8)


def test_a_singular_matrix_is_refused():
    with pytest.raises(ZeroDivisionError):
        linear.solve(np.ones((2, 2)), np.ones((2, 1)))


@pytest.mark.parametrize("seed", SEEDS)
def test_eigenvalues(seed):
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(3, 3)) * 10.0 ** rng.integers(-6, 6, size=(1, 3))
    m = half @ half.T
    value, vector = linear.eigen3(m)
    np.testing.assert_allclose(value, np.linalg.eigvalsh(m)[::-1], rtol=1e-9, atol=1e-12 * np.abs(m).max())
    np.testing.assert_allclose(vector @ vector.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(vector.T * value @ vector, m, atol=1e-12 * np.abs(m).max())


def test_eigenvalues_of_a_diagonal_matrix_are_sorted():
    value, vector = linear.eigen3(np.diag([1.0, 3.0, 2.0]))
    np.testing.assert_allclose(value, [3.0, 2.0, 1.0])
    np.testing.assert_allclose(np.abs(vector), np.eye(3)[[1, 2, 0]], atol=1e-12)


def test_elementary_functions():
    x = np.linspace(-3.0, 3.0, 12).reshape(3, 4)
    np.testing.assert_allclose(linear.exp(x), np.exp(x), rtol=1e-15)
    np.testing.assert_allclose(linear.angle_of(x[0], x[1]), np.arctan2(x[0], x[1]), rtol=1e-15)
    assert linear.norm(np.array([3.0, 4.0])) == pytest.approx(5.0)


@pytest.mark.parametrize("seed", SEEDS)
def test_kernels(seed):
    rng = np.random.default_rng(seed)
    a, b, m = rng.normal(size=(5, 4)), rng.normal(size=(4, 3)), rng.normal(size=(3, 3))
    np.testing.assert_allclose(linear_kernels.times(a, b), a @ b, atol=1e-13)
    np.testing.assert_allclose(linear_kernels.times_transposed(a, b.T.copy()), a @ b, atol=1e-13)
    inverse, condition = linear_kernels.inverse3(m)
    np.testing.assert_allclose(inverse @ m, np.eye(3), atol=1e-13 * condition)
    assert condition == pytest.approx(np.linalg.norm(m) * np.linalg.norm(np.linalg.inv(m)), rel=1e-9)
    np.testing.assert_allclose(linear_kernels.solve3(m, b[0]), np.linalg.solve(m, b[0]), rtol=1e-8, atol=1e-10)


def test_no_inverse():
    inverse, condition = linear_kernels.inverse3(np.zeros((3, 3)))
    assert not inverse.any()
    assert math.isinf(condition)
