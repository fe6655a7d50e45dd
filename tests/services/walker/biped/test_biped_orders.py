"""A command at any moment of a step: no robot falls, no command is lost, and its end is known before it comes."""

import copy
import math

import numpy as np
import pytest

from surefoot.services.walker.biped.gait import LATE_TICKS
from surefoot.services.walker.biped.state import Mode
from surefoot.services.walker.interface import MotionCommand
from tests.services.walker.biped.biped_plant import Plant, standing

HALF = math.radians(11.5)
WALK = MotionCommand("walk", distance=0.1)
LEFT, RIGHT = (MotionCommand("turn", angle=sign * 2 * HALF) for sign in (1, -1))
ARC_LEFT, ARC_RIGHT = (MotionCommand("walk", distance=0.1, angle=sign * 2 * HALF) for sign in (1, -1))
STOP = MotionCommand("stop")


def saved(plant):
    return plant.world.checkpoint(), copy.deepcopy((plant.estimator, plant.walker.state)), plant.pending.copy()


def back(plant, kept):
    plant.world.restore(kept[0])
    plant.estimator, plant.walker.state = copy.deepcopy(kept[1])
    plant.pending = kept[2].copy()


def left(plant):
    """Ticks until the landing."""
    return plant.walker._ticks_left()


def closing(plant):
    s = plant.walker.state
    return s.mode is Mode.STEP and (s.undone is None or s.undone.finished)


def tilt_until_standing(plant, number):
    """Largest tilt until the robot stands after command `number`, rad, and the steps that it takes."""
    steps, tilt = plant.out.steps, 0.0
    while plant.tick().state != "standing":
        tilt = max(tilt, plant.world.truth().tilt)
        assert plant.out.walk_id == number
        assert plant.out.state in ("walking", "turning", "stopping")
        assert plant.world.tick < 3000
    return tilt, plant.out.steps - steps


@pytest.mark.parametrize(("before", "after", "seed"), [(LEFT, RIGHT, 0), (ARC_LEFT, WALK, 2)])
def test_a_command_while_the_feet_come_together_topples_no_robot(before, after, seed):
    plant = Plant("nao", seed=seed, level=1.0).stand()
    plant.walker.command(before)
    plant.until(lambda out: closing(plant))
    kept = saved(plant)
    for ticks in (2, LATE_TICKS - 1, LATE_TICKS + 1):
        back(plant, kept)
        while left(plant) > ticks:
            plant.tick()
        tilt, steps = tilt_until_standing(plant, plant.walker.command(after).walk_id)
        assert not plant.fallen
        assert math.degrees(tilt) < 10.0
        assert steps == 4  # the closing one, two, and one to close


@pytest.mark.parametrize(("before", "after"), [(WALK, WALK), (ARC_RIGHT, ARC_LEFT), (LEFT, RIGHT)])
def test_a_command_before_the_end_of_the_last_one_follows_without_a_halt(before, after):
    plant = Plant("nao", seed=4, level=1.0).stand()
    plant.walker.command(before)
    plant.until(lambda out: out.ends_in_s is not None and out.ends_in_s <= 0.3)
    steps = plant.out.steps
    plant.walker.command(after)
    states, feet = [], []

    def landed(out):
        states.append(out.state)
        feet.append(out.stance.all())
        return out.steps == steps + 3

    ticks = plant.until(landed, 400)
    assert ticks == 30 + 2 * 90
    assert set(states) <= {"walking", "turning"} | {states[-1]}
    runs = np.split(feet, np.flatnonzero(np.diff(feet)) + 1)
    double = math.ceil(90 * plant.walker.params.double)
    assert max(len(run) for run in runs if run[0]) <= double + 1  # never on both feet for long
    plant.until(standing, 300)
    assert not plant.fallen


def test_the_end_of_a_command_is_reported_from_its_first_tick_on():
    plant = Plant("nao", seed=5, level=0.0).stand()
    assert plant.out.ends_in_s is None
    plant.walker.command(MotionCommand("walk", distance=0.2))
    told, clock = [], plant.world.tick
    plant.until(lambda out: told.append(out.ends_in_s) or out.steps == 4)
    end = plant.world.tick
    assert told[1:-1] == pytest.approx([0.01 * (end - clock - k) for k in range(1, len(told) - 1)], abs=0.021)
    assert plant.out.ends_in_s is None  # the closing step belongs to no command
    plant.walker.command(MotionCommand("walk"))
    assert plant.tick().ends_in_s is None  # endless
    plant.walker.command(STOP)
    assert plant.tick().ends_in_s is None


def test_a_walk_with_a_duration_reports_its_end():
    plant = Plant("nao", seed=5, level=0.0).begin("walk", duration=2.0)
    plant.until(lambda out: out.steps == 1)
    told, clock = plant.out.ends_in_s, plant.world.tick
    plant.until(lambda out: out.ends_in_s is None)
    assert 0.01 * (plant.world.tick - clock) == pytest.approx(told, abs=0.03)


def test_a_walker_killed_with_a_late_command_goes_on_with_it():
    plant = Plant("nao", seed=1, level=0.0).stand()
    plant.walker.command(WALK)
    plant.until(lambda out: closing(plant) and left(plant) < 10)
    number = plant.walker.command(LEFT).walk_id
    kept = plant.walker.kept()
    assert (kept.walk_id, kept.command.action, kept.command.angle) == (number, "turn", LEFT.angle)
    assert plant.tick().state == "turning"
    assert plant.out.remaining == pytest.approx(LEFT.angle)


def test_a_walk_that_is_not_to_be_learned_from_leaves_the_steps_as_they_are():
    gains = {}
    for learn in (True, False):
        plant = Plant("nao", seed=3, level=1.0).stand()
        arc = MotionCommand("walk", distance=0.4, angle=4 * HALF, learn=learn)
        plant.walker.command(arc)
        plant.until(lambda out: out.steps == 6)
        gains[learn] = plant.walker.state.gain.copy()
        assert plant.walker.kept().command.learn == learn
    assert np.any(gains[True] != 1.0)
    assert gains[False].tolist() == [1.0, 1.0]
