"""Unitree's messages as a driver: over DDS on loopback, the bits of the bag, and every bad message by name."""

import importlib.util
import math
import struct
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from surefoot.errors import Refusal, SurefootError
from surefoot.lab.bags.fit import fitted
from surefoot.lab.bags.importing import record
from surefoot.record.columns import recorded_columns
from surefoot.record.recording import open_readable
from surefoot.robot.reader import load_robot
from surefoot.schemas.hw import JointCommand
from surefoot.schemas.topics import HW_MAKER
from tests.lab.bags.sway import MS, ORDER, ROBOT, START_NS, sway
from tests.lab.bags.test_bad_bags import log_of_rows
from tests.services.ros_robot.test_driver import LAST_TICK, ran

pytest.importorskip("cyclonedds")
from cyclonedds.idl._support import Endianness

from surefoot.services.unitree.messages import (
    PACKED,
    SPORT_STATE,
    LowState,
    MemoryAsSent,
    PathPoint,
    SportModeState,
    TimeSpec,
    check_sum,
    memory_of,
    sensors_of,
)
from surefoot.services.unitree.service import Unitree, UnitreeConfig
from tests.services.stage import Stage

ROOT = Path(__file__).parents[3]
NAMES = load_robot(ROBOT).joint_names
MAKER = [name for leg in ORDER for name in NAMES if name.startswith(f"{leg}_")]
ZERO, PER_NEWTON = 40.0, 2.0
WRAP = 2**32


def fake() -> Any:
    spec = importlib.util.spec_from_file_location("fake_go2", ROOT / "examples" / "unitree" / "fake.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


low_state = fake().low_state


def driver(**more: Any) -> Unitree:
    known = {"foot_zero": (ZERO,) * 4, "foot_scale": (1.0 / PER_NEWTON,) * 4, "contact_on": 20.0, "contact_off": 12.0}
    return Unitree(UnitreeConfig(**{"robot": ROBOT, "joints": tuple(MAKER), "feet": ORDER, **known, **more}))


class Quiet(Unitree):
    """Without a network."""

    def _open(self) -> Any:
        nothing = type("Reader", (), {"take": lambda *_, **__: []})()
        return nothing, nothing


def quiet(**more: Any) -> Quiet:
    made = Quiet(driver(**more).config)
    made.attach(Stage())
    made.on_start()
    return made


def states(first_ms: int = 0) -> list[LowState]:
    log = sway()
    order = [NAMES.index(name) for name in MAKER]
    return [
        low_state(
            (first_ms + int(stamp - START_NS) // MS) % WRAP, log.joints[k, order].tolist(), log.gyro[k].tolist(),
            log.acc[k].tolist(), np.round(log.raw[k]).astype(int).tolist(),
        )
        for k, stamp in enumerate(log.stamp_ns)
    ]  # fmt: skip


@pytest.mark.parametrize("first_ms", [0, WRAP - 700])
def test_messages_give_the_bits_of_the_bag(tmp_path: Path, first_ms: int) -> None:
    log = log_of_rows(sway())
    log.feet = log.feet._replace(values=np.round(log.feet.values))  # type: ignore[union-attr]
    log.torque, log.velocity = 0.0 * log.joints.values, 0.0 * log.joints.values
    bag = fitted(log, load_robot(ROBOT))
    assert bag.contact is not None
    bag.contact = driver().config.contact(4)
    record(bag, ROBOT, tmp_path / "bag.mcap")
    made = Quiet(driver().config)
    start = made.on_start
    made.on_start = lambda: (start(), [made.take(memory_of(state)) for state in states(first_ms)])  # type: ignore[method-assign]
    live, recorded = ran(made, tmp_path / "live.mcap"), recorded_columns(tmp_path / "bag.mcap")[0]
    assert not made.intake.refused
    for key in ("published_velocity_imu", "published_position", "published_covariance", "touch", "joints"):
        np.testing.assert_array_equal(live[key], recorded[key][: len(live[key])], err_msg=key)
    assert len(live["published_position"]) == LAST_TICK + 1


@pytest.mark.parametrize("later_ms", [2800, 0])
def test_a_clock_that_jumps_back_is_counted_and_time_goes_on(tmp_path: Path, later_ms: int) -> None:
    rows = [*states(5000)[:400], *states(later_ms)[: len(states()) - 400]]  # back by 3 s, or from 0: a reboot
    made = Quiet(driver().config)
    start = made.on_start
    made.on_start = lambda: (start(), [made.take(memory_of(state)) for state in rows])  # type: ignore[method-assign]
    live = ran(made, tmp_path / "live.mcap")
    assert dict(made.intake.refused) == {"clock": 1}
    assert len(live["published_position"]) == LAST_TICK + 1
    assert len(live["joints"]) == len(live["gyro"]) == LAST_TICK + 1
    assert np.isfinite(live["published_position"]).all()
    assert live["published_flags"][-1, 0] > 0.5  # initialised


def test_check_sum_is_the_one_of_its_definition() -> None:
    state = states()[5]
    assert struct.calcsize(PACKED) == 1180
    data = struct.pack(PACKED, *numbers(state))
    crc = 0xFFFFFFFF
    for word in struct.unpack(f"<{len(data) // 4}I", data)[:-1]:
        for bit in range(31, -1, -1):
            top = (crc >> 31) ^ ((word >> bit) & 1)
            crc = ((crc << 1) & 0xFFFFFFFF) ^ (0x04C11DB7 * top)
    assert state.crc == crc


def numbers(value: Any) -> list[float]:
    if hasattr(value, "__dataclass_fields__"):
        return [x for name in value.__dataclass_fields__ for x in numbers(getattr(value, name))]
    return [x for part in value for x in numbers(part)] if isinstance(value, list | bytes) else [value]


@pytest.mark.parametrize("v2", [False, True])
@pytest.mark.parametrize("endianness", list(Endianness))
def test_numbers_of_a_message_in_any_encoding(endianness: Endianness, v2: bool) -> None:
    rng = np.random.default_rng(26)
    data = bytearray(states()[0].serialize(endianness=endianness, use_version_2=v2))
    data[4:] = rng.integers(0, 127, len(data) - 4, dtype=np.uint8).tobytes()  # no float is NaN
    if v2:
        data[84:88] = states()[0].serialize(endianness=endianness, use_version_2=v2)[84:88]  # size of the motors
    theirs = LowState.deserialize(bytes(data))
    assert list(struct.unpack(PACKED, MemoryAsSent.deserialize(bytes(data)))) == numbers(theirs)
    m = sensors_of(memory_of(theirs))
    for name in ("q", "dq", "tau_est", "lost"):
        assert getattr(m, name) == tuple(getattr(motor, name) for motor in theirs.motor_state)
    assert [*m.gyroscope, *m.accelerometer] == [*theirs.imu_state.gyroscope, *theirs.imu_state.accelerometer]
    assert [*m.foot_force, m.tick, m.crc] == [*theirs.foot_force, theirs.tick, theirs.crc]


def test_bad_messages_are_counted_by_name() -> None:
    made, rows = quiet(), states()
    for state in rows[:5]:
        made.take(memory_of(state))
    rows[5].imu_state.gyroscope[0] += 0.1
    made.take(memory_of(rows[5]))
    for state in rows[6:]:
        state.motor_state[7].lost = 3
    rows[9].foot_force, rows[10].tick = [0] * 4, 5_000_000
    for k in (6, 7, 8, 9, 8, 10):
        made.take(memory_of(relabelled(rows[k])))
    assert dict(made.intake.refused) == {
        "crc": 1, "motor_lost": 1, "feet_zero": 1, "imu_late": 1, "feet_duplicate": 1, "joints_late": 1, "clock": 1
    }  # fmt: skip


def relabelled(state: LowState) -> LowState:
    state.crc = check_sum(memory_of(state))
    return state


def test_a_makers_estimate_that_is_no_number_is_refused() -> None:
    made = quiet()
    made.take(memory_of(states()[0]))
    imu = SimpleNamespace(quaternion=[1.0, 0.0, 0.0, 0.0])
    maker = {"position": [0.0] * 3, "velocity": [0.0] * 3, "yaw_speed": 0.0, "imu_state": imu, "gait_type": 1}
    made._maker = SimpleNamespace(**maker)
    assert HW_MAKER in [one.topic for one in made.release(0)]
    made._maker = SimpleNamespace(**maker | {"velocity": [0.0, math.nan, 0.0]})
    assert HW_MAKER not in [one.topic for one in made.release(1)]
    assert made.intake.refused == {"maker_nonfinite": 1}


def test_nothing_is_sent_unasked() -> None:
    made = quiet()
    with pytest.raises(Refusal, match="only watches"):
        made.check(JointCommand(position=(0.0,) * 12))
    made.actuate(0, JointCommand(position=(0.0,) * 12))
    with pytest.raises(Refusal, match="sends no commands"):
        quiet(command=True)
    with pytest.raises(Refusal, match="got 0 numbers, wanted is one of 4 feet"):
        quiet(foot_scale=())
    with pytest.raises(SurefootError, match="no joint"):
        quiet(robot="messor", foot_zero=(), foot_scale=())


def test_reads_a_publisher_on_loopback() -> None:
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.pub import DataWriter
    from cyclonedds.topic import Topic

    from surefoot.services.unitree.messages import LOW_STATE

    made = driver(domain=87)
    made.attach(Stage())
    made.on_start()
    participant = DomainParticipant(87)
    writer = DataWriter(participant, Topic(participant, LOW_STATE, LowState))
    sport = DataWriter(participant, Topic(participant, SPORT_STATE, SportModeState))
    rows = states()
    other = SportModeState(
        TimeSpec(1, 2), 0, rows[0].imu_state, 1, 0.0, 1, 0.08, [1.0, 2.0, 0.3], 0.3, [0.5, 0.0, 0.0], 0.1, [0.0] * 4,
        [60] * 4, [0.0] * 12, [0.0] * 12, [PathPoint(*[0.0] * 7)] * 10,
    )  # fmt: skip
    for state in rows:
        writer.write(state)
        sport.write(other)
        made.poll()
        if made.intake.newest_ns >= 0 and made.intake.lacking_ns(2) == 0:
            break
    samples = {sample.topic.key: sample.message for tick in range(3) for sample in made.release(tick)}
    assert set(samples) == {"hw/imu", "hw/joints", "hw/contacts", "hw/maker"}
    maker: Any = samples["hw/maker"]
    assert maker.velocity == (0.5, 0.0, 0.0)


def test_no_command_leaves_the_driver() -> None:
    """Of all that is published in the domain, as DDS itself lists it, only what the robot sends is there."""
    from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.pub import DataWriter
    from cyclonedds.topic import Topic

    from surefoot.services.unitree.messages import LOW_STATE

    made = driver(domain=89)
    made.attach(Stage())
    made.on_start()
    participant = DomainParticipant(89)
    published = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
    writer = DataWriter(participant, Topic(participant, LOW_STATE, LowState))
    for k, state in enumerate(states()[:100]):
        writer.write(state)
        made.poll()
        made.actuate(k, JointCommand(position=(0.1,) * 12))
    assert {found.topic_name for found in published.take(N=100)} == {LOW_STATE}


def test_the_makers_estimate_is_in_the_recording(tmp_path: Path) -> None:
    made = Quiet(driver().config)
    sport = SportModeState(
        TimeSpec(1, 2), 0, states()[0].imu_state, 1, 0.0, 1, 0.08, [1.0, 2.0, 0.25], 0.3, [0.5, 0.0, -0.125], 0.25,
        [0.0] * 4, [60] * 4, [0.0] * 12, [0.0] * 12, [PathPoint(*[0.0] * 7)] * 10,
    )  # fmt: skip

    def begin() -> None:
        Quiet.on_start(made)
        for state in states():
            made.take(memory_of(state))
        made._maker = SportModeState.deserialize(sport.serialize())

    made.on_start = begin  # type: ignore[method-assign]
    ran(made, tmp_path / "live.mcap", 20)
    (maker,) = [item.message() for item in open_readable(tmp_path / "live.mcap").messages((HW_MAKER.key,))]
    assert (maker.position, maker.velocity, maker.yaw_speed) == ((1.0, 2.0, 0.25), (0.5, 0.0, -0.125), 0.25)


def test_an_interface_that_is_none() -> None:
    with pytest.raises(SurefootError, match="interface"):
        driver(domain=88, interface="none7").on_start()
