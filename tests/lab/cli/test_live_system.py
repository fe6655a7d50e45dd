"""A system that is up: by plain Zenoh, zenoh-cli and the examples, nothing of ours imported; by the command line."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from surefoot.bus.zenoh import ZenohBus, ZenohOptions
from surefoot.client import connect
from surefoot.errors import CallError
from surefoot.geometry.heightmap_files import load
from surefoot.services.supervisor.processes.rundir import RunFolder
from tests.ports import free_address
from tests.processes import run_process, running

pytestmark = pytest.mark.e2e

ROOT = Path(__file__).parents[3]
WAIT_S = 80.0  # s wall; takes 1 to 3
PLAIN = """
import json, sys, zenoh
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [sys.argv[1]]}}))
with zenoh.open(config) as session:
    subscriber = session.declare_subscriber("surefoot/ragno/state/velocity")
    v = json.loads(subscriber.recv().payload.to_string())
    feet = [{"position": [x, y, 0], "normal": [0, 0, 1], "mu": 0.5} for x, y in [(0.1, 0.1), (0.1, -0.1), (-0.1, 0)]]
    answers = session.get("surefoot/ragno/stability/region", payload=json.dumps({"contacts": feet}), timeout=60.0)
    region = json.loads(next(iter(answers)).ok.payload.to_string())
    typo = json.dumps({"contacts": feet, "direction": 8})
    wrong = session.get("surefoot/ragno/stability/region", payload=typo, timeout=60.0)
    error = json.loads(next(iter(wrong)).err.payload.to_string())
print(json.dumps({"velocity": v["velocity"], "region": region, "error": error, "ours": "surefoot" in sys.modules}))
"""


def processes(place):
    return RunFolder("ragno", place[0] / "state" / "surefoot").processes()


@pytest.fixture(scope="module")
def system(surefoot):
    done = surefoot("up", "ragno", "-d")
    assert done.returncode == 0, done.stderr
    yield
    assert surefoot("down").returncode == 0


@pytest.fixture
def endpoint(system, place):
    return place[1]["SUREFOOT_LISTEN"]


def test_plain_zenoh_python(endpoint, tmp_path):
    done = run_process([sys.executable, "-I", "-c", PLAIN, endpoint], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    got = json.loads(done.stdout)
    assert len(got["velocity"]) == 3
    assert got["region"]["status"] == "ok"
    assert len(got["region"]["inner"]) == 3
    assert got["error"]["code"] == "invalid"
    assert got["error"]["field"] == "direction"
    assert got["ours"] is False


def test_zenoh_cli_asks_for_a_region(endpoint, tmp_path):
    contacts = [{"position": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0], "mu": 0.5}]
    done = run_process(
        [
            str(Path(sys.executable).parent / "zenoh"), "--mode", "client", "--connect", endpoint, "get",
            "--selector", "surefoot/ragno/stability/region", "--value", json.dumps({"contacts": contacts}),
            "--encoder", "text", "--decoder", "json",
        ],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert "point" in done.stdout, done.stdout + done.stderr


def test_zenoh_cli_echoes_the_velocity(endpoint, tmp_path):
    command = [
        str(Path(sys.executable).parent / "zenoh"), "--mode", "client", "--connect", endpoint, "subscribe",
        "-k", "surefoot/ragno/state/velocity", "--decoder", "text", "--line", "{value}",
    ]  # fmt: skip
    environment = dict(os.environ, PYTHONUNBUFFERED="1")
    with running(command, cwd=tmp_path, env=environment, text=True, stdout=subprocess.PIPE) as echo:
        assert echo.stdout is not None
        ticks = [json.loads(echo.stdout.readline())["tick"] for _ in range(5)]
    assert ticks == sorted(set(ticks))


EXAMPLES = sorted({p.name for p in (ROOT / "examples").glob("*.py")} - {"goto.py"})
"""Those for Ragno; `tests/e2e/test_goals.py` runs the other one."""


@pytest.mark.parametrize("name", EXAMPLES)
def test_example_runs(endpoint, name, tmp_path):
    command = [sys.executable, str(ROOT / "examples" / name), endpoint]
    done = run_process(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_tells_how_to_watch_it(system, surefoot):
    done = surefoot("status")
    assert done.returncode == 0
    assert len(re.findall(r"\bhealthy\b", done.stdout)) == 6


def test_topics_can_be_heard_and_measured(system, surefoot):
    done = surefoot("topic", "echo", "state/odometry", "-n", "3", "--timeout", "60", "--raw")
    assert done.returncode == 0
    assert len([json.loads(line) for line in done.stdout.splitlines()]) == 3
    rate = json.loads(surefoot("topic", "hz", "hw/imu", "--window", "1", "--json").stdout)
    assert rate["simulated_hz"] == pytest.approx(100.0, rel=0.02)


def test_queries_are_answered_or_refused_in_words(system, surefoot):
    reply = json.loads(surefoot("call", "sim/features").stdout)
    assert reply["robot"] == "ragno"
    done = surefoot("call", "sim/push", '{"force": [0, 1, 0], "duration": 0.1, "body": "tail"}')
    assert done.returncode != 0
    assert "tail" in done.stderr


def test_nodes_parameters_and_traffic_of_a_running_system(system, surefoot):
    nodes = {node["service"]: node for node in json.loads(surefoot("node", "list", "--json").stdout)}
    assert {"simulator", "estimator", "walker", "stability", "footholds"} <= set(nodes)
    shown = surefoot("node", "info", "walker").stdout
    assert str(nodes["walker"]["pid"]) in shown
    assert re.search(r"asks +footholds/select", shown)
    assert surefoot("param", "set", "stability", "mu", "0.45").stdout == "stability: mu = 0.45\n"
    assert surefoot("param", "get", "stability", "mu").stdout == "0.45\n"
    status = json.loads(surefoot("topic", "echo", "state/stability", "--once", "--raw", "--timeout", "30").stdout)
    assert status["mu"] == 0.45
    surefoot("param", "set", "stability", "mu", "0.6")
    wrong = (("robot", "nao", "start only"), ("mu", "nan", "nan"), ("directions", "[1]", "[1]"), ("nu", "1", "mu"))
    for name, value, part in wrong:
        done = surefoot("param", "set", "stability", name, value)
        assert done.returncode == 2
        assert part in done.stderr
        assert "Traceback" not in done.stderr
    rows = {row["key"]: row for row in json.loads(surefoot("topic", "top", "--once", "--json").stdout)}
    assert 0.0 < rows["state/velocity"]["p50_ms"] <= rows["state/velocity"]["p99_ms"]
    assert "margin planned" in surefoot("topic", "top", "--once").stdout


def test_an_emergency_stop_is_confirmed_by_the_driver_and_released_by_a_reset(system, surefoot):
    for _ in range(2):
        done = surefoot("stop", "--reason", "a hand in the way", "--json")
        assert done.returncode == 0, done.stderr
        (found,) = json.loads(done.stdout)["systems"]
        assert (found["system"], found["driver"]) == ("ragno", "simulator")
        assert found["stopped"] == "a hand in the way"
    refused = json.loads(surefoot("health", "simulator", "--json").stdout)["refused"]
    assert refused["stopped"] > 0
    assert "held (emergency stop: a hand in the way)" in surefoot("sim", "status").stdout
    assert surefoot("sim", "reset").returncode == 0
    found = status(surefoot)
    assert (found["stopped"], found["mode"], found["pace"]) == ("", "paced", 1.0)  # as it was


def status(surefoot):
    return json.loads(surefoot("sim", "status", "--json").stdout)


def wait_for_pause(surefoot):
    """Return when time is paused: that happens at a tick to come, later still where all join anew after a reset."""
    deadline = time.monotonic() + WAIT_S
    while (found := status(surefoot)["state"]) != "paused" and time.monotonic() < deadline:
        time.sleep(0.02)
    assert found == "paused"


def test_paused_time_is_reported_by_status_echo_hz_and_the_client(system, surefoot, place):
    assert surefoot("sim", "pause").returncode == 0
    wait_for_pause(surefoot)
    assert "simulated time is paused" in surefoot("status").stdout
    for words in (
        ("topic", "echo", "state/velocity", "--timeout", "0.5"),
        ("topic", "hz", "hw/imu", "--window", "0.5"),
    ):
        done = surefoot(*words)
        assert done.returncode == 1
        assert "simulated time is paused" in done.stderr
    found = RunFolder("ragno", place[0] / "state" / "surefoot").endpoint()
    with connect("ragno", found.connect) as robot, pytest.raises(CallError, match="simulated time is paused"):
        robot.latest("state/velocity", 0.3)
    before = status(surefoot)["tick"]
    assert surefoot("sim", "step", "7").returncode == 0
    wait_for_pause(surefoot)
    assert status(surefoot)["tick"] == before + 7
    assert surefoot("sim", "speed", "0.8").returncode == 0
    assert surefoot("sim", "resume").returncode == 0
    assert (status(surefoot)["state"], status(surefoot)["pace"]) == ("running", 0.8)
    for words in (("push", "1.0"), ("set", "friction", "0.7"), ("fault", "imu_drop", "--duration", "0.1")):
        assert surefoot("sim", *words).returncode == 0
    assert surefoot("sim", "fault", "nosuch").returncode != 0
    assert surefoot("sim", "speed", "1").returncode == 0


def test_a_latched_topic_reaches_a_late_reader_and_its_numbers_are_kept(system, surefoot, tmp_path):
    done = surefoot("topic", "echo", "terrain/map", "-n", "1", "--timeout", "20", "--raw")
    assert done.returncode == 0, done.stderr
    out = tmp_path / "map.npz"
    assert surefoot("call", "terrain/map", "--out", out).returncode == 0
    assert load(out).shape == (json.loads(done.stdout)["rows"], json.loads(done.stdout)["cols"])


def test_a_stop_that_nobody_confirms_is_an_error(surefoot, place):
    address = free_address()
    bus = ZenohBus(ZenohOptions("router", (), (address,), "test/nobody"))
    try:
        done = surefoot("stop", "--timeout", "0.3", "--connect", address, "--namespace", "test/nobody", "--json")
    finally:
        bus.close()
    assert done.returncode == 1
    (found,) = json.loads(done.stdout)["systems"]
    assert found["driver"] == ""
    assert "cut the power" in found["detail"]


def test_it_cannot_be_started_twice(system, surefoot):
    for words in (["up", "ragno", "-d"], ["run", "stand"]):
        done = surefoot(*words)
        assert done.returncode == 1
        assert "surefoot down ragno" in done.stderr


def test_a_killed_service_is_healthy_again(system, surefoot, place):
    before = processes(place)["footholds"]
    os.kill(before.pid, signal.SIGKILL)
    deadline = time.monotonic() + WAIT_S
    while time.monotonic() < deadline:
        rows = {row["service"]: row for row in json.loads(surefoot("status", "--json").stdout)["ragno"]["services"]}
        if rows["footholds"]["restarts"] == 1 and rows["footholds"]["state"] == "healthy":
            break
    assert rows["footholds"]["restarts"] == 1
    assert rows["footholds"]["state"] == "healthy"
    assert processes(place)["footholds"] != before


def test_bags_are_recorded_and_played(system, surefoot, tmp_path):
    bag = tmp_path / "x.mcap"
    done = surefoot("bag", "record", "-o", bag, "--duration", "1", "-k", "state/odometry")
    assert done.returncode == 0, done.stdout
    assert json.loads(surefoot("bag", "info", bag, "--json").stdout)["topics"]["state/odometry"] > 10
    assert surefoot("bag", "record", "-o", bag, "--duration", "0.5").returncode == 2  # it exists
    nothing = surefoot("bag", "record", "-o", tmp_path / "y.mcap", "--duration", "0.3", "-k", "log/nobody")
    assert (nothing.returncode, "0 messages" in nothing.stdout) == (1, True)
    assert surefoot("bag", "play", bag, "-k", "state/odometry", "--start", "100").returncode == 1


def test_logs_are_kept(system, surefoot):
    shown = surefoot("logs", "supervisor", "--json").stdout.splitlines()
    told = [json.loads(line) for line in shown]
    assert "everything is ready" in [line["text"] for line in told]
    assert all(line["time"] and line["level"] for line in told)
    assert surefoot("logs", "nobody").returncode == 2


def test_what_a_killed_supervisor_leaves_behind_is_found_and_ended(system, surefoot, place):
    folder = RunFolder("ragno", place[0] / "state" / "surefoot")
    os.kill(folder.supervisor().pid, signal.SIGKILL)
    left = processes(place)
    assert len(left) == 6
    deadline = time.monotonic() + WAIT_S
    while folder.held() and time.monotonic() < deadline:
        time.sleep(0.02)
    done = surefoot("status")
    assert done.returncode == 1
    assert "services of ragno run without their supervisor; `surefoot down ragno` ends them" in done.stdout
    done = surefoot("stop", "--json")  # the router is gone; the driver has a port of its own
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["systems"][0]["driver"] == "simulator"
    done = surefoot("down", "ragno")
    assert done.returncode == 0
    assert "ragno" in done.stdout
    assert processes(place) == {}
