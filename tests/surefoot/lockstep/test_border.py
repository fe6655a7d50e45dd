"""Freshness at the border: what is forged, misplaced in time or of an unknown process changes nothing."""

import pytest

from surefoot.bus.codec import encode
from surefoot.bus.frame import Frame, FramePart, pack
from surefoot.bus.interface import Delivery, Life, Raw, Stamp
from surefoot.lockstep.binding import MOST_TRIED, Bindings, is_prime
from surefoot.lockstep.commands import STALE_TICKS
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.join import DRIVER, MISLED_PRIMES
from surefoot.schemas.hw import Imu, JointCommand
from surefoot.schemas.system import Done, JoinRequest, LogRecord
from surefoot.schemas.topics import CMD_JOINTS, HW_IMU, HW_TICK, SIM_JOIN, STATE_VELOCITY, TICK_DONE, TICK_NS
from tests.surefoot.lockstep.driver_bench import Bench as DriverBench
from tests.surefoot.lockstep.driver_bench import reference
from tests.surefoot.lockstep.node_bench import Bench
from tests.surefoot.net import Inbox, Net, wait_until
from tests.surefoot.toys import ToyWalker, estimate


@pytest.fixture
def bench() -> Bench:
    made = Bench()
    made.prime_as("real")
    return made


def walk(bench: Bench, ticks: range, epoch: int = 1) -> None:
    for tick in ticks:
        bench.imu(tick, epoch=epoch)
        bench.signed_tick("real", tick, epoch=epoch)


def test_frames_before_the_links_were_proved_count_only_where_their_process_is_never_bound() -> None:
    """As when a system starts: services publish before all of them have seen each other's primes."""
    bench = Bench()
    for tick in range(3):
        bench.signed_tick("real", tick)
        bench.signed_tick("stranger", tick)
    assert bench.node.refused == {"unbound": 6}
    bench.prime_as("real")
    assert bench.node.refused == {"unbound": 3}
    walk(bench, range(2))
    assert (bench.subject.ticks, bench.node.refused) == ([0, 1], {"unbound": 3})
    assert not [message for message in bench.out if isinstance(message, LogRecord) and "refused" in message.text]


def test_ticks_before_a_service_was_admitted_are_not_counted_once_it_is(bench: Bench) -> None:
    for tick in range(3):
        bench.signed_tick("real", tick, roster=("walker",))
    assert bench.node.refused == {"not_on_roster": 3}
    bench.imu(3)
    bench.signed_tick("real", 3, version=2, since=(3,))
    assert (bench.subject.ticks, bench.node.refused) == ([3], {})


def test_a_tick_of_an_older_roster_that_comes_late_takes_no_service_off_the_newer_one(bench: Bench) -> None:
    bench.signed_tick("real", 2, version=1, roster=("walker",))
    for tick in (3, 4):
        bench.imu(tick)
        bench.signed_tick("real", tick, version=2, since=(3,))
    bench.signed_tick("real", 2, version=1, roster=("walker",))
    bench.imu(5)
    bench.signed_tick("real", 5, version=2, since=(3,))
    assert bench.subject.ticks == [3, 4, 5]
    assert bench.node.join.on_roster
    bench.signed_tick("real", 5, version=3, roster=("walker",))
    assert not bench.node.join.on_roster


def test_a_manifest_of_a_far_epoch_by_a_stranger_is_refused(bench: Bench) -> None:
    walk(bench, range(3))
    bench.signed_tick("stranger", 0, epoch=10**9)
    walk(bench, range(3, 6))
    assert bench.subject.ticks == list(range(6))
    assert bench.node.refused["unbound"] == 1


@pytest.mark.parametrize("epoch", [2, 10**9])
def test_an_epoch_that_the_driver_has_not_primed_is_refused_and_the_primed_one_obeyed(bench: Bench, epoch: int) -> None:
    """As from somebody who copies the name of the driver's process."""
    walk(bench, range(3))
    bench.signed_tick("real", 500, epoch=epoch)
    assert bench.node.refused == {"epoch_ahead": 1}
    logged = [record.text for record in bench.sent(LogRecord)]
    assert any("hw/tick of epoch" in text and "by process 'real'" in text for text in logged)
    walk(bench, range(3, 6))
    assert (bench.subject.ticks, bench.subject.resets) == (list(range(6)), 1)
    bench.signed_tick("real", -1, epoch=2)
    walk(bench, range(2), epoch=2)
    assert bench.subject.resets == 2


def test_a_flood_of_the_next_epoch_displaces_nothing_of_this_one(bench: Bench) -> None:
    bench.imu(0)
    for ahead in range(300):
        bench.imu(ahead, epoch=2)
    walk(bench, range(4))
    assert bench.subject.ticks == list(range(4))
    bench.signed_tick("real", -1, epoch=2)
    bench.imu(4)
    for ahead in range(300):
        bench.imu(ahead, epoch=2)
    walk(bench, range(4, 6))
    assert bench.subject.ticks == list(range(6))


def test_a_reset_heals_a_service_that_followed_forged_primes_and_ticks_of_the_next_run(bench: Bench) -> None:
    """Whoever copies the name of the driver's process can lead a service away, but not for longer than this run."""
    walk(bench, range(3))
    bench.signed_tick("real", -1, epoch=2)
    bench.imu(500, epoch=2)
    bench.signed_tick("real", 500, epoch=2, since=(500,))
    assert bench.subject.ticks[-1] == 500
    for _ in range(MISLED_PRIMES):
        assert bench.node.join.last == 500
        bench.signed_tick("real", -1, epoch=2, version=0)
    assert bench.node.join.last == -1
    walk(bench, range(3), epoch=2)
    assert bench.subject.ticks[-3:] == [0, 1, 2]
    assert bench.subject.resets == 3
    assert bench.node.refused["misled"] == MISLED_PRIMES - 1


def test_a_late_copy_of_a_prime_does_not_reset_a_run(bench: Bench) -> None:
    walk(bench, range(3))
    bench.signed_tick("real", -1, epoch=1, version=0)
    walk(bench, range(3, 5))
    bench.signed_tick("real", -1, epoch=1, version=0)
    walk(bench, range(5, 7))
    assert (bench.subject.ticks, bench.subject.resets) == (list(range(7)), 1)


@pytest.mark.parametrize("epoch", [1, 7])
def test_a_prime_heals_whatever_epoch_went_before(bench: Bench, epoch: int) -> None:
    """A service that missed some epochs, or was in a far one, follows the driver that primes."""
    walk(bench, range(2), epoch=1)
    bench.signed_tick("real", -1, epoch=2)
    walk(bench, range(2), epoch=2)
    bench.signed_tick("real", -1, epoch=epoch)
    walk(bench, range(2), epoch=epoch)
    assert bench.subject.resets == 3
    assert bench.node.epoch == epoch


def test_a_token_alone_or_a_second_driver_changes_nothing(bench: Bench) -> None:
    walk(bench, range(2))
    bench.node.handle(Life(DRIVER, "x", True))
    bench.signed_tick("x", -1, epoch=1)
    bench.signed_tick("x", 2, epoch=1)
    bench.node.handle(Life(DRIVER, "x", False))
    walk(bench, range(2, 4))
    assert bench.subject.ticks == [0, 1, 2, 3]
    assert bench.node.refused["unbound"] == 2


def test_a_driver_out_of_sight_for_a_while_is_the_same_one(bench: Bench) -> None:
    walk(bench, range(2))
    bench.node.handle(Life(DRIVER, "real", False))
    walk(bench, range(2, 3))
    bench.node.handle(Life(DRIVER, "real", True))
    walk(bench, range(3, 5))
    assert (bench.subject.ticks, bench.subject.resets) == ([0, 1, 2, 3, 4], 1)


@pytest.mark.parametrize("stamp_ns", [2**62, -(2**62), 10**10])
def test_a_stamp_outside_the_run_is_refused(bench: Bench, stamp_ns: int) -> None:
    walk(bench, range(2))
    forged = Imu(acc=(9.0, 0.0, 0.0), gyro=(0.0, 0.0, 0.0)).stamped(stamp_ns, 2, 1, 2, "driver")
    bench.node.handle(Delivery(HW_IMU, forged, None))
    walk(bench, range(2, 4))
    assert [message.velocity[0] for message in bench.sent(type(estimate(0.0)))] == [0.5] * 4
    assert bench.node.refused == {"stamp": 1}


@pytest.mark.parametrize(("instance", "obeyed"), [("real", True), ("stranger", False), ("", False)])
def test_a_frame_is_obeyed_of_the_process_one_is_bound_to_only(bench: Bench, instance: str, obeyed: bool) -> None:
    """As messages come over the network: several of a service as one, with the name of the process."""
    walk(bench, range(2))
    forged = Imu(acc=(9.0, 0.0, 0.0), gyro=(0.0, 0.0, 0.0)).stamped(2 * TICK_NS, 2, 1, 2, "driver")
    part = FramePart(HW_IMU.key, encode(forged)[0], Stamp(2, 1, 2 * TICK_NS, 2))
    bench.node.handle(Frame(HW_IMU.owner, {HW_IMU.key: HW_IMU}, *pack([part], instance)))
    walk(bench, range(2, 4))
    expected = [0.5, 0.5, 9.0 if obeyed else 0.5, 0.5]
    assert [message.velocity[0] for message in bench.sent(type(estimate(0.0)))] == expected
    assert bench.node.refused == ({} if obeyed else {"unbound": 1})


@pytest.fixture
def driven(no_waiting: None) -> DriverBench:
    return DriverBench(at=10)


@pytest.mark.parametrize("topic", [CMD_JOINTS, STATE_VELOCITY])
def test_a_message_of_another_process_is_not_obeyed(driven: DriverBench, topic: object) -> None:
    """Whoever publishes it before its owner."""
    for ahead in range(4):
        tick = driven.leader.tick + ahead
        header = (tick * TICK_NS, tick, 1, tick, "forger")
        forged = JointCommand(position=(30.0,)) if topic is CMD_JOINTS else estimate(40.0)
        driven.bus.publisher(topic, "forger").put(forged.stamped(*header))  # type: ignore[arg-type, call-overload]
    assert driven.finish(40) == reference(40)
    refused = sum((node.refused for node in driven.system.nodes), driven.node.refused.copy())
    assert refused["unbound"] > 0


def test_ready_of_another_process_replaces_no_member(driven: DriverBench) -> None:
    before = driven.leader.members["walker"].instance
    driven.node.handle(Delivery(TICK_DONE, Done(tick=-1, epoch=1, source="walker", instance="x", ready=True), None))
    driven.bus.announce("walker", "x")
    driven.node.handle(Delivery(TICK_DONE, Done(tick=-1, epoch=1, source="walker", instance="x", ready=True), None))
    assert driven.finish(40) == reference(40)
    assert driven.leader.members["walker"].instance == before


def test_nobody_joins_without_a_token(driven: DriverBench) -> None:
    reply = driven.bus.call(SIM_JOIN, JoinRequest(service="viewer", instance="x"))
    assert not reply.accepted
    assert "token" in reply.reason


def test_a_member_out_of_sight_goes_on_where_it_was(driven: DriverBench) -> None:
    """The lease of a paused process is over; it is the same process that returns."""
    walker = next(node for node in driven.system.nodes if node.name == "walker")
    driven.node.on_life(Life("walker", walker.instance, False))
    assert driven.leader.state == "holding"
    driven.node.on_life(Life("walker", walker.instance, True))
    assert driven.leader.state == "running"
    assert driven.finish(40) == reference(40)


def test_a_command_from_the_far_future_does_not_deafen_the_driver(driven: DriverBench) -> None:
    tick = driven.leader.tick
    command = JointCommand(position=(1.0,)).stamped(2**62, tick, 1, tick, "walker")
    driven.node.handle(Delivery(CMD_JOINTS, command, None))
    assert driven.node.refused["stamp"] == 1
    driven.finish(40)
    assert driven.node.refused["stamp"] == 1
    assert driven.node.refused["stamp_back"] == 0


def test_a_lost_stream_of_commands_is_reported_in_the_manifest_and_ends(no_waiting: None) -> None:
    bench = DriverBench(mode="paced", policy="degrade", at=30)
    bench.until(lambda: bench.node.commands.known(bench.leader.tick - 1))
    walker = bench.kill("walker")
    lost_at = bench.leader.tick
    bench.until_tick(lost_at + 30)
    held = [tick.tick for tick in bench.ticks if tick.held]
    assert held == list(range(held[0], held[-1] + 1))
    assert STALE_TICKS <= held[0] - lost_at <= STALE_TICKS + 4
    new = bench.revive(ToyWalker(ServiceConfig()))
    bench.bus.call(SIM_JOIN, JoinRequest(service="walker", instance=new.instance))
    bench.until(lambda: not bench.ticks[-1].held)
    assert new.instance != walker.instance


def test_frames_name_their_process(net: Net) -> None:
    reader, writer, inbox = net.open(), net.open(), Inbox()
    reader.take((HW_IMU,), inbox.put)
    publisher = writer.publisher(HW_IMU, "me")
    wait_until(lambda: bool(publisher._framer._frames.matching_status.matching))  # type: ignore[union-attr]
    publisher.put(Imu(acc=(0.0, 0.0, 9.81), gyro=(0.0, 0.0, 0.0)).stamped(0, 0, 1, 0, "simulator"))
    assert inbox.get().instance == "me"


def test_a_process_without_a_token_is_bound_to_nothing() -> None:
    bindings = Bindings()
    assert not bindings.bind("walker", "x")
    bindings.on_life(Life("walker", "x", True))
    assert bindings.bind("walker", "x")
    assert not bindings.bind("walker", "y")
    assert bindings.bound == {"walker": "x"}


def test_a_damaged_manifest_proves_no_link() -> None:
    assert is_prime(Delivery(HW_TICK, None, Raw(b"", None, "")))
    assert not is_prime(Delivery(HW_TICK, None, Raw(b"{", None, "")))


def test_of_many_processes_with_a_token_few_are_tried_at_a_time_the_newest_first_and_each_in_turn() -> None:
    bindings = Bindings()
    for number in range(100):
        bindings.on_life(Life("estimator", f"stranger {number}", True))
    bindings.on_life(Life("estimator", "real", True))
    tried = [bindings.candidates("estimator") for _ in range(34)]
    assert tried[0] == ("real", "stranger 99", "stranger 98")
    assert {len(names) for names in tried} == {MOST_TRIED}
    assert {name for names in tried for name in names} == {"real", *(f"stranger {number}" for number in range(100))}
    assert bindings.bind("estimator", "real")
    assert bindings.candidates("estimator") == ("real",)


def test_large_frames_before_a_process_is_bound_count_only_where_it_never_is() -> None:
    bench = Bench()
    for process in ("real", "stranger"):
        index = f"{process};" + ";".join(["hw/imu,0,5,1,0,0"] * 2000)
        bench.node.handle(Frame("driver", {HW_IMU.key: HW_IMU}, b"[]", index.encode()))
    assert bench.node.refused == {"unbound": 2}
    bench.prime_as("real")
    assert bench.node.refused == {"unbound": 1}
    assert not [message for message in bench.out if isinstance(message, LogRecord) and "refused" in message.text]
    bench.node.handle(Frame("driver", {HW_IMU.key: HW_IMU}, b"[]", index.encode()))
    (logged,) = [message for message in bench.out if isinstance(message, LogRecord) and "refused" in message.text]
    assert "by 'stranger', to which the driver is not bound" in logged.text
