"""Recording of bus messages to an MCAP file as an observer, and publishing the messages of such a file again."""

import os
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from surefoot.bus.endpoint import checked, to_listen
from surefoot.bus.interface import Delivery, Publisher
from surefoot.bus.zenoh import ZenohBus, ZenohOptions, client_options
from surefoot.client import Client, topic_named
from surefoot.errors import BusError, Refusal, SurefootError
from surefoot.record.recording import RecordingWriter, read_recording, recording_info, topic_of
from surefoot.schemas.topics import HW_TICK, TICK_DONE, TOPICS, Kind
from surefoot.services.supervisor.processes.ports import refuse_taken
from surefoot.version import VERSION


def record_bag(robot: Client, file: Path, keys: Sequence[str], duration_s: float) -> int:
    """Record messages from the bus to `file`, until Ctrl-C or for `duration_s` of wall time; return their number.

    Raises:
        SurefootError: a key is unknown.
    """
    topics = [topic_named(key) for key in keys] or [t for t in TOPICS if t.kind is not Kind.LOCKSTEP or t == HW_TICK]
    queue: SimpleQueue[Delivery] = SimpleQueue()
    refused: Counter[str] = Counter()
    for topic in topics:
        robot.bus.subscribe(topic, queue.put)
    writer = RecordingWriter(file, {"namespace": robot.bus.endpoint.namespace, "version": VERSION, "by": "onlooker"})
    end = time.monotonic() + duration_s if duration_s > 0 else float("inf")
    try:
        while time.monotonic() < end:
            try:
                delivery = queue.get(timeout=min(0.2, max(0.0, end - time.monotonic())))
            except Empty:
                continue
            if delivery.prime:
                continue
            try:
                writer.write(delivery.topic, delivery.header(), delivery.raw())
            except Refusal as refusal:
                refused[refusal.code] += 1
    except KeyboardInterrupt:
        pass  # the usual way to end a recording
    finally:
        writer.close({"refused": ", ".join(f"{n} {code}" for code, n in refused.items())})
    return writer.messages


def play_bag(
    file: Path,
    rate: float,
    *,
    loop: bool = False,
    window: tuple[float, float | None] = (0.0, None),
    keys: Sequence[str] = (),
    listen: str | None = None,
    connect: str | None = None,
    namespace: str | None = None,
) -> int:
    """Publish the messages of a recording in the order and at the intervals of their stamps; return how many.

    Args:
        file: MCAP file.
        rate: factor on the recorded speed; 0 = as fast as possible.
        loop: True: begin again at the end, until Ctrl-C; False: end after the last message.
        window: seconds from the beginning of the recording, (start, end).
        keys: keys whose messages are published, all when empty.
        listen: endpoint of a router that is started for the playback.
        connect: endpoint of the router of a running system, used instead of `listen`; None = start a router.
        namespace: prefix of the keys, None = the one of the recording's robot.

    Raises:
        SurefootError: the file cannot be read, or lacks one of the keys.
        BusError: the port is taken or no system answers.
    """
    info = recording_info(file)
    begin = int(info["start_ns"])
    known = set(info["topics"])
    if missing := sorted(set(keys) - known):
        raise SurefootError("unknown_topic", f"{file} has no {', '.join(missing)}; it has {', '.join(sorted(known))}")
    robot = info["metadata"].get("run", {}).get("robot", "ragno")
    bus = _open(listen, connect, namespace or os.environ.get("SUREFOOT_NAMESPACE") or f"surefoot/{robot}")
    publishers: dict[str, Publisher[Any]] = {}
    count = 0
    try:
        while True:
            origin = time.monotonic()
            for item in read_recording(file, tuple(keys) or None):
                at_s = (item.stamp_ns - begin) * 1e-9
                topic = topic_of(item.key)
                if topic is None or at_s < window[0] or topic == TICK_DONE:
                    continue
                if window[1] is not None and at_s > window[1]:
                    break
                if rate > 0.0:
                    time.sleep(max(0.0, origin + (at_s - window[0]) / rate - time.monotonic()))
                if item.key not in publishers:
                    member = topic.of(item.key[len(topic.key) - 1 :]) if topic.key.endswith("/*") else topic
                    publishers[item.key] = bus.publisher(member, framed=False)
                raw = item.raw()
                publishers[item.key].resend((raw.payload, raw.attachment))
                count += 1
            if not loop:
                return count
    except KeyboardInterrupt:
        return count
    finally:
        bus.close()


def _open(listen: str | None, connect: str | None, namespace: str) -> ZenohBus:
    if connect is not None:
        return ZenohBus(client_options(checked("--connect", connect), namespace))
    listen = to_listen(listen)
    try:
        return ZenohBus(ZenohOptions(mode="router", connect=(), listen=(listen,), namespace=namespace))
    except BusError:
        refuse_taken(listen, "play into that system with --connect, or choose another endpoint with --listen")
        raise
