"""Set-points: inverse kinematics, load shares, sag."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import optimize

from surefoot.geometry import rotations
from surefoot.geometry.constants import GRAVITY
from surefoot.robot import kinematics
from surefoot.robot.reader import load_robot
from surefoot.services.walker.legged import posture

ROBOT = load_robot("ragno")
FEET = kinematics.foot_positions(ROBOT.model, ROBOT.neutral)
ALL = np.ones(6)
SOFT = 80.0  # Nm/rad; with 50 three legs of Lupo only just hold its trunk
PLANNED = (np.zeros(0), np.eye(3))  # torques of the planned posture


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
    command, q, reachable = posture.set_points(
        ROBOT.model, FEET + body, body, np.eye(3), ALL, np.zeros(ROBOT.nj), *PLANNED
    )
    assert reachable.all()
    assert q == pytest.approx(ROBOT.neutral, abs=1e-9)
    assert command == pytest.approx(q)


def test_compensation_pushes_the_feet_down_and_out_of_the_body():
    body = np.array([0.0, 0.0, 0.07])
    compliance = np.full(ROBOT.nj, 1.0 / 12.0)
    command, q, _ = posture.set_points(ROBOT.model, FEET + body, body, np.eye(3), ALL, compliance, *PLANNED)
    moved = kinematics.foot_positions(ROBOT.model, command) - kinematics.foot_positions(ROBOT.model, q)
    assert (moved[:, 2] < -1e-3).all()  # the servos give way by about 2 mm under 3.5 N a foot
    assert (moved[:, 2] > -6e-3).all()


def angles(robot, feet, standing, command, pose):
    """Return the joint angles (nj,) of a trunk at a pose over its standing feet, rad, and the trunk's rotation."""
    rot = rotations.matrix_from_rpy(*pose[3:])
    q = kinematics.legs_ik(robot.model, posture.into_base(feet, pose[:3], rot))[0]
    return np.where(np.repeat(standing, 3), q, command), rot


def rest(robot, feet, standing, command, stiffness, begin):
    """Return position and roll, pitch, yaw of a trunk at rest on feet that cannot slide, (6,): the least energy.

    An oracle without Jacobians or load shares: springs between set-points and joints, and the height of the centre of
    mass.
    """

    def energy(pose):
        q, rot = angles(robot, feet, standing, command, pose)
        weight = GRAVITY * kinematics.total_mass(robot.model)
        return 0.5 * stiffness * np.sum((command - q) ** 2) + weight * (
            pose[2] + rot[2] @ kinematics.com(robot.model, q)
        )

    return optimize.minimize(energy, begin, method="BFGS", options={"gtol": 1e-6}).x


@pytest.mark.parametrize("real", [0.8, 1.25])
def test_a_trunk_on_soft_legs_returns_to_its_plan_by_the_measured_posture(real):
    """Three legs whose servos have `real` of the described stiffness, not far from what holds the weight at all."""
    lupo = load_robot("lupo")
    neutral, support = kinematics.foot_positions(lupo.model, lupo.neutral), np.array([1.0, 0.0, 1.0, 1.0])
    body = np.array([-0.2 * neutral[1, 0], -0.2 * neutral[1, 1], -neutral[0, 2]])  # away from the swinging foot
    feet = neutral + np.array([0.0, 0.0, body[2]])
    drifts, compliance = [], np.full(lupo.nj, 1.0 / SOFT)
    for by_measured in (False, True):
        seen, pose = PLANNED, np.append(body, np.zeros(3))
        for _ in range(16 if by_measured else 1):
            command = posture.set_points(lupo.model, feet, body, np.eye(3), support, compliance, *seen)[0]
            end = rest(lupo, feet, support > 0.0, command, real * SOFT, pose)
            pose = pose + (0.2 * (end - pose) if by_measured else end - pose)
            seen = angles(lupo, feet, support > 0.0, command, pose)
        drifts.append(np.hypot(*(pose[:2] - body[:2])))
    assert drifts[1] < 0.7 * drifts[0]
    assert drifts[0] > 0.004


def test_set_points_stay_within_the_joint_limits():
    body = np.array([0.0, 0.0, 0.25])
    command, _, reachable = posture.set_points(
        ROBOT.model, FEET, body, np.eye(3), ALL, np.full(ROBOT.nj, 1.0), *PLANNED
    )
    assert not reachable.any()
    assert (command >= ROBOT.joint_lower).all()
    assert (command <= ROBOT.joint_upper).all()
