"""Started again in mid-run: the estimator's odometry from the start pose, the walker from its memory."""

import dataclasses
import json
import math
import os

import numpy as np
import pytest

from surefoot.services.walker.interface import BodyPose, MotionCommand
from surefoot.services.walker.legged.gait import LeggedWalker
from surefoot.services.walker.memory import MemoryFile, WalkMemory
from tests.services.walker.legged.plant import KINEMATICS_TICKS, ROBOT, Plant, begun, obeyed, plant


class Forgetful(Plant):
    """Its odometry may begin anew: then it is at zero where the robot is, and initialised after half a second."""

    origin = BodyPose()
    uncertain_until = 0

    def inputs(self):
        base = super().inputs()
        c, n = math.cos(self.origin.yaw), math.sin(self.origin.yaw)
        dx, dy = base.x - self.origin.x, base.y - self.origin.y
        return dataclasses.replace(
            base,
            x=c * dx + n * dy,
            y=-n * dx + c * dy,
            yaw=base.yaw - self.origin.yaw,
            initialised=self.tick >= self.uncertain_until,
        )

    def restart_estimator(self):
        s = self.walker.state
        if self.walker.state.plan is not None:
            end = s.plan.end  # the robot finishes its step and stands
            self.origin = BodyPose(end.x, end.y, 0.0, end.yaw)
        else:
            self.origin = BodyPose(float(s.body[0]), float(s.body[1]), 0.0, s.yaw)
        self.uncertain_until = self.tick + 150


def test_after_a_restart_of_the_estimator_the_walk_goes_on_where_the_robot_is():
    p = Forgetful(LeggedWalker(ROBOT))
    p.run(1.0)
    p.walker.command(MotionCommand("turn", angle=0.5))
    p.step()
    p.until("standing")
    p.walker.command(MotionCommand("walk", distance=0.3))
    p.run(3.1)
    before = p.walker.state.body.copy()
    p.restart_estimator()
    outs = p.until("standing")
    assert {"hold", "walking"} <= {out.state for out in outs}
    body = p.walker.state.body
    assert np.hypot(*(body[:2] - 0.3 * np.array([math.cos(0.5), math.sin(0.5)]))) < 0.03
    assert np.hypot(*body[:2]) > np.hypot(*before[:2])
    feet = np.array([out.footholds for out in outs])
    assert np.abs(np.diff(feet, axis=0)).max() < 0.1  # no foothold jumps to the start pose
    commands = np.array([out.command for out in outs])
    assert np.abs(np.diff(commands, axis=0)).max() < 0.15


def test_what_was_learned_of_the_old_estimate_is_forgotten():
    p = Forgetful(LeggedWalker(ROBOT))
    p.run(1.0)
    p.walker.state.tilt_offset[:] = 0.03
    p.restart_estimator()
    p.run(2.0)
    assert (p.walker.state.tilt_offset, p.out.state) == (pytest.approx(0.0, abs=1e-9), "standing")


@pytest.mark.parametrize("after_s", [2.25, 2.5, 2.7])
def test_a_walker_started_again_closes_and_walks_the_rest(tmp_path, after_s):
    p = begun(MotionCommand("walk", distance=0.3, gait="ripple"))
    p.run(after_s)
    memory = MemoryFile(str(tmp_path / "walker.json"))
    memory.keep(1, p.tick, p.walker.kept())
    again = plant()
    again.joints, again.contacts, again.tick = p.joints, p.contacts, p.tick + -p.tick % KINEMATICS_TICKS
    found = MemoryFile(str(tmp_path / "walker.json")).recall(1, p.tick + 200)
    assert found == p.walker.kept()
    assert found.command is not None
    again.walker.resume(found)
    again.walker.state.body[:2] = p.walker.state.body[:2]  # what the plant takes for the odometry
    outs = again.until("standing", "refused")
    assert (outs[-1].state, outs[0].state) == ("standing", "recovering")
    assert {out.walk_id for out in outs} == {p.walker.state.walk_id}
    assert again.walker.state.body[0] == pytest.approx(0.3, abs=0.01)
    assert again.walker.state.usual.name == "ripple"
    assert all(out.unreachable == 0 for out in outs)


def test_a_memory_of_another_run_or_of_later_is_not_taken_up(tmp_path):
    path = tmp_path / "walker.json"
    kept = WalkMemory(
        3,
        MotionCommand("walk", distance=1.0),
        BodyPose(0.1, 0.2, 0.3, 0.4),
        5.0,
        (0.0, 0.1, 0.2),
        ({"action": "stop"},),
    )
    MemoryFile(str(path)).keep(2, 100, kept)
    assert MemoryFile(str(path)).recall(2, 101) == kept
    assert MemoryFile(str(path)).recall(1, 101) is None
    assert MemoryFile(str(path)).recall(2, 100) == kept  # killed before that tick was sent: it is done again
    assert MemoryFile(str(path)).recall(2, 99) is None
    assert MemoryFile(None).recall(2, 101) is None
    assert MemoryFile(str(tmp_path / "none.json")).recall(2, 101) is None


@pytest.mark.parametrize(
    "damage",
    [
        "", "{", "[]", '{"epoch": 2}', '{"epoch": 2, "tick": 1, "walk_id": 1, "command": 7}', {"offset": [0.0]},
        {"planned": [{"action": "fly"}]}, {"planned": 7}, "[" * 100_000, '{"epoch": 2, "tick": 1, "walk_id": 1e400}',
        {"walk_id": 1e400}, {"walk_id": 2**80}, {"walk_id": "3"}, {"began": "soon"}, {"began": [1]}, {"began": 1e400},
        {"offset": [0.0, "1", 0.0]}, {"offset": [0.0, 1e400, 0.0]}, {"start": {"x": None}}, {"start": {"x": 1e400}},
        {"command": {"action": "fly"}}, {"command": {"action": 7}}, {"command": {"action": "walk", "distance": "far"}},
        {"command": {"action": "walk", "distance": 1e400}}, {"order": -1}, " " * (1 << 21),
    ],
    ids=lambda damage: str(damage)[:60],
)  # fmt: skip
def test_a_memory_that_is_torn_or_has_a_damaged_field_is_reported_in_words(tmp_path, damage):
    path = tmp_path / "walker.json"
    MemoryFile(str(path)).keep(2, 100, WalkMemory(3, None, None, None))
    path.write_text(damage if isinstance(damage, str) else json.dumps(json.loads(path.read_text()) | damage))
    memory = MemoryFile(str(path))
    assert memory.recall(2, 101) is None
    assert "cannot be read" in memory.problem
    assert "\n" not in memory.problem


def test_a_memory_that_is_a_pipe_is_not_waited_for(tmp_path):
    path = tmp_path / "walker.json"
    os.mkfifo(path)
    memory = MemoryFile(str(path))
    assert memory.recall(2, 101) is None
    assert "no regular file" in memory.problem


def test_a_disk_that_fails_costs_the_memory_only(tmp_path):
    memory = MemoryFile(str(tmp_path / "no such folder" / "walker.json"))
    memory.keep(1, 1, WalkMemory(0, None, None, None, (0.0, 0.0, 0.0)))
    assert "cannot be kept" in memory.problem
    assert memory.path is None


def test_it_writes_only_what_has_changed(tmp_path):
    path = tmp_path / "walker.json"
    memory, kept = MemoryFile(str(path)), WalkMemory(1, None, None, None, (0.0, 0.0, 0.0))
    for tick in range(5):
        memory.keep(1, tick, kept)
    assert json.loads(path.read_text())["tick"] == 0
    memory.forget()
    memory.keep(2, 7, kept)
    assert json.loads(path.read_text())["tick"] == 7


def test_a_walk_with_a_duration_ends_after_it():
    p, outs = obeyed(MotionCommand("walk", velocity=0.05, duration=2.0))
    assert outs[-1].state == "standing"
    assert 2.0 <= 0.01 * len(outs) < 5.0
    assert 0.05 < p.walker.state.body[0] < 0.15
