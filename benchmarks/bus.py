"""Round trips of the message bus, compared with raw Zenoh and a hand-written program of Zenoh and pydantic."""

import itertools
import multiprocessing
import statistics
import time
from queue import SimpleQueue
from typing import Any

import zenoh
from pydantic import BaseModel

from benchmarks.bench import Bench, goal
from surefoot.bus.codec import encode
from surefoot.bus.frame import Frame
from surefoot.bus.interface import Delivery
from surefoot.bus.zenoh import ZenohBus, ZenohOptions
from surefoot.lockstep.leader import REPORT_TICKS
from surefoot.schemas.hw import JointState
from surefoot.schemas.topics import Kind, Topic
from tests.ports import free_address

BENCH = Bench("bus")

PING = Topic("bench/ping", JointState, Kind.SAMPLE, "ping")
PONG = Topic("bench/pong", JointState, Kind.SAMPLE, "pong")
LONE_PING = Topic("bench/lone/ping", JointState, Kind.SAMPLE, "ping")
LONE_PONG = Topic("bench/lone/pong", JointState, Kind.SAMPLE, "pong")
NAMESPACE = "surefoot/bench"
PER_BLOCK = 100
JOINTS = tuple(0.1 * i + 1 / 3 for i in range(18))


class Plain(BaseModel):
    """Joint message of a hand-written program, which the bus is compared with.

    Angles, rad, velocities, rad/s, currents, A, and torques, Nm, of all joints.
    """

    stamp_ns: int
    tick: int
    epoch: int
    seq: int
    source: str
    position: list[float]
    velocity: list[float]
    current: list[float]
    torque: list[float]


def state(seq: int) -> JointState:
    """Return an 18-joint state, about 1.5 kB of JSON."""
    return JointState(
        position=JOINTS, velocity=JOINTS, current=JOINTS, torque=JOINTS, seq=seq, stamp_ns=seq, tick=seq, source="bench"
    )


def publish(bus: ZenohBus, publisher: Any, message: Any) -> None:
    """Publish a message through the bus as a service does in a control tick: corked, then flushed."""
    bus.cork()
    publisher.put(message)
    bus.flush(batch=message.seq % REPORT_TICKS == 0)


def echo(router: str, ready: Any, stop: Any) -> None:
    """Send every message back in the format in which it came, in a process of its own."""
    bus = ZenohBus(ZenohOptions("peer", (router,), (), NAMESPACE))
    work: SimpleQueue[Any] = SimpleQueue()
    pong, lone_pong = bus.publisher(PONG), bus.publisher(LONE_PONG, framed=False)
    bus.take((PING,), work.put)
    bus.subscribe(LONE_PING, work.put)
    quick = {"congestion_control": zenoh.CongestionControl.BLOCK, "priority": zenoh.Priority.REAL_TIME, "express": True}
    raw_out, plain_out = (bus.session.declare_publisher(f"{k}/pong", **quick) for k in ("raw", "plain"))
    kept = [
        bus.session.declare_subscriber("raw/ping", lambda s: work.put(("raw", s.payload.to_bytes()))),
        bus.session.declare_subscriber("plain/ping", lambda s: work.put(("plain", s.payload.to_bytes()))),
    ]
    ready.set()
    while not stop.is_set():
        try:
            item = work.get(timeout=0.2)
        except Exception:  # queue.Empty: look at the stop flag
            continue
        if isinstance(item, Frame):
            for delivery in item.deliveries():
                publish(bus, pong, delivery.message())
        elif isinstance(item, Delivery):
            message: Any = item.message()
            lone_pong.put(message)
        elif item[0] == "raw":
            raw_out.put(item[1])
        else:
            plain_out.put(Plain.model_validate_json(item[1]).model_dump_json())
    del kept
    bus.close()


@BENCH.part("--blocks 1")
def round_trips(*, blocks: int = 30) -> None:
    """Round trips of an 18-joint state beside raw Zenoh and hand-written zenoh + pydantic, interleaved in one run.

    Two processes on tcp loopback, peer to peer; ping on one key, pong on another; medians over interleaved blocks.
    `typed`: in frames, as services do; `topic`: on the topic itself, as tools read it. Goals: typed at most 1.5 of raw
    Zenoh of equal size, 1.15 of hand-written zenoh + pydantic.

    Args:
        blocks: number of blocks of 100 round trips each way.
    """
    router = free_address()
    hub = ZenohBus(ZenohOptions("router", (), (router,), NAMESPACE))
    context = multiprocessing.get_context("spawn")
    ready, stop = context.Event(), context.Event()
    other = context.Process(target=echo, args=(router, ready, stop))
    other.start()
    bus = ZenohBus(ZenohOptions("peer", (router,), (), NAMESPACE))
    try:
        times = _measure(bus, ready, blocks)
    finally:
        stop.set()
        other.join(10)
        bus.close()
        hub.close()
    print(f"{len(encode(state(0))[0])} bytes, {blocks} x {PER_BLOCK} interleaved, two processes, loopback")
    for name, values in times.items():
        goal(name, statistics.median(values) * 1e6, unit="us")
    for ours, theirs, most in (("typed", "raw", 1.5), ("typed", "plain", 1.15), ("topic", "plain", None)):
        ratio = statistics.median(a / b for a, b in zip(times[ours], times[theirs], strict=True))
        goal(f"{ours} / {theirs}", ratio, "<=", most)


def _measure(bus: ZenohBus, ready: Any, blocks: int) -> dict[str, list[float]]:
    quick = {"congestion_control": zenoh.CongestionControl.BLOCK, "priority": zenoh.Priority.REAL_TIME, "express": True}
    session = bus.session
    got: SimpleQueue[Any] = SimpleQueue()
    bus.take((PONG,), got.put)
    bus.subscribe(LONE_PONG, got.put)
    kept = [session.declare_subscriber(f"{k}/pong", lambda s: got.put(s.payload.to_bytes())) for k in ("raw", "plain")]
    ping, lone_ping = bus.publisher(PING), bus.publisher(LONE_PING, framed=False)
    count = itertools.count()
    raw, plain = (session.declare_publisher(f"{k}/ping", **quick) for k in ("raw", "plain"))
    payload = encode(state(1))[0]
    model = Plain.model_validate_json(payload)

    def typed_trip() -> None:
        publish(bus, ping, state(next(count)))
        for delivery in got.get(timeout=5.0).deliveries():
            delivery.message()

    def topic_trip() -> None:
        lone_ping.put(state(1))
        got.get(timeout=5.0).message()

    def raw_trip() -> None:
        raw.put(payload)
        got.get(timeout=5.0)

    def plain_trip() -> None:
        values = {name: getattr(model, name) for name in ("position", "velocity", "current", "torque")}
        plain.put(Plain(stamp_ns=1, tick=1, epoch=0, seq=1, source="bench", **values).model_dump_json())
        Plain.model_validate_json(got.get(timeout=5.0))

    ready.wait(20)
    ways = {"typed": typed_trip, "topic": topic_trip, "raw": raw_trip, "plain": plain_trip}
    for way in ways.values():
        while True:  # the links are up when the first round trip comes back
            try:
                way()
                break
            except Exception:
                time.sleep(0.02)
        for _ in range(200):
            way()
    times: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(blocks):
        for name, way in ways.items():
            began = time.perf_counter()
            for _ in range(PER_BLOCK):
                way()
            times[name].append((time.perf_counter() - began) / PER_BLOCK)
    del kept
    return times
