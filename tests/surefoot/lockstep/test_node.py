"""Bad input to a node is a named, counted refusal, and the node goes on."""

import pytest

from surefoot.bus.codec import encode
from surefoot.bus.interface import Life
from surefoot.bus.memory import MemoryBus
from surefoot.lockstep.join import DRIVER, MAX_AHEAD
from surefoot.lockstep.leader import KEEP_TICKS
from surefoot.lockstep.node import Node
from surefoot.schemas.state import GaitState, VelocityEstimate
from surefoot.schemas.system import Done, LogRecord
from surefoot.schemas.topics import FOOTHOLDS_ASSESS, HW_IMU, HW_TICK, STATE_GAIT, STATE_VELOCITY, TICK_NS
from tests.surefoot.lockstep.node_bench import IMU, MEGABYTE, Bench, Subject


@pytest.mark.parametrize(
    ("payload", "encoding", "reason"),
    [
        (b"{", "", "malformed"),
        (b"\xff\xfe\x00", "", "malformed"),
        (b"[" * 100_000, "", "malformed"),
        (b'{"acc":[0,0,NaN],"gyro":[0,0,0]}', "", "invalid"),
        (b'{"acc":[0,0,Infinity],"gyro":[0,0,0]}', "", "invalid"),
        (b'{"acc":[0,0],"gyro":[0,0,0]}', "", "invalid"),
        (b'{"acc":[0,0,0],"gyro":[0,0,0],"tick":-7}', "", "invalid"),
        (b'{"acc":"' + b"9" * 10 * MEGABYTE + b'"}', "", "too_large"),
        (encode(IMU)[0], "application/json;surefoot/Imu/2.0", "schema"),
        (encode(IMU)[0], "application/json;surefoot/JointState/1.0", "schema"),
    ],
    ids=["cut", "binary", "deep", "nan", "inf", "short", "negative", "10 MB", "major", "name"],
)
def test_bad_message_is_counted_told_once_and_the_node_goes_on(
    bench: Bench, payload: bytes, encoding: str, reason: str
) -> None:
    bench.both(0)
    for _ in range(3):
        bench.raw(HW_IMU, payload, encoding)
    assert bench.node.refused == {reason: 3}
    assert [(log.level, "hw/imu" in log.text) for log in bench.sent(LogRecord)] == [("warning", True)]
    assert len(bench.sent(LogRecord)[0].text) < 400
    bench.both(1)
    assert bench.subject.ticks == [0, 1]


def test_generic_encoding_means_the_current_schema(bench: Bench) -> None:
    bench.raw(HW_IMU, encode(IMU.stamped(0, 0, 1, 0, "driver"))[0], "zenoh/bytes")
    bench.tick(0)
    assert bench.subject.ticks == [0]
    assert not bench.node.refused


def test_bad_tick_is_counted_and_the_next_good_one_is_taken(bench: Bench) -> None:
    bench.raw(HW_TICK, b'{"tick":0}')
    bench.raw(HW_TICK, b"x" * 2 * MEGABYTE)
    bench.both(0)
    assert bench.node.refused == {"invalid": 1, "too_large": 1}
    assert bench.subject.ticks == [0]


def test_ticks_and_stamps_that_go_back_are_not_taken_again(bench: Bench) -> None:
    for tick in range(5):
        bench.both(tick)
    before = list(bench.subject.seen)
    bench.imu(2, x=99.0)
    bench.imu(4, x=99.0)
    bench.tick(2)
    assert bench.subject.ticks == [0, 1, 2, 3, 4]
    assert bench.subject.seen == before


def test_first_of_two_messages_of_one_tick_counts(bench: Bench) -> None:
    bench.imu(0, x=1.0)
    bench.imu(0, x=2.0)
    bench.tick(0)
    assert bench.subject.seen[0][HW_IMU.key].acc[0] == 1.0


def test_too_far_ahead_is_refused(bench: Bench) -> None:
    bench.both(0)
    bench.imu(MAX_AHEAD + 1)
    assert bench.node.refused == {"too_far_ahead": 1}
    bench.imu(10**18)
    bench.tick(10**18)
    assert bench.node.refused == {"too_far_ahead": 3}
    bench.both(1)
    assert bench.subject.ticks == [0, 1]


def test_stale_epoch_is_refused_and_a_new_one_drops_the_state(bench: Bench) -> None:
    bench.both(0, epoch=2)
    bench.imu(1, epoch=1)
    bench.tick(1, epoch=1)
    assert bench.node.refused == {"stale_epoch": 2}
    assert bench.subject.resets == 1
    bench.tick(-1, epoch=3)
    bench.both(0, epoch=3)
    assert bench.subject.resets == 2
    assert bench.subject.ticks == [0, 0]


def test_a_new_driver_that_counts_epochs_from_one_again_resets_the_service(bench: Bench) -> None:
    bench.both(0)
    bench.both(1)
    bench.prime_as("old")
    bench.node.handle(Life(DRIVER, "old", False))
    bench.both(0)
    assert bench.subject.resets == 1  # out of sight is not gone
    bench.prime_as("new")
    bench.both(0)
    assert bench.subject.resets == 2
    assert bench.subject.ticks == [0, 1, 0]


def test_nobody_fills_the_memory_of_a_node_that_is_not_on_the_roster(bench: Bench) -> None:
    for tick in range(2000):
        bench.imu(tick)
        bench.tick(tick, roster=("walker",))
    assert len(bench.node.join._slots) <= 4 * MAX_AHEAD
    assert not bench.node.join._ticks
    assert bench.subject.ticks == []


def test_inputs_of_absent_services_are_not_awaited(bench: Bench) -> None:
    bench.both(0, roster=("estimator", "walker"))
    bench.both(1, roster=("estimator", "walker"))
    assert bench.subject.ticks == [0]  # state/gait of tick 0 is owed
    assert bench.node.health().waiting_for == ("state/gait",)
    bench.tick(1, roster=("estimator",), roster_version=2)
    assert bench.subject.ticks == [0, 1]


def test_delayed_input_is_that_of_the_tick_before(bench: Bench) -> None:
    roster = ("estimator", "walker")
    gait = bench.bus.publisher(STATE_GAIT)
    for tick in range(3):
        bench.both(tick, roster=roster)
        message = GaitState(walk_id=tick, state="walking", phase=0.0, stance=(), footholds=(), remaining=0.0)
        gait.put(message.stamped(tick * TICK_NS, tick, 1, tick, "walker"))
        bench.node.pump()
    assert [seen[STATE_GAIT.key].walk_id for seen in bench.subject.seen[1:]] == [0, 1]


def test_a_repeated_tick_brings_the_same_bytes_without_work(bench: Bench) -> None:
    for tick in range(3):
        bench.both(tick)
    first = [encode(m)[0] for m in bench.sent(VelocityEstimate)]
    bench.out.clear()
    for tick in range(3):
        bench.tick(tick)
    assert [encode(m)[0] for m in bench.sent(VelocityEstimate)] == first
    assert {(m.tick, m.instance) for m in bench.sent(Done)} == {(t, bench.node.instance) for t in range(3)}
    assert bench.subject.ticks == [0, 1, 2]


def test_outputs_are_kept_for_so_many_ticks_and_no_more(bench: Bench) -> None:
    for tick in range(KEEP_TICKS + 5):
        bench.both(tick)
    bench.out.clear()
    bench.tick(0)
    assert bench.sent(VelocityEstimate) == []
    assert len(bench.node._outbox) <= KEEP_TICKS
    bench.tick(KEEP_TICKS + 4)
    assert len(bench.sent(VelocityEstimate)) == 1


def test_outputs_of_a_service_that_leaves_ticks_out_are_kept_no_longer(bench: Bench) -> None:
    for tick in range(0, 9 * KEEP_TICKS, 3):
        bench.both(tick, mode="paced")
    assert bench.subject.ticks[-1] == tick
    assert len(bench.subject.ticks) > 2 * KEEP_TICKS
    assert len(bench.node._outbox) <= KEEP_TICKS


def test_headers_are_filled_in_by_the_runtime(bench: Bench) -> None:
    bench.both(3, epoch=7, since=(3,))
    (velocity,) = bench.sent(VelocityEstimate)
    assert (velocity.tick, velocity.epoch, velocity.seq, velocity.stamp_ns, velocity.source) == (
        3, 7, 3, 3 * TICK_NS, "estimator",
    )  # fmt: skip


def test_a_topic_is_published_at_the_rate_of_its_row(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(vars(STATE_VELOCITY), "period_ticks", 2)
    for tick in range(6):
        bench.both(tick)
    assert bench.subject.ticks == list(range(6))
    assert [(m.tick, m.seq) for m in bench.sent(VelocityEstimate)] == [(0, 0), (2, 1), (4, 2)]


def test_prime_is_answered_once_every_link_is_proved(bench: Bench) -> None:
    primes: list[str] = []
    bench.bus.subscribe(STATE_VELOCITY, lambda d: primes.append(d.topic.key) if d.prime else None)
    roster = ("estimator", "footholds", "walker")
    bench.tick(-1, roster=roster, due=())
    assert primes == ["state/velocity"]
    assert bench.sent(Done) == []
    assert bench.node.health().waiting_for == ("footholds/assess", "hw/imu", "state/gait")
    bench.bus.publisher(STATE_GAIT).prime()
    bench.imu_publisher.prime()
    bench.bus.serve(FOOTHOLDS_ASSESS, lambda incoming: None, instance="f")
    bench.bus.announce("footholds", "f")
    bench.tick(-1, roster=roster, due=())
    (done,) = bench.sent(Done)
    assert (done.tick, done.ready, done.instance) == (-1, True, bench.node.instance)
    assert bench.node.health().state == "ready"
    assert bench.node.health().waiting_for == ()
    assert bench.node.join.last == -1  # PRIME is no tick


def test_links_to_services_that_are_not_there_are_not_awaited(bench: Bench) -> None:
    bench.imu_publisher.prime()
    bench.tick(-1, due=())
    assert len(bench.sent(Done)) == 1


def test_undeclared_use_is_an_error_of_the_programmer(bench: Bench) -> None:
    with pytest.raises(ValueError, match="does not declare"):
        bench.service.publish(STATE_GAIT, GaitState.model_construct())
    with pytest.raises(ValueError, match="does not declare"):
        bench.service.handle(FOOTHOLDS_ASSESS, lambda request: None)  # type: ignore[arg-type,return-value]


def test_a_declared_query_needs_its_handler() -> None:
    class Forgetful(Subject):
        def on_start(self) -> None:
            return

    with pytest.raises(ValueError, match="registered no handler"):
        Node(Forgetful(), MemoryBus()).start()
