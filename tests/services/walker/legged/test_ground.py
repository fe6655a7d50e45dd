"""The walker's map layers."""

import numpy as np
import pytest

from surefoot.geometry.heightmap import HeightMap
from surefoot.services.walker.legged.ground import FILL_ROUNDS, Ground, Rectangle

RNG = np.random.default_rng(5)


def build(z, cell=0.005):
    return Ground.build(HeightMap(z=np.asarray(z, dtype=np.float32), cell=cell, origin=(0.0, 0.0), version=7), 0.008)


def test_flat_ground_carries_the_foot_centre_one_radius_high():
    ground = build(np.zeros((40, 40)))
    assert ground.centre_height(0.1, 0.1) == pytest.approx(0.008)
    assert ground.normal(0.1, 0.1, 0.0) == pytest.approx([0.0, 0.0, 1.0])
    assert ground.version == 7


def test_median_takes_out_single_cells_and_keeps_an_edge():
    z = np.zeros((40, 40))
    z[20, 20] = 0.05
    z[:, 30:] = 0.025
    ground = build(z)
    assert (ground.surface.z[20, 20], ground.surface.z[20, 29]) == (0.0, 0.0)
    assert ground.surface.z[20, 30] == pytest.approx(0.025)


def test_noise_raises_the_foot_less_with_the_filter():
    z = 0.003 * RNG.standard_normal((80, 80))
    heights = HeightMap(z=z.astype(np.float32), cell=0.005, origin=(0.0, 0.0))
    smooth, raw = (Ground.build(heights, 0.008, smooth=s).centres.z.mean() - 0.008 for s in (True, False))
    assert smooth < 0.6 * raw


def test_holes_are_filled_from_their_rim_up_to_a_limit():
    z = np.full((60, 60), 0.02)
    z[10:14, 10:14] = np.nan
    z[25:55, 25:55] = np.nan
    ground = build(z)
    assert ground.surface.z[11, 11] == pytest.approx(0.02)
    assert ground.surface.z[25 + FILL_ROUNDS - 1, 40] == pytest.approx(0.02)
    assert np.isnan(ground.centre_height(0.2, 0.2))
    assert ground.normal(0.2, 0.2, 0.02) == pytest.approx([0.0, 0.0, 1.0])


def test_normal_of_a_slope_points_up_and_back():
    x = 0.005 * np.arange(60)
    normal = build(np.broadcast_to(0.5 * x, (60, 60))).normal(0.15, 0.15, 0.075)
    assert normal == pytest.approx(np.array([-0.5, 0.0, 1.0]) / np.hypot(1.0, 0.5), abs=1e-3)


@pytest.mark.parametrize("level", [0.0, 0.025])
@pytest.mark.parametrize("away", [0.004, 0.010, 0.016])
def test_a_foot_beside_or_upon_a_step_stands_on_level_ground(level, away):
    z = np.zeros((60, 60))
    z[:, 30:] = 0.025  # from x = 0.1475 on
    z += 0.001 * np.random.default_rng(5).standard_normal(z.shape)
    x = 0.1475 + (away if level else -away)
    normal = build(z).normal(x, 0.15, level)
    assert np.degrees(np.arccos(normal[2])) < 6.0


def test_noise_of_the_map_hardly_tilts_a_normal():
    ground = build(0.003 * RNG.standard_normal((100, 100)))
    tilts = [np.degrees(np.arccos(ground.normal(x, y, 0.0)[2])) for x, y in RNG.uniform(0.05, 0.45, (200, 2))]
    assert np.percentile(tilts, 95) < 6.0


def test_highest_under_looks_at_the_turned_rectangle_only():
    z = np.zeros((101, 101))
    z[50, 90] = 0.07  # 0.2 m ahead of the middle
    heights = HeightMap(z=z.astype(np.float32), cell=0.005, origin=(0.0, 0.0))
    ground = Ground.build(heights, 0.008, smooth=False)
    assert ground.highest_under(Rectangle(0.25, 0.25, 0.0, 0.22, 0.05)) == pytest.approx(0.07)
    assert ground.highest_under(Rectangle(0.25, 0.25, np.pi / 2, 0.22, 0.05)) == 0.0
    assert np.isnan(ground.highest_under(Rectangle(9.0, 9.0, 0.0, 0.1, 0.1)))
