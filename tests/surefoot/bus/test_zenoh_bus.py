"""The bus over Zenoh, sessions of this process on a loopback port: typed, bounded, and an answer for every question."""

import itertools
import json
import time
from queue import Empty
from typing import Any

import pytest
import zenoh

from surefoot.bus import options
from surefoot.bus.codec import encode, encoding_of
from surefoot.bus.interface import Delivery, Incoming, Life
from surefoot.bus.publish import FramedPublisher
from surefoot.bus.zenoh import BOUNDED_KEEP, ZenohBus, ZenohOptions, zenoh_config
from surefoot.errors import BusError, CallError, Refusal
from surefoot.schemas import topics
from surefoot.schemas.base import Request, Wire
from surefoot.schemas.hw import Imu
from surefoot.schemas.sim import FeaturesReply, FeaturesRequest
from surefoot.schemas.stability import RegionReply, RegionRequest
from surefoot.schemas.system import Health
from surefoot.schemas.terrain import HeightMapMessage, MapRequest
from tests.ports import free_address
from tests.surefoot.expect import expect_error
from tests.surefoot.net import WAIT_S, Inbox, Net, matched, own, reached, serve, wait_until
from tests.surefoot.toys import estimate

IMU = Imu(acc=(0.1, -1 / 3, 9.81), gyro=(1e-17, 0.0, -5.5), stamp_ns=7, tick=0, epoch=1, seq=0, source="driver")
EMPTY = RegionReply(status="infeasible", inner=(), outer=(), support=())


# -- topics ------------------------------------------------------------------------------------------------------------


def test_message_arrives_as_it_was(net: Net) -> None:
    inbox, tool = Inbox(), net.open("client")
    tool.subscribe(topics.HW_IMU, inbox.put)
    publisher = matched(net.open(), topics.HW_IMU)
    token = publisher.put(IMU)
    delivery: Delivery = inbox.get()
    assert delivery.message() == IMU
    assert delivery.raw().payload == encode(IMU)[0]
    publisher.resend(token)
    assert inbox.get().raw() == delivery.raw()


def test_a_reader_that_looks_now_and_then_gets_the_newest(net: Net) -> None:
    inbox, tool = Inbox(), net.open("client")
    look = tool.newest(topics.HW_IMU)
    tool.subscribe(topics.HW_IMU, inbox.put)
    publisher = matched(net.open(), topics.HW_IMU)
    for seq in range(5):
        publisher.put(IMU.model_copy(update={"seq": seq}))
    assert [inbox.get().message().seq for _ in range(5)] == [*range(5)]  # type: ignore[attr-defined]
    found: list[Delivery] = []
    wait_until(lambda: (one := look()) is not None and not found.append(one) and one.header().seq == 4)
    assert look() is None


def test_message_says_what_it_is(net: Net) -> None:
    inbox = Inbox()
    with net.plain() as stranger:
        heard = stranger.declare_subscriber(f"{net.namespace}/hw/imu", lambda sample: inbox.put(str(sample.encoding)))
        matched(net.open(), topics.HW_IMU).put(IMU)
        assert inbox.get() == "application/json;surefoot/Imu/1.0"
        heard.undeclare()


def test_array_travels_raw_beside_its_header(net: Net) -> None:
    inbox, tool = Inbox(), net.open()
    tool.subscribe(topics.TERRAIN_MAP, inbox.put)
    data = bytes(range(256)) * 4096  # 1 MiB
    message = HeightMapMessage(rows=512, cols=512, cell=0.02, origin=(-1.0, 2.0), data=data)
    publisher = matched(net.open(), topics.TERRAIN_MAP)

    def arrived() -> bool:
        publisher.put(message)  # again and again: for an observer on a busy machine it may be dropped
        try:
            found.append(inbox.queue.get(timeout=1.0))
        except Empty:
            return False
        return True

    found: list[Delivery] = []
    wait_until(arrived)
    delivery = found[0]
    assert delivery.raw().payload == data
    assert delivery.message() == message
    assert delivery.header().stamp_ns == 0


def test_order_of_one_key_is_kept_and_participants_lose_nothing(net: Net) -> None:
    """An observer may lose messages (on a busy machine it does); those that reach it are in order."""
    frames, observer, reader, owner = Inbox(), Inbox(), net.open(), net.open()
    reader.take((topics.STATE_VELOCITY,), frames.put)
    reader.subscribe(topics.STATE_VELOCITY, observer.put)
    publisher = matched(owner, topics.STATE_VELOCITY)
    frames_of: Any = owner._framers["estimator"]._frames
    wait_until(lambda: frames_of.matching_status.matching)
    ticks = itertools.count()

    def put() -> int:
        tick = next(ticks)
        publisher.put(estimate(0.0).stamped(0, tick, 1, tick, "estimator"))
        return tick

    while put() < 499:
        pass
    assert [frames.get().deliveries()[0].header().tick for _ in range(500)] == list(range(500))
    heard: list[int] = []

    def came_after() -> bool:
        put()
        while not observer.queue.empty():
            heard.append(observer.get().header().tick)
        return bool(heard) and heard[-1] >= 500

    wait_until(came_after)
    assert heard == sorted(set(heard))


def velocities(bus: ZenohBus, publishers: list[Any], tick: int, *, batch: bool) -> None:
    bus.cork()
    for publisher in publishers:
        publisher.put(estimate(0.0).stamped(tick * 10, tick, 1, tick, "estimator"))
    bus.flush(batch=batch)


def test_participants_get_a_tick_in_one_piece_and_a_batch_when_it_is_full(net: Net) -> None:
    ticks, batches, owner = Inbox(), Inbox(), net.open()
    both = (topics.STATE_VELOCITY, topics.STATE_VELOCITY_EKF)
    net.open().take(both, ticks.put)
    net.open().take(both, batches.put, batched=True)
    publishers = [owner.publisher(topic) for topic in both]
    framer: Any = owner._framers["estimator"]
    wait_until(lambda: framer._frames.matching_status.matching and framer._batches.matching_status.matching)
    for tick in range(10):
        velocities(owner, publishers, tick, batch=tick % 5 == 4)
    for tick in range(10):
        deliveries = ticks.get().deliveries()
        assert [(d.topic, d.header().tick) for d in deliveries] == [(topic, tick) for topic in both]
        assert deliveries[0].message() == estimate(0.0).stamped(tick * 10, tick, 1, tick, "estimator")
    for first in (0, 5):
        heads = [d.header() for d in batches.get().deliveries()]
        assert [(head.tick, head.stamp_ns, head.seq) for head in heads] == [
            (tick, tick * 10, tick) for tick in range(first, first + 5) for _ in both
        ]
    owner.cork()
    for publisher in publishers:
        publisher.prime()
    owner.flush()
    assert [d.prime for d in ticks.get().deliveries()] == [True, True]
    assert [d.prime for d in batches.get().deliveries()] == [True, True]


def test_onlookers_hear_the_topic_itself_from_when_they_listen(net: Net) -> None:
    inbox, owner = Inbox(), net.open()
    publisher = owner.publisher(topics.STATE_VELOCITY)
    velocities(owner, [publisher], 0, batch=True)  # no process listens
    net.open("client").subscribe(topics.STATE_VELOCITY, inbox.put)
    assert isinstance(publisher, FramedPublisher)
    wait_until(lambda: publisher.watched)
    velocities(owner, [publisher], 1, batch=False)
    assert inbox.get().header().tick == 1


def test_namespaces_do_not_hear_each_other(net: Net) -> None:
    mine, other = Inbox(), Inbox()
    net.open(namespace="test/other").subscribe(topics.HW_IMU, other.put)
    net.open().subscribe(topics.HW_IMU, mine.put)
    matched(net.open(), topics.HW_IMU).put(IMU)
    assert mine.get().message() == IMU
    assert other.queue.empty()


@pytest.mark.parametrize(
    ("payload", "encoding", "code"),
    [
        (b"{", "application/json", "malformed"),
        (b'{"acc":[0,0,NaN],"gyro":[0,0,0]}', "application/json", "invalid"),
        (b"9" * 10_000_000, "zenoh/bytes", "too_large"),
        (encode(IMU)[0], "application/json;surefoot/Imu/3.1", "schema"),
        (encode(IMU)[0], "application/json;surefoot/Tick/1.0", "schema"),
    ],
    ids=["cut", "nan", "10 MB", "major", "name"],
)
def test_what_strangers_publish_is_refused_by_name(net: Net, payload: bytes, encoding: str, code: str) -> None:
    inbox = Inbox()
    net.open().subscribe(topics.HW_IMU, inbox.put)
    with net.plain() as stranger:
        publisher: Any = stranger.declare_publisher(
            f"{net.namespace}/hw/imu", encoding=encoding, congestion_control=zenoh.CongestionControl.BLOCK
        )
        wait_until(lambda: publisher.matching_status.matching)
        publisher.put(payload)
        delivery: Delivery = inbox.get()
    with expect_error(Refusal, code):
        delivery.message()


# -- queries -----------------------------------------------------------------------------------------------------------


def test_question_and_answer(net: Net) -> None:
    seen: list[RegionRequest] = []
    serve(net.open(), lambda request: seen.append(request) or EMPTY)
    tool = reached(net.open("client"), topics.STABILITY_REGION)
    request = RegionRequest(contacts=(), directions=16)
    assert tool.call(topics.STABILITY_REGION, request) == EMPTY
    assert seen == [request]


def test_refusal_comes_back_typed(net: Net) -> None:
    def refuses(request: RegionRequest) -> Wire:
        raise Refusal("refused", "no feet", "contacts")

    serve(net.open(), refuses)
    tool = reached(net.open("client"), topics.STABILITY_REGION)
    with expect_error(CallError, "refused", field="contacts") as caught:
        tool.call(topics.STABILITY_REGION, RegionRequest(contacts=()))
    assert caught.value.message == "no feet"


def test_absent_server_is_told_at_once(net: Net) -> None:
    began = time.monotonic()
    with expect_error(CallError, "absent"):
        net.open("client").call(topics.STABILITY_REGION, RegionRequest(contacts=()), 60.0)
    assert time.monotonic() - began < 20.0


def test_silent_server_is_a_time_out(net: Net) -> None:
    kept: list[Incoming] = []
    own(net.open(), topics.STABILITY_REGION, lambda q: q.accept_probe() if q.probe else kept.append(q))
    tool = reached(net.open("client"), topics.STABILITY_REGION)
    with expect_error(CallError, "timeout", text="0.3 s"):
        tool.call(topics.STABILITY_REGION, RegionRequest(contacts=()), 0.3)


def test_reply_in_another_schema_is_refused(net: Net) -> None:
    server = net.open()

    def wrong(asked: zenoh.Query) -> None:
        with asked:
            asked.reply(topics.STABILITY_REGION.key, b"{}", encoding="application/json;surefoot/RegionReply/9.0")

    server._keep.append(server.session.declare_queryable(topics.STABILITY_REGION.key, wrong, complete=True))
    own(server, topics.STABILITY_REGION)
    tool = reached(net.open("client"), topics.STABILITY_REGION)
    with expect_error(CallError, "schema"):
        tool.call(topics.STABILITY_REGION, RegionRequest(contacts=()))


def test_array_as_an_answer(net: Net) -> None:
    message = HeightMapMessage(rows=1, cols=2, cell=0.02, origin=(0.0, 0.0), data=b"\0" * 8)
    own(net.open(), topics.TERRAIN_MAP_GET, lambda q: q.accept_probe() if q.probe else q.reply(message))
    tool = reached(net.open("client"), topics.TERRAIN_MAP_GET)
    assert tool.call(topics.TERRAIN_MAP_GET, MapRequest()) == message


class Asked:
    """Raw replies to a plain Zenoh query."""

    def __init__(self, net: Net, key: str, payload: bytes | None, encoding: str | None = None) -> None:
        with net.plain() as stranger:
            replies = list(stranger.get(f"{net.namespace}/{key}", payload=payload, encoding=encoding, timeout=WAIT_S))
            assert len(replies) == 1
            (reply,) = replies
            self.ok = reply.ok is not None
            sample: Any = reply.ok or reply.err
            self.text = sample.payload.to_bytes()
            self.encoding = str(sample.encoding)


@pytest.mark.parametrize(
    ("payload", "encoding", "code", "field"),
    [
        (b"{", None, "malformed", None),
        (None, None, "invalid", "contacts"),
        (b'{"contacts":[],"friction":1}', None, "invalid", "friction"),
        (b'{"contacts":[{"position":[0,0,NaN],"normal":[0,0,1],"mu":1}]}', None, "invalid", "contacts.0.position.2"),
        (b"[" + b"0," * 5_000_000 + b"0]", None, "too_large", None),
        (b'{"contacts":[]}', "application/json;surefoot/RegionRequest/2.0", "schema", None),
    ],
    ids=["cut", "empty", "unknown", "nan", "10 MB", "major"],
)
def test_bad_question_of_a_stranger_gets_a_typed_error(
    net: Net, payload: bytes | None, encoding: str | None, code: str, field: str | None
) -> None:
    serve(net.open(), lambda request: EMPTY)
    reached(net.open("client"), topics.STABILITY_REGION)
    asked = Asked(net, topics.STABILITY_REGION.key, payload, encoding)
    assert not asked.ok
    error = json.loads(asked.text)
    assert (error["code"], error["field"]) == (code, field)
    assert len(error["message"]) < 400
    assert asked.encoding == "application/json;surefoot/ErrorReply/1.0"


def test_an_empty_question_asks_for_the_defaults_but_never_acts(net: Net) -> None:
    """A reader of all keys of a robot, as a viewer is, sends an empty request to every query."""
    seen: list[Request] = []
    features = FeaturesReply(robot="ragno", terrains=(), faults=(), map_profiles=(), queries=(), version="")

    def answer(incoming: Incoming) -> None:
        if incoming.probe:
            incoming.accept_probe()
            return
        try:
            seen.append(incoming.request())
            incoming.reply(features)
        except Refusal as refusal:
            incoming.fail(refusal)

    server = net.open()
    own(server, topics.SIM_PAUSE)
    for query in (topics.SIM_PAUSE, topics.SIM_FEATURES):
        server.serve(query, answer)
        reached(net.open("client"), query)
    with net.plain() as stranger:
        replies = list(stranger.get(f"{net.namespace}/**", timeout=WAIT_S))
    errors = [json.loads(reply.err.payload.to_bytes())["message"] for reply in replies if reply.err is not None]
    assert errors == ["sim/pause: an empty request does nothing; send a JSON object"]
    assert [reply.ok is not None for reply in replies].count(True) == 1
    assert seen == [FeaturesRequest()]


@pytest.mark.parametrize("encoding", [None, "application/json", "zenoh/bytes", "text/plain"])
def test_plain_question_of_a_stranger_is_answered(net: Net, encoding: str | None) -> None:
    serve(net.open(), lambda request: EMPTY)
    reached(net.open("client"), topics.STABILITY_REGION)
    asked = Asked(net, topics.STABILITY_REGION.key, b'{"contacts":[]}', encoding)
    assert asked.ok
    assert asked.encoding == encoding_of(RegionReply)


# -- life --------------------------------------------------------------------------------------------------------------


def test_life_and_death_are_seen_by_those_before_and_after(net: Net) -> None:
    early, late = Inbox(), Inbox()
    net.router.watch(early.put)
    service = net.open()
    service.announce("walker", "one")
    assert early.get() == Life("walker", "one", True)
    net.open().watch(late.put)
    assert late.get() == Life("walker", "one", True)
    service.close()
    assert early.get() == Life("walker", "one", False)
    assert late.get() == Life("walker", "one", False)
    service.close()  # harmless


def test_busy_port_is_one_sentence_with_the_flag(net: Net) -> None:
    with expect_error(BusError, "no_bus", text="--listen", without="\n"):
        net.open("router")


def test_no_router_is_one_sentence_with_the_flag(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(options, "CONNECT_TIMEOUT_MS", 200)
    address = free_address()
    with expect_error(BusError, text=address, without="\n") as caught:
        ZenohBus(ZenohOptions("client", (address,), (), "test/nobody"))
    assert "--connect" in caught.value.message


def test_settings_keep_to_the_loopback_and_off_multicast() -> None:
    for mode in ("peer", "client", "router"):
        config = zenoh_config(ZenohOptions(mode, listen=("tcp/127.0.0.1:7999",) if mode == "router" else ()))
        assert config.get_json("scouting/multicast/enabled") == "false"
        assert "0.0.0.0" not in config.get_json("listen/endpoints")
        assert config.get_json("namespace") == '"surefoot/ragno"'


def test_a_service_observes_heartbeats_of_services_only(net: Net) -> None:
    """Strangers that flood a heartbeat displace none: they publish on the key that is open to every reader."""
    inbox, observer = Inbox(), Inbox()
    net.open().subscribe(topics.HEALTH, inbox.put, bounded=True)
    net.open("client").subscribe(topics.HEALTH, observer.put)
    publisher = matched(net.open(), topics.HEALTH.of("estimator"))
    with net.plain() as stranger:
        for _ in range(2 * BOUNDED_KEEP):
            stranger.put(f"{net.namespace}/health/walker", b"{")
        assert observer.get().raw().payload == b"{"
        wait_until(lambda: publisher._participants.matching_status.matching)
        publisher.put(Health(service="estimator", instance="1", state="running", pid=1))
    assert inbox.get().message().service == "estimator"
    assert inbox.queue.empty()
