"""The world of a biped: servos with steps, play and latency, twist of soles, perturbation levels, checkpoints."""

import dataclasses
import math

import numpy as np
import pytest

from surefoot.bus.codec import encode
from surefoot.robot.reader import load_robot
from surefoot.services.simulator.ground.terrain import make_terrain
from surefoot.services.simulator.messages import truth_message
from surefoot.services.simulator.physics.model import Physics
from surefoot.services.simulator.physics.perturb import perturbation
from surefoot.services.simulator.physics.samples import ServoCommand
from surefoot.services.simulator.physics.servo_line import ServoLine
from surefoot.services.simulator.world import PhysicsWorld, WorldConfig
from tests.services.simulator.stepping import steps

BIOLOID, NAO, RAGNO = (load_robot(name) for name in ("bioloid", "nao", "ragno"))


def sway(robot, tick):
    """Set-points that shake the hips a little."""
    q = robot.neutral.copy()
    for leg in robot.legs:
        q[leg.joints[1]] += 0.05 * math.sin(0.2 * tick)
    return q


@pytest.mark.parametrize("robot", [BIOLOID, NAO], ids=lambda robot: robot.name)
def test_a_biped_stands_on_eight_switches_and_weighs_what_it_should(robot):
    world = PhysicsWorld(robot, make_terrain("flat"))
    steps(world, 8)
    truth = world.truth()
    assert truth.foot_force_n.sum() == pytest.approx(9.81 * robot.mass, rel=0.01)
    touch = None
    while touch is None:
        world.step_tick()
        touch = world.samples.contacts
    assert [len(foot) for foot in touch.touch] == [4, 4]
    assert all(any(foot) for foot in touch.touch)
    assert truth.tilt < 0.03


def test_a_restored_biped_has_the_same_future_to_the_bit():
    config = WorldConfig(perturbation=perturbation(1.0, 4, BIOLOID.nj, "biped"))
    world = PhysicsWorld(BIOLOID, make_terrain("flat"), 4, config)
    for tick in range(20):
        world.step_tick(sway(BIOLOID, tick))
    saved = world.checkpoint()
    futures = []
    for _ in range(2):
        world.restore(saved)
        for tick in range(20, 50):
            world.step_tick(sway(BIOLOID, tick))
        futures.append(b"".join(np.asarray(a).tobytes() for a in world.truth()[1:]) + repr(world.samples).encode())
    assert futures[0] == futures[1]


def test_set_points_come_in_steps_and_late():
    line = ServoLine(BIOLOID, 1_000_000)
    assert line.latency_steps == 4
    heard = line.heard(np.full(18, 0.1))
    step = BIOLOID.joints[0].servo.resolution
    assert heard / step == pytest.approx(np.rint(heard / step))
    assert np.abs(heard - 0.1).max() <= 0.5 * step
    limit = np.full(18, 0.5)
    line.send(100, ServoCommand(np.full(18, 0.1), limit))
    assert line.arrival(103) is None
    at, (position, torque_limit) = line.arrival(110)
    assert at == 104
    assert np.array_equal(position, heard)
    assert torque_limit is limit
    assert line.arrival(110) is None


def test_servos_of_hexapods_hear_exactly_what_is_sent_at_once():
    line = ServoLine(RAGNO, 1_000_000)
    sent = np.linspace(-1.0, 1.0, 18)
    line.send(7, ServoCommand(sent))
    at, (position, torque_limit) = line.arrival(7)
    assert at == 7
    assert position is sent
    assert torque_limit is None


def test_perturbation_levels_scale_and_are_seeded():
    one, two = (perturbation(level, 3, 18, "biped") for level in (1.0, 2.0))
    assert two.zero_sigma == pytest.approx(2 * one.zero_sigma)
    assert two.floor_tilt == pytest.approx(tuple(2 * tilt for tilt in one.floor_tilt))
    assert max(map(abs, one.floor_tilt)) <= math.radians(0.7)
    assert perturbation(1.0, 3, 18, "biped").floor_tilt == one.floor_tilt
    assert perturbation(1.0, 4, 18, "biped").floor_tilt != one.floor_tilt
    hexapod = perturbation(1.0, 3, 18)
    assert (hexapod.zero_sigma, hexapod.floor_tilt) == (0.0, (0.0, 0.0))
    assert np.array_equal(hexapod.kp_scale, one.kp_scale)


def test_a_tilted_floor_is_what_the_accelerometer_feels():
    differs = dataclasses.replace(perturbation(0.0, 0, 18), floor_tilt=(0.05, -0.03))
    config = WorldConfig(perturbation=differs, imu_profile="ideal", physics=Physics(friction=2.0))
    world = PhysicsWorld(NAO, make_terrain("flat"), 0, config)
    world.step_tick()
    acc = world.samples.imu.acc
    up = acc / np.linalg.norm(acc)
    assert math.atan2(up[1], up[2]) == pytest.approx(0.05, abs=0.01)  # roll of the floor
    assert math.asin(-up[0]) == pytest.approx(-0.03, abs=0.015)


def test_twist_is_on_the_wire_for_soles_only():
    biped = PhysicsWorld(BIOLOID, make_terrain("flat")).truth()
    assert biped.foot_twist.shape == biped.stance_twist.shape == (2,)
    assert b"foot_twist" in encode(truth_message(biped))[0]
    hexapod = PhysicsWorld(RAGNO, make_terrain("flat")).truth()
    assert hexapod.foot_twist.shape == (0,)
    assert b"twist" not in encode(truth_message(hexapod))[0]


def test_a_turning_robot_twists_its_standing_soles():
    world = PhysicsWorld(BIOLOID, make_terrain("flat"), config=WorldConfig(physics=Physics(friction=0.02)))
    q = BIOLOID.neutral.copy()
    for leg, sign in zip(BIOLOID.legs, (1.0, -1.0), strict=True):
        q[leg.joints[0]] = 0.3 * sign
    steps(world, 60, q)
    assert np.all(np.abs(world.truth().foot_twist) > 0.03)
    assert world.truth().foot_twist[0] * world.truth().foot_twist[1] < 0.0
