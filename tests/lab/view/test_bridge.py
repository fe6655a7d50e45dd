"""The bridge to Foxglove, read by a plain WebSocket client with the schemas that it advertises."""

import base64
import json
import socket
import struct
import time
from contextlib import suppress

import pytest

from surefoot.bus.interface import Delivery
from surefoot.errors import BusError
from surefoot.robot.reader import load_robot
from surefoot.schemas.system import LogRecord
from surefoot.schemas.topics import LOG
from tests.lab.scene.protobuf import reader_of
from tests.lab.view.quiet import QuietClient

pytest.importorskip("foxglove", reason="the extra `foxglove` is not installed")

from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from surefoot.lab.view.bridge import FoxgloveBridge

PROTOCOL, MESSAGE, WAIT_S = "foxglove.sdk.v1", 1, 10.0


@pytest.fixture
def client():
    return QuietClient()


@pytest.fixture
def bridge(client):
    running = FoxgloveBridge(client, load_robot("ragno"), 0)
    yield running
    running.close()


class Viewer:
    """A client that subscribes to topics and reads the first message of each."""

    def __init__(self, socket):
        self.socket, self.channels = socket, {}

    def receive(self):
        """Return the next text as JSON, or message as topic, stamp and content."""
        data = self.socket.recv(timeout=WAIT_S)
        if isinstance(data, str):
            content = json.loads(data)
            if content["op"] == "advertise":
                self.channels |= {each["topic"]: each for each in content["channels"]}
            return content
        kind, number, stamp = struct.unpack_from("<BIQ", data)
        if kind != MESSAGE:
            return None
        channel = next(each for each in self.channels.values() if each["id"] == number)
        if channel["encoding"] == "json":
            return channel["topic"], stamp, json.loads(data[13:])
        schema = base64.b64decode(channel["schema"])
        return channel["topic"], stamp, reader_of(schema, channel["schemaName"]).FromString(data[13:])

    def subscribe(self, topics):
        """Subscribe to topics, once they are advertised."""
        while not set(topics) <= set(self.channels):
            self.receive()
        wanted = [self.channels[topic]["id"] for topic in topics]
        asked = [{"id": number, "channelId": number} for number in wanted]
        self.socket.send(json.dumps({"op": "subscribe", "subscriptions": asked}))

    def read(self, topics):
        """Return stamp and content of the next message of each topic."""
        found, end = {}, time.monotonic() + WAIT_S
        while not set(topics) <= set(found):
            assert time.monotonic() < end, set(topics) - set(found)
            got = self.receive()
            if isinstance(got, tuple):
                found.setdefault(got[0], got[1:])
        return found

    def first(self, topics):
        """Subscribe, and return stamp and content of the first message of each topic."""
        self.subscribe(topics)
        return self.read(topics)


def test_a_client_that_comes_late_reads_every_channel(bridge, client, recorded):
    last = client.hand_over(recorded)
    with connect(bridge.url, subprotocols=[PROTOCOL], max_size=None) as socket:
        viewer = Viewer(socket)
        lasting = viewer.first(["/robot", "/ground", "/map", "/scene", "/shape/base_link"])
        assert {entity.id for entity in lasting["/robot"][1].entities} >= {"base_link", "lf_tibia"}
        assert len(lasting["/map"][1].data) % lasting["/map"][1].row_stride == 0
        viewer.subscribe(["/log"])
        found = viewer.first(["/tf", "/pose", "/joint_states", "/odometry", "/values"])
        client.sinks[LOG.key](Delivery(LOG, _line("a foot slides"), None))
        lines = viewer.read(["/log"])
    truth = last["sim/truth"]
    stamp, transforms = found["/tf"]
    base = next(t.translation for t in transforms.transforms if t.child_frame_id == "base_link")
    assert stamp == truth.stamp_ns
    assert (base.x, base.y, base.z) == pytest.approx(truth.position, abs=1e-9)
    assert found["/values"][1]["margin"] == pytest.approx(1000.0 * last["state/stability"].margin_planned)
    assert lines["/log"][1].message in ("a foot slides", last["state/gait"].state)


def _line(text):
    return LogRecord(level="warning", text=text, stamp_ns=5, tick=0, epoch=1, seq=0, source="walker")


@pytest.mark.parametrize("path", ["", "/", "/?token=", "/?token=wrong", "/?tok={token}"])
def test_a_client_without_the_token_is_refused(bridge, path):
    """Before, any page in a browser on this machine could read the bridge."""
    with pytest.raises(InvalidStatus) as refused:
        connect(f"ws://127.0.0.1:{bridge.port}{path.format(token=bridge._door.token)}", subprotocols=[PROTOCOL])
    assert refused.value.response.status_code == 403
    assert bridge._door.token not in refused.value.response.body.decode()


def test_a_page_of_a_foreign_host_is_refused_and_one_of_a_foreign_origin_with_the_token_is_not(bridge):
    token = bridge.url.partition("?")[2]
    with socket.create_connection(("127.0.0.1", bridge.port)) as plain:
        plain.sendall(f"GET /?{token} HTTP/1.1\r\nHost: evil.example:{bridge.port}\r\n\r\n".encode())
        assert b" 403 " in plain.makefile("rb").readline()
    with connect(bridge.url, subprotocols=[PROTOCOL], origin="https://app.foxglove.dev", max_size=None) as viewer:
        assert json.loads(viewer.recv(timeout=WAIT_S))["op"] == "serverInfo"


def test_the_server_behind_the_door_is_not_where_a_page_would_look(bridge, monkeypatch):
    place, port = bridge._door._http.behind
    assert place.startswith("127.")
    assert place != "127.0.0.1"
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", port)).close()


def test_a_bridge_that_ends_ends_its_clients(client):
    running = FoxgloveBridge(client, load_robot("ragno"), 0)
    with connect(running.url, subprotocols=[PROTOCOL], max_size=None) as viewer:
        viewer.recv(timeout=WAIT_S)
        running.close()
        with suppress(ConnectionClosed):
            while True:
                viewer.recv(timeout=WAIT_S)  # a TimeoutError where the connection stands


def test_a_taken_port_is_named(bridge, client):
    with pytest.raises(BusError, match=rf"{bridge.port} .*--port"):
        FoxgloveBridge(client, load_robot("ragno"), bridge.port)
