"""Planes about cells against least squares of numpy, on grounds with gaps; the scale grows with the noise of a map."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surefoot.services.footholds.ground import ground_features, updated_ground
from surefoot.services.footholds.models.files import load
from surefoot.services.footholds.models.shipped import shipped
from surefoot.services.footholds.relief import FAINT, LEAST_KNOWN, patch_features, relief_features, relief_of, scale_of
from surefoot.services.footholds.select import SelectParams, best_cell, window_costs
from tests.services.footholds.grounds import CELL, STROKE, ground_of, heights_of


def by_lstsq(z: np.ndarray, i: int, j: int, s: int) -> tuple[float, ...] | None:
    rows = [(p - i, q - j) for p in range(i - s, i + s + 1) for q in range(j - s, j + s + 1)]
    near = [(a, b) for a, b in rows if 0 <= i + a < z.shape[0] and 0 <= j + b < z.shape[1]]
    near = [(a, b) for a, b in near if np.isfinite(z[i + a, j + b])]
    inner = 0 < i < z.shape[0] - 1 and 0 < j < z.shape[1] - 1
    if not inner or len(near) < LEAST_KNOWN * (2 * s + 1) ** 2 or np.isnan(z[i, j]):
        return None
    x = np.array([(1.0, b, a) for a, b in near])
    y = np.array([z[i + a, j + b] for a, b in near], dtype=np.float64)
    w = np.linalg.lstsq(x, y, rcond=None)[0]
    r = float(np.sqrt(np.mean((y - x @ w) ** 2)))
    around = ((x[:, 1:] - x[:, 1:].mean(axis=0)) ** 2).sum() / 2.0
    return w[1] / CELL, w[2] / CELL, r, np.sqrt(2.0 * r * r / around) / CELL


@given(st.integers(0, 500), st.integers(2, 4))
def test_planes_are_those_of_least_squares(seed: int, scale: int) -> None:
    rng = np.random.default_rng(seed)
    z = rng.normal(0.3, 0.01, (11, 12)).astype(np.float32)
    z[rng.random(z.shape) < 0.3] = np.nan
    found = relief_of(z, CELL, scale)
    for i, j in rng.integers(0, 11, (12, 2)):
        wanted = by_lstsq(z, int(i), int(j), scale)
        got = [float(layer[i, j]) for layer in found]
        if wanted is None:
            assert np.isnan(got).all()
        else:
            np.testing.assert_allclose(got, wanted, rtol=2e-4, atol=2e-5)


def test_coefficients_of_a_plane() -> None:
    slope = np.array([0.3, -0.2])
    z = CELL * (slope[0] * np.arange(20.0)[None, :] + slope[1] * np.arange(20.0)[:, None]).astype(np.float32)
    push = np.array([-0.05, 0.0, 0.0])
    found = relief_features(relief_of(z.astype(np.float32), CELL, 1), (8, 8, 3, 3), push, CELL, 1)
    assert found.k2 == pytest.approx(8 * CELL * np.hypot(*slope), rel=1e-3)
    assert found.cos_k3 == pytest.approx(slope[0] / np.sqrt(1.0 + slope @ slope), rel=1e-3)
    assert np.abs(found.k1) == pytest.approx(0.0, abs=1e-4)
    patch = patch_features(z[3:16, 3:16].astype(np.float32), 1, push.tolist(), CELL, 1)
    for one, other in zip(found, patch, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-5)


def test_noise_makes_the_planes_wider() -> None:
    rng = np.random.default_rng(0)
    z = 0.02 * np.sin(np.arange(120.0) / 9.0)[None, :] * np.ones((100, 1))
    scales = []
    for noise in (0.0, 0.003, 0.005, 0.008):
        raw = heights_of(z + rng.normal(0.0, 1.0, z.shape) * noise)
        scales.append(scale_of(raw, raw.smoothed()))
    assert scales == [1, 2, 3, 4]


def test_no_foot_goes_aside_for_noise() -> None:
    rng, way = np.random.default_rng(2), []
    ground = ground_of(rng.normal(0.0, 0.003, (160, 200)), smooth=True)
    path = shipped("ragno")
    assert ground.scale > 1
    assert path is not None
    model = load(path)
    for x, y in rng.uniform((-0.3, -0.25), (0.3, 0.25), (200, 2)):
        row, col = ground.surface.index(x, y)
        costs = window_costs(ground, model, (row - 7, col - 7, 15, 15), np.array(STROKE), (x, y), SelectParams())
        way.append(costs.away.ravel()[best_cell(np.zeros((15, 15), dtype=np.uint8), costs)])
    assert np.mean(np.array(way) > 0.01) < 0.03  # one in ten before; the walker steps once more for such a foot
    steep = ground_of(rng.normal(0.0, 0.003, (60, 60)) + 0.4 * CELL * np.arange(60.0), smooth=True)
    found = ground_features(steep, True, (10, 10, 40, 40), np.array(STROKE))
    assert found.k2.mean() / (8.0 * CELL) == pytest.approx(np.sqrt(0.4**2 - FAINT**2), rel=0.05)


def test_a_changed_map_has_the_relief_of_a_new_one() -> None:
    rng = np.random.default_rng(1)
    z = rng.normal(0.0, 0.002, (70, 80))
    raw = heights_of(z)
    z[20:24, 30:36] += 0.02
    z[40, 41] = np.nan
    changed = raw.with_z(z.astype(np.float32))
    found = updated_ground(ground_of(raw.z, smooth=True), raw, changed)
    for one, other in zip(found.relief, ground_of(z, smooth=True).relief, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-6)
