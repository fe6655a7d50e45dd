"""A model of somebody else with a controller of their own: the estimator follows it."""

import runpy
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.lab.robots.export import mjcf_of
from surefoot.lab.robots.folder import import_robot
from surefoot.lockstep.local import LocalSystem
from surefoot.robot.kinematics import foot_positions
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.config import EstimatorConfig
from surefoot.services.estimator.service import EstimatorService

EXAMPLE = Path(__file__).parents[3] / "examples" / "mujoco"
SECONDS, FROM_S = 3.0, 1.5  # before it the model settles, and the estimator begins anew


def test_the_estimate_follows_a_model_of_another(tmp_path: Path) -> None:
    lupo = load_robot("lupo")
    (tmp_path / "dog.xml").write_text(mjcf_of(lupo))
    import_robot(tmp_path / "dog.xml", tmp_path / "dog")
    floor = foot_positions(lupo.model, lupo.neutral)[:, 2].mean() - lupo.foot_radius
    plane = f'<worldbody><geom type="plane" size="5 5 1" pos="0 0 {floor}"/></worldbody>'
    (tmp_path / "scene.xml").write_text(f'<mujoco><include file="dog.xml"/>{plane}</mujoco>')
    made: Any = runpy.run_path(str(EXAMPLE / "driver.py"))["MujocoRobot"]
    config = made.Config(
        robot=str(tmp_path / "dog"), model=str(tmp_path / "scene.xml"), controller=str(EXAMPLE / "controller.py")
    )
    driver, estimator = made(config), EstimatorService(EstimatorConfig(robot=str(tmp_path / "dog")))
    system = LocalSystem([driver, estimator])
    driver.node.begin(("estimator",), "lockstep", 0.0, 1, "fail", 0)
    leader = driver.node.leader
    leader.end_tick = round(100 * SECONDS)
    way: list[tuple[float, float]] = []

    def finished() -> bool:
        if driver.data.time > FROM_S:
            way.append((float(driver.data.qpos[0]), float(estimator.estimator.pose().position[0])))
        return leader.state == "ended" and leader.all_done()

    system.run_until(finished)
    system.close()
    assert estimator.estimator.initialised
    true, own = np.array(way).T
    assert np.ptp(true) > 0.01
    assert np.abs((own - own[0]) - (true - true[0])).max() < 0.0015
