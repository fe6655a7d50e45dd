"""Messages beyond any legal size are dropped by the network, before they occupy memory, and others pass."""

import zenoh

from surefoot.bus import options
from surefoot.bus.codec import MAX_BULK_BYTES
from surefoot.bus.options import MAX_MESSAGE_BYTES
from surefoot.schemas.hw import EmergencyStop
from surefoot.schemas.system import HealthRequest
from surefoot.schemas.topics import CMD_ESTOP, HEALTH_GET
from tests.surefoot.net import Inbox, Net, wait_until

MEGABYTE = 1 << 20


def test_the_largest_map_with_its_header_passes() -> None:
    assert MAX_BULK_BYTES + MEGABYTE < MAX_MESSAGE_BYTES < 2 * MAX_BULK_BYTES


def test_a_message_beyond_the_limit_is_dropped_and_the_next_one_passes(monkeypatch) -> None:
    monkeypatch.setattr(options, "MAX_MESSAGE_BYTES", MEGABYTE)
    net, inbox, asked = Net(), Inbox(), Inbox()
    try:
        peer = net.open("peer")
        peer.subscribe(CMD_ESTOP, inbox.put)
        peer.serve(HEALTH_GET.of("walker"), asked.put)
        with net.plain() as client:
            key, query = (f"{net.namespace}/{name}" for name in (CMD_ESTOP.key, "health/walker"))
            block = zenoh.CongestionControl.BLOCK

            def answered() -> bool:  # the first messages of a session may be lost
                client.put(key, EmergencyStop(reason="first").model_dump_json(), congestion_control=block)
                return not inbox.queue.empty()

            wait_until(answered)
            client.put(key, b" " * (2 * MEGABYTE), congestion_control=block)
            client.get(query, payload=b" " * (2 * MEGABYTE), timeout=0.2)
            client.put(key, EmergencyStop(reason="last").model_dump_json(), congestion_control=block)
            sizes = list[int]()
            while True:
                delivery = inbox.get()
                sizes.append(delivery.size)
                if delivery.size < MEGABYTE and delivery.message().reason == "last":
                    break
            client.get(query, payload=HealthRequest().model_dump_json(), timeout=5.0)
            assert asked.get().size < MEGABYTE
        assert max(sizes) < MEGABYTE
    finally:
        net.close()
