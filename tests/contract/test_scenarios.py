"""Every scenario can be run: its system, terrain, commands and limits exist."""

from pathlib import Path

import pytest

from surefoot.files import find
from surefoot.lab.report.judge import METRICS
from surefoot.robot.reader import load_robot
from surefoot.schemas.base import Request
from surefoot.schemas.sim import World
from surefoot.services.simulator.ground.terrain import KINDS
from surefoot.services.supervisor.processes.compose import ComposeError, load_compose
from surefoot.services.supervisor.scenarios.director import LEAD_TICKS
from surefoot.services.supervisor.scenarios.limits import LIMITS
from surefoot.services.supervisor.scenarios.scenario import COMMANDS, load_scenario

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / "scenarios").glob("*.toml"))


def test_there_are_some() -> None:
    assert {"rough-terrain", "flat", "stand", "push"} <= {path.stem for path in FILES}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_can_be_run(path: Path) -> None:
    scenario = load_scenario(path)
    assert scenario.name == path.stem
    assert scenario.description
    assert scenario.steps
    assert "no_fall" in scenario.limits
    assert scenario.world.terrain in KINDS
    compose = load_compose(find("compose", scenario.compose, ".yaml", ComposeError))
    assert "simulator" in compose.services
    for service in compose.services.values():
        load_robot(service.environment["SUREFOOT_ROBOT"])
    for step in scenario.steps:
        assert step.do == "kill" or step.request is not None
        assert not step.service or step.service in compose.services
        assert step.at_tick is None or LEAD_TICKS <= step.at_tick < scenario.max_ticks


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_robot_that_walks_undisturbed_keeps_its_static_margin(path: Path) -> None:
    """Statically stable gaits: one sample with the centre of mass near the edge is a fault of walker or stability."""
    scenario = load_scenario(path)
    compose = load_compose(find("compose", scenario.compose, ".yaml", ComposeError))
    robot = load_robot(compose.services["simulator"].environment["SUREFOOT_ROBOT"])
    does = {step.do for step in scenario.steps}
    least = {"hexapod": 0.03, "quadruped": 0.02}
    if robot.kind in least and "walk" in does and not does & {"push", "fault", "set", "kill"}:
        assert scenario.limits["min_margin_m"] >= least[robot.kind]


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_step_is_a_command_with_a_tick(name: str) -> None:
    query, model = COMMANDS[name]
    assert issubclass(model, Request)
    assert query.request is model
    assert "at_tick" in model.model_fields


def test_every_limit_has_a_metric() -> None:
    assert {limit.metric for limit in LIMITS.values()} <= set(METRICS)


def test_the_page_names_every_step_and_limit() -> None:
    page = (ROOT / "docs" / "systems.md").read_text(encoding="utf-8")
    for word in (*COMMANDS, *LIMITS, *World.model_fields):
        assert f"`{word}`" in page or f"`{word} = " in page, word
