"""Feet beside unknown ground: where there is a choice, no part of a foot's disc lies on cells that are not known."""

import math

import numpy as np
import pytest

from surefoot.geometry.heightmap import HeightMap
from surefoot.services.footholds.footing import add_unsupported, footprint
from surefoot.services.footholds.ground import build_ground
from surefoot.services.footholds.models.files import load, shipped
from surefoot.services.footholds.patch import PatchStep, choose_on_patch

CELL = 0.005
RAGNO = load(shipped("ragno") or "")


@pytest.mark.parametrize("radius", [0.0001, 0.003, 0.006, 0.008, 0.02])
def test_the_disc_of_a_foot_covers_cells_by_their_common_area(radius: float) -> None:
    disc = footprint(radius, CELL)
    n = disc.shape[0]
    assert disc.sum() == pytest.approx(1.0)
    assert (disc == disc.T).all()
    assert (disc == disc[::-1]).all()
    rng = np.random.default_rng(0)
    r, angle = radius * np.sqrt(rng.random(200_000)), rng.uniform(0.0, 2.0 * math.pi, 200_000)
    cells = [np.floor(v / CELL + 0.5 * n).astype(int) for v in (r * np.sin(angle), r * np.cos(angle))]
    drawn = np.zeros((n, n))
    np.add.at(drawn, tuple(cells), 1.0 / r.size)
    assert disc == pytest.approx(drawn, abs=0.02)


def test_unknown_ground_under_a_foot_counts_as_a_slip_of_one_in_any_window() -> None:
    rng = np.random.default_rng(1)
    z = rng.normal(0.0, 0.01, (20, 25)).astype(np.float32)
    z[rng.random(z.shape) < 0.3] = np.nan
    ground = build_ground(HeightMap(z=z, cell=CELL, origin=(0.0, 0.0)), 0.011, smooth=False)
    disc, b = footprint(0.011, CELL), footprint(0.011, CELL).shape[0] // 2
    unknown = np.pad(np.isnan(z), b + 12, constant_values=True)
    for row, col in ((-4, -4), (3, 5), (9, 17)):
        slip = rng.uniform(-0.2, 1.2, (15, 15)).astype(np.float32)
        got = slip.copy()
        add_unsupported(ground, (row, col, 15, 15), got)
        for i, j in np.ndindex(slip.shape):
            r, c = row + i + b + 12, col + j + b + 12
            share = float(disc[unknown[r - b : r + b + 1, c - b : c + b + 1]].sum())
            p = float(slip[i, j])
            assert got[i, j] == pytest.approx(p if p < 0.0 else p + share * (1.0 - min(p, 1.0)), abs=1e-6)


def reaches(z: np.ndarray, at: tuple[float, ...], radius: float) -> bool:
    """Return True if a disc about a place of a patch touches a cell that is not known, to a hundredth of a cell."""
    rows, cols = np.nonzero(np.isnan(z))
    x, y = CELL * (cols - z.shape[1] // 2) - at[0], CELL * (rows - z.shape[0] // 2) - at[1]
    away = np.hypot(np.maximum(abs(x) - 0.5 * CELL, 0.0), np.maximum(abs(y) - 0.5 * CELL, 0.0))
    return bool((away < radius - 0.06 * CELL).any())


def test_no_foot_stands_on_the_last_known_cell_beside_a_gap_where_there_is_room() -> None:
    y, x = CELL * (np.mgrid[0:61, 0:61] - 30)
    beside, radius = 0, 0.008
    for seed in range(40):
        rng = np.random.default_rng((seed, 3))
        angle, off = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(-0.004, 0.008)
        z = 0.002 * np.sin(200.0 * x + seed) + 0.3 * rng.uniform() * x
        away = math.cos(angle) * x + math.sin(angle) * y
        z[(away > off) & (away < off + 0.04)] = np.nan  # 4 cm wide, its edge within 8 mm of the nominal foothold
        found = choose_on_patch(z, CELL, RAGNO, PatchStep((-0.04, 0.0, 0.0), radius))
        assert found.foothold is not None
        filled = HeightMap(z=z.astype(np.float32), cell=CELL, origin=(0.0, 0.0)).smoothed().z
        beside += reaches(filled, (0.0, 0.0), radius)
        assert not reaches(filled, found.foothold, radius), seed
    assert beside > 10


def test_where_every_place_reaches_into_unknown_ground_there_still_is_a_foothold() -> None:
    z = np.full((41, 41), np.nan)
    z[19:22] = 0.0  # a strip of three cells
    found = choose_on_patch(z, CELL, RAGNO, PatchStep((-0.04, 0.0, 0.0), 0.008))
    assert found.foothold is not None
    assert abs(found.foothold[1]) < 0.003  # in its middle
