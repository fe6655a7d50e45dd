"""A goal on images of the floor alone: the services of a run in one process, with a map of the same floor."""

import math
from dataclasses import replace

import numpy as np
import pytest

from surefoot.lab.runs.local import run_local
from surefoot.lab.vision.blur import map_by_grid, still_camera
from surefoot.lab.vision.replay import floor
from surefoot.schemas.navigation import GotoRequest
from surefoot.services.supervisor.scenarios.scenario import Step, find_scenario, load_scenario
from surefoot.services.vision.feature_map import save

START = (0.05, -0.06, 0.1)
"""True pose at the start, m and rad; the belief begins at the origin."""


@pytest.mark.slow
def test_a_robot_set_down_beside_its_start_finds_its_place_on_images_and_walks_to_the_goal(tmp_path):
    scenario = load_scenario(find_scenario("examples/vision/nao-eyes.toml"))
    seed = scenario.world.texture_seed
    assert seed is not None
    ground = still_camera(floor("parquet", seed), 0.01)
    world = str(save(map_by_grid(ground, "orb", np.arange(-0.2, 1.0, 0.15).tolist(), (-0.2, 0.0, 0.2)), tmp_path / "m"))
    goal = Step("goto", when="ready", after_s=1.5, request=GotoRequest(position=(0.8, 0.0)))
    config = {"navigator": scenario.config["navigator"] | {"landmarks": world}, "vision": {"map": world}}
    beside = scenario.world.model_copy(update={"start": START})
    found = run_local(replace(scenario, world=beside, config=config, steps=(goal,)), 3, without=("recorder",)).verdict
    assert found.ok, found.problems
    values = {name: found.value(name) for name in ("goal_error_m", "pose_error_m")}
    assert values["goal_error_m"] is not None
    assert values["goal_error_m"] < 0.2
    assert values["pose_error_m"] is not None
    assert values["pose_error_m"] < 0.5 * math.hypot(*START[:2])
