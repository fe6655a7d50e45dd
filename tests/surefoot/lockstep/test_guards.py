"""Guards of the border one by one: each refuses what it is for, at its very limit, and takes what is just inside."""

from contextlib import nullcontext

import pytest

from surefoot.errors import Refusal
from surefoot.lockstep.commands import KEEP_TICKS, STALE_TICKS, Commands
from surefoot.lockstep.join import Delayed, Join
from surefoot.schemas.base import Header
from surefoot.schemas.hw import Imu, JointCommand, Tick
from surefoot.schemas.topics import HW_IMU, HW_TICK, STATE_STABILITY, TICK_NS

NOW = 50


@pytest.mark.parametrize(
    ("tick", "stamp_ns", "code"),
    [
        (NOW, NOW * TICK_NS, ""),
        (NOW + 1, (NOW + 1) * TICK_NS, "stale"),
        (NOW - STALE_TICKS, (NOW - STALE_TICKS) * TICK_NS, ""),
        (NOW - STALE_TICKS - 1, (NOW - STALE_TICKS - 1) * TICK_NS, "stale"),
        (NOW, (NOW + 1) * TICK_NS, ""),
        (NOW, (NOW + 1) * TICK_NS + 1, "stamp"),
        (NOW, (NOW - STALE_TICKS) * TICK_NS, ""),
        (NOW, (NOW - STALE_TICKS) * TICK_NS - 1, "stamp"),
    ],
)
def test_a_command_of_another_time_is_refused(tick: int, stamp_ns: int, code: str) -> None:
    commands, command = Commands(), JointCommand(position=(0.0,)).stamped(stamp_ns, tick, 1, tick, "walker")
    if code:
        with pytest.raises(Refusal) as refusal:
            commands.offer(command, NOW, lambda given: None)
        assert refusal.value.code == code
    else:
        commands.offer(command, NOW, lambda given: None)
    assert commands.known(tick) == (not code)


@pytest.mark.parametrize(
    ("sender", "position", "code"), [("a", 0.0, ""), ("a", 1.0, "conflict"), ("b", 1.0, ""), ("b", 0.0, "")]
)
def test_of_two_commands_of_a_tick_the_first_is_obeyed(sender: str, position: float, code: str) -> None:
    commands, checked = Commands(), list[JointCommand]()
    first, second = (JointCommand(position=(x,)).stamped(NOW * TICK_NS, NOW, 1, NOW, "walker") for x in (0.0, position))
    commands.offer(first, NOW, checked.append, "a")
    if code:
        with pytest.raises(Refusal, match="'a'") as refusal:
            commands.offer(second, NOW, checked.append, sender)
        assert refusal.value.code == code
    else:
        commands.offer(second, NOW, checked.append, sender)
    assert len(checked) == 1
    assert commands.take(NOW, exact=True) is first


def test_what_the_hardware_refuses_is_answered_and_never_obeyed() -> None:
    def refuse(command: JointCommand) -> None:
        raise Refusal("range", "too far")

    commands = Commands()
    with pytest.raises(Refusal):
        commands.offer(JointCommand(position=(9.0,)).stamped(NOW * TICK_NS, NOW, 1, NOW, "walker"), NOW, refuse)
    assert commands.answered(NOW)
    assert commands.take(NOW, exact=False) is None


def test_a_stream_of_commands_is_lost_100_ms_after_the_last_and_not_before_the_first() -> None:
    commands = Commands()
    assert not commands.lost(NOW + 10 * STALE_TICKS)
    commands.offer(JointCommand(position=(0.0,)).stamped(NOW * TICK_NS, NOW, 1, NOW, "walker"), NOW, lambda given: None)
    assert not commands.lost(NOW + STALE_TICKS)
    assert commands.lost(NOW + STALE_TICKS + 1)


@pytest.mark.parametrize("wrong", [False, True])
def test_memory_of_commands_is_bounded_whatever_comes_and_is_left_out(wrong: bool) -> None:
    commands = Commands()
    for tick in range(0, 20 * KEEP_TICKS, 3):
        stamp_ns = -1 if wrong else tick * TICK_NS
        with nullcontext() if not wrong or tick < STALE_TICKS else pytest.raises(Refusal):
            command = JointCommand(position=(0.0,)).stamped(stamp_ns, tick, 1, tick, "walker")
            commands.offer(command, tick, lambda given: None)
    assert len(commands._by_tick) <= KEEP_TICKS
    assert commands.answered(tick)


def manifest(tick: int, roster: tuple[str, ...] = ("estimator",)) -> Tick:
    return Tick(
        stamp_ns=tick * TICK_NS, tick=tick, epoch=1, seq=tick, source="driver", roster=roster, roster_version=1,
        due=(HW_IMU.key,), mode="lockstep", seed=0,
    )  # fmt: skip


def imu(tick: int) -> Imu:
    return Imu(acc=(0.0, 0.0, 9.81), gyro=(0.0, 0.0, 0.0)).stamped(tick * TICK_NS, tick, 1, tick, "driver")


def test_a_service_that_is_not_on_the_roster_gets_no_tick() -> None:
    join = Join("estimator", (HW_IMU,))
    assert join.offer(HW_TICK, manifest(0, ("walker",))) == "not_on_roster"
    assert join.offer(HW_IMU, imu(0)) is None
    assert join.take() is None
    assert not join.on_roster


def test_a_service_that_leaves_the_roster_does_no_tick_that_waits() -> None:
    join = Join("estimator", (HW_IMU,))
    assert join.offer(HW_TICK, manifest(0)) is None
    assert join.offer(HW_IMU, imu(0)) is None
    assert join.offer(HW_TICK, manifest(1, ("walker",))) == "not_on_roster"
    assert join.take() is None


def test_of_two_manifests_of_a_tick_the_first_is_obeyed() -> None:
    join = Join("estimator", (HW_IMU,))
    first = manifest(0)
    assert join.offer(HW_TICK, first) is None
    assert join.offer(HW_TICK, first.model_copy(update={"seed": 7})) == "conflict"
    assert join.offer(HW_IMU, imu(0)) is None
    inputs = join.take()
    assert inputs is not None
    assert inputs.tick == first


def test_a_delayed_input_is_awaited_in_the_ticks_after_those_in_which_it_is_due_only() -> None:
    join, roster = Join("walker", (HW_IMU, Delayed(STATE_STABILITY))), ("stability", "walker")
    for tick in range(8):
        assert join.offer(HW_TICK, manifest(tick, roster)) is None
        assert join.offer(HW_IMU, imu(tick)) is None
        if tick > 0 and STATE_STABILITY.due(tick - 1):
            assert join.take() is None
            status = Header(stamp_ns=(tick - 1) * TICK_NS, tick=tick - 1, epoch=1, source="stability")
            assert join.offer(STATE_STABILITY, status) is None
        assert join.take() is not None
    assert not all(STATE_STABILITY.due(tick) for tick in range(8))


def test_what_was_used_is_not_taken_again() -> None:
    join = Join("estimator", (HW_IMU,))
    for tick in range(3):
        assert join.offer(HW_TICK, manifest(tick)) is None
        assert join.offer(HW_IMU, imu(tick)) is None
        assert join.take() is not None
    assert join.offer(HW_IMU, imu(1)) == "duplicate"
    assert join.offer(HW_TICK, manifest(1)) == "replay"
    assert join.take() is None


def test_a_message_of_a_tick_that_was_missed_contradicts_none_of_an_earlier_tick() -> None:
    """Of a process that was cut off, as by a half-open link, and is admitted again behind the tick that it did last."""
    join = Join("estimator", (HW_IMU,))
    assert join.offer(HW_TICK, manifest(0), sender="a") is None
    assert join.offer(HW_IMU, imu(0), sender="a") is None
    assert join.take() is not None
    assert join.offer(HW_TICK, manifest(1, ("walker",)), sender="a") == "not_on_roster"
    again = manifest(9).model_copy(update={"mode": "paced", "roster_version": 3})
    assert join.offer(HW_TICK, again, sender="a") is None
    assert join.last == 8
    assert join.offer(HW_IMU, imu(8), sender="a") == "duplicate"
    assert join.offer(HW_IMU, imu(9), sender="a") is None
    inputs = join.take()
    assert inputs is not None
    assert inputs.tick.tick == 9
    changed = imu(9).model_copy(update={"acc": (0.0, 0.0, 0.0)})
    assert join.offer(HW_IMU, changed, sender="a") == "conflict"
