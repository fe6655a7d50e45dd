"""From outside, nothing of ours imported: plain Zenoh, zenoh-cli and the examples against a live system."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from surefoot.client import connect
from surefoot.errors import BusError
from surefoot.schemas.topics import STATE_VELOCITY
from tests.ports import free_address
from tests.processes import end_systems, run_process, running

ROOT = Path(__file__).parents[2]
BIN = Path(sys.executable).parent

END_S = 80.0  # s wall; takes 1 to 2

pytestmark = pytest.mark.e2e

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


@pytest.fixture(scope="module")
def endpoint(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A system that is up on a port of its own."""
    folder = tmp_path_factory.mktemp("up")
    where = free_address()
    environment = dict(os.environ, SUREFOOT_LISTEN=where, XDG_STATE_HOME=str(folder))
    command = [sys.executable, "-m", "surefoot.lab.cli.main", "up", "ragno"]
    try:
        with (
            (folder / "up.log").open("w") as log,
            running(command, cwd=folder, env=environment, stdout=log, stderr=log) as up,
        ):
            _wait_until_it_walks(where, up)
            yield where
            up.send_signal(signal.SIGINT)
            assert up.wait(END_S) == 0
    finally:
        end_systems(folder / "surefoot")


def _wait_until_it_walks(where: str, up: subprocess.Popen[bytes]) -> None:
    for _ in range(20):  # a client waits 8 s for the router
        assert up.poll() is None, "surefoot up ended"
        try:
            with connect("ragno", where) as robot:
                robot.latest(STATE_VELOCITY, 300.0)
                return
        except BusError as error:
            last = error
    raise AssertionError(f"not up: {last}")


def test_plain_zenoh_python(endpoint: str, tmp_path: Path) -> None:
    done = run_process([sys.executable, "-I", "-c", PLAIN, endpoint], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    got = json.loads(done.stdout)
    assert len(got["velocity"]) == 3
    assert got["region"]["status"] == "ok"
    assert len(got["region"]["inner"]) == 3
    assert got["error"]["code"] == "invalid"
    assert got["error"]["field"] == "direction"
    assert got["ours"] is False


def test_zenoh_cli_asks_for_a_region(endpoint: str, tmp_path: Path) -> None:
    contacts = [{"position": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0], "mu": 0.5}]
    done = run_process(
        [
            str(BIN / "zenoh"), "--mode", "client", "--connect", endpoint, "get",
            "--selector", "surefoot/ragno/stability/region", "--value", json.dumps({"contacts": contacts}),
            "--encoder", "text", "--decoder", "json",
        ],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert "point" in done.stdout, done.stdout + done.stderr


def test_zenoh_cli_echoes_the_velocity(endpoint: str, tmp_path: Path) -> None:
    command = [
        str(BIN / "zenoh"), "--mode", "client", "--connect", endpoint, "subscribe",
        "-k", "surefoot/ragno/state/velocity", "--decoder", "text", "--line", "{value}",
    ]  # fmt: skip
    environment = dict(os.environ, PYTHONUNBUFFERED="1")
    with running(command, cwd=tmp_path, env=environment, text=True, stdout=subprocess.PIPE) as echo:
        assert echo.stdout is not None
        ticks = [json.loads(echo.stdout.readline())["tick"] for _ in range(5)]
    assert ticks == sorted(set(ticks))


EXAMPLES = sorted({p.name for p in (ROOT / "examples").glob("*.py")} - {"goto.py"})
"""Those for Ragno; `test_goals.py` runs the other one."""


@pytest.mark.parametrize("name", EXAMPLES)
def test_example_runs(endpoint: str, name: str, tmp_path: Path) -> None:
    command = [sys.executable, str(ROOT / "examples" / name), endpoint]
    done = run_process(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout
