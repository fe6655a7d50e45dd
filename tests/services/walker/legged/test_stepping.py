"""Feet that land and lose the ground again: an edge met on the way, a bounce, nothing at all."""

import numpy as np
import pytest

from surefoot.geometry.heightmap import HeightMap
from surefoot.services.walker.interface import MotionCommand
from surefoot.services.walker.legged.gait import LeggedWalker
from tests.services.walker.legged.plant import KINEMATICS_TICKS, ROBOT, Plant

FLAT = HeightMap(z=np.zeros((161, 161), dtype=np.float32), cell=0.005, origin=(-0.4, -0.4))
EDGE = 0.012  # m over the ground


def walking(heights: HeightMap | None = None) -> Plant:
    plant = Plant(LeggedWalker(ROBOT), heights)
    plant.run(1.0)
    assert plant.walker.command(MotionCommand("walk", distance=0.1)).accepted
    return plant


def heights_over_ground(plant: Plant) -> np.ndarray:
    return plant.walker.state.feet[:, 2] - ROBOT.foot_radius


def until_a_foot_falls_below(plant: Plant, height: float) -> int:
    """Steps until a foot on its way down is below `height` when its switch is read next; returns the leg."""
    plant.step()
    before = heights_over_ground(plant)
    for _ in range(200):
        plant.step()
        now = heights_over_ground(plant)
        low = (now < height) & (now < before - 1e-4) & ~plant.walker.state.landed & (now > 0.004)
        if low.any() and plant.tick % KINEMATICS_TICKS == 0:
            return int(np.flatnonzero(low)[0])
        before = now
    raise AssertionError("no foot came down")


def finish_step(plant: Plant, limit: int = 300) -> int:
    """Steps until the step is done; returns the ticks."""
    steps = plant.walker.state.steps
    for k in range(limit):
        if plant.walker.state.steps > steps:
            return k
        plant.step()
    raise AssertionError("the step never ended")


def test_a_foot_that_met_an_edge_goes_on_down_before_the_others_are_lifted():
    plant = walking()
    leg = until_a_foot_falls_below(plant, EDGE)
    plant.contacts[leg] = True  # the edge, for one sample
    while plant.walker.state.steps < 1:
        plant.step()
        assert plant.tick < 600
    assert heights_over_ground(plant)[leg] == pytest.approx(0.0, abs=0.002)
    assert plant.contacts[leg]
    footholds = plant.walker.state.footholds[:, 2] - ROBOT.foot_radius
    assert footholds[leg] == pytest.approx(0.0, abs=0.002)


def test_a_bounce_of_one_sample_changes_nothing():
    ends = []
    for bounces in (False, True):
        plant = walking()
        while not (plant.walker.state.landed.all() and plant.walker.state.plan is not None):
            plant.step()
        leg = int(np.flatnonzero(plant.walker.state.plan.swing)[0])
        if bounces:
            while plant.tick % KINEMATICS_TICKS:
                plant.step()
            plant.contacts[leg] = False
        finish_step(plant)
        ends.append((plant.tick, plant.walker.state.footholds.tolist()))
    assert ends[0] == ends[1]


def test_a_foot_with_nothing_below_it_is_given_up_at_the_depth_of_the_search():
    """The step ends all the same: the check of the next one knows where the feet are."""
    plant = walking(FLAT)
    leg = until_a_foot_falls_below(plant, EDGE)
    plant.contacts[leg] = True
    plant.step()
    steps = plant.walker.state.steps
    for _ in range(600):
        plant.contacts[leg] = False
        plant.step()
        if plant.walker.state.steps > steps:
            break
    deep = plant.walker.params.search_m + plant.walker.params.press_m
    assert plant.walker.state.footholds[leg, 2] - ROBOT.foot_radius == pytest.approx(-deep, abs=0.003)
