"""Pages of "your robot in an afternoon": their commands are run as they stand, with stand-ins for hardware.

The robot is Lupo, exported and named as a Go2; a program beside the page's commands is the robot on ROS 2.
"""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from surefoot.lab.robots.export import mjcf_of
from surefoot.robot.kinematics import foot_positions
from surefoot.robot.reader import load_robot
from tests.e2e.guide import BLOCK, Guide
from tests.e2e.live import ROOT
from tests.processes import end_systems

pytestmark = pytest.mark.e2e

DOMAIN = "93"  # of DDS, of this test alone
CRAWLS = "surefoot run crawl-"
"""Walks that tests of scenarios do for the same robot."""
ROS = """
import sys, time
from tests.lab.bags.sway import messages, sway
from surefoot.bus.ros2 import Ros2Node, types
from surefoot.errors import BusError
log, names, node = sway(120.0, 100), sys.argv[2].split(","), None
while node is None:
    try:
        node = Ros2Node("dog", sys.argv[1])
    except BusError:  # no router yet
        time.sleep(0.2)
rows = messages(log, types(), names)
out = {topic: node.publisher(topic, rows[topic][0][1].__msgtype__) for topic in ("/imu/data", "/joint_states")}
began = time.monotonic()
for k in range(len(log.stamp_ns)):
    for topic, publisher in out.items():
        publisher.put(rows[topic][k][1])
    time.sleep(max(0.0, began + 0.01 * k - time.monotonic()))
"""
"""Publishes a robot that stands and sways as rmw_zenoh would: router, names of the joints."""


@pytest.fixture
def guide(tmp_path: Path) -> Iterator[Guide]:
    yield Guide(tmp_path)
    end_systems(tmp_path / "state" / "surefoot")


def test_a_simulated_quadruped(guide: Guide) -> None:
    count = len(BLOCK.findall((ROOT / "docs" / "afternoon.md").read_text(encoding="utf-8")))
    lines = [line for block in range(count) for line in guide.commands("afternoon.md", block)]
    shown = guide.run([line for line in lines if not line.startswith(CRAWLS)])
    assert sum(line.startswith(CRAWLS) for line in lines) == 2
    assert "sphere at body" in shown or "foot of fl" in shown
    for command in ("robot check ./", "run stand --robot ./", "run crawl-flat --robot ./"):
        assert f"next: surefoot {command}" in shown  # each command is printed by the one before
    assert "velocity=" in shown
    assert "accepted" in shown


def test_a_robot_on_ros_2(guide: Guide) -> None:
    pytest.importorskip("rosbags")
    with guide.beside("-c", ROS, guide.address, ",".join(guide.names)):
        shown = guide.run(guide.commands("ros2.md"))
    assert "velocity=" in shown


def test_a_go2_over_dds(guide: Guide) -> None:
    """The fake of the page publishes on loopback, in a domain of its own; the legs of Lupo have its names for links."""
    pytest.importorskip("cyclonedds")
    parts = (f"{leg}_{part}" for leg in ("FR", "FL", "RR", "RL") for part in ("hip", "thigh", "calf"))
    driver = f"SUREFOOT_UNITREE_DOMAIN={DOMAIN} SUREFOOT_UNITREE_JOINTS='{json.dumps(list(parts))}'"
    lines = guide.commands("unitree.md", others={"INTERFACE=eth0": f"INTERFACE=lo {driver}"})
    with guide.beside(str(ROOT / "examples" / "unitree" / "fake.py"), DOMAIN, "3600"):
        shown = guide.run(lines)
    assert "velocity=" in shown


def test_a_model_and_controller_of_ones_own(guide: Guide) -> None:
    """The model is Lupo on a floor; two commands go on in shells of their own while the last one looks."""
    (guide.folder / "examples").symlink_to(ROOT / "examples")
    lupo = load_robot("lupo")
    (guide.folder / "dog.xml").write_text(mjcf_of(lupo))
    floor = foot_positions(lupo.model, lupo.neutral)[:, 2].mean() - lupo.foot_radius
    plane = f'<worldbody><geom type="plane" size="5 5 1" pos="0 0 {floor}"/></worldbody>'
    (guide.folder / "scene.xml").write_text(f'<mujoco><include file="dog.xml"/>{plane}</mujoco>')
    first, driver, estimator, look = guide.commands("own-driver.md")
    guide.run([first])
    guide.environment["SUREFOOT_ROBOT"] = "./dog"
    assert driver.startswith("SUREFOOT_ROBOT=./dog python ")
    assert estimator.startswith("SUREFOOT_ROBOT=./dog surefoot-service ")
    service = ("-m", "surefoot.lockstep.discover", *estimator.split()[2:])
    with guide.beside(*driver.split()[2:]), guide.beside(*service):
        shown = guide.run([f"for each in $(seq 50); do {look} && break; done"])  # until both are there
    assert "velocity=" in shown


def test_a_gait_of_ones_own(guide: Guide) -> None:
    (guide.folder / "examples").symlink_to(ROOT / "examples")
    shown = guide.run(guide.commands("own-driver.md", 1))
    assert "status=" in shown
    assert "infeasible" in shown


def test_a_log_and_nothing_else(guide: Guide) -> None:
    pytest.importorskip("rosbags")
    from tests.lab.bags.sway import sway, write_ros2

    write_ros2(guide.folder / "walk", sway(), guide.names)
    guide.run(guide.commands("logs.md", others={"/foot_force": "/feet.effort"}))
    for name in ("walk.mcap", "walk.html", "estimate/estimates.npz", "walk-bag"):
        assert (guide.folder / name).exists(), name
