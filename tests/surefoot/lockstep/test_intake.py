"""Samples of a robot with a clock of its own: bad first rows, two clocks, feet that go silent, and bounds."""

import math

import pytest

from surefoot.lockstep import intake
from surefoot.lockstep.intake import SILENT_NS, ForceContact, Intake
from surefoot.robot.reader import load_robot
from surefoot.schemas.hw import FootContacts
from surefoot.schemas.topics import HW_CONTACTS, TICK_NS

ROBOT = load_robot("lupo")
STANCE = ROBOT.neutral.tolist()
STILL, UP = (0.0, 0.0, 0.0), (0.0, 0.0, 9.81)
START_NS = 7_000_000_000_000


@pytest.mark.parametrize("row", [(math.nan, 0.0, 0.0), (0.0, 0.0)])
def test_time_does_not_begin_with_a_row_that_is_refused(row: tuple[float, ...]) -> None:
    made = Intake(ROBOT)
    made.imu(START_NS - 5_000_000_000, row, UP)
    made.joints(START_NS, STANCE)
    assert made.newest_ns == -1
    assert made.lacking_ns(0) > 0
    made.imu(START_NS, STILL, UP)
    assert made.lacking_ns(0) == 0
    assert made.lacking_ns(2) == 2 * TICK_NS
    assert made.newest_ns == 0
    assert len(made.refused) == 1


@pytest.mark.parametrize("offset_s", [-2.0, 2.0])
def test_a_second_clock_does_not_let_time_run_away(offset_s: float) -> None:
    made = Intake(ROBOT)
    for k in range(200):
        made.imu(START_NS + k * TICK_NS, STILL, UP)
        made.joints(START_NS + k * TICK_NS + int(offset_s * 1e9), STANCE)
        assert made.newest_ns == k * TICK_NS
    assert made.refused == ({"joints_clock": 200} if offset_s < 0.0 else {})


def touch_of(made: Intake, tick: int) -> FootContacts:
    (found,) = (one.message for one in made.release(tick) if one.topic is HW_CONTACTS)
    assert isinstance(found, FootContacts)
    return found


def test_feet_that_go_silent_are_judged_by_their_height_again() -> None:
    made, last = Intake(ROBOT, ForceContact((0.0,) * 4, (1.0,) * 4, 30.0, 18.0)), SILENT_NS // TICK_NS
    for tick in range(last + 1):
        made.imu(START_NS + tick * TICK_NS, STILL, UP)
        if tick == 0:
            made.feet(START_NS, (0.0,) * 4)  # all in the air
        made.joints(START_NS + tick * TICK_NS, STANCE)
        found = touch_of(made, tick)
        assert found.touch == ((tick == last,),) * 4
        assert found.normal_force_n == ((None,) * 4 if tick == last else (0.0,) * 4)


def test_feet_without_joints_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(intake, "MOST_FEET", 10)
    made = Intake(ROBOT)
    for k in range(50):
        made.imu(START_NS + k * TICK_NS, STILL, UP)
        made.feet(START_NS + k * TICK_NS, (1.0,) * 4)
        made.release(k)
    assert len(made._feet) == 10
