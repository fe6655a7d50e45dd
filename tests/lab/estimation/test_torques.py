"""Ground forces by joint torques, and what a log with torques becomes."""

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.lab.estimation.files import log_of_table
from surefoot.lab.estimation.torques import forces_by_torques
from surefoot.robot.kinematics import com_jacobian_of, foot_positions, forward, total_mass
from surefoot.robot.reader import load_robot
from tests.lab.estimation.test_files import standing
from tests.surefoot.expect import expect_error

RNG = np.random.default_rng(5)
STEP = 1e-6


def torques_of(robot, q, force, up):
    """Torques (nj,) by virtual work: forces (F, 3) N at the feet, and the weight of the links."""
    out, jacobian = np.zeros(robot.nj), com_jacobian_of(robot.model, *forward(robot.model, q))
    for j in range(robot.nj):
        step = STEP * np.eye(robot.nj)[j]
        moved = (foot_positions(robot.model, q + step) - foot_positions(robot.model, q - step)) / (2.0 * STEP)
        weight = total_mass(robot.model) * 9.81 * (jacobian[:, j] @ up)
        out[j] = weight - np.sum(moved * force)
    return out


def walking(robot, samples=40):
    """Angles, torques, vertical forces and up of a robot on half of its feet in turn."""
    joints = robot.neutral + RNG.normal(size=(samples, robot.nj)) * 0.05
    feet, weight = len(robot.legs), 9.81 * robot.mass
    up = np.tile([0.03, -0.02, 1.0], (samples, 1))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    stands = (np.arange(feet)[None] + np.arange(samples)[:, None] // 10) % 2 == 0
    load = stands * weight / stands.sum(axis=1, keepdims=True)
    force = (
        load[..., None] * up[:, None] + np.cross(up[:, None], RNG.normal(size=(samples, feet, 3))) * stands[..., None]
    )
    torques = np.array([torques_of(robot, *row) for row in zip(joints, force, up, strict=True)])
    return joints, torques, load, up, stands


@pytest.mark.parametrize("name", ["ragno", "messor"])
def test_forces_by_virtual_work(name):
    robot = load_robot(name)
    joints, torques, load, up, _ = walking(robot)
    found = forces_by_torques(robot, joints, torques, up)
    assert found.note == ""
    np.testing.assert_allclose(found.force, load, atol=1e-4 * 9.81 * robot.mass)


def test_legs_of_six_joints_show_the_load():
    robot = load_robot("nao")
    joints, torques, load, up, _ = walking(robot)
    found = forces_by_torques(robot, joints, torques, up)
    np.testing.assert_allclose(found.force, load, atol=0.2 * 9.81 * robot.mass)


def test_the_other_sign_is_refused_and_another_scale_reported():
    robot = load_robot("ragno")
    joints, torques, _, up, _ = walking(robot)
    weight = np.array([torques_of(robot, q, np.zeros((6, 3)), u) for q, u in zip(joints, up, strict=True)])
    with expect_error(SurefootError, "invalid", "torque", text="multiply the torques by -1"):
        forces_by_torques(robot, joints, 2.0 * weight - torques, up)
    assert "another scale" in forces_by_torques(robot, joints, 30.0 * torques, up).note


def columns_of(robot, order=None):
    joints, torques, _, _, stands = walking(robot, 60)
    order = np.arange(robot.nj) if order is None else order
    names = np.array(robot.joint_names)[order]
    more = {"joints": joints[:, order], "torque": torques[:, order], "joint_names": names}
    own = {key: value for key, value in standing(robot).items() if key not in ("contact", "touch", "force")}
    return own | more, stands


@pytest.mark.parametrize("shuffled", [False, True])
def test_contacts_of_a_log_by_its_torques(shuffled):
    robot = load_robot("ragno")
    columns, stands = columns_of(robot, RNG.permutation(robot.nj) if shuffled else None)
    log, notes = log_of_table("log", columns, robot)
    assert "ground forces by the joint torques" in notes
    assert (log.contact == stands).mean() > 0.97


def test_contact_flags_count_more_than_torques():
    robot = load_robot("ragno")
    columns, _ = columns_of(robot)
    log, _ = log_of_table("log", columns | {"contact": np.ones((60, 6))}, robot)
    assert log.contact.all()
    assert log.force is not None
