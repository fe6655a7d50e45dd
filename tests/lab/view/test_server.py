"""The view's server: who may ask, what a page gets, a page that does not read, and the frames beside the bus."""

import http.client
import json
import math
import socket
import threading
from types import SimpleNamespace

import pytest

from surefoot.bus.interface import Delivery
from surefoot.errors import BusError, SurefootError
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.lab.cli.viewing import tunnel
from surefoot.lab.scene.film import UNITS_PER_M, frame
from surefoot.lab.scene.pages import LAYOUT
from surefoot.lab.view import server as serving
from surefoot.lab.view.newest import NewestScene, robot_behind
from surefoot.lab.view.server import BODY_BYTES, HOST, READERS, ViewServer
from surefoot.robot.reader import load_robot
from surefoot.schemas.system import LogRecord
from surefoot.schemas.topics import LOG
from tests.lab.view.quiet import QuietClient

WAIT_S = 5.0


def ask(server, method="GET", path="/", token=True, body=None, **headers):
    connection = http.client.HTTPConnection(HOST, server.port, timeout=WAIT_S)
    query = f"?token={server.token}" if token is True else f"?token={token}" if token else ""
    connection.request(method, path + query, body, headers)
    reply = connection.getresponse()
    text = reply.read().decode()
    connection.close()
    return reply.status, text


def order(server, **content):
    return json.loads(ask(server, "POST", "/do", body=json.dumps(content))[1])


def next_frame(reader):
    """Return the next content that has a frame."""
    while True:
        text = reader.next(WAIT_S)
        assert text is not None
        if (content := json.loads(text))["frame"] is not None:
            return content


def test_the_page_asks_for_nothing_from_outside(server):
    status, text = ask(server)
    assert status == 200
    assert "http://" not in text
    assert "https:" not in text
    assert "default-src 'none'" in text
    assert "surefoot/&lt;ragno&gt;" in text
    assert json.loads(ask(server, path=f"/{LAYOUT}")[1])["layout"]


@pytest.mark.parametrize("path", ["/", "/head", "/events", "/do", f"/{LAYOUT}"])
@pytest.mark.parametrize(("token", "headers"), [
    ("", {}), ("wrong", {}), (True, {"Host": "evil.example:7480"}), (True, {"Host": HOST}),
    (True, {"Origin": "http://evil.example"}), (True, {"Origin": "null"}),
])  # fmt: skip
def test_a_foreign_host_or_a_missing_token_is_refused(server, path, token, headers):
    status, text = ask(server, "POST" if path == "/do" else "GET", path, token, **headers)
    assert status == 403
    assert text.count("\n") == 1
    assert server.token not in text


def test_a_port_that_was_asked_for_and_is_taken_is_named(server):
    assert server._http.server_address[0] == HOST
    with pytest.raises(BusError, match=rf"{server.port} .*--port") as refused:
        ViewServer("", None, server.port)
    assert refused.value.code == "busy"


def test_the_usual_port_gives_way_to_any(server, monkeypatch):
    monkeypatch.setattr(serving, "PORT", server.port)
    other = ViewServer("", None)
    other.close()
    assert other.port not in (0, server.port)


def test_over_ssh_it_prints_the_tunnel():
    command = tunnel(7480, {"SSH_CONNECTION": "10.0.0.1 1 10.0.0.2 22", "USER": "ann"})
    assert command == "ssh -N -L 7480:127.0.0.1:7480 ann@10.0.0.2"
    assert not tunnel(7480, {})


@pytest.mark.parametrize(("body", "refusal", "headers"), [
    ("", 400, {}), ("[]", 400, {}), ("{", 400, {}), ('{"action": 1, "fields": []}', 400, {}),
    ("x" * (BODY_BYTES + 1), 413, {}), ("{}", 413, {"Content-Length": "-1"}), ("{}", 413, {"Content-Length": "two"}),
])  # fmt: skip
def test_a_malformed_order_is_refused(server, client, body, refusal, headers):
    status, text = ask(server, "POST", "/do", body=body, **headers)
    assert status == refusal
    assert text.count("\n") == 1
    assert not client.calls


def test_orders_have_one_path_and_a_recording_takes_none(server, client):
    for path in ("/", "/head", "/stop"):
        assert ask(server, "POST", path, body='{"action": "pause"}')[0] == 404
    assert not client.calls
    recorded = ViewServer("<html>", None, 0)
    try:
        assert ask(recorded, "POST", "/do", body='{"action": "pause"}') == (404, "a recording takes no orders\n")
        assert ask(recorded, path="/events")[0] == ask(recorded, path="/head")[0] == 404
    finally:
        recorded.close()


def test_more_pages_than_may_look_are_refused(server):
    places = [server.readers.acquire(blocking=False) for _ in range(READERS)]
    assert all(places)
    connection = http.client.HTTPConnection(HOST, server.port, timeout=WAIT_S)
    connection.request("GET", f"/events?token={server.token}")
    assert connection.getresponse().status == 503  # one that is let in has no end
    connection.close()
    assert ask(server, path="/nothing")[0] == 404


def test_buttons_reach_the_simulator_and_a_refusal_is_a_sentence(server, client, stops):
    assert order(server, action="pause")["accepted"]
    assert client.calls[-1] == ("sim/pause", {})
    refused = order(server, action="step", fields={"ticks": 3})
    assert refused == {"accepted": False, "reason": "no service answers sim/step"}
    assert "allowed are" in order(server, action="fly")["reason"]
    assert order(server, action="stop") == {"accepted": True, "reason": "held"}
    assert stops == ["the live view"]


def test_the_page_learns_what_the_driver_offers(server, client):
    content = json.loads(ask(server, path="/head")[1])
    assert content["actions"] == ["pause", "push"]
    assert content["faults"] == ["imu_drop"]
    client.answers.pop("sim/features")  # the driver of a real robot
    assert json.loads(ask(server, path="/head")[1])["actions"] == []


def test_a_push_is_along_the_heading(live, client, recorded):
    reader, last = live.reader(), client.hand_over(recorded)
    next_frame(reader)
    ahead = matrix_from_quat(last["sim/truth"].quat_wxyz)[:2, 0]
    live.act("push", {"force": [2.0, 0.0, 0.0], "duration": 0.2})
    force = client.calls[-1][1]["force"]
    assert force[:2] == pytest.approx(2.0 * ahead / math.hypot(*ahead), abs=1e-9)
    live.act("push", {"force": "hard"})
    assert client.calls[-1][1]["force"] == "hard"  # the request's own check refuses it


def test_numbers_of_a_frame_are_those_of_the_bus(live, client, recorded):
    reader, last = live.reader(), client.hand_over(recorded)
    frame, head = next_frame(reader)["frame"], live.head()["head"]
    values = {v["name"]: x for v, x in zip(head["values"], frame["values"], strict=True)}
    truth, stability = last["sim/truth"], last["state/stability"]
    assert [x / UNITS_PER_M for x in frame["base"]] == pytest.approx(truth.position, abs=0.51 / UNITS_PER_M)
    assert values["margin"] == pytest.approx(1000.0 * stability.margin_planned, abs=1e-3)
    assert values["speed"] == pytest.approx(last["state/velocity"].velocity[0], abs=1e-4)
    assert frame["t"] == pytest.approx(truth.stamp_ns * 1e-9)


def test_without_truth_the_frame_shows_the_estimate(live, client, recorded):
    reader, last = live.reader(), client.hand_over(recorded, without=("sim/truth",))
    frame = next_frame(reader)["frame"]
    assert [x / UNITS_PER_M for x in frame["base"]] == pytest.approx(
        last["state/odometry"].position, abs=0.51 / UNITS_PER_M
    )


def test_every_page_gets_all_marks_and_one_that_comes_late_too(live, client, recorded):
    early = live.reader()
    client.hand_over(recorded, 2.0)
    first = next_frame(early)["new"]
    client.hand_over(recorded, 4.5)
    more = next_frame(early)["new"]
    late = live.reader()
    client.hand_over(recorded, 4.5)
    assert more
    assert next_frame(late)["new"] == first + more


def test_another_ground_makes_a_page_ask_again(live, client, recorded):
    reader = live.reader()
    client.hand_over(recorded, without=("terrain/map",))
    before = next_frame(reader)["world"]
    client.hand_over(recorded)
    assert next_frame(reader)["world"] == before + 1 == live.head()["world"]


def test_a_driver_that_was_started_anew_is_shown_though_its_epochs_begin_anew(live, client, recorded):
    reader = live.reader()
    client.hand_over(recorded, 4.0, epoch=7)
    before = next_frame(reader)
    last = client.hand_over(recorded, 1.0)
    after = next_frame(reader)
    assert last["sim/truth"].epoch < 7
    assert after["frame"]["t"] == pytest.approx(last["sim/truth"].stamp_ns * 1e-9)
    assert after["epoch"] == before["epoch"] + 1


def test_lines_of_logs_and_health_are_reported(live, client):
    line = LogRecord(level="warning", text="a foot slides", stamp_ns=0, tick=0, epoch=1, seq=0, source="walker")
    client.sinks[LOG.key](Delivery(LOG, line, None))
    content = json.loads(live.reader().next(WAIT_S))
    assert content["status"]["log"] == [["warning", "walker: a foot slides"]]
    assert content["frame"] is None


def test_a_page_that_does_not_read_is_given_up(server, live, client, recorded, warnings, monkeypatch):
    monkeypatch.setattr(serving._Handler, "timeout", 0.3)
    given_up = threading.Event()
    server.warn = lambda text: (warnings.append(text), given_up.set())
    stuck = socket.socket()
    stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
    stuck.connect((HOST, server.port))
    stuck.sendall(f"GET /events?token={server.token} HTTP/1.1\r\nHost: {HOST}:{server.port}\r\n\r\n".encode())
    other = live.reader()
    client.hand_over(recorded, 0.1)
    again = dict(client.newest)
    for _ in range(1000):
        client.newest = dict(again)
        next_frame(other)  # who reads gets frames meanwhile
        if given_up.is_set():
            break
    stuck.close()
    assert "has not read" in warnings[0]


def test_an_unknown_action_is_an_error(live):
    with pytest.raises(SurefootError, match="allowed are"):
        live.act("fly", {})


def test_a_robot_that_is_not_known_here_is_named_with_the_option():
    with pytest.raises(SurefootError, match="--robot"):
        robot_behind(QuietClient({"hw/description": SimpleNamespace(robot="nobot", hash="")}), None, print)


def test_another_description_than_the_drivers_is_reported(warnings):
    answers = {"hw/description": SimpleNamespace(robot="ragno", hash="another")}
    assert robot_behind(QuietClient(answers), None, warnings.append).name == "ragno"
    assert "another description" in warnings[0]


class CountedDelivery(Delivery):
    """A message that counts how often it is decoded."""

    def message(self):
        self.decoded.append(self.key)
        return super().message()

    decoded: list[str]


def test_joints_and_switches_are_not_decoded_while_the_truth_comes(client, recorded):
    scene = NewestScene(client, load_robot("ragno"))
    assert "hw/imu" not in client.asked

    def shown(without=()):
        client.hand_over(recorded, without=without)
        counted = {key: CountedDelivery(one.topic, one.message(), None) for key, one in client.newest.items()}
        CountedDelivery.decoded, client.newest = [], counted
        came, snapshot = scene.look()
        assert came
        assert snapshot is not None
        return json.dumps(frame(snapshot)), set(CountedDelivery.decoded)

    first, decoded = shown()
    assert decoded >= {"hw/joints", "hw/contacts", "sim/truth"}
    again, decoded = shown()
    assert again == first
    assert "sim/truth" in decoded
    assert not decoded & {"hw/joints", "hw/contacts"}
    without, decoded = shown(without=("sim/truth",))
    assert decoded >= {"hw/joints", "hw/contacts"}
    assert without == first  # the last truth
