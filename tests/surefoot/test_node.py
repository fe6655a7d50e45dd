"""What a node does with bad input: a named, counted refusal, an answer for whoever asks, and it goes on."""

from collections.abc import Callable
from typing import Any

import pytest

from schemas.base import Message
from schemas.footholds import AssessRequest, SelectReply, SelectRequest
from schemas.hw import Imu, JointState, Tick
from schemas.state import GaitState, VelocityEstimate
from schemas.stability import RegionReply, RegionRequest
from schemas.system import Done, Health, LogRecord
from schemas.terrain import HeightMapMessage
from schemas.topics import (
    FOOTHOLDS_ASSESS,
    FOOTHOLDS_SELECT,
    HEALTH_GET,
    HW_IMU,
    HW_TICK,
    LOG,
    STABILITY_REGION,
    STATE_GAIT,
    STATE_VELOCITY,
    TERRAIN_MAP,
    TICK_DONE,
    TICK_NS,
    Query,
    Topic,
)
from surefoot import node as runtime
from surefoot.bus import Delivery, Life, Raw
from surefoot.codec import decode, encode, encoding_of
from surefoot.config import ServiceConfig
from surefoot.errors import CallError, Refusal
from surefoot.join import DRIVER, MAX_AHEAD, Delayed, TickInputs
from surefoot.memory_bus import MemoryBus, MemoryIncoming
from surefoot.node import DONE_TICKS, KEEP_TICKS, Node
from surefoot.service import Service
from tests.surefoot.toys import estimate

MEGABYTE = 1 << 20
IMU = Imu(acc=(0.5, 0.0, 9.81), gyro=(0.0, 0.0, 0.0))
SELECT = {"base": {"position": (0.0, 0.0, 0.1), "quat_wxyz": (1.0, 0.0, 0.0, 0.0)}, "legs": [{"leg": "lf", "nominal": (0.1, 0.1, 0.0), "stroke": (-0.05, 0.0, 0.0)}]}


class Subject(Service[ServiceConfig]):
    """An estimator that also answers queries."""

    name = "estimator"
    inputs = (HW_IMU, Delayed(STATE_GAIT))
    outputs = (STATE_VELOCITY,)
    serves = (STABILITY_REGION, FOOTHOLDS_SELECT)
    calls = (FOOTHOLDS_ASSESS,)

    def __init__(self) -> None:
        super().__init__(ServiceConfig())
        self.ticks: list[int] = []
        self.seen: list[dict[str, Any]] = []
        self.resets = 0
        self.stopped = False
        self.answer: Callable[[Any], Any] = lambda request: RegionReply(
            status="infeasible", inner=(), outer=(), support=()
        )

    def on_start(self) -> None:
        self.handle(STABILITY_REGION, lambda request: self.answer(request))
        self.handle(FOOTHOLDS_SELECT, lambda request: SelectReply(legs=(), map_version=len(self.ticks), model="m"))

    def on_reset(self) -> None:
        self.resets += 1

    def on_tick(self, inputs: TickInputs) -> None:
        self.ticks.append(inputs.number)
        self.seen.append(dict(inputs.messages))
        imu = inputs.get(HW_IMU)
        self.publish(STATE_VELOCITY, estimate(0.0 if imu is None else imu.acc[0]))

    def on_stop(self) -> None:
        self.stopped = True


class Bench:
    """A node alone on a bus, with a driver made by hand."""

    def __init__(self, service: Service[Any] | None = None) -> None:
        self.bus = MemoryBus()
        self.service = service or Subject()
        self.node = Node(self.service, self.bus)
        self.node.start()
        self.out: list[Message] = []
        for topic in (STATE_VELOCITY, TICK_DONE, LOG):
            self.bus.subscribe(topic, self._keep)
        for query in (*self.service.serves, HEALTH_GET.of(self.service.name)):
            self.bus.pump_with(query, self.node.pump)
        self.tick_publisher = self.bus.publisher(HW_TICK)
        self.imu_publisher = self.bus.publisher(HW_IMU)

    @property
    def subject(self) -> Subject:
        assert isinstance(self.service, Subject)
        return self.service

    def _keep(self, delivery: Delivery) -> None:
        if not delivery.prime:
            self.out.append(delivery.message())

    def sent(self, kind: type[Message]) -> list[Any]:
        return [message for message in self.out if isinstance(message, kind)]

    def tick(self, tick: int, *, epoch: int = 1, roster: tuple[str, ...] = ("estimator",), **fields: Any) -> None:
        given = {"due": ("hw/imu",), "mode": "lockstep", "roster_version": 1, **fields}
        self.tick_publisher.put(
            Tick(tick=tick, epoch=epoch, stamp_ns=tick * TICK_NS, seq=max(tick, 0), roster=roster, **given)
        )
        self.node.pump()

    def imu(self, tick: int, *, epoch: int = 1, x: float = 0.5) -> None:
        message = Imu(acc=(x, 0.0, 9.81), gyro=(0.0, 0.0, 0.0))
        self.imu_publisher.put(message.stamped(tick * TICK_NS, tick, epoch, tick, "driver"))
        self.node.pump()

    def both(self, tick: int, **fields: Any) -> None:
        self.imu(tick, epoch=fields.get("epoch", 1))
        self.tick(tick, **fields)

    def raw(self, topic: Topic[Any], payload: bytes, encoding: str = "", attachment: bytes | None = None) -> None:
        """What comes from the network, whoever sent it."""
        self.node.handle(Delivery(topic, None, Raw(payload, attachment, encoding)))
        self.node.pump()


@pytest.fixture
def bench() -> Bench:
    return Bench()


# -- messages ----------------------------------------------------------------------------------------------------------


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
    bench.both(0, epoch=3)
    assert bench.subject.resets == 2
    assert bench.subject.ticks == [0, 0]


def test_a_new_driver_that_counts_epochs_from_one_again_resets_the_service(bench: Bench) -> None:
    bench.both(0)
    bench.both(1)
    bench.node.handle(Life(DRIVER, "old", False))
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


# -- replay ------------------------------------------------------------------------------------------------------------


def test_a_repeated_tick_brings_the_same_bytes_without_work(bench: Bench) -> None:
    for tick in range(3):
        bench.both(tick)
    first = [encode(m)[0] for m in bench.sent(VelocityEstimate)]
    bench.out.clear()
    for tick in range(3):
        bench.tick(tick)
    assert [encode(m)[0] for m in bench.sent(VelocityEstimate)] == first
    assert {(m.tick, m.instance) for m in bench.sent(Done)} == {(2, bench.node.instance)}  # how far it is
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


def test_headers_are_filled_in_by_the_runtime(bench: Bench) -> None:
    bench.both(3, epoch=7)
    (velocity,) = bench.sent(VelocityEstimate)
    assert (velocity.tick, velocity.epoch, velocity.seq, velocity.stamp_ns, velocity.source) == (
        3, 7, 3, 3 * TICK_NS, "estimator",
    )  # fmt: skip


# -- prime -------------------------------------------------------------------------------------------------------------


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
    bench.bus.serve(FOOTHOLDS_ASSESS, lambda incoming: None)
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


# -- queries -----------------------------------------------------------------------------------------------------------


class Asked(MemoryIncoming):
    """A query whose request comes as bytes."""

    def __init__(self, query: Query[Any, Any], payload: bytes, encoding: str = "") -> None:
        super().__init__(query, None)
        self.probe = False
        self._payload, self._encoding = payload, encoding

    def request(self) -> Any:
        return decode(self.query.request, self._payload, None, self._encoding)


@pytest.mark.parametrize(
    ("payload", "encoding", "code", "field"),
    [
        (b"{", "", "malformed", None),
        (b"[]", "", "invalid", None),
        (b"{}", "", "invalid", "contacts"),
        (b'{"contacts":[],"friction":1}', "", "invalid", "friction"),
        (b'{"contacts":[{"position":[0,0,0],"normal":[0,0,1],"mu":-1}]}', "", "invalid", "contacts.0.mu"),
        (b'{"contacts":[{"position":[0,0,NaN],"normal":[0,0,1],"mu":1}]}', "", "invalid", "contacts.0.position.2"),
        (b'{"contacts":"' + b"x" * 10 * MEGABYTE + b'"}', "", "too_large", None),
        (b'{"contacts":[]}', "application/json;surefoot/RegionRequest/2.0", "schema", None),
        (b'{"contacts":[]}', "application/json;surefoot/CheckRequest/1.0", "schema", None),
    ],
    ids=["cut", "list", "missing", "unknown", "negative", "nan", "10 MB", "major", "name"],
)
def test_bad_request_gets_a_typed_error(
    bench: Bench, payload: bytes, encoding: str, code: str, field: str | None
) -> None:
    asked = Asked(STABILITY_REGION, payload, encoding)
    bench.node.handle(asked)
    assert asked.error is not None
    reply = asked.error.reply()
    assert (reply.code, reply.field) == (code, field)
    assert len(reply.message) < 400
    assert bench.node.refused == {code: 1}
    again = Asked(STABILITY_REGION, b'{"contacts":[]}')
    bench.node.handle(again)
    assert isinstance(again.answer, RegionReply)


def test_a_handler_that_fails_answers_internal_and_the_node_lives(bench: Bench) -> None:
    def broken(request: RegionRequest) -> RegionReply:
        raise ZeroDivisionError("no feet")

    bench.subject.answer = broken
    with pytest.raises(CallError, match="no feet") as caught:
        bench.bus.call(STABILITY_REGION, RegionRequest(contacts=()))
    assert caught.value.code == "internal"
    assert bench.node.refused == {"internal": 1}
    bench.both(0)
    assert bench.subject.ticks == [0]


def test_a_handler_that_refuses_is_heard_under_its_own_code(bench: Bench) -> None:
    def refuses(request: RegionRequest) -> RegionReply:
        raise Refusal("refused", "not today", "contacts")

    bench.subject.answer = refuses
    with pytest.raises(CallError) as caught:
        bench.bus.call(STABILITY_REGION, RegionRequest(contacts=()))
    assert (caught.value.code, caught.value.message, caught.value.field) == ("refused", "not today", "contacts")


def test_a_request_for_a_tick_waits_until_it_is_consumed(bench: Bench) -> None:
    bench.both(0)
    asked = MemoryIncoming(FOOTHOLDS_SELECT, SelectRequest.model_validate({"tick": 1, "epoch": 1, **SELECT}))
    bench.node.handle(asked)
    assert asked.answer is None
    bench.both(1)
    assert isinstance(asked.answer, SelectReply)
    assert asked.answer.map_version == 2
    at_once = MemoryIncoming(FOOTHOLDS_SELECT, SelectRequest.model_validate({"tick": 1, **SELECT}))
    bench.node.handle(at_once)
    assert at_once.answer is not None


def test_a_request_for_a_tick_that_does_not_come_is_not_ready(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.both(0)
    asked = MemoryIncoming(FOOTHOLDS_SELECT, SelectRequest.model_validate({"tick": 10**6, "epoch": 1, **SELECT}))
    bench.node.handle(asked)
    bench.node._timers()
    assert asked.error is None
    monkeypatch.setattr(runtime, "NOT_READY_S", 0.0)
    bench.node._timers()
    assert asked.error is not None
    assert asked.error.code == "not_ready"


def test_probe_is_answered_without_a_request(bench: Bench) -> None:
    incoming = MemoryIncoming(STABILITY_REGION, None)
    bench.node.handle(incoming)
    assert incoming.answer is None
    assert incoming.error is None
    assert bench.node.counts[STABILITY_REGION.key] == 0


def test_nobody_there_and_nobody_answers() -> None:
    bus = MemoryBus()
    with pytest.raises(CallError) as caught:
        bus.call(STABILITY_REGION, RegionRequest(contacts=()))
    assert caught.value.code == "absent"
    bus.serve(STABILITY_REGION, lambda incoming: None)
    with pytest.raises(CallError) as caught:
        bus.call(STABILITY_REGION, RegionRequest(contacts=()))
    assert caught.value.code == "timeout"


def test_a_call_within_a_tick_goes_only_to_the_roster(bench: Bench) -> None:
    request = AssessRequest.model_construct()
    with pytest.raises(CallError) as caught:
        bench.node.call(FOOTHOLDS_ASSESS, request, None)
    assert caught.value.code == "absent"
    with pytest.raises(ValueError, match="does not declare"):
        bench.node.call(STABILITY_REGION, RegionRequest(contacts=()), None)


def test_health_is_asked_like_any_query_and_counts_refusals_by_name(bench: Bench) -> None:
    bench.raw(HW_IMU, b"{")
    health: Health = bench.bus.call(HEALTH_GET.of("estimator"), HEALTH_GET.request()).health
    assert health.refused == {"malformed": 1}
    assert health.instance == bench.node.instance
    assert health.state == "joining"


# -- declarations ------------------------------------------------------------------------------------------------------


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


# -- raw, latched, paced -----------------------------------------------------------------------------------------------


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


def test_paced_mode_goes_on_without_what_is_late_and_never_back(bench: Bench) -> None:
    for tick in range(4):
        bench.tick(tick, mode="paced")  # no imu at all
    assert bench.subject.ticks == [0, 1]
    bench.imu(3)
    assert bench.subject.ticks == [0, 1, 3]
    bench.imu(2)
    bench.tick(2, mode="paced")
    assert bench.subject.ticks == [0, 1, 3]


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


def test_joint_state_of_any_length_within_the_limit_is_read() -> None:
    with pytest.raises(Refusal) as caught:
        decode(JointState, b'{"position":[' + b"0," * 100 + b"0]}")
    assert caught.value.field == "position"


def test_stop_ends_run_and_the_service_is_told(bench: Bench) -> None:
    bench.node.stop()
    bench.node.run()
    assert bench.subject.stopped
    assert bench.node.state == "stopping"


