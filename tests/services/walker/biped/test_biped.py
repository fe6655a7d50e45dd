"""The biped walker in its world: walks, turns, stops, refuses, falls."""

import hashlib
import math

import numpy as np
import pytest

from surefoot.robot.reader import load_robot
from surefoot.services.walker.biped.gait import STALE, BipedWalker
from surefoot.services.walker.interface import MotionCommand, WalkerInputs
from tests.services.walker.biped.biped_plant import Plant, standing

BOTH = ("bioloid", "nao")


@pytest.mark.parametrize("name", BOTH)
def test_walks_the_distance_and_stands_with_its_feet_together(name):
    plant = Plant(name, seed=1, level=1.0).stand()
    before = plant.world.truth()
    assert plant.walker.command(MotionCommand("walk", distance=0.15)).accepted
    plant.until(standing, 1500)
    plant.run(80)
    after = plant.world.truth()
    assert not plant.fallen
    assert after.position[0] - before.position[0] == pytest.approx(0.15, abs=0.03)
    feet = after.foot_position
    assert abs(feet[0, 0] - feet[1, 0]) < 0.015
    assert np.all(after.foot_force_n > 1.0)


@pytest.mark.parametrize("name", BOTH)
def test_turns_by_two_steps_of_half_the_angle(name):
    plant = Plant(name, seed=2, level=1.0).begin("turn", angle=math.radians(23))
    plant.until(standing, 800)
    assert not plant.fallen
    assert plant.out.steps == 3
    assert math.degrees(plant.yaw) == pytest.approx(23.0, abs=4.0)


@pytest.mark.parametrize(("name", "phase"), [("bioloid", 0.1), ("nao", 0.6)])
def test_a_stop_in_any_support_is_a_closing_step(name, phase):
    plant = Plant(name, level=1.0).begin("walk")
    plant.until(lambda out: out.steps >= 2 and out.phase > phase)
    steps = plant.out.steps
    assert plant.walker.command(MotionCommand("stop")).accepted
    plant.until(standing, 400)
    assert plant.out.steps - steps <= 2
    assert not plant.fallen


def test_a_new_command_while_stepping_replaces_the_old_one_at_the_next_step():
    plant = Plant("bioloid").stand()
    first = plant.walker.command(MotionCommand("walk"))
    plant.until(lambda out: out.steps >= 2 and out.phase > 0.5)
    second = plant.walker.command(MotionCommand("turn", angle=-0.2))
    assert second.walk_id == first.walk_id + 1
    plant.until(standing, 600)
    assert not plant.fallen
    assert plant.yaw == pytest.approx(-0.2, abs=0.06)


def test_impossible_commands_while_stepping_change_nothing():
    plant = Plant("bioloid").begin("walk", distance=0.1)
    plant.until(lambda out: out.steps >= 1 and out.phase > 0.5)
    route = plant.walker.state.route
    for command in (
        MotionCommand("walk", velocity=9.0),
        MotionCommand("turn"),
        MotionCommand("walk", distance=math.inf),
    ):
        reply = plant.walker.command(command)
        assert not reply.accepted
        assert reply.reason
    assert plant.walker.state.route is route
    plant.until(standing, 800)
    assert not plant.fallen


@pytest.mark.parametrize("name", BOTH)
def test_a_walk_without_an_estimate_waits_on_two_feet_and_goes_on_with_it(name):
    plant = Plant(name, seed=1, level=1.0).stand()
    before = plant.world.truth().position[0]
    plant.walker.command(MotionCommand("walk", distance=0.2))
    plant.until(lambda out: out.steps >= 2 and out.phase > 0.5)
    steps = plant.out.steps
    plant.until(lambda out: out.state == "hold" and not out.phase, 400, blind=True)
    assert plant.out.steps - steps <= 2
    assert plant.out.stance.all()
    assert plant.out.reason == STALE
    states = {plant.tick(blind=True).state for _ in range(100)}
    plant.until(lambda out: states.add(out.state) or out.state == "standing", 2000)
    assert states == {"hold", "walking", "stopping", "standing"} - ({"stopping"} - states)
    plant.run(80)
    assert plant.world.truth().position[0] - before == pytest.approx(0.2, abs=0.04)
    assert not plant.fallen


@pytest.mark.parametrize("force", [15.0, 30.0])
def test_a_lost_robot_folds_and_says_so(force):
    """Pushes that topple it; from 35 N on it turns over in the air, faster than the gyro can measure."""
    plant = Plant("bioloid").stand()
    plant.world.push((0.0, force, 0.0), 0.2)
    plant.until(lambda out: out.state == "refused", 300)
    assert plant.out.reason.startswith("fallen")
    reply = plant.walker.command(MotionCommand("walk", distance=0.1))
    assert reply.code == "fallen"
    plant.run(100)
    assert np.all(np.isfinite(plant.out.command))
    assert plant.fallen


def test_feet_of_a_robot_that_lies_show_no_delay_of_their_stamps() -> None:
    plant = Plant("bioloid", seed=11).stand()
    way = 1.1 * 11  # 26 ms were taken off 1.3 s after this push
    plant.world.push((30.0 * math.sin(way), 30.0 * math.cos(way), 0.0), 0.2)
    for _ in range(250):
        plant.tick()
        assert not any("stamps of the feet" in reason for reason in plant.estimator.estimate().reasons)
    assert plant.out is not None
    assert plant.out.reason.startswith("fallen")


def test_a_step_after_much_tilt_is_shorter():
    plant = Plant("bioloid").begin("walk")
    state, params = plant.walker.state, plant.walker.params
    plant.until(lambda out: out.steps >= 2 and out.phase > 0.9)
    state.peak = 0.5 * (params.slow_from_rad + params.slow_full_rad)
    before = state.step.body[0]
    plant.until(lambda out: out.steps >= 3)
    full = params.step_m / state.gain[0]
    assert state.step.body[0] - before == pytest.approx(0.5 * full, abs=0.1 * full)


def test_a_push_that_tilts_the_robot_slows_it_down_until_it_is_level_again():
    plant = Plant("bioloid").begin("walk")
    state, params = plant.walker.state, plant.walker.params
    plant.until(lambda out: out.steps >= 3 and out.phase > 0.5)
    assert state.scale == 1.0
    plant.world.push((0.0, 5.0, 0.0), 0.1)
    scales, peak = [], 0.0

    def look(out):
        nonlocal peak
        peak = max(peak, float(np.hypot(*state.tilt)))
        scales.append(state.scale)
        return out.steps >= 9

    plant.until(look, 1500)
    assert not plant.fallen
    assert peak > params.slow_from_rad
    assert min(scales) < 0.9
    assert scales[-1] == 1.0


def test_the_gait_does_not_change_in_mid_walk():
    plant = Plant("bioloid").begin("walk", distance=0.1, gait="quick")
    plant.until(lambda out: out.phase > 0.5)
    assert plant.walker.command(MotionCommand("walk", gait="zmp")).code == "conflict"
    ticks = plant.until(standing, 900)
    assert ticks < 400
    assert plant.walker.command(MotionCommand("walk", gait="zmp")).accepted


def test_equal_seeds_give_equal_walks():
    def digest():
        plant = Plant("bioloid", seed=5, level=1.0).stand()
        plant.walker.command(MotionCommand("walk", distance=0.05))
        plant.until(standing, 800)
        return hashlib.sha256(b"".join(np.asarray(a).tobytes() for a in plant.world.truth()[1:])).hexdigest()

    assert digest() == digest()


def test_plan_is_what_the_feet_do():
    """Soles land where the plan put them, seen from each other: within the play of the servos."""
    plant = Plant("nao").begin("walk", distance=0.2)
    gaps = []

    def look(out):
        state = plant.walker.state
        if state.step is not None and state.clock == 10 and out.steps > 0:
            truth, soles = plant.world.truth().foot_position, plant.walker._soles()
            gaps.append(np.abs((truth[0] - truth[1])[:2] - (soles[0] - soles[1])[:2]).max())
        return out.state == "standing"

    plant.until(look, 1500)
    assert len(gaps) >= 3
    assert max(gaps) < 0.006


def test_a_walk_waits_for_the_estimate_before_its_first_step_too():
    walker, both, tick = BipedWalker(load_robot("nao")), np.array([True, True]), 0

    def step(age=0.0):
        nonlocal tick
        tick, now = tick + 1, 0.01 * tick
        q = walker.state.q.copy()
        return walker.step(WalkerInputs(now, estimate_stamp=now - age, initialised=True, joints=q, contacts=both))

    while step().state != "standing":
        assert tick < 500
    assert walker.command(MotionCommand("walk", distance=0.1)).accepted
    assert [step(age).state for age in (0.0, 0.09, 0.2, 0.2)] == ["walking", "walking", "hold", "hold"]
    assert walker.kept().command.distance == pytest.approx(0.1)
    assert (step().state, step().reason) == ("walking", "")
