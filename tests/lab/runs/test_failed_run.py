"""Runs that mean nothing end at once and never pass; a service that cannot be set up reports it in a sentence."""

import os
import sys
from pathlib import Path

import pytest

from surefoot.files import find
from surefoot.lab.runs.local import run_local
from surefoot.logline import read_log_line
from surefoot.robot.reader import load_robot
from surefoot.services.simulator.ground.terrain import make_terrain
from surefoot.services.simulator.physics import disturb
from surefoot.services.simulator.world import PhysicsWorld
from surefoot.services.supervisor.processes.compose import ComposeError
from surefoot.services.supervisor.scenarios.scenario import parse_scenario
from tests.processes import run_process

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


def test_physics_that_diverged_end_the_run_and_fail_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(disturb, "MOST_WEIGHTS", 1e12)  # else such a push is refused
    run = run_local(parse_scenario(MAD, Path("mad.toml")), 0)
    assert not run.verdict.ok
    assert any("diverged" in problem and "accelerations" in problem for problem in run.verdict.problems)
    assert 60 < run.ticks < 200


def test_a_service_told_to_use_an_unknown_robot_says_so() -> None:
    done = run_process(
        [sys.executable, "-m", "surefoot.lockstep.discover", "footholds", "--connect", "tcp/127.0.0.1:1"],
        env=dict(os.environ, SUREFOOT_ROBOT="nobody"), capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert "nobody" in done.stderr
    assert "ragno" in done.stderr


@pytest.mark.parametrize(("words", "env"), [(("--terrain", "moon"), {}), ((), {"SUREFOOT_ROBOT": "rango"})])
def test_a_system_that_cannot_begin_ends_with_a_sentence(
    words: tuple[str, ...], env: dict[str, str], listen: str, tmp_path: Path
) -> None:
    compose = tmp_path / "x.yaml"
    text = find("compose", "ragno", ".yaml", ComposeError).read_text()
    compose.write_text(text.replace("SUREFOOT_ROBOT: ragno", f"SUREFOOT_ROBOT: {env.get('SUREFOOT_ROBOT', 'ragno')}"))
    done = run_process(
        [sys.executable, "-m", "surefoot.lab.cli.main", "up", str(compose), *words, "--listen", listen],
        cwd=tmp_path, env=dict(os.environ, XDG_STATE_HOME=str(tmp_path)), capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert ("moon" in done.stderr and "flat" in done.stderr) or ("rango" in done.stderr and "ragno" in done.stderr)
    assert "Traceback" not in done.stderr


def test_a_world_taken_back_forgets_that_it_diverged_later() -> None:
    world = PhysicsWorld(load_robot("ragno"), make_terrain("flat", 0), 0)
    saved = world.checkpoint()
    world.push((1.0e9, 0.0, 0.0), 0.1)
    for _ in range(20):
        world.step_tick()
    assert world.diverged
    world.restore(saved)
    assert not world.diverged


@pytest.mark.parametrize(
    ("options", "environment", "source"),
    [
        ((), {"SUREFOOT_CONNECT": "7447"}, "SUREFOOT_CONNECT"),
        (("--connect", "tcp/host"), {}, "--connect"),
        (("--listen", "127.0.0.1:0"), {}, "--listen"),
    ],
)
def test_a_service_refuses_what_is_no_endpoint(
    options: tuple[str, ...], environment: dict[str, str], source: str
) -> None:
    done = run_process(
        [sys.executable, "-m", "surefoot.lockstep.discover", "footholds", *options],
        env={**os.environ, **environment}, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    found = read_log_line(line)
    assert found is not None
    assert found.text.startswith(f"{source}: got ")
    assert "tcp/<host>:<port" in found.text
