"""Goals over Zenoh: the same run as in one process, and a navigator that is killed on the way and goes on."""

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from surefoot.lab.runs.local import run_local
from surefoot.services.supervisor.scenarios.scenario import load_scenario
from tests.e2e.live import ROOT, environment
from tests.ports import free_address
from tests.processes import run_process

pytestmark = pytest.mark.e2e

SHORT = """
description = "Nao walks 30 cm to a goal"
compose = "nao-goal"
max_duration_s = 40.0
[world]
terrain = "corridor"
[config.navigator]
policy = "steer"
[[step]]
when = "ready"
do = "goto"
position = [0.35, 0.05]
[limits]
no_fall = true
all_goals = true
max_goal_error_m = 0.2
"""
KILL = """
[[step]]
at_tick = 700
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


def test_a_navigator_that_is_killed_goes_on_with_its_goal(tmp_path: Path) -> None:
    steps, limits = SHORT.split("[limits]")
    _, result = run(tmp_path, f"{steps}{KILL}[limits]{limits}")
    assert result["ok"], result
    assert "navigator was restarted 1x" in json.dumps(result)
