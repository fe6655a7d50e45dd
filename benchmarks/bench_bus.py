"""The bus beside raw Zenoh and hand-written zenoh + pydantic: round trips of an 18-joint state, interleaved in one run.

Conditions: two processes on tcp loopback, peer to peer; ping on one key, pong on another; medians over interleaved
blocks. ``typed``: in frames, as services speak to each other; ``topic``: on the topic itself, as tools listen. Targets:
typed <= 1.5x raw Zenoh of equal size, <= 1.15x hand-written zenoh + pydantic.
"""

import itertools
import multiprocessing
import statistics
import time
from queue import SimpleQueue
from typing import Any

import zenoh
from pydantic import BaseModel

from surefoot.bus.codec import encode
from surefoot.bus.frame import Frame
from surefoot.bus.interface import Delivery
from surefoot.bus.zenoh import ZenohBus, ZenohOptions
from surefoot.lockstep.leader import REPORT_TICKS
from surefoot.schemas.hw import JointState
from surefoot.schemas.topics import Kind, Topic

ROUTER = "tcp/127.0.0.1:17461"
PING = Topic("bench/ping", JointState, Kind.SAMPLE, "ping")
PONG = Topic("bench/pong", JointState, Kind.SAMPLE, "pong")
LONE_PING = Topic("bench/lone/ping", JointState, Kind.SAMPLE, "ping")
LONE_PONG = Topic("bench/lone/pong", JointState, Kind.SAMPLE, "pong")
NAMESPACE = "surefoot/bench"
BLOCKS, PER_BLOCK = 30, 100
JOINTS = tuple(0.1 * i + 1 / 3 for i in range(18))


class Plain(BaseModel):
    """What one writes without us."""

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
    """An 18-joint state, about 1.5 kB of JSON."""
    return JointState(
        position=JOINTS, velocity=JOINTS, current=JOINTS, torque=JOINTS, seq=seq, stamp_ns=seq, tick=seq, source="bench"
    )


def tell(bus: ZenohBus, publisher: Any, message: Any) -> None:
    """A message as a service says it in a tick that nobody has to report."""
    bus.cork()
    publisher.put(message)
    bus.flush(batch=message.seq % REPORT_TICKS == 0)


def echo(ready: Any, stop: Any) -> None:
    """The other process: sends back what comes, each way in its own manner."""
    bus = ZenohBus(ZenohOptions("peer", (ROUTER,), (), NAMESPACE))
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
                tell(bus, pong, delivery.message())
        elif isinstance(item, Delivery):
            message: Any = item.message()
            lone_pong.put(message)
        elif item[0] == "raw":
            raw_out.put(item[1])
        else:
            plain_out.put(Plain.model_validate_json(item[1]).model_dump_json())
    del kept
    bus.close()


def main() -> dict[str, float]:
    """Prints the table and returns the ratios."""
    router = ZenohBus(ZenohOptions("router", (), (ROUTER,), NAMESPACE))
    context = multiprocessing.get_context("spawn")
    ready, stop = context.Event(), context.Event()
    other = context.Process(target=echo, args=(ready, stop))
    other.start()
    bus = ZenohBus(ZenohOptions("peer", (ROUTER,), (), NAMESPACE))
    try:
        times = _measure(bus, ready)
    finally:
        stop.set()
        other.join(10)
        bus.close()
        router.close()
    medians = {name: statistics.median(values) * 1e6 for name, values in times.items()}
    ratios = {
        "typed / raw": statistics.median(a / b for a, b in zip(times["typed"], times["raw"], strict=True)),
        "typed / hand-written": statistics.median(a / b for a, b in zip(times["typed"], times["plain"], strict=True)),
        "topic / hand-written": statistics.median(a / b for a, b in zip(times["topic"], times["plain"], strict=True)),
    }
    print(
        f"round trip of {len(encode(state(0))[0])} bytes, {BLOCKS} x {PER_BLOCK} interleaved, two processes, loopback"
    )
    for name, value in medians.items():
        print(f"  {name:<22} {value:7.1f} us")
    for name, value in ratios.items():
        print(f"  {name:<22} {value:7.3f}")
    return ratios


def _measure(bus: ZenohBus, ready: Any) -> dict[str, list[float]]:
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
        tell(bus, ping, state(next(count)))
        for delivery in got.get(timeout=5.0).deliveries():
            delivery.message()

    def topic_trip() -> None:
        lone_ping.put(state(1))
        got.get(timeout=5.0).message()

    def raw_trip() -> None:
        raw.put(payload)
        got.get(timeout=5.0)

    def plain_trip() -> None:
        plain.put(
            Plain(
                stamp_ns=1,
                tick=1,
                epoch=0,
                seq=1,
                source="bench",
                position=model.position,
                velocity=model.velocity,
                current=model.current,
                torque=model.torque,
            ).model_dump_json()
        )
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
    for _ in range(BLOCKS):
        for name, way in ways.items():
            began = time.perf_counter()
            for _ in range(PER_BLOCK):
                way()
            times[name].append((time.perf_counter() - began) / PER_BLOCK)
    del kept
    return times


if __name__ == "__main__":
    main()
