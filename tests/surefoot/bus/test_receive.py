"""Messages larger than any legal one of their key: dropped uncopied, counted, named; clients that send much are named;
memory that a large message needed is returned."""

import threading
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from surefoot import heap
from surefoot.bus.heavy import CALM_BYTES, Heavy
from surefoot.bus.options import MAX_MESSAGE_BYTES
from surefoot.bus.receive import largest
from surefoot.bus.sizes import MAX_BULK_BYTES, MAX_JSON_BYTES
from surefoot.bus.unread import Connection
from surefoot.schemas.base import Bulk
from surefoot.schemas.hw import EmergencyStop
from surefoot.schemas.topics import CMD_ESTOP, HEALTH, TOPICS
from tests.surefoot.net import Inbox, Net, wait_until

MEGABYTE = 1 << 20


def test_the_largest_legal_message_of_every_topic_is_not_too_large() -> None:
    for topic in TOPICS:
        legal = MAX_JSON_BYTES + (MAX_BULK_BYTES if issubclass(topic.model, Bulk) else 0)
        assert legal < largest(topic.model) < legal + 4096
        assert largest(topic.model) < MAX_MESSAGE_BYTES


@pytest.mark.parametrize("family", ["observed", "participants", "frames"])
def test_a_message_that_is_too_large_is_dropped_counted_and_named(family: str) -> None:
    net, inbox = Net(), Inbox()
    try:
        peer = net.open("peer")
        if family == "observed":
            peer.subscribe(CMD_ESTOP, inbox.put, bounded=True)
            key, most = CMD_ESTOP.key, MAX_JSON_BYTES
        elif family == "participants":
            peer.subscribe(HEALTH.of("walker"), inbox.put, bounded=True)
            key, most = "@health/walker", MAX_JSON_BYTES
        else:
            peer.take([row for row in TOPICS if row.owner == "walker" and row.framed][:1], inbox.put)
            key, most = "@frame/walker", 9 * MAX_JSON_BYTES
        counted: dict[str, int] = {}
        texts: list[str] = []

        def dropped() -> bool:
            for one in peer.look_at_links():
                if one.reason == "too_large":
                    counted[one.peer] = counted.get(one.peer, 0) + one.number
                    texts.append(one.text)
            return bool(counted)

        with net.plain() as client:
            publisher: Any = client.declare_publisher(
                f"{net.namespace}/{key}", congestion_control=zenoh.CongestionControl.BLOCK
            )
            wait_until(lambda: publisher.matching_status.matching)
            publisher.put(b" " * (most + MEGABYTE))
            wait_until(dropped)
            publisher.put(EmergencyStop(reason="next").model_dump_json())
            inbox.get()
        assert counted == {key.removeprefix("@") if family == "participants" else key: 1}
        assert "at most" in texts[0]
        assert str(most + MEGABYTE) in texts[0]
        assert inbox.queue.empty()
    finally:
        net.close()


def _links(*addresses: str) -> Any:
    links = [SimpleNamespace(zid=f"z{address[-1]}", dst=f"tcp/{address}") for address in addresses]
    info = SimpleNamespace(links=lambda: links, peers_zid=lambda: ["z2"], routers_zid=list)
    return SimpleNamespace(info=info)


def test_a_client_that_sends_more_than_the_largest_message_at_a_stretch_is_named_once_for_as_many_bytes() -> None:
    sent = {"h:1": 0, "h:2": 0, "h:3": 0}
    heavy = Heavy(_links(*sent), lambda: {address: Connection(0, 0, count) for address, count in sent.items()})
    found = []
    for step in range(40):
        sent["h:1"] += 4 * CALM_BYTES * (step < 20)  # a client, 640 MiB in 20 looks
        sent["h:2"] += 4 * CALM_BYTES  # a peer: services of the system may send maps
        sent["h:3"] += CALM_BYTES  # a client that streams images
        found += heavy.look()
    assert {one.peer for one in found} == {"z1"}
    assert {one.reason for one in found} == {"heavy"}
    assert len(found) == 20 * 4 * CALM_BYTES // (96 * MEGABYTE)
    assert "h:1" in found[0].text
    assert "96 MiB" in found[0].text


def test_memory_that_has_grown_is_returned_once_and_what_is_in_use_is_no_growth(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    size, calls = [100 * MEGABYTE], list[int]()
    monkeypatch.setattr(heap, "_resident", lambda: size[0])
    monkeypatch.setattr(heap, "_least_bytes", [0])
    monkeypatch.setattr(heap, "_returned_s", [-heap.APART_S])
    monkeypatch.setattr(heap, "hand_back", lambda: calls.append(size[0]))

    def look() -> int:
        heap.hand_back_growth()
        for thread in threading.enumerate():
            if thread.name == "heap":
                thread.join(5.0)
        return len(calls)

    assert look() == 0
    size[0] += heap.GROWN_BYTES
    assert look() == 0
    size[0] += MEGABYTE
    assert look() == 1
    assert look() == 1
    size[0] -= 20 * MEGABYTE
    assert look() == 1
    size[0] += heap.GROWN_BYTES + MEGABYTE
    assert look() == 2
