"""Faults of a leg's sensors: found in the leg that has them, in time, and in no other."""

import numpy as np
import pytest

from surefoot.robot.reader import load_robot
from surefoot.services.estimator.feet.faulty import FASTEST, KEPT_S, RISEN, STILL_S, LegFaults, leg_faults

DT_NS = 10_000_000
LEGS = ((0, 1, 2), (3, 4, 5))
SHUT, FLAT = np.ones(2, dtype=np.bool_), np.zeros(2)


def angles(tick: int) -> np.ndarray:
    """Joints (6,) rad that all move."""
    return 0.3 * np.sin(0.05 * tick + np.arange(6))


def follow(faults: LegFaults, ticks: range, edit=lambda tick, q: None, risen: np.ndarray = FLAT) -> list[list[bool]]:
    """Flags of the legs by tick; `edit` changes the angles of a tick."""
    out = []
    for tick in ticks:
        q = angles(tick)
        edit(tick, q)
        out.append(faults.update(q, tick * DT_NS, SHUT, risen).tolist())
    return out


def test_sound_sensors_are_never_faulty() -> None:
    assert not np.any(follow(LegFaults(LEGS, 6), range(500)))


def test_an_encoder_that_stands_still_spoils_its_leg_after_its_time_and_until_it_moves() -> None:
    def still(tick: int, q: np.ndarray) -> None:
        if 100 <= tick < 225:  # a whole swing, so that it moves on without a jump
            q[4] = angles(99)[4]

    found = np.array(follow(LegFaults(LEGS, 6), range(300), still))
    assert not found[:, 0].any()
    spoilt = np.flatnonzero(found[:, 1])
    assert spoilt[0] == pytest.approx(99 + STILL_S * 1e9 / DT_NS, abs=1)
    assert spoilt.tolist() == list(range(spoilt[0], 225))


@pytest.mark.parametrize("times", [0.9, 1.1])
def test_a_joint_that_moves_faster_than_a_motor_turns_spoils_its_leg_for_a_time(times: float) -> None:
    def jump(tick: int, q: np.ndarray) -> None:
        if tick >= 100:
            q[1] = angles(99)[1] + times * FASTEST * 1e-9 * DT_NS + 1e-3 * (tick - 100)

    found = np.array(follow(LegFaults(LEGS, 6), range(300), jump))
    assert not found[:, 1].any()
    kept = round(KEPT_S * 1e9 / DT_NS)
    expected = list(range(100, 100 + kept)) if times > 1.0 else []
    assert np.flatnonzero(found[:, 0]).tolist() == expected


def test_a_switch_that_stays_closed_while_its_foot_rises_is_stuck() -> None:
    faults = LegFaults(LEGS, 6)
    assert not np.any(follow(faults, range(100), risen=np.array((0.9 * RISEN, 0.0))))
    assert np.array_equal(follow(faults, range(100, 101), risen=np.array((1.1 * RISEN, 0.0))), [[True, False]])
    rest = np.array(follow(faults, range(101, 400)))
    assert rest[:50, 0].all()  # of the stance that the rise ended
    assert not rest[150:].any()
    open_foot = faults.update(angles(400), 400 * DT_NS, ~SHUT, np.array((1.1 * RISEN, 0.0)))
    assert not open_foot.any()


def test_a_robot_is_followed_by_the_joints_of_its_legs() -> None:
    robot = load_robot("ragno")
    faults = leg_faults(robot)
    rng = np.random.default_rng(0)
    closed, flat = np.ones(robot.nlegs, dtype=np.bool_), np.zeros(robot.nlegs)
    for tick in range(100):
        q = rng.uniform(-0.01, 0.01, robot.nj)
        q[robot.legs[2].joints[1]] = 0.5
        found = faults.update(q, tick * DT_NS, closed, flat)
    assert np.flatnonzero(found).tolist() == [2]
