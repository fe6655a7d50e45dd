"""Pages of "your robot in an afternoon": their commands are run as they stand, with stand-ins for hardware.

The robot is Lupo, exported and named as a Go2; a program beside the page's commands is the robot on ROS 2.
"""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.e2e.guide import BLOCK, Guide
from tests.e2e.live import ROOT
from tests.processes import end_systems

pytestmark = pytest.mark.e2e

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


def test_a_log_and_nothing_else(guide: Guide) -> None:
    pytest.importorskip("rosbags")
    from tests.lab.bags.sway import sway, write_ros2

    write_ros2(guide.folder / "walk", sway(), guide.names)
    guide.run(guide.commands("logs.md", others={"/foot_force": "/feet.effort"}))
    for name in ("walk.mcap", "walk.html", "estimate/estimates.npz", "walk-bag"):
        assert (guide.folder / name).exists(), name
