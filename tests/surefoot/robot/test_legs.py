"""Closed-form inverse kinematics of roll-pitch-pitch legs against the forward kinematics."""

import tomllib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surefoot.geometry import rotations
from surefoot.robot import kinematics as kin
from surefoot.robot.files import RobotFile
from surefoot.robot.profiles import ROBOTS
from surefoot.robot.reader import _robot, load_robot, robot_names
from tests.surefoot.robot.test_kinematics import random_points_are_reached_or_refused

LUPO = (ROBOTS / "lupo" / "robot.toml").read_text()


def changed(edit):
    """Return the quadruped with its description's tables changed by a function."""
    data = tomllib.loads(LUPO)
    edit(data)
    return _robot(RobotFile.model_validate(data), data)


def crooked(rng, limit_deg=170.0):
    """Return a quadruped whose legs have random offsets, mounts, axes' senses and neutral angles."""

    def edit(data):
        links = data["chains"]["leg"]["links"]
        for link in links:
            link["position"] = (np.array(link["position"]) + rng.uniform(-0.02, 0.02, 3)).tolist()
            link["axis"] = (rng.choice([-1.0, 1.0]) * np.array(link["axis"])).tolist()
            link["lower_deg"], link["upper_deg"] = -limit_deg, limit_deg
            link["neutral_deg"] = rng.uniform(-60.0, 60.0)
        links[0]["quat_wxyz"] = rotations.quat_from_rotvec(rng.uniform(-1.0, 1.0, 3)).tolist()
        foot = data["chains"]["leg"]["foot"]
        foot["position"] = (np.array(foot["position"]) + rng.uniform(-0.02, 0.02, 3)).tolist()
        for limb in data["limbs"]:
            limb["yaw_deg"] = rng.uniform(-180.0, 180.0)

    return changed(edit)


def on_its_side(robot, leg, q):
    """Return whether the foot lies on the neutral side of the first axis with the knee bent to the neutral side."""
    rolled, (_, femur, tibia) = robot.model.rolled, robot.legs[leg].joints
    f, t = rolled.segment[leg]
    along, bend, turn = rolled.side[leg]
    upper = rolled.rest[leg, 0] + q[femur]
    knee = rotations.wrap_angle(rolled.rest[leg, 1] + turn * q[tibia])
    w = rolled.offset[leg, 1] + f * np.cos(upper) + t * np.cos(upper + knee)
    return along * w > 1e-3 and bend * knee > 1e-3


QUADRUPEDS = {name: robot for name in robot_names() if (robot := load_robot(name)).kind == "quadruped"}
LEGGED = {**QUADRUPEDS, **{f"crooked-{i}": crooked(np.random.default_rng(i)) for i in range(6)}}


@pytest.mark.parametrize("name", LEGGED)
def test_random_postures_are_found_again(name):
    robot, rng, hits = LEGGED[name], np.random.default_rng(1), 0
    for _ in range(200):
        q = rng.uniform(robot.joint_lower, robot.joint_upper)
        feet = kin.foot_positions(robot.model, q)
        found, reachable = kin.legs_ik(robot.model, feet)
        for i, leg in enumerate(robot.legs):
            if not on_its_side(robot, i, q):
                continue
            hits += 1
            assert reachable[i]
            assert np.abs(found[list(leg.joints)] - q[list(leg.joints)]).max() < 1e-6
    assert hits > 100


@pytest.mark.parametrize("name", LEGGED)
def test_random_points_are_reached_or_refused(name):
    robot = LEGGED[name]
    rolled, rng = robot.model.rolled, np.random.default_rng(2)
    random_points_are_reached_or_refused(robot, rolled.hip, 1.2 * float(rolled.segment[0].sum()), rng, 1000)


@given(st.lists(st.floats(0.0, 1.0), min_size=12, max_size=12))
def test_the_shipped_quadruped_is_found_again_within_its_limits(shares):
    robot = QUADRUPEDS["lupo"]
    q = robot.joint_lower + np.array(shares) * (robot.joint_upper - robot.joint_lower)
    feet = kin.foot_positions(robot.model, q)
    found, reachable = kin.legs_ik(robot.model, feet)
    for i in range(robot.nlegs):
        if on_its_side(robot, i, q):
            assert reachable[i]
            assert np.abs(kin.foot_positions(robot.model, found)[i] - feet[i]).max() < 1e-9


def test_a_leg_too_short_for_its_target_is_stretched_towards_it():
    robot = QUADRUPEDS["lupo"]
    down = robot.model.rolled.hip[0] + [0.0, 0.08, -0.5]
    angles, reachable = kin.leg_ik(robot.model, 0, down)
    assert not reachable
    assert angles[2] == pytest.approx(robot.joint_upper[2])
    assert not kin.leg_ik(robot.model, 0, np.array([np.nan, 0.0, 0.0]))[1]


def skewed(data):
    data["chains"]["leg"]["links"][2]["quat_wxyz"] = [0.8, 0.6, 0.0, 0.0]


def doubled(data):
    data["chains"]["leg"]["links"][2]["position"] = [0.0, 0.0, 0.0]


def four(data):
    links = data["chains"]["leg"]["links"]
    links.append(links[-1] | {"name": "toe", "lower_deg": -60.0, "upper_deg": 60.0, "neutral_deg": 0.0})
    data["chains"]["leg"]["foot"]["link"] = "toe"


@pytest.mark.parametrize("edit", [skewed, four])
def test_other_legs_are_solved_numerically_within_their_limits(edit):
    robot, rng = changed(edit), np.random.default_rng(3)
    assert np.isnan(robot.model.rolled.segment).all()
    for _ in range(50):
        q = robot.neutral + rng.uniform(-0.3, 0.3, robot.nj)
        feet = kin.foot_positions(robot.model, q)
        found, reachable = kin.legs_ik(robot.model, feet)
        assert reachable.all()
        assert np.abs(kin.foot_positions(robot.model, found) - feet).max() < 1e-9
        assert np.all((found >= robot.joint_lower) & (found <= robot.joint_upper))


@pytest.mark.parametrize("edit", [skewed, four, doubled])
def test_a_numeric_solution_reaches_no_point_beyond_the_leg(edit):
    robot = changed(edit)
    for far in (np.array([0.0, 0.0, -2.0]), np.array([np.nan, 0.0, 0.0])):
        angles, reachable = kin.leg_ik(robot.model, 1, far)
        assert not reachable
        assert np.isfinite(angles).all()


def test_a_straight_neutral_knee_bends_into_its_range():
    def straight(data):
        data["chains"]["leg"]["links"][2] |= {"neutral_deg": 0.0, "upper_deg": 0.0}

    assert np.all(changed(straight).model.rolled.side[:, 1] == -1.0)
