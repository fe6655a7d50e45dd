"""Raw and latched inputs, and paced time."""

import pytest

from surefoot.bus.codec import decode, encode, encoding_of
from surefoot.bus.interface import Delivery, Raw
from surefoot.bus.memory import MemoryIncoming
from surefoot.errors import Refusal
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.join import BACKLOG_TICKS, MAX_AHEAD, Delayed, Join, TickInputs
from surefoot.lockstep.service import Service
from surefoot.schemas.base import Header
from surefoot.schemas.footholds import SelectReply, SelectRequest
from surefoot.schemas.hw import JointState, Tick
from surefoot.schemas.terrain import HeightMapMessage
from surefoot.schemas.topics import (
    FOOTHOLDS_SELECT,
    HW_IMU,
    HW_TICK,
    STATE_GAIT,
    STATE_STABILITY,
    STATE_VELOCITY,
    TERRAIN_MAP,
    TICK_NS,
)
from tests.surefoot.expect import expect_error
from tests.surefoot.lockstep.node_bench import IMU, MEGABYTE, SELECT, Bench, Subject


class Keeper(Service[ServiceConfig]):
    """Takes inputs undecoded, as the recorder does."""

    name = "estimator"
    inputs = (HW_IMU, TERRAIN_MAP)
    raw = True

    def __init__(self) -> None:
        super().__init__(ServiceConfig())
        self.seen: list[dict[str, Delivery]] = []

    def on_tick(self, inputs: TickInputs) -> None:
        self.seen.append(dict(inputs.messages))


def height_map(epoch: int, version: int = 1) -> HeightMapMessage:
    message = HeightMapMessage(rows=1, cols=2, cell=0.02, origin=(0.0, 0.0), version=version, data=b"\0" * 8)
    return message.stamped(0, 0, epoch, 0, "driver")


def test_raw_inputs_are_handed_over_as_they_came() -> None:
    bench = Bench(Keeper())
    payload = encode(IMU.stamped(0, 0, 1, 0, "driver"))[0].replace(b'"acc"', b'"new":1,"acc"')
    data, attachment = encode(height_map(1))
    bench.raw(TERRAIN_MAP, data, encoding_of(HeightMapMessage), attachment)
    bench.raw(HW_IMU, payload)
    bench.tick(0)
    assert isinstance(bench.service, Keeper)
    assert bench.service.seen[0][HW_IMU.key].raw().payload == payload
    assert bench.service.seen[0][TERRAIN_MAP.key].raw() == Raw(data, attachment, encoding_of(HeightMapMessage))


@pytest.mark.parametrize("payload", [b"{", b"1" * 2 * MEGABYTE, b'{"tick":-5}'])
def test_raw_inputs_need_a_readable_header(payload: bytes) -> None:
    bench = Bench(Keeper())
    bench.raw(HW_IMU, payload)
    assert sum(bench.node.refused.values()) == 1


class Mapped(Subject):
    inputs = (HW_IMU, TERRAIN_MAP)


def test_latched_input_is_awaited_and_then_stays() -> None:
    bench = Bench(Mapped())
    bench.both(0)
    assert bench.subject.ticks == []
    assert bench.node.health().waiting_for == ("terrain/map",)
    bench.bus.publisher(TERRAIN_MAP).put(height_map(1))
    bench.node.pump()
    bench.both(1)
    assert [seen[TERRAIN_MAP.key].version for seen in bench.subject.seen] == [1, 1]


def test_a_latched_input_that_is_sent_again_is_the_same_object() -> None:
    """A driver sends it again when a member is late, at any tick: who looks for a new map must not find one."""
    bench = Bench(Mapped())
    for tick, version in enumerate((1, 1, 2)):
        bench.bus.publisher(TERRAIN_MAP).put(height_map(1, version=version))
        bench.node.pump()
        bench.both(tick)
    first, second, third = (seen[TERRAIN_MAP.key] for seen in bench.subject.seen)
    assert second is first
    assert (first.version, third.version) == (1, 2)


def test_latched_input_of_an_epoch_before_is_not_the_map() -> None:
    bench = Bench(Mapped())
    bench.bus.publisher(TERRAIN_MAP).put(height_map(1))
    bench.both(0, epoch=2)
    assert bench.subject.ticks == []
    bench.bus.publisher(TERRAIN_MAP).put(height_map(2, version=3))
    bench.node.pump()
    assert bench.subject.seen[0][TERRAIN_MAP.key].version == 3
    bench.bus.publisher(TERRAIN_MAP).put(height_map(1))
    bench.node.pump()
    assert bench.node.refused["stale_epoch"] == 1


class MapOnly(Subject):
    inputs = (TERRAIN_MAP,)

    def on_tick(self, inputs: TickInputs) -> None:
        self.ticks.append(inputs.number)


def test_who_knows_only_the_map_answers_for_any_tick_of_its_epoch() -> None:
    bench = Bench(MapOnly())
    bench.bus.publisher(TERRAIN_MAP).put(height_map(1))
    bench.tick(0)
    assert bench.subject.ticks == [0]
    now, later = (
        MemoryIncoming(FOOTHOLDS_SELECT, SelectRequest.model_validate({**SELECT, "epoch": epoch, "tick": 7}))
        for epoch in (1, 2)
    )
    bench.node.handle(now)
    bench.node.handle(later)
    assert isinstance(now.answer, SelectReply)
    assert later.answer is None
    bench.bus.publisher(TERRAIN_MAP).put(height_map(2))
    bench.tick(-1, epoch=2)
    bench.tick(0, epoch=2)
    assert isinstance(later.answer, SelectReply)


def test_paced_mode_goes_on_without_what_is_late_and_never_back(bench: Bench) -> None:
    for tick in range(4):
        bench.tick(tick, mode="paced")  # no imu at all
    assert bench.subject.ticks == [0, 1]
    bench.imu(3)
    assert bench.subject.ticks == [0, 1]
    bench.tick(4, mode="paced")
    assert bench.subject.ticks == [0, 1, 2, 3]  # in order: 2 without its sample, 3 with it
    bench.imu(2)
    bench.tick(2, mode="paced")
    assert bench.subject.ticks == [0, 1, 2, 3]


def test_services_that_await_each_other_do_every_tick_in_paced_mode_even_after_one_fell_behind() -> None:
    joins = {
        "walker": (STATE_GAIT, Join("walker", (HW_IMU, Delayed(STATE_STABILITY), Delayed(STATE_VELOCITY)))),
        "stability": (STATE_STABILITY, Join("stability", (HW_IMU, STATE_VELOCITY, Delayed(STATE_GAIT)))),
        "estimator": (STATE_VELOCITY, Join("estimator", (HW_IMU, Delayed(STATE_GAIT)))),
    }
    done: dict[str, list[int]] = {name: [] for name in joins}
    for tick in range(120):
        manifest = Tick(tick=tick, epoch=1, roster=tuple(joins), due=("hw/imu",), mode="paced", roster_version=1)
        for _, join in joins.values():
            join.offer(HW_IMU, IMU.stamped(0, tick, 1, tick, "driver"))
            join.offer(HW_TICK, manifest)
        progressed = True
        while progressed:
            progressed = False
            for name, (topic, join) in joins.items():
                if name == "walker" and 40 <= tick < 40 + 3 * BACKLOG_TICKS:
                    continue  # asleep
                if (inputs := join.take()) is None:
                    continue
                progressed = True
                done[name].append(inputs.number)
                if topic.due(inputs.number):
                    header = Header(tick=inputs.number, epoch=1, source=name)
                    for _, reader in joins.values():
                        if topic.key in reader.owners:
                            reader.offer(topic, header)
    for name, ticks in done.items():
        assert ticks[-30:] == list(range(90, 120)), name
    assert done["estimator"] == done["stability"] == list(range(120))
    assert len(done["walker"]) >= 120 - 3 * BACKLOG_TICKS


def test_whoever_gets_ticks_in_batches_leaves_none_out_in_paced_mode() -> None:
    join = Join("recorder", (HW_IMU, STATE_VELOCITY), batched=True)
    done: list[TickInputs] = []
    for first in range(0, 200, 10):
        for tick in range(first, first + 10):  # the driver's batch; the estimator's comes a whole one later
            join.offer(HW_IMU, IMU.stamped(0, tick, 1, tick, "driver"))
            roster = ("estimator", "recorder")
            manifest = Tick(tick=tick, epoch=1, roster=roster, due=("hw/imu",), mode="paced", roster_version=1)
            join.offer(HW_TICK, manifest)
        while (inputs := join.take()) is not None:
            done.append(inputs)
        for tick in range(max(0, first - 10), first):
            join.offer(STATE_VELOCITY, Header(tick=tick, epoch=1, source="estimator"))
    assert [inputs.number for inputs in done] == list(range(180))
    assert all(set(inputs.messages) == {"hw/imu", "state/velocity"} for inputs in done)


def test_paced_mode_is_never_stale_however_long_the_service_slept(bench: Bench) -> None:
    bench.both(0, mode="paced")
    for tick in range(1, 3 * MAX_AHEAD):  # all at once, as after a long sleep
        bench.imu_publisher.put(IMU.model_copy().stamped(tick * TICK_NS, tick, 1, tick, "driver"))
        bench.tick_publisher.put(
            Tick(tick=tick, epoch=1, roster=("estimator",), due=("hw/imu",), mode="paced", roster_version=1)
        )
    bench.node.pump()
    last = 3 * MAX_AHEAD - 1
    assert bench.subject.ticks[-1] == last
    assert len(bench.subject.ticks) < 10
    bench.both(last + 1, mode="paced")
    assert bench.subject.ticks[-1] == last + 1
    assert HW_IMU.key in bench.subject.seen[-1]


@pytest.mark.parametrize("mode", ["paced", "lockstep"])
def test_a_service_that_was_away_for_seconds_gets_every_input_once_it_is_admitted(bench: Bench, mode: str) -> None:
    away, back = 8 * MAX_AHEAD, 9 * MAX_AHEAD
    for tick in range(away):
        bench.imu(tick)
        bench.tick(tick, roster=("walker",), mode=mode)
    bench.both(away, mode=mode, since=(away,))
    for tick in range(away + 1, back, 3):  # three at once
        for act in (bench.imu, lambda n: bench.tick(n, mode=mode, since=(away,))):
            for number in range(tick, tick + 3):
                act(number)
    assert bench.subject.ticks == list(range(away, back))
    assert all(HW_IMU.key in seen for seen in bench.subject.seen)


def test_the_last_tick_is_done_without_what_never_comes_once_the_driver_has_repeated_it(bench: Bench) -> None:
    for tick in range(3):
        bench.both(tick, mode="paced")
    bench.tick(3, mode="paced", end=True)
    bench.tick(2, mode="paced")
    bench.tick(3, mode="paced", end=True)
    assert bench.subject.ticks == [0, 1, 2]  # what was lost may be sent again with the first repetition
    bench.tick(3, mode="paced", end=True)
    assert bench.subject.ticks == [0, 1, 2, 3]


def test_an_end_that_is_repeated_waits_in_lockstep(bench: Bench) -> None:
    for _ in range(8):
        bench.tick(0, end=True)
    assert bench.subject.ticks == []
    bench.imu(0)
    assert bench.subject.ticks == [0]


def test_joint_state_of_any_length_within_the_limit_is_read() -> None:
    with expect_error(Refusal, field="position"):
        decode(JointState, b'{"position":[' + b"0," * 100 + b"0]}")


def test_stop_ends_run_and_the_service_is_told(bench: Bench) -> None:
    bench.node.stop()
    bench.node.run()
    assert bench.subject.stopped
    assert bench.node.state == "stopping"
