"""Set-points: inverse kinematics, load shares, sag."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surefoot.geometry import rotations
from surefoot.robot import kinematics
from surefoot.robot.reader import load_robot
from surefoot.services.walker.legged import posture

ROBOT = load_robot("ragno")
FEET = kinematics.foot_positions(ROBOT.model, ROBOT.neutral)
ALL = np.ones(6)


@given(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-3, 3), st.floats(-1, 1), st.floats(-1, 1))
def test_frames_are_inverse_to_each_other(roll, pitch, yaw, x, y):
    rot, body = rotations.matrix_from_rpy(roll, pitch, yaw), np.array([x, y, 0.08])
    assert posture.into_base(posture.into_map(FEET, body, rot), body, rot) == pytest.approx(FEET, abs=1e-12)


@given(st.lists(st.floats(0.05, 1.0), min_size=6, max_size=6), st.floats(-0.05, 0.05), st.floats(-0.05, 0.05))
def test_load_balances_the_weight_about_the_centre_of_mass(support, x, y):
    support, com = np.array(support), np.array([x, y])
    force = posture.share_load(FEET, com, support, 21.0)
    assert (force >= 0.0).all()
    if (force > 0.0).all():
        assert force.sum() == pytest.approx(21.0)
        assert force @ (FEET[:, :2] - com) == pytest.approx(np.zeros(2), abs=1e-9)


def test_feet_without_support_carry_nothing_and_too_few_feet_share_evenly():
    tripod = np.array([1.0, 0.0, 1.0, 0.0, 1.0, 0.0])
    force = posture.share_load(FEET, np.zeros(2), tripod, 21.0)
    assert force[tripod == 0.0] == pytest.approx(np.zeros(3))
    assert force.sum() == pytest.approx(21.0)
    pair = np.array([1.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    assert posture.share_load(FEET, np.zeros(2), pair, 21.0) == pytest.approx(10.5 * pair)
    assert posture.share_load(FEET, np.zeros(2), np.zeros(6), 21.0) == pytest.approx(np.zeros(6))


def test_without_compensation_the_set_points_are_the_joint_angles():
    body = np.array([0.0, 0.0, 0.07])
    command, q, reachable = posture.set_points(ROBOT.model, FEET + body, body, np.eye(3), ALL, np.zeros(ROBOT.nj))
    assert reachable.all()
    assert q == pytest.approx(ROBOT.neutral, abs=1e-9)
    assert command == pytest.approx(q)


def test_compensation_pushes_the_feet_down_and_out_of_the_body():
    body = np.array([0.0, 0.0, 0.07])
    compliance = np.full(ROBOT.nj, 1.0 / 12.0)
    command, q, _ = posture.set_points(ROBOT.model, FEET + body, body, np.eye(3), ALL, compliance)
    moved = kinematics.foot_positions(ROBOT.model, command) - kinematics.foot_positions(ROBOT.model, q)
    assert (moved[:, 2] < -1e-3).all()  # the servos give way by about 2 mm under 3.5 N a foot
    assert (moved[:, 2] > -6e-3).all()


def test_set_points_stay_within_the_joint_limits():
    body = np.array([0.0, 0.0, 0.25])
    command, _, reachable = posture.set_points(ROBOT.model, FEET, body, np.eye(3), ALL, np.full(ROBOT.nj, 1.0))
    assert not reachable.any()
    assert (command >= ROBOT.joint_lower).all()
    assert (command <= ROBOT.joint_upper).all()
