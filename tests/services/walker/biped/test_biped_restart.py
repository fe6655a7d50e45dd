"""A biped walker killed in mid-walk: the robot stays up and the next walker takes up what was left."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surefoot.robot.reader import load_robot
from surefoot.services.walker.biped.gait import BipedWalker
from surefoot.services.walker.biped.params import BipedParams
from surefoot.services.walker.biped.route import route_of
from surefoot.services.walker.interface import MotionCommand
from surefoot.services.walker.memory import MemoryFile
from tests.services.walker.biped.biped_plant import Plant, standing

P = BipedParams.for_robot(load_robot("bioloid"))


@given(
    distance=st.floats(-1.0, 1.0).filter(lambda d: abs(d) > 0.03),
    speed=st.none() | st.floats(0.02, 0.08),
    angle=st.none() | st.floats(-0.3, 0.3),
    done=st.integers(0, 6),
)
def test_what_is_left_leads_to_the_same_steps(distance, speed, angle, done):
    velocity = None if speed is None else math.copysign(speed, distance)
    routes = [route_of(MotionCommand("walk", distance, velocity, angle), P, 7)]
    routes.append(route_of(MotionCommand("turn", angle=1.0 if angle is None else angle), P, 7))
    for route in routes:
        for _ in range(done):
            route = route.next(1.0)[2]
        if route.finished:
            continue
        again = route_of(route.left(P.step_s, "zmp", None), P, 7)
        assert again.turning == route.turning
        while not route.finished:
            forward, turn, route = route.next(1.0)
            other_forward, other_turn, again = again.next(1.0)
            assert (other_forward, other_turn) == pytest.approx((forward, turn), abs=1e-6)
        assert again.finished


def restart(plant, memory):
    """A new walker in place of the one that is lost; it knows what the file knows."""
    kept = MemoryFile(str(memory)).recall(1, plant.world.tick + 1)
    assert kept is not None
    plant.walker = BipedWalker(plant.robot)
    plant.walker.resume(kept)
    return kept


@pytest.mark.parametrize(("name", "phase"), [("bioloid", 0.1), ("nao", 0.4), ("bioloid", 0.7), ("nao", 0.95)])
def test_killed_in_any_support_it_stays_up_and_walks_the_rest(name, phase, tmp_path):
    plant = Plant(name, seed=1, level=1.0).stand()
    before = plant.world.truth().position[0]
    number = plant.walker.command(MotionCommand("walk", distance=0.2)).walk_id
    plant.until(lambda out: out.steps >= 2 and out.phase > phase)
    MemoryFile(str(tmp_path / "walker.json")).keep(1, plant.world.tick, plant.walker.kept())
    kept = restart(plant, tmp_path / "walker.json")
    assert 0.0 < kept.command.distance < 0.2
    states = []
    plant.until(lambda out: states.append(out.state) or standing(out), 2500)
    assert states[0] == "recovering"
    assert "walking" in states
    assert not plant.fallen
    assert plant.out.walk_id == number
    assert plant.world.truth().position[0] - before == pytest.approx(0.2, abs=0.05)


def test_a_turn_in_the_quick_gait_goes_on_in_it():
    plant = Plant("bioloid", level=1.0).begin("turn", angle=-0.6, gait="quick")
    plant.until(lambda out: out.steps >= 2 and out.phase > 0.6)
    plant.restart()
    assert plant.walker.params.step_s == plant.walker.params.quick_s
    plant.until(standing, 1500)
    assert plant.yaw == pytest.approx(-0.6, abs=0.12)
    assert not plant.fallen


def test_the_time_of_a_walk_goes_on():
    plant = Plant("bioloid").begin("walk", duration=3.0)
    plant.until(lambda out: out.steps >= 2 and out.phase > 0.5)
    kept = plant.restart()
    assert (kept.command.distance, kept.command.duration) == (None, 3.0)
    plant.until(standing, 1200)
    assert 0.01 * plant.world.tick < kept.began + 3.0 + 3.0


def test_nothing_under_way_is_kept_as_nothing():
    plant = Plant("bioloid").stand()
    assert plant.walker.kept().command is None
    plant.walker.command(MotionCommand("walk", distance=0.05))
    plant.until(standing, 900)
    kept = plant.walker.kept()
    assert (kept.walk_id, kept.command) == (1, None)


def test_a_walker_that_finds_its_robot_lying_does_not_walk():
    plant = Plant("bioloid").begin("walk")
    kept = plant.walker.kept()
    plant.world.push((0.0, 40.0, 0.0), 0.2)
    plant.until(lambda out: out.state == "refused", 300)
    plant.run(100)
    plant.walker = BipedWalker(plant.robot)
    plant.walker.resume(kept)
    plant.until(lambda out: out.state == "refused", 100)
    assert plant.out.reason.startswith("fallen")
    assert np.all(np.isfinite(plant.out.command))
