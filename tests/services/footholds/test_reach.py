"""The workspace of a leg against the closed-form inverse kinematics."""

import numpy as np
import pytest

from surefoot.robot.kinematics import foot_positions, forward, leg_ik
from surefoot.robot.reader import load_robot
from surefoot.services.footholds import reach
from surefoot.services.footholds.reach import leg_table, solve
from tests.surefoot.robot.test_legs import crooked

CROOKED = {f"crooked-{i}": crooked(np.random.default_rng(i), 150.0) for i in range(3)}


@pytest.mark.parametrize("name", ["ragno", "messor", "lupo", *CROOKED])
def test_same_workspace_as_inverse_kinematics(name: str) -> None:
    robot = CROOKED[name] if name in CROOKED else load_robot(name)
    model, rng, legs = robot.model, np.random.default_rng(4), robot.nlegs
    tables = [leg_table(model, leg) for leg in range(legs)]
    feet = foot_positions(model, robot.neutral)
    size = (2.0 if legs == 6 else 1.2) * float(np.linalg.norm(feet[0] - model.hip[0, :3]))
    inside = 0
    for _ in range(6000):
        leg = int(rng.integers(legs))
        point = model.hip[leg, :3] + rng.uniform(-size, size, 3)
        margin = solve(tables[leg], *point)[0]
        assert leg_ik(model, leg, point)[1] == (margin >= 0.0), (leg, point)
        if margin < 0.0:
            continue
        inside += 1
        aside = rng.normal(size=3)
        aside *= 0.999 * margin / np.linalg.norm(aside)
        assert leg_ik(model, leg, point + aside)[1], (leg, point, margin)
    assert inside > 300


@pytest.mark.parametrize("name", ["ragno", "lupo"])
def test_inner_joints(name: str) -> None:
    robot = load_robot(name)
    model, rng = robot.model, np.random.default_rng(7)
    for _ in range(10):
        q = robot.neutral + rng.uniform(-0.3, 0.3, robot.neutral.size)
        _, pos = forward(model, q)
        feet = foot_positions(model, q)
        for leg in range(robot.nlegs):
            margin, *joints = solve(leg_table(model, leg), *feet[leg])
            assert margin > 0.0
            femur, tibia = robot.legs[leg].links[1:3]
            np.testing.assert_allclose(joints[:3], pos[femur], atol=1e-9)
            np.testing.assert_allclose(joints[3:], pos[tibia], atol=1e-9)


def test_far_points_and_nan_are_outside() -> None:
    table = leg_table(load_robot("ragno").model, 0)
    assert solve(table, 5.0, 0.0, 0.0)[0] == reach.OUTSIDE
    assert solve(table, float("nan"), 0.0, 0.0)[0] == reach.OUTSIDE


def test_leg_without_closed_form_reaches_nothing() -> None:
    model = load_robot("ragno").model
    unknown = model._replace(segment=np.full_like(model.segment, np.nan))  # nor is it a roll-pitch-pitch leg
    assert solve(leg_table(unknown, 0), 0.18, 0.12, -0.07)[0] == reach.OUTSIDE
