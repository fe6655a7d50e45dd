"""K1 to K3 against their equations, written out with plain loops."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surefoot.services.footholds.features import map_features, push_direction, window_features
from tests.services.footholds.numpy_features import map_features_numpy

CELL = 0.005
# the eight neighbours (p along x, q along y), counter-clockwise from +x
RING = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)]
PUSHES = [
    (-0.05, 0.0, 0.0), (0.05, 0.02, 0.0), (0.03, -0.04, 0.01), (-0.01, 0.05, -0.02), (-0.03, -0.02, 0.0),
    (0.0, -0.05, 0.0), (0.0, 0.05, 0.0), (-0.0, 0.0, -0.01), (0.0, 0.0, 0.01),
]  # fmt: skip


def oracle(z: np.ndarray, row: int, col: int, stroke: tuple[float, float, float]) -> tuple[float, float, float]:
    """K1, K2, cos K3 of one cell, Eqs. 1-4: five vectors in a fan of 180 deg about the quadrant of the push."""
    here = float(z[row, col])
    near = [float(z[row + q, col + p]) for p, q in RING]
    k1 = sum(here - other for other in near)
    k2 = sum(abs(here - other) for other in near)
    fx, fy, fz = stroke
    corner = RING.index((1 if fx >= 0 else -1, 1 if fy >= 0 else -1))
    fan = [(corner + k) % 8 for k in (-2, -1, 0, 1, 2)]
    s = [np.array([RING[k][0] * CELL, RING[k][1] * CELL, near[k] - here]) for k in fan]
    n = sum(np.cross(s[k], s[k + 1]) for k in range(4))
    return k1, k2, float(n @ np.array(stroke) / np.linalg.norm(n) / math.sqrt(fx**2 + fy**2 + fz**2))


def rough(seed: int = 0, shape: tuple[int, int] = (13, 17)) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, 0.01, shape).astype(np.float32)


@pytest.mark.parametrize("function", [map_features, map_features_numpy])
@pytest.mark.parametrize("stroke", PUSHES)
def test_equations_in_all_quadrants(function, stroke: tuple[float, float, float]) -> None:
    z = rough()
    got = function(z, np.array(stroke), CELL)
    for row in range(1, z.shape[0] - 1):
        for col in range(1, z.shape[1] - 1):
            k1, k2, cos_k3 = oracle(z, row, col, stroke)
            assert got.k1[row, col] == pytest.approx(k1, abs=1e-6)
            assert got.k2[row, col] == pytest.approx(k2, abs=1e-6)
            assert got.cos_k3[row, col] == pytest.approx(cos_k3, abs=1e-6)
    for layer in (got.k1, got.k2, got.cos_k3):
        border = np.ones(z.shape, dtype=bool)
        border[1:-1, 1:-1] = False
        np.testing.assert_array_equal(np.isnan(layer), border)


@pytest.mark.parametrize("stroke", PUSHES)
def test_unknown_cell_spoils_its_nine_windows(stroke: tuple[float, float, float]) -> None:
    z = rough()
    z[6, 8] = np.nan
    expected = np.ones(z.shape, dtype=bool)
    expected[1:-1, 1:-1] = False
    expected[5:8, 7:10] = True
    for got in (map_features(z, np.array(stroke), CELL), map_features_numpy(z, np.array(stroke), CELL)):
        for layer in (got.k1, got.k2, got.cos_k3):
            np.testing.assert_array_equal(np.isnan(layer), expected)


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1), st.floats(-0.5, 0.5))
def test_plane(a: float, b: float, fx: float, fy: float, height: float) -> None:
    x, y = np.meshgrid(CELL * np.arange(5), CELL * np.arange(4))
    z = (a * x + b * y + height).astype(np.float32)
    got = map_features(z, np.array([fx, fy, 0.0]), CELL)
    high, low = max(abs(a), abs(b)), min(abs(a), abs(b))
    assert got.k1[1:-1, 1:-1] == pytest.approx(0.0, abs=3e-7)
    assert got.k2[1:-1, 1:-1] == pytest.approx(CELL * (6 * high + 2 * low), abs=3e-7)
    push = push_direction(np.array([fx, fy, 0.0]))
    expected = (-a * push[0] - b * push[1]) / math.sqrt(a * a + b * b + 1.0)
    assert got.cos_k3[1:-1, 1:-1] == pytest.approx(expected, abs=5e-5)


@given(st.integers(0, 1000))
def test_k1_never_exceeds_k2_and_heights_shift_freely(seed: int) -> None:
    z = rough(seed, (6, 7))
    got = map_features(z, np.array([-1.0, 0.3, 0.0]), CELL)
    inner = (slice(1, -1), slice(1, -1))
    assert (np.abs(got.k1[inner]) <= got.k2[inner] + 1e-7).all()
    assert (np.abs(got.cos_k3[inner]) <= 1.0 + 1e-6).all()
    higher = map_features(z + np.float32(0.25), np.array([-1.0, 0.3, 0.0]), CELL)
    np.testing.assert_allclose(higher.k1, got.k1, atol=1e-6)
    np.testing.assert_allclose(higher.cos_k3, got.cos_k3, atol=2e-5)


def test_signs_of_the_paper() -> None:
    peak, hole = np.zeros((3, 3), dtype=np.float32), np.zeros((3, 3), dtype=np.float32)
    peak[1, 1], hole[1, 1] = 0.01, -0.01
    push = np.array([-1.0, 0.0, 0.0])
    assert map_features(peak, push, CELL).k1[1, 1] == pytest.approx(0.08)
    assert map_features(hole, push, CELL).k1[1, 1] == pytest.approx(-0.08)
    uphill = np.tile(0.5 * CELL * np.arange(3), (3, 1)).astype(np.float32)
    assert map_features(uphill, push, CELL).cos_k3[1, 1] > 0.4  # walking uphill the foot pushes downhill: it slips
    assert map_features(-uphill, push, CELL).cos_k3[1, 1] < -0.4


@pytest.mark.parametrize("stroke", [(0.0, 0.0, 0.0), (float("nan"), 0.0, 0.0), (float("inf"), 1.0, 0.0)])
def test_no_push_is_neutral(stroke: tuple[float, float, float]) -> None:
    got = map_features(rough(), np.array(stroke), CELL)
    assert (got.cos_k3[1:-1, 1:-1] == 0.0).all()


def test_windows_equal_the_map_and_reach_beyond_it() -> None:
    z, push = rough(3, (30, 40)), np.array([-0.03, 0.01, 0.0])
    whole = map_features(z, push, CELL)
    window = window_features(z, 5, 20, 15, 15, push, CELL)
    np.testing.assert_array_equal(window.k2, whole.k2[5:20, 20:35])
    np.testing.assert_array_equal(window.cos_k3, whole.cos_k3[5:20, 20:35])
    edge = window_features(z, -7, 33, 15, 15, push, CELL)
    np.testing.assert_array_equal(edge.k1[8:, :6], whole.k1[1:8, 33:39])
    assert np.isnan(edge.k1[:8]).all()
    assert np.isnan(edge.k1[:, 6:]).all()
    assert np.isnan(window_features(z, 1000, -1000, 15, 15, push, CELL).k1).all()


@pytest.mark.parametrize("shape", [(1, 1), (2, 5), (5, 2), (1, 9)])
def test_maps_without_inner_cells(shape: tuple[int, int]) -> None:
    got = map_features(np.zeros(shape, dtype=np.float32), np.array([1.0, 0.0, 0.0]), CELL)
    assert np.isnan(got.k1).all()
    assert np.isnan(got.cos_k3).all()
