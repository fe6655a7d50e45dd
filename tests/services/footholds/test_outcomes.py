"""Samples of stances: what is learned is the ground on which the foothold was chosen."""

import math

import numpy as np
import pytest

from surefoot.geometry.heightmap import HeightMap
from surefoot.services.footholds.ground import build_ground, ground_features
from surefoot.services.footholds.learning.samples import gather
from surefoot.services.footholds.models.lattice import coordinates
from surefoot.services.footholds.outcomes import sample_at

CELL, STROKE = 0.005, (-0.04, 0.0, 0.0)


def seen(degrees: float, noise: float) -> HeightMap:
    """A slope of 41 x 41 cells with a gap of 3 cm across it, one end of it open, and cells that dropped out."""
    rng = np.random.default_rng(5)
    y, x = CELL * (np.mgrid[0:41, 0:41] - 20)
    z = math.tan(math.radians(degrees)) * x + rng.normal(0.0, noise, x.shape)
    z[(abs(x - 0.03) < 0.015) & (y < 0.06)] = np.nan
    z[rng.random(z.shape) < 0.03] = np.nan
    return HeightMap(z=z.astype(np.float32), cell=CELL, origin=(-20 * CELL, -20 * CELL))


@pytest.mark.parametrize("degrees", [10.0, 20.0, 30.0])
@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_the_point_of_a_sample_is_that_of_the_choice_beside_unknown_ground_too(degrees: float, noise: float) -> None:
    ground = build_ground(seen(degrees, noise), 0.008)
    beside = 0
    for row, col in np.ndindex(ground.surface.shape):
        if not (7 <= row < 34 and 7 <= col < 34):
            continue
        k1, k2, k3 = (layer[0, 0] for layer in ground_features(ground, True, (row, col, 1, 1), np.array(STROKE)))
        at = ground.surface.centre(row, col)
        found = gather([sample_at(ground, at, at, STROKE, 0.001, ("walk", 0, 0))])
        if not len(found):
            continue
        beside += bool(np.isnan(ground.surface.z[row - 1 : row + 2, col - 2 : col + 3]).any())
        want = coordinates(np.array([k1]), np.array([k2]), np.array([k3]), CELL)[0]
        assert found.x[0][1:] == pytest.approx(want[1:], abs=2e-3), (row, col)  # heights are kept to a micrometre
    assert beside > 20


def test_a_slope_is_learned_as_steep_beside_a_gap_as_elsewhere() -> None:
    ground = build_ground(seen(20.0, 0.0), 0.008)
    last = min(col for col in range(20, 41) if np.isnan(ground.surface.z[20, col])) - 1
    at = ground.surface.centre(20, last - 1)  # its own 3 x 3 cells are known, those of its neighbour are not
    found = gather([sample_at(ground, at, at, STROKE, 0.001, ("walk", 0, 0))])
    assert found.x[0][1] == pytest.approx(math.tan(math.radians(20.0)), rel=0.01)
