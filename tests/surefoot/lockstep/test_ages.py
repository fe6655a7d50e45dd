"""Silent inputs are named: in the tick, in the log and in health; nothing else is."""

import pytest

from surefoot.lockstep.ages import Ages, limit_ns
from surefoot.lockstep.join import Delayed, TickInputs
from surefoot.schemas.hw import Tick
from surefoot.schemas.system import LogRecord
from surefoot.schemas.topics import (
    HW_IMU,
    HW_JOINTS,
    HW_LANDMARKS,
    STATE_GAIT,
    STATE_POSE,
    STATE_VELOCITY,
    TERRAIN_MAP,
    TICK_NS,
)
from tests.surefoot.lockstep.node_bench import IMU, Bench
from tests.surefoot.toys import estimate

ROSTER = ("estimator", "walker")


def tick(number: int, ages: Ages, *, imu: bool = True, velocity: bool = True, roster: tuple[str, ...] = ROSTER):
    manifest = Tick(
        tick=number, stamp_ns=number * TICK_NS, epoch=1, roster=roster, roster_version=1, due=(), mode="lockstep"
    )
    header = (number * TICK_NS, number, 1, number, "x")
    messages = {HW_IMU.key: IMU.relabelled(*header)} if imu else {}
    if velocity:
        messages[STATE_VELOCITY.key] = estimate(0.0).stamped(*header)
    inputs = TickInputs(manifest, messages)
    return inputs, ages.note(inputs)


@pytest.mark.parametrize(
    ("topic", "limit_s"),
    [(HW_IMU, 0.1), (HW_JOINTS, 0.1), (HW_LANDMARKS, 0.3), (STATE_VELOCITY, 0.1), (STATE_POSE, 0.3), (TERRAIN_MAP, 0)],
)
def test_limits_come_from_the_table(topic, limit_s) -> None:
    assert limit_ns(topic) == pytest.approx(limit_s * 1e9)


def test_a_silent_imu_is_late_within_0_3_s_and_comes_again() -> None:
    ages = Ages((HW_IMU, STATE_VELOCITY, TERRAIN_MAP))
    for number in range(50):
        assert tick(number, ages) == (tick(number, ages)[0], ([], []))
    first = next(n for n in range(50, 100) if tick(n, ages, imu=False)[1][0])
    assert first * TICK_NS - 49 * TICK_NS <= 300_000_000
    inputs, changes = tick(first + 50, ages, imu=False)
    assert inputs.late == {HW_IMU.key: pytest.approx((first + 50 - 49) * 0.01)}
    assert changes == ([], [])
    inputs, changes = tick(first + 51, ages)
    assert (dict(inputs.late), changes) == ({}, ([], [HW_IMU.key]))
    assert ages.longest == {HW_IMU.key: pytest.approx((first + 50 - 49) * 0.01)}
    ages.begin()
    assert ages.longest == {}


def test_a_sensor_dead_from_the_start_is_late_and_one_that_the_driver_lacks_is_not() -> None:
    ages = Ages((HW_IMU, HW_JOINTS))
    for number in range(30):
        manifest = Tick(
            tick=number, stamp_ns=number * TICK_NS, epoch=1, roster=ROSTER, roster_version=1, due=(), mode="lockstep"
        )
        ages.note(TickInputs(manifest, {}), absent={HW_JOINTS.key})
    assert set(ages.late) == {HW_IMU.key}


def test_a_service_that_was_never_there_is_not_missed_and_one_that_left_is() -> None:
    ages = Ages((STATE_VELOCITY, Delayed(STATE_GAIT)))
    for number in range(30):
        tick(number, ages, roster=("estimator",))
    assert ages.late == {}
    for number in range(30, 60):
        tick(number, ages, velocity=False, roster=())
    assert set(ages.late) == {STATE_VELOCITY.key}


def test_a_node_names_it_in_log_and_health() -> None:
    bench = Bench()
    for number in range(20):
        bench.both(number)
    assert bench.node.health().late == {}
    for number in range(20, 60):
        bench.tick(number, due=())
    late = bench.node.health().late
    assert late == {HW_IMU.key: pytest.approx(0.40)}
    assert [r.text for r in bench.sent(LogRecord) if "silent" in r.text] == [
        "hw/imu is silent: no new sample for 0.11 s"
    ]
    for number in range(60, 63):
        bench.both(number)
    assert bench.node.health().late == {}
    assert bench.node.health().silences == late


def test_a_service_sets_limits_of_its_own() -> None:
    ages = Ages((HW_IMU, STATE_VELOCITY))
    ages.begin({HW_IMU.key: 2 * 10**9, STATE_VELOCITY.key: 0})
    late = [n for n in range(300) if tick(n, ages, imu=False, velocity=False)[1][0]]
    assert late == [201], "the one after two seconds, the other never"
    assert set(ages.late) == {HW_IMU.key}
    ages.begin()
    assert {key for n in range(30) for key in tick(n, ages, imu=False, velocity=False)[1][0]} == {
        HW_IMU.key, STATE_VELOCITY.key,
    }  # fmt: skip
