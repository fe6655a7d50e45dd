"""Due times of paced ticks, on a clock that the test moves."""

import pytest

from surefoot.lockstep.intake import Intake
from surefoot.lockstep.pace import SLACK_S, Pace
from surefoot.lockstep.sensed import PATIENCE_S, SensorPace
from surefoot.robot.reader import load_robot
from surefoot.schemas.topics import TICK_NS, TICK_S


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def pace(clock: Clock) -> Pace:
    """A pace that keeps to wall time from now on."""
    made = Pace(clock)
    made.begin(1.0)
    return made


def run(pace: Pace, clock: Clock, ticks: int, cost_s: float) -> float:
    """Wall time of so many ticks that cost so much each and are begun when they are due."""
    began = clock.now
    for tick in range(1, ticks + 1):
        clock.now += max(0.0, pace.until_due(tick)) + cost_s
    return clock.now - began


@pytest.mark.parametrize("factor", [0.5, 1.0, 4.0])
def test_keeps_its_factor_and_is_not_late(clock: Clock, pace: Pace, factor: float) -> None:
    pace.begin(factor)
    assert run(pace, clock, 400, 0.2 * TICK_S / factor) == pytest.approx(400 * TICK_S / factor, rel=0.01)
    assert not pace.late()


def test_short_delays_are_caught_up(clock: Clock, pace: Pace) -> None:
    clock.now += 0.9 * SLACK_S
    run(pace, clock, 200, 0.0)
    assert clock.now == pytest.approx(100.0 + 200 * TICK_S)
    assert not pace.late()


def test_a_long_delay_is_given_up_and_time_does_not_race(clock: Clock, pace: Pace) -> None:
    run(pace, clock, 50, 0.0)
    clock.now += 3.0
    assert pace.until_due(51) == 0.0
    assert pace.until_due(52) == pytest.approx(TICK_S)  # the ticks of three seconds do not come at once
    assert pace.given_up_s == pytest.approx(3.0 - TICK_S)
    assert pace.late()
    assert not pace.late()


def test_a_processor_too_slow_is_late_all_the_time(clock: Clock, pace: Pace) -> None:
    for _ in range(5):
        run(pace, clock, 100, 2.0 * TICK_S)
        pace.resume(0)
    began = clock.now
    for tick in range(1, 101):
        pace.until_due(tick)
        clock.now += 2.0 * TICK_S
    assert pace.late()
    assert clock.now - began == pytest.approx(200 * TICK_S)


def test_a_pause_is_no_delay_and_zero_never_waits(clock: Clock, pace: Pace) -> None:
    clock.now += 60.0
    pace.resume(7)
    assert pace.until_due(7) == 0.0
    assert not pace.late()
    pace.begin(0.0)
    assert pace.until_due(1000) == 0.0


@pytest.mark.parametrize(("period_ms", "most_s"), [(2, 0.002), (10, 0.003)])
def test_sensors_are_looked_at_when_they_may_have_come(clock: Clock, period_ms: int, most_s: float) -> None:
    """Rows of 500 and 100 Hz: each tick soon follows its last row, by few looks; silence passes by the clock."""
    intake, looks, sent, ends = Intake(load_robot("lupo")), 0, 0, 4.0

    def poll() -> None:
        nonlocal looks, sent
        looks += 1
        while sent * period_ms <= 1000.0 * min(clock.now - 100.0, ends):
            intake.imu(sent * period_ms * 1_000_000, (0.0, 0.0, 0.0), (0.0, 0.0, 9.81))
            sent += 1

    pace = SensorPace(intake, poll, clock)
    for tick in range(1, 401):
        while (wait_s := pace.until_due(tick)) > 0.0:
            assert pace.until_due(tick) == pytest.approx(wait_s)  # asked twice, looked at once
            clock.now += 1.05 * wait_s
        assert intake.newest_ns >= tick * TICK_NS
        assert clock.now - 100.0 <= tick * TICK_S + most_s
    assert looks <= 1.5 * 400
    began = clock.now
    for tick in range(401, 501):
        while (wait_s := pace.until_due(tick)) > 0.0:
            clock.now += wait_s
    assert clock.now - began == pytest.approx(100 * TICK_S, abs=3 * PATIENCE_S)
