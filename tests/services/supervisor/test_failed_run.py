"""Runs that mean nothing end at once and never pass; a service that cannot be set up says so in a sentence."""

import os
import subprocess
import sys
from pathlib import Path

from services.supervisor.scenario import parse_scenario
from services.supervisor.study import run_local

MAD = """
description = "a push no robot survives"
max_duration_s = 20.0
[[step]]
at_tick = 60
do = "push"
force = [1.0e9, 0.0, 0.0]
duration = 0.5
[[step]]
when = "ready"
after_s = 15.0
do = "stand"
"""


def test_physics_that_diverged_end_the_run_and_fail_it() -> None:
    run = run_local(parse_scenario(MAD, Path("mad.toml")), 0)
    assert not run.verdict.ok
    assert any("diverged" in problem and "accelerations" in problem for problem in run.verdict.problems)
    assert 60 < run.ticks < 200


def test_a_service_told_to_use_an_unknown_robot_says_so() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "services.supervisor.launch", "footholds", "--connect", "tcp/127.0.0.1:1"],
        env=dict(os.environ, SUREFOOT_ROBOT="nobody"), capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert "nobody" in done.stderr and "ragno" in done.stderr
