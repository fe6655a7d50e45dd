"""Unequal legs: a straight walk becomes an arc of the curvature that was set, seen from each foot, and nothing else."""

import math
from functools import cache

import numpy as np
import pytest

from surefoot.robot import kinematics
from surefoot.robot.reader import load_robot
from surefoot.services.simulator.ground.terrain import make_terrain
from surefoot.services.simulator.physics.disturb import WorldError
from surefoot.services.simulator.physics.unequal import UnequalLegs
from surefoot.services.simulator.world import PhysicsWorld, WorldConfig
from surefoot.services.walker.biped import plan, posture
from surefoot.services.walker.biped.ik import leg_geometry
from surefoot.services.walker.interface import MotionCommand
from tests.services.refusals import refused
from tests.services.walker.biped.biped_plant import Plant

BOTH = ("nao", "bioloid")
HALF_STEP = 0.025  # m


def posed(robot, dx):
    """Joint angles with the left foot dx ahead of its neutral place and the right one as far behind, soles level."""
    feet = kinematics.foot_positions(robot.model, robot.neutral)
    soles = np.column_stack((feet[:, 0] + (dx, -dx), feet[:, 1], np.zeros(2), np.zeros(2)))
    q = robot.neutral.copy()
    missed, reached, _ = posture.pose_legs(
        leg_geometry(robot), q, soles, np.array([0.0, 0.0, 0.0, -feet[0, 2]]), np.zeros(2)
    )
    assert reached
    assert abs(missed) < 1e-6
    return q


def trunk_from(robot, q, foot):
    """Pose (x, y, yaw) of the trunk as seen from a foot, m and rad."""
    rot, _ = kinematics.forward(robot.model, q)
    place = kinematics.foot_positions(robot.model, q)[foot]
    sole = rot[robot.model.foot_link[foot]]
    yaw = -math.atan2(sole[1, 0], sole[0, 0])
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([-(c * place[0] - s * place[1]), -(s * place[0] + c * place[1]), yaw])


@pytest.mark.parametrize("name", BOTH)
@pytest.mark.parametrize("drift", [-0.7, 0.35, 0.7])
@pytest.mark.parametrize("foot", [0, 1])
def test_seen_from_a_standing_foot_the_trunk_goes_along_an_arc(name, drift, foot):
    robot = load_robot(name)
    legs, sign = UnequalLegs(robot, drift), 1.0 if foot == 0 else -1.0
    begin = trunk_from(robot, legs(posed(robot, sign * HALF_STEP)), foot)
    for way in (0.01, 0.03, 2.0 * HALF_STEP):
        now = trunk_from(robot, legs(posed(robot, sign * (HALF_STEP - way))), foot)
        turn = drift * way
        c, s = math.cos(begin[2]), math.sin(begin[2])
        forward, left = math.sin(turn) / drift, (1.0 - math.cos(turn)) / drift
        expected = begin + np.array([c * forward - s * left, s * forward + c * left, turn])
        assert now == pytest.approx(expected, abs=2e-4)


@pytest.mark.parametrize("drift", [-0.7, 0.35])
@pytest.mark.parametrize("curvature", [-4.0, 2.0])
def test_on_arcs_the_drift_comes_on_top(curvature, drift):
    """Two steps of 5 cm of an arc, one on each foot: the turn is the arc's and the drift's."""
    robot = load_robot("nao")
    legs, geometry = UnequalLegs(robot, drift), leg_geometry(robot)
    neutral = kinematics.foot_positions(robot.model, robot.neutral)
    width, step, turned = float(abs(geometry.hip[0, 1])), 2.0 * HALF_STEP, 0.0
    before, now = np.zeros(3), plan.advanced(np.zeros(3), step, 0.0, curvature * step)
    after = plan.advanced(now, step, 0.0, curvature * step)
    for stance in (plan.LEFT, plan.RIGHT):
        yaws = []
        for swing in (plan.placed(before, 1 - stance, width), plan.placed(after, 1 - stance, width)):
            feet = np.zeros((2, 4))
            feet[stance, :3], feet[1 - stance, :3] = plan.placed(now, stance, width), swing
            middle, q = plan.between(feet), robot.neutral.copy()
            back = neutral[0, 0] * np.array([math.cos(middle[2]), math.sin(middle[2])])
            trunk = np.array([*(middle[:2] - back), middle[2], -neutral[0, 2]])
            posture.pose_legs(geometry, q, feet, trunk, np.zeros(2))
            yaws.append(trunk_from(robot, legs(q), stance)[2])
        turned += yaws[1] - yaws[0]
    assert turned == pytest.approx(2.0 * step * (curvature + drift), abs=0.01 * 2.0 * step * abs(drift))


@pytest.mark.parametrize("name", BOTH)
def test_soles_stay_level_and_at_their_height(name):
    robot = load_robot(name)
    for dx in (-0.05, 0.02, 0.05):
        q = posed(robot, dx)
        crooked = UnequalLegs(robot, 0.7)(q)
        rot, _ = kinematics.forward(robot.model, crooked)
        for link in robot.model.foot_link:
            assert rot[link][2, 2] == pytest.approx(1.0, abs=1e-5)
        before, after = (kinematics.foot_positions(robot.model, angles)[:, 2] for angles in (q, crooked))
        assert after == pytest.approx(before, abs=1e-4)


def test_straight_legs_pay_nothing_and_a_neutral_stance_is_no_other():
    robot = load_robot("nao")
    q = posed(robot, 0.03)
    assert UnequalLegs(robot, 0.0)(q) is q
    assert UnequalLegs(robot, 0.5)(robot.neutral) == pytest.approx(robot.neutral, abs=1e-12)
    assert UnequalLegs(robot, 0.5)(q) == pytest.approx(2 * q - UnequalLegs(robot, -0.5)(q), abs=1e-9)  # odd in drift


def test_joints_stay_within_their_limits():
    robot = load_robot("nao")
    for q in (robot.joint_lower, robot.joint_upper):
        found = UnequalLegs(robot, 0.8)(q)
        assert np.all(found >= robot.joint_lower)
        assert np.all(found <= robot.joint_upper)


def test_robots_without_soles_have_no_drift_to_set():
    with refused(WorldError, field="drift"):
        PhysicsWorld(load_robot("ragno"), make_terrain("flat"), config=WorldConfig(drift=0.1))


def yaw_of(plant):
    w, x, y, z = plant.world.truth().quat_wxyz
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


@cache
def turned_by(drift):
    """Turn of a walk of six steps, rad/m; the estimate knows of it."""
    plant = Plant("nao", drift=drift).stand()
    plant.walker.command(MotionCommand("walk", distance=0.5))
    plant.until(lambda out: out.steps == 2)
    yaw, place = yaw_of(plant), plant.world.truth().position[:2]
    plant.until(lambda out: out.steps == 8)
    way = float(np.hypot(*(plant.world.truth().position[:2] - place)))
    assert plant.estimator.pose().yaw == pytest.approx(yaw_of(plant), abs=math.radians(3.0))
    assert not plant.fallen
    return (yaw_of(plant) - yaw) / way


@pytest.mark.parametrize("drift_deg", [2.0, 4.0])
def test_a_straight_walk_turns_as_much_as_was_set_and_the_gyro_feels_it(drift_deg):
    """Half of the difference of a left and a right turn: what the walk itself turns by is in neither."""
    drift = math.radians(drift_deg) / 0.1
    assert math.degrees(turned_by(drift) - turned_by(-drift)) * 0.05 == pytest.approx(drift_deg, rel=0.15)
