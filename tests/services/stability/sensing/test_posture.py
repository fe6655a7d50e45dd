"""CoM shift while the feet stay."""

import numpy as np
import pytest

from surefoot.geometry.rotations import matrix_from_rpy
from surefoot.robot.kinematics import com, foot_positions, legs_ik
from surefoot.robot.reader import load_robot
from surefoot.services.stability.programs.contacts import StabilityError, contact_set
from surefoot.services.stability.sensing.posture import PosedRobot
from tests.services.stability.sets import UP

RAGNO, MESSOR = load_robot("ragno"), load_robot("messor")
ALL = np.ones(6, dtype=bool)


@pytest.mark.parametrize("robot", [RAGNO, MESSOR], ids=["ragno", "messor"])
@pytest.mark.parametrize("movement", [(0.03, 0.0, 0.0), (-0.02, 0.015, 0.01)])
def test_feet_stay_and_the_closed_form_agrees(robot, movement) -> None:  # type: ignore[no-untyped-def]
    move = np.array(movement)
    found = PosedRobot(robot, robot.neutral, np.zeros(3), np.eye(3)).moved(move, ALL)
    feet = foot_positions(robot.model, robot.neutral)
    np.testing.assert_allclose(foot_positions(robot.model, found.after.joints) + move, feet, atol=1e-9)
    q, reachable = legs_ik(robot.model, feet - move)
    assert found.reachable == bool(reachable.all())
    np.testing.assert_allclose(found.after.joints, q, atol=1e-7)
    np.testing.assert_allclose(found.vector, com(robot.model, q) - com(robot.model, robot.neutral), atol=1e-9)


def test_the_shift_points_backward_and_turns_with_the_trunk() -> None:
    forward = np.array([0.03, 0.0, 0.0])
    level = PosedRobot(RAGNO, RAGNO.neutral, np.zeros(3), np.eye(3)).moved(forward, ALL).vector
    assert -0.01 < level[0] < -0.003
    rot = matrix_from_rpy(0.1, -0.2, 1.0)
    turned = PosedRobot(RAGNO, RAGNO.neutral, np.zeros(3), rot).moved(rot @ forward, ALL).vector
    np.testing.assert_allclose(turned, rot @ level, atol=1e-12)


def test_only_standing_legs_move() -> None:
    stance = np.array([True, False, True, False, True, False])
    found = PosedRobot(RAGNO, RAGNO.neutral, np.zeros(3), np.eye(3)).moved(np.array([0.02, 0.0, 0.0]), stance)
    for leg, stands in zip(RAGNO.legs, stance, strict=True):
        changed = np.any(found.after.joints[list(leg.joints)] != RAGNO.neutral[list(leg.joints)])
        assert changed == stands


def test_no_movement_is_no_shift_and_a_far_one_is_out_of_reach() -> None:
    still = PosedRobot(RAGNO, RAGNO.neutral, np.zeros(3), np.eye(3)).moved(np.zeros(3), ALL)
    np.testing.assert_allclose(still.vector, 0.0, atol=1e-12)
    assert still.reachable
    far = PosedRobot(RAGNO, RAGNO.neutral, np.zeros(3), np.eye(3)).moved(np.array([0.5, 0.0, 0.0]), ALL)
    assert not far.reachable
    assert np.all(np.isfinite(far.vector))


def test_stance_by_name_by_place_or_all() -> None:
    feet = foot_positions(RAGNO.model, RAGNO.neutral)
    names = [leg.name for leg in RAGNO.legs]
    eye, origin = np.eye(3), np.zeros(3)
    three = contact_set(feet[[0, 2, 4]], [UP] * 3, 0.5)
    near = PosedRobot(RAGNO, RAGNO.neutral, origin, eye).standing_legs(three, (None,) * 3)
    np.testing.assert_array_equal(near, [True, False, True, False, True, False])
    named = PosedRobot(RAGNO, RAGNO.neutral, origin, eye).standing_legs(three, (names[1], names[3], None))
    np.testing.assert_array_equal(named, [False, True, False, True, True, False])
    elsewhere = contact_set(feet[:3] + [5.0, 0.0, 0.0] * np.ones((3, 1)), [UP] * 3, 0.5)
    assert PosedRobot(RAGNO, RAGNO.neutral, origin, eye).standing_legs(elsewhere, (None,) * 3).all()
    for wrong, code in ((("x", None, None), "unknown_leg"), ((names[0], names[0], None), "duplicate_leg")):
        with pytest.raises(StabilityError) as refused:
            PosedRobot(RAGNO, RAGNO.neutral, origin, eye).standing_legs(three, wrong)
        assert refused.value.code == code
