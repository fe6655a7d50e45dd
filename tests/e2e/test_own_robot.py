"""A robot of one's own: a driver that is no simulator, in paced time over Zenoh, with the services a robot needs."""

import json
import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from surefoot.client import Client, connect
from surefoot.errors import BusError
from surefoot.record.recording import read_recording
from surefoot.schemas.topics import (
    CMD_WALK,
    HW_JOINTS,
    HW_TICK,
    SIM_STATUS,
    STATE_GAIT,
    STATE_ODOMETRY,
    STATE_STABILITY,
    SUPERVISOR_STATUS,
)
from tests.e2e.live import ROOT, environment, wait_until
from tests.ports import free_address
from tests.processes import end_process, end_systems, run_process, start_process

pytestmark = pytest.mark.e2e

SYSTEM = "examples/robot/system.yaml"
SERVICES = {"my-robot", "estimator", "stability", "walker", "recorder"}
WAIT_S = 120.0  # s wall; takes seconds
PLAIN = """
import runpy, sys
runpy.run_path("examples/robot/driver.py")
print([name for name in sys.modules if name.startswith(("surefoot.services.", "surefoot.lab.", "mujoco"))])
"""


class Robot:
    """A system that is up, and the command line beside it."""

    def __init__(self, folder: Path) -> None:
        self.bag, self.log = folder / "run.mcap", folder / "up.log"
        self.endpoint = free_address()
        self.environment = environment(folder, SUREFOOT_LISTEN=self.endpoint)
        with self.log.open("wb") as log:
            self.up = start_process(
                self.command("up", SYSTEM, "--record", str(self.bag)),
                cwd=ROOT, env=self.environment, stdout=log, stderr=log,
            )  # fmt: skip

    def command(self, *words: str) -> list[str]:
        return [sys.executable, "-m", "surefoot.lab.cli.main", *words]

    def surefoot(self, *words: str) -> tuple[int, Any]:
        """Exit code and answer of a command."""
        done = run_process(
            self.command(*words, "--json"), cwd=ROOT, env=self.environment, capture_output=True, text=True
        )
        return done.returncode, json.loads(done.stdout)

    def client(self) -> Client:
        """A client, once the router is there."""
        found: list[Client] = []

        def there() -> bool:
            assert self.up.poll() is None, self.log.read_text()
            try:
                found.append(connect("ragno", self.endpoint))
            except BusError:
                return False
            return True

        wait_until(there, WAIT_S, "a router")
        return found[0]


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    robot = Robot(tmp_path)
    try:
        yield robot
    finally:
        end_process(robot.up)
        end_systems(tmp_path / "state" / "surefoot")


def driver_pid(client: Client) -> Any:
    rows = next(iter(client.messages(SUPERVISOR_STATUS, WAIT_S))).services
    return next(row.pid for row in rows if row.service == "my-robot")


def refusals(status: dict[str, Any]) -> dict[str, int]:
    """Return what the services refused, by reason, from a status; requests to join are asked again until links hold."""
    found = Counter[str]()
    for row in status["my-robot"]["services"]:
        found.update({reason: n for reason, n in row.get("refused", {}).items() if not reason.startswith("join_")})
    return dict(found)


def left_out(bag: Path) -> int:
    """Return the number of ticks that a busy machine left out of a paced recording."""
    ticks: list[Any] = [item.message() for item in read_recording(bag, (HW_TICK.key,))]
    return sum(max(0, b.tick - a.tick - 1) for a, b in pairwise(ticks))


def test_a_driver_of_ones_own_walks_stops_and_is_recorded(robot: Robot) -> None:
    with robot.client() as client:
        standing = next(gait for gait in client.messages(STATE_GAIT, WAIT_S) if gait.state == "standing")
        began = next(tick for tick in client.messages(HW_TICK, WAIT_S) if tick.tick >= standing.tick)
        wall, before = time.monotonic(), next(iter(client.messages(HW_JOINTS, WAIT_S)))
        reply = client.call(CMD_WALK, action="walk", distance=0.05)
        assert reply.accepted, reply.reason
        arrived = next(g for g in client.messages(STATE_GAIT, WAIT_S) if (g.walk_id, g.state) == (reply.id, "standing"))
        tick, took = next(iter(client.messages(HW_TICK, WAIT_S))), time.monotonic() - wall
        assert arrived.steps > standing.steps
        assert tick.mode == "paced"
        assert set(tick.roster) >= {"estimator", "walker", "stability"}
        assert 0.2 < (tick.tick - began.tick) * 0.01 / took < 1.1  # its clock is the wall's
        odometry = next(iter(client.messages(STATE_ODOMETRY, WAIT_S)))
        # by its joints; where a busy machine leaves ticks out, they jump to the newest command, and feet slide
        assert odometry.position[0] == pytest.approx(0.05, abs=0.025)
        assert before.position != next(iter(client.messages(HW_JOINTS, WAIT_S))).position
        status = next(s for s in client.messages(STATE_STABILITY, WAIT_S) if s.status == "ok" and s.tick > tick.tick)
        assert status.margin_planned is not None
        assert status.margin_planned > 0.03
        rows = next(iter(client.messages(SUPERVISOR_STATUS, WAIT_S))).services
        assert {row.service: row.state for row in rows} == dict.fromkeys(SERVICES, "healthy")
        code, answer = robot.surefoot("stop")
        (stopped,) = answer["systems"]
        assert (code, stopped["driver"]) == (0, "my-robot")
        refused = next(iter(client.messages(HW_JOINTS, WAIT_S)))
        assert refused.position == next(iter(client.messages(HW_JOINTS, WAIT_S))).position
        before = driver_pid(client)
        refused = refusals(robot.surefoot("status")[1])
        os.kill(before, signal.SIGKILL)  # what it knew of the stop dies with it
        status = next(s for s in client.messages(SIM_STATUS, WAIT_S) if s.stopped and s.tick > 0)
        assert driver_pid(client) not in (before, None)
        assert status.stopped == stopped["stopped"]
        reply = client.call(CMD_WALK, action="walk", distance=0.05)
        assert (reply.accepted, reply.code) == (False, "stopped")
    assert robot.surefoot("down", "my-robot") == (0, {"stopped": ["my-robot"]})
    code, held = robot.surefoot("bag", "info", str(robot.bag))
    topics = held["topics"]
    assert code == 0
    # a busy machine leaves ticks out, and SIGKILL may fall between two messages of one tick
    assert 0 <= topics["hw/imu"] - topics["hw/tick"] <= 1
    assert min(topics[key] for key in ("hw/tick", "hw/joints", "cmd/joints", "state/velocity", "state/odometry")) > 30
    assert "sim/truth" not in topics
    # of a clean start, walk and stop nothing is refused; where a busy machine leaves ticks out, messages come late
    assert set(refused) <= ({"stale", "late"} if left_out(robot.bag) else set()), (refused, left_out(robot.bag))
    code, found = robot.surefoot("bag", "info", str(robot.bag), "--verify")
    assert (code, found["lost"], found["readable"]) == (0, 0, held["messages"])
    page = robot.bag.with_suffix(".html")
    code, _ = robot.surefoot("report", str(robot.bag), "--out", str(page))
    text = page.read_text(encoding="utf-8")
    assert code in (0, 1), "1: a limit is not met, or no verdict"
    assert all(
        each in text for each in ("<code>paced</code>", "Versions", "from the first to the last tick", "walker ")
    )


def test_the_driver_needs_nothing_but_the_runtime() -> None:
    done = run_process([sys.executable, "-c", PLAIN], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stdout.strip()) == (0, "[]")
