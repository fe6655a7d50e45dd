"""Slip of stances: none for rolling and lifting feet, the way for sliding ones, whatever the switches do meanwhile."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surefoot.geometry.rotations import matrix_from_quat, matrix_from_rotvec
from surefoot.robot import kinematics
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.feet.mount import feet_in_imu, foot_mount
from surefoot.services.estimator.feet.slip import (
    LONGEST_OPEN,
    OPEN_WEIGHT,
    SIGMA,
    FinishedStance,
    StanceSlip,
    feet_in_odom,
)
from surefoot.services.estimator.output import OdometryPose

RADIUS = np.array([0.008, 0.008])
UP = np.array([0.0, 0.0, 1.0])
LIFT = np.array([0.0, 0.0, 0.02])


def run(centres: np.ndarray, turns: np.ndarray, contacts: np.ndarray) -> tuple[StanceSlip, list[FinishedStance]]:
    """Foot 0 as given, foot 1 in swing; (n, 3) m, (n, 3) rotation vectors, (n,) flags."""
    meter, ended = StanceSlip(2, RADIUS), []
    for centre, turn, contact in zip(centres, turns, contacts, strict=True):
        both = np.stack((centre, np.zeros(3)))
        ended += meter.update(np.array([contact, False]), both, np.stack((matrix_from_rotvec(turn), np.eye(3))))
    return meter, ended


def stance(way: np.ndarray, turn: np.ndarray, n: int = 20) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """An even movement over n samples with contact, then three samples in the air."""
    share = np.concatenate((np.linspace(0.0, 1.0, n), np.ones(3)))[:, None]
    lifted = np.concatenate((np.zeros(n), np.ones(3)))[:, None]
    return share * way + lifted * LIFT, share * turn, np.arange(n + 3) < n


def noiseless(way: float) -> float:
    """Return the slip that is reported of a way: less the noise of a foot at rest."""
    return math.sqrt(max(0.0, way * way - SIGMA * SIGMA))


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_a_rolling_foot_does_not_slip(a: float, b: float, spin: float) -> None:
    turn = np.array([a, b, 0.0])
    centres, turns, contacts = stance(np.cross(turn, RADIUS[0] * UP), turn)
    _, ended = run(centres, turns, contacts)
    assert [each.leg for each in ended] == [0]
    assert ended[0].slip == pytest.approx(0.0, abs=1e-9)
    spun = run(*stance(np.zeros(3), np.array([0.0, 0.0, spin])))[1]
    assert spun[0].slip == pytest.approx(0.0, abs=1e-9)  # a foot that twists in its place slips nowhere


@given(st.floats(-0.03, 0.03), st.floats(-0.03, 0.03), st.floats(-0.4, 0.4))
def test_a_sliding_foot_slips_by_its_way(x: float, y: float, tilt: float) -> None:
    turn = np.array([0.1, tilt, 0.0])
    way = np.array([x, y, 0.0])
    _, ended = run(*stance(way + np.cross(turn, RADIUS[0] * UP), turn))
    assert ended[0].slip == pytest.approx(noiseless(math.hypot(x, y)), abs=1e-9)
    assert ended[0].samples == 20


def test_the_noise_of_a_foot_at_rest_is_no_slip() -> None:
    rng = np.random.default_rng(0)
    centres, turns, contacts = stance(np.zeros(3), np.zeros(3), 25)
    slips = [run(centres + 1e-4 * rng.standard_normal(centres.shape), turns, contacts)[1][0].slip for _ in range(20)]
    assert np.mean(slips) < 1e-4


def test_what_slides_back_has_slid() -> None:
    centres, turns, contacts = stance(np.zeros(3), np.zeros(3))
    centres[8] += (0.01, 0.0, 0.0)
    assert run(centres, turns, contacts)[1][0].slip == pytest.approx(noiseless(0.01))


def test_a_light_foot_slides_on_with_its_switch_open() -> None:
    centres, turns, contacts = stance(np.array([0.02, 0.0, -0.02]), np.zeros(3), 21)
    contacts[8:11] = False
    meter, ended = run(centres, turns, contacts)
    counted = 0.001 * (16 + 2 * 0.5 * (1.0 + OPEN_WEIGHT) + 2 * OPEN_WEIGHT)
    assert [each.slip for each in ended] == [pytest.approx(noiseless(counted), abs=1e-9)]
    assert not meter.slip.any()


def test_a_stance_ends_when_the_foot_rises_or_its_switch_stays_open() -> None:
    centres, turns, contacts = stance(np.array([0.01, 0.0, 0.0]), np.zeros(3))
    low = np.zeros((LONGEST_OPEN, 3)) + centres[19]
    slow = np.concatenate((centres[:20], low)), np.zeros((20 + LONGEST_OPEN, 3)), np.arange(20 + LONGEST_OPEN) < 20
    assert run(*(part[:-1] for part in slow))[1] == []
    assert [each.slip for each in run(*slow)[1]] == [pytest.approx(noiseless(0.01))]
    assert len(run(centres[:-1], turns[:-1], contacts[:-1])[1]) == 1


def test_touches_that_are_too_short_and_numbers_that_are_none() -> None:
    centres, turns, contacts = stance(np.array([0.01, 0.0, 0.0]), np.zeros(3))
    short = np.arange(len(contacts)) == 19
    assert run(centres, turns, short)[1] == []
    centres[10:13] = np.nan
    _, ended = run(centres, turns, contacts)
    assert ended[0].slip == pytest.approx(noiseless(0.01))


def test_feet_in_odom_are_those_of_the_description() -> None:
    robot = load_robot("ragno")
    rng = np.random.default_rng(1)
    quat = rng.standard_normal(4)
    quat /= np.linalg.norm(quat)
    pose = OdometryPose(rng.standard_normal(3), quat, 0.0, np.array([0.1, 0.2, 0.3]), np.eye(4))
    q = robot.neutral + 0.1 * rng.standard_normal(robot.nj)
    mount = foot_mount(robot)
    centres, rots = feet_in_odom(mount, feet_in_imu(mount, q), pose, 0.01)
    rot, pos = kinematics.forward(robot.model, q)
    turn, begin = matrix_from_quat(quat), pose.position - 0.01 * pose.velocity
    np.testing.assert_allclose(
        centres, kinematics.foot_positions_of(robot.model, rot, pos) @ turn.T + begin, atol=1e-12
    )
    np.testing.assert_allclose(rots, [turn @ rot[k] for k in robot.model.foot_link], atol=1e-12)


def test_a_stance_is_sound_unless_its_leg_is_faulty_when_it_ends() -> None:
    centres, turns, contacts = stance(np.array([0.01, 0.0, 0.0]), np.zeros(3))
    for at, faulty, sound in ((-1, [True, False], False), (-1, [False, True], True), (3, [True, True], True)):
        meter, ended = StanceSlip(2, RADIUS), list[FinishedStance]()
        for i, (centre, turn, contact) in enumerate(zip(centres, turns, contacts, strict=True)):
            both, rots = np.stack((centre, np.zeros(3))), np.stack((matrix_from_rotvec(turn), np.eye(3)))
            now = np.array(faulty) if at < 0 or i == at else None
            ended += meter.update(np.array([contact, False]), both, rots, now)
        assert [each.healthy for each in ended] == [sound]
