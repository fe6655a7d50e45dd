"""Closed-form legs: forward kinematics is the oracle."""

import math

import numpy as np
import pytest

from surefoot.geometry.rotations import matrix_from_rpy
from surefoot.robot import kinematics as kin
from surefoot.robot.description import RobotError
from surefoot.robot.reader import load_robot
from surefoot.services.walker.biped import ik
from tests.services.refusals import refused

ROBOTS = {name: load_robot(name) for name in ("bioloid", "nao")}


@pytest.fixture(params=sorted(ROBOTS))
def robot(request):
    return ROBOTS[request.param]


def soles(robot, q):
    """Ankle points and rot_base_from_foot by forward kinematics."""
    rot, pos = kin.forward(robot.model, q)
    links = robot.model.foot_link
    return np.ascontiguousarray(pos[links]), np.ascontiguousarray(rot[links])


def random_stance(robot, rng):
    """Joint angles with bent knees; left and right hip yaw equal where they must be."""
    q, g = robot.neutral.copy(), ik.leg_geometry(robot)
    low, high = np.maximum(robot.joint_lower, -0.6), np.minimum(robot.joint_upper, 0.6)
    for leg in range(2):
        q[g.joints[leg]] = rng.uniform(low, high)[g.joints[leg]]
        q[g.joints[leg, 3]] = rng.uniform(0.2, 1.6)
    return q


def test_legs_come_back_to_the_same_angles(robot):
    g, rng = ik.leg_geometry(robot), np.random.default_rng(2)
    for _ in range(300):
        q = random_stance(robot, rng)
        ankles, rots = soles(robot, q)
        found = robot.neutral.copy()
        found[g.joints[:, 0]] = q[g.joints[:, 0]] + rng.uniform(-0.15, 0.15)
        missed, reachable = ik.legs_ik(g, found, ankles, rots)
        assert reachable
        assert missed < 1e-9
        assert np.abs(found - q)[g.joints].max() < 1e-7


def test_ankle_and_sole_normal_are_exact_whatever_the_hip_yaw(robot):
    g, rng = ik.leg_geometry(robot), np.random.default_rng(3)
    for _ in range(100):
        ankles, rots = soles(robot, random_stance(robot, rng))
        for leg in range(2):
            angles, rest, reached = ik.leg_angles(g, leg, float(rng.uniform(-0.5, 0.5)), ankles[leg], rots[leg])
            if not reached:
                continue
            q = robot.neutral.copy()
            q[g.joints[leg]] = angles
            got_ankle, got_rot = soles(robot, q)
            assert np.abs(got_ankle[leg] - ankles[leg]).max() < 1e-9
            assert np.abs(got_rot[leg, :, 2] - rots[leg, :, 2]).max() < 1e-9
            turn = got_rot[leg].T @ rots[leg]  # a rotation about the sole's normal by the yaw that is left over
            assert math.atan2(turn[1, 0], turn[0, 0]) == pytest.approx(rest, abs=1e-9)


def test_a_shared_motor_keeps_the_relative_yaw_of_the_feet():
    robot = ROBOTS["nao"]
    g = ik.leg_geometry(robot)
    assert g.coupled
    q = robot.neutral.copy()
    height = 0.9 * (g.thigh + g.shin)
    ankles = g.hip - np.array([[0.0, 0.0, height], [0.02, 0.0, height]])
    rots = np.stack([matrix_from_rpy(0.0, 0.0, 0.25), matrix_from_rpy(0.0, 0.0, 0.05)])
    ik.legs_ik(g, q, ankles, rots)
    got = soles(robot, q)[1]
    relative = got[1].T @ got[0]
    assert math.atan2(relative[1, 0], relative[0, 0]) == pytest.approx(0.20, abs=1e-8)


def test_out_of_reach_is_reported_and_stays_within_the_limits(robot):
    g = ik.leg_geometry(robot)
    q = robot.neutral.copy()
    far = g.hip - np.array([0.0, 0.0, 1.2 * (g.thigh + g.shin)])
    _, reachable = ik.legs_ik(g, q, far, np.stack([np.eye(3)] * 2))
    assert not reachable
    assert np.all(q >= robot.joint_lower)
    assert np.all(q <= robot.joint_upper)


def test_other_robots_are_refused():
    with refused(RobotError, field="limbs"):
        ik.leg_geometry(load_robot("ragno"))
