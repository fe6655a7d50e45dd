"""Goals over Zenoh: the same run as in one process, and a navigator that is killed on the way and goes on."""

import json
import signal
import sys
from pathlib import Path
from typing import Any

import pytest

from surefoot.client import connect
from surefoot.errors import BusError, CallError
from surefoot.lab.runs.local import run_local
from surefoot.schemas.topics import STATE_POSE
from surefoot.services.supervisor.scenarios.scenario import load_scenario
from tests.e2e.live import ROOT, environment, wait_until
from tests.ports import free_address
from tests.processes import run_process, running

pytestmark = pytest.mark.e2e

PACE = 0.4
"""Simulated over wall time: a robot in paced time falls where its walker gets no processor for 0.1 s."""
END_S = 80.0  # s wall; takes 1 to 2

SHORT = """
description = "Nao walks 20 cm to a goal"
compose = "nao-goal"
max_duration_s = 40.0
[world]
terrain = "corridor"
[config.navigator]
policy = "steer"
[[step]]
when = "ready"
do = "goto"
position = [0.25, 0.05]
xy_goal_tolerance = 0.15
[limits]
no_fall = true
all_goals = true
max_goal_error_m = 0.15
"""
KILL = """
[[step]]
at_tick = 500
do = "kill"
service = "navigator"
"""


def run(folder: Path, text: str) -> tuple[Path, dict[str, Any]]:
    """Conducts a scenario with `surefoot run`; returns its file and what was printed."""
    path = folder / "short.toml"
    path.write_text(text)
    done = run_process(
        [sys.executable, "-m", "surefoot.lab.cli.main", "run", str(path), "--json", "--out", str(folder / "out")],
        cwd=ROOT, env=environment(folder, SUREFOOT_LISTEN=free_address()), timeout=300, capture_output=True,
        text=True,
    )  # fmt: skip
    assert done.stdout, done.stderr
    return path, json.loads(done.stdout)


def test_a_goal_over_zenoh_is_the_run_of_one_process(tmp_path: Path) -> None:
    path, result = run(tmp_path, SHORT)
    assert result["ok"], result
    assert run_local(load_scenario(path)).run_hash in json.dumps(result)


def stands(where: str) -> bool:
    """Return whether the robot of the system at an endpoint is there."""
    try:
        with connect("nao", where) as robot:
            return robot.latest(STATE_POSE, 5.0).initialised
    except (BusError, CallError):
        return False


def test_the_example_walks_to_its_goal_in_paced_time(tmp_path: Path) -> None:
    where = free_address()
    around = environment(tmp_path, SUREFOOT_LISTEN=where)
    command = [sys.executable, "-m", "surefoot.lab.cli.main"]
    log = tmp_path / "up.log"
    with (
        log.open("wb") as stream,
        running(
            [*command, "up", "nao-goal", "--terrain", "corridor", "--rtf", str(PACE)],
            cwd=ROOT, env=around, stdout=stream, stderr=stream,
        ) as up,
    ):  # fmt: skip
        wait_until(lambda: stands(where), 120.0, "the robot")
        done = run_process(
            [sys.executable, str(ROOT / "examples" / "goto.py"), where, "0.3", "0.06"],
            cwd=tmp_path, env=around, timeout=200, capture_output=True, text=True,
        )  # fmt: skip
        up.send_signal(signal.SIGINT)
        assert up.wait(END_S) == 0
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[-1].startswith("succeeded"), done.stdout
    assert len(lines) >= 3  # two decisions at least, each with its reason


def test_a_navigator_that_is_killed_goes_on_with_its_goal(tmp_path: Path) -> None:
    steps, limits = SHORT.replace("40.0", "300.0").split("[limits]")  # simulated time goes on while it starts anew
    _, result = run(tmp_path, f"{steps}{KILL}[limits]{limits}")
    assert result["ok"], (result["failed"], result["problems"], result["notes"])
    assert not result["comparable"]
    assert "navigator was restarted 1x" in result["notes"]
    assert "navigator was restarted" in (tmp_path / "out" / "report.html").read_text()
