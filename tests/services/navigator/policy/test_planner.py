"""Value iteration against worlds that can be computed by hand, and its own equation."""

import math
from itertools import pairwise

import numpy as np
import pytest

from surefoot.services.navigator.policy.arrays import STAND, arrays
from surefoot.services.navigator.policy.grids import LAYER_MIN, add_values
from surefoot.services.navigator.policy.params import load
from surefoot.services.navigator.policy.planner import noise_samples, plan, shown_by_standing

STILL = [
    f"actions.{a}.{what}=0" for a in ("walk", "left", "right") for what in ("along_sd", "across_sd", "heading_sd_deg")
]
SMALL = {"d_max": 2.0, "shape": (3, 41, 72)}


@pytest.fixture(scope="module")
def noisy():
    world = arrays(load("paper"))
    return world, *plan(world, **SMALL)


def read(world, table, grid, d, phi, b):
    out = np.zeros(len(world.names))
    add_values(table, grid, world.tables.actions, d, phi, b, 1.0, out)
    return out


def test_without_noise_and_drift_it_takes_the_steps_that_geometry_asks_for():
    world = arrays(load("paper", STILL))
    table, grid, _ = plan(world, d_max=2.0, shape=(2, 81, 72), tolerance=1e-6)
    for d in (0.2, 0.5, 1.0, 1.5):
        steps = math.ceil((d - 0.15) / 0.10 - 1e-9)
        seconds = -read(world, table, grid, d + 0.001, 0.0, 0.0)[0]
        assert seconds == pytest.approx(1.75 * steps, abs=1.76)  # interpolation may cost one step, at most
    behind = -np.delete(read(world, table, grid, 1.0, math.pi - 0.01, 0.0), 3).max()
    assert behind == pytest.approx(1.75 * (9 + 7), abs=2 * 1.75)  # seven or eight turns of 23 deg


def test_left_and_right_are_mirror_images(noisy):
    world, table, grid, _ = noisy
    mirror = world.tables.actions["mirror"].astype(int)
    for d, phi, b in ((0.7, 0.5, 0.3), (1.4, -2.0, 0.9), (0.3, 3.0, 0.0)):
        here, there = read(world, table, grid, d, phi, b), read(world, table, grid, d, -phi, -b)
        assert here[:3] == pytest.approx(there[mirror][:3], abs=0.3 if b == 0 else 1e-9)


def test_values_satisfy_the_bellman_equation_where_the_grid_is_exact(noisy):
    """A sweep over converged values changes nothing: their largest change is the tolerance."""
    world, table, _, sweeps = noisy
    again, _, more = plan(world, **SMALL, tolerance=1e-4)
    assert more > sweeps
    moving = world.tables.actions["kind"] != STAND
    assert np.abs(again - table)[..., moving].max() < 1.0


def test_farther_is_longer_and_drift_costs(noisy):
    world, table, grid, _ = noisy
    ahead = [read(world, table, grid, d, 0.0, 0.0)[:3].max() for d in np.arange(0.3, 4.0, 0.2)]
    assert all(later < sooner for sooner, later in pairwise(ahead))
    assert ahead[-1] < -1.75 * 35
    drifting = [read(world, table, grid, 1.9, 0.0, b)[:3].max() for b in (0.0, 0.7, 1.39)]
    assert drifting[0] > drifting[1] > drifting[2]


def test_it_turns_against_the_drift_earlier_than_with_it(noisy):
    """With a drift to the left a goal slightly to the left needs no turn, one to the right does."""
    world, table, grid, _ = noisy
    b, phi = math.radians(80.0), math.radians(18.0)
    left, right = read(world, table, grid, 1.5, phi, b), read(world, table, grid, 1.5, -phi, b)
    assert world.names[int(np.argmax(left[:3]))] == "walk"
    assert world.names[int(np.argmax(right[:3]))] == "right"


def test_switching_costs_are_part_of_what_starting_costs():
    world = arrays(load("paper", ["switching.walk.stand=0.9", "switching.stand.walk=1.0", "switching.stand.turn=1.0"]))
    plain, grid, _ = plan(arrays(load("paper")), **SMALL)
    table, _, _ = plan(world, **SMALL)
    assert table[..., :3] == pytest.approx(plain[..., :3], abs=0.2)  # without a stand on the way nothing is switched
    assert grid[LAYER_MIN] == 0.0


def test_noise_samples_have_zero_mean_and_unit_variance():
    samples = noise_samples(24)
    assert samples.mean(axis=0) == pytest.approx([0, 0, 0], abs=1e-12)
    assert (samples**2).mean(axis=0) == pytest.approx([1, 1, 1], abs=1e-12)


def test_what_a_stand_shows_grows_with_landmarks_and_falls_with_tilt():
    few, many = (shown_by_standing(arrays(load("paper", [f"scene.landmarks_per_m2={n}"]))) for n in (5, 20))
    assert many[:3, :3].diagonal() == pytest.approx(few.diagonal() / 4, rel=1e-9)
    tilted = shown_by_standing(arrays(load("paper", ["scene.landmarks_per_m2=20", "sight.tilt_sd_deg=2"])))
    assert (tilted - many)[0, 0] == pytest.approx((0.45 * math.radians(2)) ** 2)
    blind = shown_by_standing(arrays(load("paper", ["scene.landmarks_per_m2=0"])))
    assert blind[0, 0] > 1e3
