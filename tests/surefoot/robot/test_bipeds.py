"""The descriptions of the two-legged robots: published numbers, the shared motor, the D-H table, bad files."""

import mujoco
import numpy as np
import pytest

from surefoot.robot import kinematics as kin
from surefoot.robot.description import RobotError
from surefoot.robot.reader import ROBOTS, load_robot
from surefoot.services.simulator.physics.joints import place_joints, read_joints
from surefoot.services.simulator.physics.model import build_model
from tests.surefoot.expect import expect_error
from tests.surefoot.robot.dh import dh_transform

BIOLOID, NAO = load_robot("bioloid"), load_robot("nao")
EXACT = 1e-9
FOOT_AXES = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])  # D-H frame 0 in the foot: x up, z forward


@pytest.fixture
def rng():
    return np.random.default_rng(4)


def test_published_sizes():
    assert (BIOLOID.nj, NAO.nj) == (18, 25)
    assert BIOLOID.mass == pytest.approx(2.041, abs=0.002)
    assert NAO.mass == pytest.approx(5.195350051, abs=1e-4)  # the maker's total of all solids
    for robot in (BIOLOID, NAO):
        assert robot.leg_names == ("left_leg", "right_leg")
        assert all(len(leg.joints) == 6 and len(leg.foot.points) == 4 for leg in robot.legs)
        assert robot.contacts.switches == 4


def test_both_sides_are_mirror_images():
    for robot in (BIOLOID, NAO):
        q = robot.neutral
        feet = kin.foot_positions(robot.model, q)
        assert feet[0] * [1, -1, 1] == pytest.approx(feet[1], abs=1e-15)
        assert abs(kin.com(robot.model, q)[1]) < 1e-15


def test_one_motor_turns_both_hips_of_nao():
    left, right = NAO.legs
    assert left.joints[0] == right.joints[0] == NAO.joint_names.index("left_leg_hip_yaw_pitch")
    q = np.zeros(NAO.nj)
    q[left.joints[0]] = 0.3
    feet = kin.foot_positions(NAO.model, q)
    assert feet[0] * [1, -1, 1] == pytest.approx(feet[1], abs=1e-15)  # the two legs move as mirror images
    assert feet[0, 0] < -0.02  # a positive angle swings the legs back


@pytest.mark.parametrize("robot", [BIOLOID, NAO], ids=lambda robot: robot.name)
def test_the_shared_motor_and_the_play_of_the_model(robot, rng):
    model, at = build_model(robot)
    data = mujoco.MjData(model)
    q = rng.uniform(robot.joint_lower, robot.joint_upper)
    place_joints(data.qpos, at, q)
    assert np.array_equal(read_joints(data.qpos, at), q)
    play = {joint.name: joint.servo.backlash for joint in robot.joints if joint.servo.backlash}
    assert len(play) == sum(len(leg.joints) for leg in robot.legs) - len(at.coupled)
    for name, size in play.items():
        assert np.ptp(model.jnt_range[model.joint(f"{name}_backlash").id]) == pytest.approx(size)
    assert model.neq == len(at.coupled) == (1 if robot is NAO else 0)
    assert model.nu == robot.nj


def test_dh_table_gives_the_foot_of_the_model(rng):
    assert "reconstruct" in (ROBOTS / "bioloid" / "dh_right_leg.toml").read_text().lower()
    model, at = build_model(BIOLOID)
    data = mujoco.MjData(model)
    names = [link.name for link in BIOLOID.links]
    ankle, hip = (at.bodies[names.index(f"right_leg_{name}")] for name in ("ankle_roll", "hip_yaw"))
    for _ in range(200):
        q = rng.uniform(BIOLOID.joint_lower, BIOLOID.joint_upper)
        data.qpos[3] = 1.0
        place_joints(data.qpos, at, q)
        mujoco.mj_kinematics(model, data)
        rot = data.xmat[ankle].reshape(3, 3)
        theirs = rot.T @ (data.xpos[hip] - data.xpos[ankle])  # hip yaw axis seen from the ankle
        assert np.abs(FOOT_AXES @ dh_transform(BIOLOID, "right_leg", q)[:3, 3] - theirs).max() < EXACT


SHARED = '{ hip_yaw_pitch = "left_leg_hip_yaw_pitch" }'
FREE_KNEE = """axis = [0.0, 1.0, 0.0]
lower_deg = 0.0
upper_deg = 130.0
neutral_deg = 43.14
servo = "ax12"
"""


@pytest.mark.parametrize(
    ("robot", "old", "new", "code", "field"),
    [
        (BIOLOID, "mass = 0.13\n", "mass = -0.13\n", "value", "chains.leg.links[1].mass"),
        (BIOLOID, "mass = 0.13\n", "mass = 0.0\n", "value", "chains.leg.links[1].mass"),
        (BIOLOID, "mass = 0.13\n", "mass = nan\n", "value", "chains.leg.links[1].mass"),
        (BIOLOID, FREE_KNEE, "", "missing", "chains.leg.links"),
        (BIOLOID, "backlash_deg = 0.5", "backlash_deg = -0.5", "value", "servos.ax12.backlash_deg"),
        (BIOLOID, "mirrored = \"limits\"\n", "mirrored = \"mass\"\n", "value", "chains.leg.links[0].mirrored"),
        (NAO, SHARED, '{ hip_yaw_pitch = "hip" }', "unknown_name", "limbs[1].shared.hip_yaw_pitch"),
        (NAO, SHARED, '{ hip_roll = "left_leg_hip_roll" }', "value", "limbs[1].shared.hip_roll"),
        (NAO, SHARED, '{ knee = "left_leg_hip_roll" }', "unknown_key", "limbs[1].shared.knee"),
    ],
)  # fmt: skip
def test_bad_descriptions_name_the_field(tmp_path, robot, old, new, code, field):
    text = (ROBOTS / robot.name / "robot.toml").read_text()
    assert old in text
    path = tmp_path / "robot.toml"
    path.write_text(text.replace(old, new, 1))
    with expect_error(RobotError, code, field=field):
        load_robot(path)
