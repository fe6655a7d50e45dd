"""Facts on a run in its recording: the scenario reads back equal, a recording without one is refused in a sentence."""

import json
from pathlib import Path

import pytest

from surefoot.errors import SurefootError
from surefoot.files import names
from surefoot.schemas.sim import ResetRequest
from surefoot.services.supervisor.scenarios.recorded import about_run, recorded_scenario
from surefoot.services.supervisor.scenarios.scenario import load_scenario, parse_scenario
from tests.surefoot.expect import expect_error

FILE = Path("run.mcap")
EVERY_STEP = """
description = "x"
[config.walker]
stride_m = 0.04
[[step]]
do = "kill"
service = "estimator"
when = "ready"
after_s = 1.5
[[step]]
do = "goto"
position = [0.5, 0.1]
at_tick = 100
[[step]]
do = "turn"
angle = 0.2
when = "walk_done"
[limits]
no_fall = true
min_margin_m = 0.02
"""


@pytest.mark.parametrize("name", [*names("scenarios", ".toml"), "every step"])
def test_a_scenario_reads_back_equal(name: str) -> None:
    scenario = parse_scenario(EVERY_STEP) if name == "every step" else load_scenario(name)
    tables = json.loads(about_run("ragno", "ragno", ("walker",), ResetRequest(), scenario))
    assert recorded_scenario(tables, FILE) == scenario
    assert tables["run"]["scenario"] == scenario.name
    assert {"python", "numpy", "mujoco"} <= set(tables["versions"])


def test_a_recording_without_a_scenario_is_refused() -> None:
    tables = json.loads(about_run("ragno", "ragno", (), ResetRequest()))
    with expect_error(SurefootError, "invalid", text="carries no scenario: it was not made by"):
        recorded_scenario(tables, FILE)
    long = parse_scenario(EVERY_STEP.replace('"x"', f'"{"x" * 200_000}"'))
    tables = json.loads(about_run("ragno", "ragno", (), ResetRequest(), long))
    assert len(json.dumps(tables)) < 10_000
    with expect_error(SurefootError, "invalid", text="too long"):
        recorded_scenario(tables, FILE)
