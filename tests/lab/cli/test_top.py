"""Rates, sizes and latencies as they are counted, and the support polygon in letters."""

import pytest

from surefoot.bus.memory import MemoryBus
from surefoot.lab.cli.graph import declared
from surefoot.lab.cli.top import COLUMNS, LINES, Traffic, inputs_of, polygon_lines, watch
from surefoot.schemas.hw import Imu, JointState, Tick
from surefoot.schemas.stability import StabilityStatus
from surefoot.schemas.topics import HW_IMU, HW_JOINTS, HW_TICK, STATE_STABILITY, STATE_VELOCITY, TICK_NS

SQUARE = ((0.1, -0.1), (0.1, 0.1), (-0.1, 0.1), (-0.1, -0.1))


def status(**fields):
    given = {
        "status": "ok", "stance": (True,) * 4, "region": SQUARE, "com_planned": (0.0, 0.0), "com_measured": None,
        "margin_planned": 0.1, "margin_measured": None, "mu": 0.6,
    }  # fmt: skip
    return StabilityStatus(**{**given, **fields})


class Robot:
    def __init__(self):
        self.bus = MemoryBus()


def test_rate_size_and_latency_of_a_topic():
    now, robot = [0.0], Robot()
    traffic = Traffic(lambda: now[0])
    watch(robot, traffic)
    ticks, samples = robot.bus.publisher(HW_TICK), robot.bus.publisher(HW_IMU)
    for tick in range(100):
        stamp = tick * TICK_NS
        manifest = Tick(
            tick=tick, epoch=1, stamp_ns=stamp, seq=tick, roster=(), roster_version=1, due=("hw/imu",), mode="lockstep"
        )
        ticks.put(manifest)
        now[0] += 2e-3 if tick != 7 else 6e-3
        samples.put(Imu(acc=(0.0, 0.0, 9.81), gyro=(0.0, 0.0, 0.0)).stamped(stamp, tick, 1, tick, "driver"))
        now[0] = 0.01 * (tick + 1)
    rows = {row.key: row for row in traffic.rows(1.0)}
    assert rows["hw/imu"].hz == pytest.approx(100.0)
    assert rows["hw/imu"].kb_per_s == pytest.approx(0.1 * rows["hw/imu"].bytes)
    assert (rows["hw/imu"].p50_ms, rows["hw/imu"].p99_ms) == (2.0, 6.0)
    assert rows["hw/tick"].p99_ms == 0.0
    assert traffic.rows(0.1)[0].hz == pytest.approx(100.0, rel=0.15)
    now[0] += 10.0
    assert traffic.rows(1.0) == []


def test_the_polygon_is_seen_from_above_with_x_up_and_y_to_the_left():
    lines = polygon_lines(status(com_planned=(0.08, 0.0), com_measured=(0.0, 0.08)))
    picture, words = lines[:-1], lines[-1]
    assert len(picture) == LINES
    (front,) = [row for row, line in enumerate(picture) if "o" in line]
    (left,) = [line for line in picture if "x" in line]
    assert front < LINES // 2
    assert left.index("x") < COLUMNS // 2
    assert "100.0 mm" in words
    inside = sum(line.count(".") for line in picture)
    assert inside == pytest.approx(COLUMNS * LINES * (1 / 1.1) ** 2, rel=0.15)


def test_no_region_is_said_in_words():
    assert polygon_lines(None) == ["no support region yet"]
    assert polygon_lines(status(status="infeasible", region=())) == ["no support region: infeasible"]


def test_the_newest_status_is_kept():
    robot, traffic = Robot(), Traffic()
    watch(robot, traffic)
    publisher = robot.bus.publisher(STATE_STABILITY)
    for tick in range(3):
        publisher.put(status(margin_planned=0.01 * tick).stamped(tick * TICK_NS, tick, 1, tick, "stability"))
    assert traffic.stability is not None
    assert traffic.stability.margin_planned == 0.02


def test_a_hop_is_the_time_since_the_last_input_of_the_publisher_and_else_since_the_ticks_first_message():
    """Before, every latency was counted from the tick's first message, and no hop could be seen."""
    now, robot = [0.0], Robot()
    traffic = Traffic(lambda: now[0], {STATE_STABILITY.key: {HW_IMU.key, STATE_VELOCITY.key}})
    watch(robot, traffic)
    samples, margins = robot.bus.publisher(HW_IMU), robot.bus.publisher(STATE_STABILITY)
    for tick in range(100):
        start, stamp = 0.01 * tick, (tick * TICK_NS, tick, 1, tick)
        now[0] = start
        robot.bus.publisher(HW_JOINTS).put(JointState(position=(0.0,), velocity=(0.0,)).stamped(*stamp, "driver"))
        now[0] = start + 1e-3
        samples.put(Imu(acc=(0.0, 0.0, 9.81), gyro=(0.0, 0.0, 0.0)).stamped(*stamp, "driver"))
        now[0] = start + (3e-3 if tick != 7 else 8e-3)
        margins.put(status().stamped(*stamp, "stability"))
    rows = {row.key: row for row in traffic.rows(1.0)}
    assert (rows["state/stability"].p50_ms, rows["state/stability"].p99_ms) == (3.0, 8.0)
    assert (rows["state/stability"].hop_p50_ms, rows["state/stability"].hop_p99_ms) == (2.0, 7.0)
    assert (rows["hw/imu"].hop_p50_ms, rows["hw/joints"].hop_p99_ms) == (1.0, 0.0)


def test_inputs_are_those_that_the_services_declare():
    found = inputs_of(declared()[1])
    assert found["state/velocity"] >= {"hw/imu", "hw/joints"}
    assert found["state/stability"] >= {"state/velocity"}
    assert "hw/imu" not in found, "a driver acts on commands of the tick before"
