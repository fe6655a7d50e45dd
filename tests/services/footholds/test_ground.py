"""Layers of a map: a new version costs what has changed, and gives what a new build gives."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surefoot.geometry.heightmap import HeightMap
from surefoot.services.footholds.ground import build_ground, changed_cells, updated_ground

CELL = 0.005


def heights(z: np.ndarray, version: int = 0, cell: float = CELL) -> HeightMap:
    return HeightMap(z=z.astype(np.float32), cell=cell, origin=(0.1, -0.2), version=version)


def rough(seed: int, shape: tuple[int, int] = (40, 33)) -> np.ndarray:
    rng = np.random.default_rng(seed)
    z = rng.normal(0.0, 0.02, shape)
    z[rng.random(shape) < 0.08] = np.nan
    return z.astype(np.float32)


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 1000), st.integers(0, 39), st.integers(0, 32), st.integers(1, 15), st.integers(1, 15),
    st.sampled_from([0.004, 0.008, 0.013]),
)  # fmt: skip
def test_an_update_equals_a_new_build(seed: int, row: int, col: int, rows: int, cols: int, radius: float) -> None:
    old = rough(seed)
    new = old.copy()
    new[row : row + rows, col : col + cols] = rough(seed + 1)[row : row + rows, col : col + cols]
    got = updated_ground(build_ground(heights(old), radius), heights(old), heights(new, 7))
    want = build_ground(heights(new, 7), radius)
    np.testing.assert_array_equal(got.surface.z, want.surface.z)
    np.testing.assert_array_equal(got.centres.z, want.centres.z)
    assert got.version == 7


def test_the_rectangle_of_what_differs() -> None:
    old = rough(1)
    new = old.copy()
    assert changed_cells(old, new) == (slice(0, 0), slice(0, 0))
    new[5, 9], new[11, 3] = 1.0, 2.0
    assert changed_cells(old, new) == (slice(5, 12), slice(3, 10))
    new = old.copy()
    known = np.argwhere(~np.isnan(old))[3]
    new[tuple(known)] = np.nan
    assert changed_cells(old, new) == tuple(slice(k, k + 1) for k in known.tolist())


@pytest.mark.parametrize("other", ["cell", "shape", "no filter"])
def test_another_grid_or_no_filter_is_built_anew(other: str) -> None:
    old = rough(2)
    new = heights(rough(3, (20, 20)) if other == "shape" else rough(3), 1, 0.01 if other == "cell" else CELL)
    smooth = other != "no filter"
    got = updated_ground(build_ground(heights(old), 0.008, smooth), heights(old), new)
    want = build_ground(new, 0.008, smooth)
    np.testing.assert_array_equal(got.centres.z, want.centres.z)
    assert (got.surface.cell, got.surface.shape) == (new.cell, new.shape)


def median(z: np.ndarray, min_known: int) -> np.ndarray:
    """The filter in plain loops."""
    out = np.full_like(z, np.nan)
    for i, j in np.ndindex(z.shape):
        window = z[max(0, i - 1) : i + 2, max(0, j - 1) : j + 2]
        known = np.sort(window[~np.isnan(window)])
        if len(known) and (not np.isnan(z[i, j]) or len(known) >= min_known):
            out[i, j] = np.float32(0.5) * (known[(len(known) - 1) // 2] + known[len(known) // 2])
    return out


def test_planes_are_fitted_to_slopes_that_are_even_beside_unknown_ground_and_at_the_border() -> None:
    rng = np.random.default_rng(3)
    y, x = np.mgrid[0:20, 0:25] * CELL
    z = (0.5 * x - 0.3 * y).astype(np.float32)
    seen = np.where(rng.random(z.shape) < 0.2, np.nan, z).astype(np.float32)
    seen[5:12, 8:12] = np.nan
    ground = build_ground(heights(seen), 0.008)
    known = ~np.isnan(ground.even)
    assert (known & np.isnan(seen)).any()
    np.testing.assert_array_equal(known, ~np.isnan(ground.surface.z))
    assert ground.even[known] == pytest.approx(z[known], abs=1e-6)
    fitted = ~np.isnan(ground.relief.slope_x)
    assert fitted.sum() > 0.8 * fitted[1:-1, 1:-1].size
    assert ground.relief.slope_x[fitted] == pytest.approx(0.5, abs=1e-4)
    assert ground.relief.slope_y[fitted] == pytest.approx(-0.3, abs=1e-4)


@pytest.mark.parametrize("shape", [(30, 41), (1, 5), (5, 1), (2, 2), (3, 3), (1, 1)])
def test_the_median_is_that_of_plain_loops(shape: tuple[int, int]) -> None:
    for seed in range(3):
        z = rough(seed, shape)
        np.testing.assert_array_equal(heights(z).smoothed().z, median(z, 6))
        np.testing.assert_array_equal(heights(z).smoothed(9).z, median(z, 9))
