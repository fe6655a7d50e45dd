"""The foot that is set down where a leaning trunk really puts it."""

import math

import numpy as np
import pytest

from surefoot.geometry.rotations import matrix_from_axis_angle
from surefoot.robot.reader import load_robot
from surefoot.services.walker.biped.landing import HEIGHT, TOUCH, set_down
from surefoot.services.walker.biped.params import BipedParams
from surefoot.services.walker.biped.plan import LEFT, RIGHT
from surefoot.services.walker.biped.route import Footstep
from surefoot.services.walker.biped.state import BipedState, Mode
from tests.services.walker.biped.biped_plant import Plant

PARAMS = BipedParams.for_robot(load_robot("nao"))
DOUBLE = 22
SOLES = np.array([[0.03, 0.05, 0.0, 0.004], [0.0, -0.05, 0.0, 0.0]])
"""The left foot swings 3 cm ahead, 4 mm over the floor."""


def swinging(tilt=(0.0, 0.0), progress=0.9, touches=False):
    """Return a state in the swing of the left foot."""
    s = BipedState(25, mode=Mode.STEP, clock=60, progress=progress, steps=3)
    s.step = Footstep(LEFT, np.zeros(3), np.zeros(3))
    s.tilt, s.contacts = np.array(tilt), np.array([touches, True])
    return s


@pytest.mark.parametrize("yaw", [0.0, 2.0])
@pytest.mark.parametrize("tilt", [(0.03, 0.0), (-0.02, 0.0), (0.0, 0.03), (0.02, -0.015)])
def test_a_leaning_trunk_sets_a_foot_down_level_and_on_the_floor(tilt, yaw):
    """Oracle: the whole robot turned by the lean about the standing foot."""
    heading = matrix_from_axis_angle(np.array([0.0, 0.0, 1.0]), yaw)
    soles = SOLES.copy()
    soles[:, :2] = SOLES[:, :2] @ heading[:2, :2].T
    soles[:, 2] = yaw
    s = swinging(tilt)
    s.trunk[2] = yaw
    moved, turns = set_down(s, PARAMS, soles, DOUBLE)
    lean = matrix_from_axis_angle(np.array([0.0, 1.0, 0.0]), tilt[1]) @ matrix_from_axis_angle(
        np.array([1.0, 0.0, 0.0]), tilt[0]
    )
    whole = soles[LEFT, 3] + (moved[LEFT, 3] - soles[LEFT, 3]) / HEIGHT
    away = heading.T @ np.array([*(soles[LEFT, :2] - soles[RIGHT, :2]), whole])
    assert (lean @ away)[2] == pytest.approx(soles[LEFT, 3], abs=5e-5)
    normal = lean @ matrix_from_axis_angle(np.array([0.0, 1.0, 0.0]), -turns[LEFT, 1])
    normal = normal @ matrix_from_axis_angle(np.array([1.0, 0.0, 0.0]), -turns[LEFT, 0])
    assert math.acos(min(1.0, normal[2, 2])) < 1e-3
    assert np.all(turns[RIGHT] == 0.0)
    assert np.array_equal(moved[RIGHT], soles[RIGHT])
    assert np.array_equal(moved[:, :3], soles[:, :3])


def test_a_push_lets_the_foot_come_down_as_planned():
    """Beyond the tilt at which the next step marks time the landing of the plan is the safe one."""
    moved, turns = set_down(swinging((-1.01 * PARAMS.slow_full_rad, 0.0)), PARAMS, SOLES, DOUBLE)
    assert np.array_equal(moved, SOLES)
    assert not turns.any()


def test_without_a_lean_the_plan_stays():
    s = swinging()
    for _ in range(3):
        moved, turns = set_down(s, PARAMS, SOLES, DOUBLE)
        assert np.array_equal(moved, SOLES)
        assert not turns.any()


def test_a_foot_that_touches_early_is_not_pressed_on_and_comes_down_in_double_support():
    s, soles, heights = swinging(touches=True), SOLES.copy(), list[float]()
    for height in (0.004, 0.003, 0.001, 0.0):
        soles[LEFT, 3] = height
        heights.append(set_down(s, PARAMS, soles, DOUBLE)[0][LEFT, 3])
    assert heights == [0.004] * 4
    s.mode, s.clock = Mode.STAND, 0
    heights = [float(set_down(s, PARAMS, soles, DOUBLE)[0][LEFT, 3]) for _ in range(DOUBLE + 5)]
    assert heights == pytest.approx([0.004 * max(0.0, 1.0 - k / DOUBLE) for k in range(1, DOUBLE + 6)], abs=1e-12)


def test_a_foot_that_still_leaves_the_floor_has_not_landed():
    s, soles = swinging(progress=TOUCH - 0.01, touches=True), SOLES.copy()
    set_down(s, PARAMS, soles, DOUBLE)
    s.progress, s.contacts, soles[LEFT, 3] = 0.95, np.array([False, True]), 0.001
    assert set_down(s, PARAMS, soles, DOUBLE)[0][LEFT, 3] == 0.001


def test_a_touch_of_the_last_step_is_forgotten():
    s, soles = swinging(touches=True), SOLES.copy()
    set_down(s, PARAMS, soles, DOUBLE)
    s.step = Footstep(RIGHT, np.zeros(3), np.zeros(3))
    s.clock, s.progress, soles[LEFT, 3], soles[RIGHT, 3] = DOUBLE + 1, 0.01, 0.0, 0.0005
    assert set_down(s, PARAMS, soles, DOUBLE)[0][RIGHT, 3] == 0.0005


@pytest.mark.parametrize("seed", [606, 915])
def test_weak_robots_turn_without_a_fall(seed):
    """They rocked more from step to step, and fell within eight, while feet came down as for a level trunk."""
    plant = Plant("nao", seed, level=1.0).begin("turn", angle=math.radians(138.0))
    plant.until(lambda out: out.state == "standing" or plant.fallen)
    assert not plant.fallen
