"""Limits of the file that keeps a goal: what a navigator wrote is taken up as it was, anything else is given up."""

import json
from pathlib import Path
from typing import Any

import pytest

from surefoot.lockstep.memory import MOST_ID
from surefoot.services.navigator.goals import NavigationGoal
from surefoot.services.navigator.memory import GoalMemory, Kept

ROUTE = ((1.0, 0.0), (2.0, 0.5), (3.0, 0.5))


def goal(**changes: Any) -> NavigationGoal:
    given = {"start": (0.1, 0.2), "missed": [0], "index": 1, "nearest": 0.7} | changes
    return NavigationGoal("g", ROUTE, "steer", 3.0, **given)


def kept(**changes: Any) -> Kept:
    given = {"goal": goal(), "planned": ((90, goal(places=(ROUTE[1], ROUTE[2]), ends=(1, 2))),)} | changes
    cov = (0.01, 0.001, 0.0, 0.001, 0.02, 0.0, 0.0, 0.0, 0.03)
    return Kept.model_construct(number=7, pose=(0.5, 0.1, -0.2), covariance=cov, odom=(0.4, 0.0, 0.0), **given)


def changed(tmp_path: Path, change: dict[str, Any], *, of_goal: bool) -> GoalMemory:
    path = tmp_path / "navigator.json"
    GoalMemory(str(path)).keep(2, 50, kept())
    content = json.loads(path.read_text())
    (content["goal"] if of_goal else content).update(change)
    path.write_text(json.dumps(content))
    return GoalMemory(str(path))


TWICE = goal(places=(ROUTE[0], ROUTE[0], ROUTE[2]), ends=(0, 0, 2))
ROUNDS = goal(yaws=(None, 0.5, None), loops=0, loop=3, reached=1, paused_at=4.5, paused=1.0)


@pytest.mark.parametrize(
    "state",
    [
        kept(), kept(goal=None, planned=()), kept(goal=goal(start=None, index=3)), kept(goal=TWICE), kept(goal=ROUNDS)
    ],
)  # fmt: skip
def test_what_was_kept_is_taken_up_in_its_epoch_from_its_tick_on(tmp_path: Path, state: Kept) -> None:
    path = str(tmp_path / "navigator.json")
    GoalMemory(path).keep(2, 50, state)
    assert GoalMemory(path).recall(2, 50) == state
    assert GoalMemory(path).recall(2, 51) == state
    for epoch, tick in ((1, 51), (3, 51), (2, 49)):
        memory = GoalMemory(path)
        assert memory.recall(epoch, tick) is None
        assert memory.problem == ""


def test_recoveries_go_on_being_counted_and_an_endless_distance_is_kept(tmp_path: Path) -> None:
    path, state = str(tmp_path / "navigator.json"), kept(goal=NavigationGoal("g", ROUTE, "steer", 0.0))
    assert state.goal is not None
    state.goal.recoveries["look"] += 2
    GoalMemory(path).keep(2, 50, state)
    found = GoalMemory(path).recall(2, 50)
    assert found is not None
    assert found.goal is not None
    found.goal.recoveries["stand_and_look"] += 1
    assert found.goal.recoveries == {"look": 2, "stand_and_look": 1}
    assert found.goal.nearest > 1e6


@pytest.mark.parametrize(
    "change",
    [
        {"number": -1}, {"number": MOST_ID + 1}, {"number": "7"}, {"number": 1.5}, {"of_others": 1},
        {"epoch": "2"}, {"tick": "50"}, {"state": "flying"}, {"end": ["idle", ""]}, {"end": ["flying", "", ""]},
        {"pose": [0.0, 0.0]}, {"pose": [float("nan"), 0.0, 0.0]}, {"odom": [0.0, float("inf"), 0.0]}, {"ended": "late"},
        {"covariance": [1.0] * 8}, {"covariance": [1.0] * 10}, {"covariance": [float("nan")] * 9},
        {"covariance": [1.0, 0, 0, 0, -1.0, 0, 0, 0, 1.0]}, {"covariance": [1.0, 0.5, 0, 0, 1.0, 0, 0, 0, 1.0]},
        {"planned": [[90, {"id": "x"}]]}, {"planned": [["soon", None]]}, {"planned": None}, {"goal": 7},
    ],
)  # fmt: skip
def test_a_field_that_no_navigator_writes_is_reported(tmp_path: Path, change: dict[str, Any]) -> None:
    memory = changed(tmp_path, change, of_goal=False)
    assert memory.recall(2, 60) is None
    assert next(iter(change)) in memory.problem


@pytest.mark.parametrize(
    "change",
    [
        {"id": 7}, {"route": []}, {"route": [[1.0]]}, {"route": [[1.0, float("nan")]]}, {"began": float("inf")},
        {"index": -1}, {"index": 4}, {"ends": [0, 1]}, {"ends": [0, 1, 3]}, {"ends": [1, 0, 2]}, {"ends": [-1, 1, 2]},
        {"ends": [0, 1, 1]}, {"xy_tolerance": "near"}, {"timeout": float("nan")}, {"missed": ["first"]},
        {"recoveries": {"look": "twice"}}, {"start": [0.0, 0.0, 0.0]}, {"places": [[0.0, 0.0]]},
        {"yaws": [0.0]}, {"yaws": [0.0, "east", 0.0]}, {"loops": -1}, {"loop": 0}, {"paused_at": float("nan")},
    ],
)  # fmt: skip
def test_a_goal_that_no_navigator_writes_is_reported(tmp_path: Path, change: dict[str, Any]) -> None:
    memory = changed(tmp_path, change, of_goal=True)
    assert memory.recall(2, 60) is None
    assert "goal" in memory.problem


def test_goals_that_wait_are_checked_as_well(tmp_path: Path) -> None:
    path = tmp_path / "navigator.json"
    GoalMemory(str(path)).keep(2, 50, kept(planned=((90, goal()), (95, goal(index=4)))))
    memory = GoalMemory(str(path))
    assert memory.recall(2, 60) is None
    assert "planned" in memory.problem
    assert "waypoint 4" in memory.problem


@pytest.mark.parametrize("text", ["", "not json", "[" * 100_000, '{"epoch": 2}', "[1e999]", "\xff"])
def test_what_is_no_memory_is_reported_and_no_file_is_no_fault(tmp_path: Path, text: str) -> None:
    path = tmp_path / "navigator.json"
    memory = GoalMemory(str(path))
    assert memory.recall(2, 60) is None
    assert memory.problem == ""
    path.write_text(text, encoding="latin-1")
    assert memory.recall(2, 60) is None
    assert "the kept goal cannot be read" in memory.problem
