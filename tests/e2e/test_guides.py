"""Pages of "your robot in an afternoon": their commands are run as they stand, with stand-ins for hardware.

The robot is Lupo, exported and named as a Go2; a program beside the page's commands is the robot on ROS 2.
"""

import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest

from surefoot.lab.robots.export import mjcf_of
from surefoot.robot.reader import load_robot
from tests.e2e.live import ROOT, environment
from tests.ports import free_address
from tests.processes import end_process, end_systems, run_process, start_process

pytestmark = pytest.mark.e2e

BLOCK = re.compile(r"^```\n(.*?)^```", re.MULTILINE | re.DOTALL)
SHELL = """
set -e
surefoot() { "$PYTHON" -m surefoot.lab.cli.main "$@"; }
surefoot-service() { "$PYTHON" -m surefoot.lockstep.discover "$@"; }
python() { "$PYTHON" "$@"; }
"""
PARTS = {"lf": "FL", "rf": "FR", "lh": "RL", "rh": "RR", "femur": "thigh", "tibia": "calf"}
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


def renamed(text: str) -> str:
    """Return text with the names of Lupo's legs and links as those of a Go2."""
    return re.sub("|".join(rf"(?<![a-z]){name}(?![a-z])" for name in PARTS), lambda found: PARTS[found[0]], text)


class Guide:
    """A folder with the files of a user, and the commands of the pages."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.address = folder, free_address()
        self.names = renamed(",".join(load_robot("lupo").joint_names)).split(",")
        (folder / "go2.xml").write_text(renamed(mjcf_of(load_robot("lupo"))))
        self.environment = environment(folder, SUREFOOT_LISTEN=self.address, PYTHON=sys.executable)

    def commands(self, page: str, block: int = 0, others: Mapping[str, str] | None = None) -> list[str]:
        """Return the commands of a block of a page, without installing; `others` replaces words."""
        found = BLOCK.findall((ROOT / "docs" / page).read_text(encoding="utf-8"))[block]
        for old, new in {"tcp/127.0.0.1:7447": self.address, **(others or {})}.items():
            found = found.replace(old, new)
        return [line for line in found.splitlines() if not line.startswith(("pip ", "export SUREFOOT_LISTEN"))]

    def run(self, commands: list[str]) -> str:
        """Run commands in one shell; return what they print."""
        done = run_process(
            ["bash", "-m", "-c", "\n".join([SHELL, *commands])], cwd=self.folder, env=self.environment,
            capture_output=True, text=True,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    @contextmanager
    def beside(self, *words: str) -> Iterator[None]:
        """Run a program of Python beside the commands."""
        process = start_process(
            [sys.executable, *words], cwd=self.folder, env=self.environment, stdout=subprocess.DEVNULL
        )
        try:
            yield
        finally:
            end_process(process)


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
