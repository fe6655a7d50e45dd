"""The view of a robot of one's own: the driver of `examples/robot`, which knows no truth, no map, no features."""

import json
import runpy
from types import SimpleNamespace
from typing import Any

import pytest

from surefoot.client import query_named
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.lab.scene.film import UNITS_PER_M
from surefoot.lab.scene.styles import STYLES, VALUES
from surefoot.lab.view.live import QUERIES, LiveFrames
from surefoot.lab.view.newest import robot_behind
from surefoot.lab.view.page import live_page
from surefoot.lab.view.server import ViewServer
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.local import LocalSystem
from surefoot.robot.kinematics import foot_positions
from surefoot.robot.reader import load_robot
from surefoot.schemas.cmd import WalkCommand
from surefoot.schemas.topics import CMD_WALK, TICK_S
from surefoot.services.estimator.service import SERVICE as ESTIMATOR
from surefoot.services.stability.service import SERVICE as STABILITY
from surefoot.services.walker.service import SERVICE as WALKER
from tests.browser import CHROMIUM, MISSING, Browser
from tests.contract.published import FILE

WALKED_S = 1.0
EXAMPLE = FILE.parents[2] / "examples" / "robot" / "driver.py"
MyRobot = runpy.run_path(str(EXAMPLE))["MyRobot"]


class MyRobotInLockstep(MyRobot):
    """The example's driver, whose time waits for the services."""

    def on_begin(self):
        self.node.begin(("estimator", "walker", "stability"), "lockstep", rtf=1.0, delay=1, policy="fail", seed=0)


class LocalClient:
    """A client of a system in this process."""

    def __init__(self, bus):
        self.memory, self.last = bus, {}
        self.bus = SimpleNamespace(
            endpoint=SimpleNamespace(namespace="surefoot/ragno"), newest=self.newest, subscribe=bus.subscribe
        )

    def newest(self, topic):
        self.memory.subscribe(topic, lambda delivery: self.last.update({topic.key: delivery}))
        return lambda: self.last.get(topic.key)

    def gait(self, states=("standing", "walking")):
        """Return the tick of the last state of the gait; -1: there is none yet, or another."""
        last = self.last.get("state/gait")
        if last is None or last.prime or last.message().state not in states:
            return -1
        return last.message().tick

    def call(self, key, timeout_s=None, **fields):
        row = query_named(key)
        return self.memory.call(row, row.request(**fields), timeout_s)


@pytest.fixture(scope="module")
def own():
    """Frames of the robot after it has walked, beside the last messages of its bus."""
    kinds: tuple[Any, ...] = ESTIMATOR, STABILITY, WALKER
    services = [kind(kind.Config(robot="ragno")) for kind in kinds]
    driver = MyRobotInLockstep(ServiceConfig(robot="ragno"))
    system = LocalSystem([driver, *services])
    client: Any = LocalClient(system.bus)
    live = LiveFrames(client, robot_behind(client, "ragno", pytest.fail), lambda reason: (True, "held"))
    system.run_until(lambda: client.gait(("standing",)) >= 0)
    assert system.bus.call(CMD_WALK, WalkCommand(action="walk", distance=0.5)).accepted
    end = client.gait() + round(WALKED_S / TICK_S)
    system.run_until(lambda: client.gait() >= end)
    yield live, {key: delivery.message() for key, delivery in client.last.items() if not delivery.prime}
    live.close()
    system.close()


def first_frame(live):
    content = json.loads(live.reader().next(5.0))
    while content["frame"] is None:
        content = json.loads(live.reader().next(5.0))
    return content["frame"]


def test_the_frame_is_the_estimate_with_its_support_and_no_truth(own):
    live, last = own
    frame, robot = first_frame(live), load_robot("ragno")
    odometry, status, gait = (last[key] for key in ("state/odometry", "state/stability", "state/gait"))
    assert "sim/truth" not in last
    assert gait.state == "walking"
    at = 0.51 / UNITS_PER_M
    assert [x / UNITS_PER_M for x in frame["base"]] == pytest.approx(odometry.position, abs=at)
    values = dict(zip(VALUES, frame["values"], strict=True))
    assert values["margin"] == pytest.approx(1000.0 * status.margin_planned, abs=1e-3)
    assert values["speed"] == pytest.approx(last["state/velocity"].velocity[0], abs=1e-4)
    assert values["remaining"] == pytest.approx(gait.remaining, abs=1e-4)
    assert values["speed_true"] is values["drift"] is None
    items = {list(STYLES)[item[0]]: item[1:] for item in frame["items"]}
    assert {"region", "holding", "com_planned", "foothold_bad"} <= set(items)
    assert not {"ghost", "force", "footprint"} & set(items)
    rot = matrix_from_quat(odometry.quat_wxyz)
    feet = odometry.position + foot_positions(robot.model, last["hw/joints"].position) @ rot.T
    tails = [[x / UNITS_PER_M for x in items["holding"][i : i + 3]] for i in range(0, len(items["holding"]), 6)]
    standing = [foot for foot, on in zip(feet, status.stance, strict=True) if on]
    for tail, foot in zip(tails, standing, strict=True):
        assert tail == pytest.approx(foot - [0.0, 0.0, robot.foot_radius], abs=at)


@pytest.mark.skipif(CHROMIUM is None, reason=MISSING)
def test_the_page_shows_the_estimate_and_offers_the_stop_alone(own, tmp_path):
    live, last = own
    server = ViewServer(live_page("surefoot/ragno"), live, 0)
    with Browser(tmp_path) as browser:
        browser.go(server.url)
        browser.wait("document.body?.dataset.ready == '1'")
        title, _, digits = VALUES["margin"]
        shown = browser.run(
            f"[...document.querySelectorAll('.numbers div')].find(d => d.innerText.startsWith('{title}\\n')"
            f" || d.firstChild.textContent == '{title}').lastChild.textContent"
        )
        margin = 1000.0 * last["state/stability"].margin_planned
        assert float(shown.split()[0]) == pytest.approx(margin, abs=0.51 * 10.0**-digits)
        words = browser.run("document.querySelector('.words').textContent")
        assert words == "walking: no foothold advice: footholds is not on the roster"
        assert browser.run("document.getElementById('time').textContent").startswith("no simulated time")
        offered = "[...document.querySelectorAll('[data-needs], .stop')].filter(e => !e.hidden).map(e => e.className)"
        assert browser.run(f"{offered}.join()") == "stop"
        assert len(QUERIES) > 1
        assert not browser.faults
    server.close()
