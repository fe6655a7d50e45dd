"""The view's server: who may ask, what a page gets, a page that does not read, and the frames beside the bus."""

import http.client
import json
import socket
import time
from types import SimpleNamespace

import pytest

from surefoot.bus.interface import Delivery
from surefoot.errors import BusError, CallError, SurefootError
from surefoot.lab.scene.film import UNITS_PER_M
from surefoot.lab.view.live import LiveFrames
from surefoot.lab.view.server import BODY_BYTES, HOST, ViewServer, live_page
from surefoot.record.recording import read_recording, topic_of
from surefoot.robot.reader import load_robot


class QuietClient:
    """A client of a system whose messages a test hands over, and that answers nothing but what it is given."""

    def __init__(self, answers=()):
        self.sinks, self.calls, self.answers = {}, [], dict(answers)
        endpoint = SimpleNamespace(namespace="surefoot/ragno", connect=())
        self.bus = SimpleNamespace(endpoint=endpoint, subscribe=self.subscribe)

    def subscribe(self, topic, sink):
        self.sinks[topic.key] = sink

    def call(self, key, timeout_s=None, **fields):
        self.calls.append((key, fields))
        if key not in self.answers:
            raise CallError("absent", f"nobody answers {key}")
        return self.answers[key]


@pytest.fixture
def client():
    return QuietClient({"sim/pause": SimpleNamespace(accepted=True, reason="")})


@pytest.fixture
def live(client):
    frames = LiveFrames(client, load_robot("ragno"))
    yield frames
    frames.close()


@pytest.fixture
def server(live):
    serving = ViewServer(lambda: live_page("surefoot/<ragno>"), live, 0)
    yield serving
    serving.close()


def ask(server, method="GET", path="/", token=True, body=None, **headers):
    connection = http.client.HTTPConnection(HOST, server.port, timeout=5.0)
    query = f"?token={server.token}" if token is True else f"?token={token}" if token else ""
    connection.request(method, path + query, body, headers)
    reply = connection.getresponse()
    text = reply.read().decode()
    connection.close()
    return reply.status, text


def hand_over(client, recording, until_s=2.0):
    """Deliver the messages of a recording; return the last of each key."""
    last = {}
    for item in read_recording(recording):
        topic = topic_of(item.key)
        if item.key in client.sinks and item.stamp_ns < until_s * 1e9:
            last[item.key] = item.message()
            client.sinks[item.key](Delivery(topic, last[item.key], None))
    return last


def test_the_page_asks_for_nothing_from_outside(server):
    status, text = ask(server)
    assert status == 200
    assert "http://" not in text.replace("http://www.w3.org", "")
    assert "https:" not in text
    assert "default-src 'none'" in text
    assert "surefoot/&lt;ragno&gt;" in text


@pytest.mark.parametrize("path", ["/", "/head", "/events", "/do"])
@pytest.mark.parametrize(("token", "headers"), [
    ("", {}), ("wrong", {}), (True, {"Host": "evil.example:7480"}), (True, {"Host": HOST}),
    (True, {"Origin": "http://evil.example"}), (True, {"Origin": "null"}),
])  # fmt: skip
def test_a_foreign_host_or_a_missing_token_is_refused(server, path, token, headers):
    status, text = ask(server, "POST" if path == "/do" else "GET", path, token, **headers)
    assert status == 403
    assert server.token not in text


def test_it_listens_on_this_machine_only_and_a_taken_port_is_named(server):
    assert server._http.server_address[0] == HOST
    with pytest.raises(BusError, match=rf"{server.port} .*--port") as refused:
        ViewServer(lambda: "", None, server.port)
    assert refused.value.code == "busy"


def test_over_ssh_it_prints_the_tunnel(server):
    lines = server.hints({"SSH_CONNECTION": "10.0.0.1 1 10.0.0.2 22", "USER": "ann"})
    assert f"-L {server.port}:127.0.0.1:{server.port} ann@10.0.0.2" in lines[0]
    assert server.hints({}) == [f"view: {server.url}"]


@pytest.mark.parametrize("body", ["", "[]", "{", '{"action": 1, "fields": []}', "x" * (BODY_BYTES + 1)])
def test_a_malformed_order_is_refused(server, client, body):
    client.calls.clear()
    status, text = ask(server, "POST", "/do", body=body)
    assert status in (200, 400, 413)
    assert "Traceback" not in text
    assert not client.calls


def test_buttons_reach_the_simulator_and_say_when_nobody_answers(server, client):
    assert json.loads(ask(server, "POST", "/do", body='{"action": "pause"}')[1])["accepted"]
    assert client.calls[-1] == ("sim/pause", {})
    refused = json.loads(ask(server, "POST", "/do", body='{"action": "step", "fields": {"ticks": 3}}')[1])
    assert refused == {"accepted": False, "reason": "nobody answers sim/step"}
    assert "allowed are" in json.loads(ask(server, "POST", "/do", body='{"action": "fly"}')[1])["reason"]


def test_numbers_of_a_frame_are_those_of_the_bus(live, client, recorded):
    last = hand_over(client, recorded)
    _, text = live.next_after(0, 5.0)
    frame, head = json.loads(text), live.head()["head"]
    values = {v["name"]: x for v, x in zip(head["values"], frame["values"], strict=True)}
    truth, stability = last["sim/truth"], last["state/stability"]
    assert [x / UNITS_PER_M for x in frame["base"]] == pytest.approx(truth.position, abs=0.51 / UNITS_PER_M)
    assert values["margin"] == pytest.approx(1000.0 * stability.margin_planned, abs=1e-3)
    assert values["speed"] == pytest.approx(last["state/velocity"].velocity[0], abs=1e-4)
    assert frame["t"] == pytest.approx(truth.stamp_ns * 1e-9)


def test_without_truth_the_frame_shows_the_estimate(live, client, recorded):
    client.sinks.pop("sim/truth")
    last = hand_over(client, recorded)
    frame = json.loads(live.next_after(0, 5.0)[1])
    position = last["state/odometry"].position
    assert [x / UNITS_PER_M for x in frame["base"]] == pytest.approx(position, abs=0.51 / UNITS_PER_M)


def test_a_page_that_does_not_read_holds_nobody(server, live, client, recorded):
    stuck = socket.create_connection((HOST, server.port))
    host = f"{HOST}:{server.port}"
    stuck.sendall(f"GET /events?token={server.token} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
    began = time.monotonic()
    hand_over(client, recorded, 0.5)
    assert ask(server)[0] == 200
    number, text = live.next_after(0, 5.0)
    assert number > 0
    assert text
    assert time.monotonic() - began < 5.0
    stuck.close()


def test_an_unknown_action_is_an_error(live):
    with pytest.raises(SurefootError, match="allowed are"):
        live.act("fly", {})
