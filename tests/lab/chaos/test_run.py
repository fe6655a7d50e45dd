"""Robots under faults from a seed: they stand, they walk on, and the seed replays it to the bit, also a failure."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from surefoot.errors import Refusal
from surefoot.lab.chaos import memory, run, shrink
from surefoot.lab.chaos.events import ChaosEvent
from surefoot.lab.chaos.run import MemoryRun, falls_when_held, run_chaos, suffer
from surefoot.lockstep.driver import DriverNode
from surefoot.schemas.hw import JointCommand
from surefoot.services.simulator.run import SimulatedRun
from surefoot.services.supervisor.scenarios.scenario import Scenario, parse_scenario

WALK = """
description = "a robot walks 5 cm while things go wrong"
compose = "{robot}"
max_duration_s = 12.0
[[step]]
when = "ready"
do = "walk"
distance = 0.05
[limits]
no_fall = true
"""


@pytest.fixture
def walk() -> Scenario:
    return walk_of("ragno")


def walk_of(robot: str) -> Scenario:
    return parse_scenario(WALK.format(robot=robot), Path("walk.toml"))


def test_a_seed_is_replayed_to_the_bit_and_nothing_forged_is_obeyed(walk: Scenario) -> None:
    kinds = ("forge", "drop", "corrupt", "duplicate")
    one, other = (run_chaos(walk, 3, 8, kinds, ticks=250) for _ in range(2))
    assert one == other
    assert one.violations == ()
    forged = run_chaos(walk, 4, 12, ("forge",), ticks=250)
    assert forged.unbound > 0
    assert (forged.run_hash, forged.violations) == (one.run_hash, ())  # another hash than without faults is a violation


@pytest.mark.parametrize("owner", ["walker", "driver", "estimator"])
def test_messages_that_come_after_later_ones_change_nothing(walk: Scenario, owner: str) -> None:
    """Those of one tick are lost or held up, those of the next are there first."""
    events = [ChaosEvent(kind, tick, owner, 9, 27.0) for kind, tick in (("delay", 120), ("drop", 160))]
    assert suffer(walk, events, 0).violations == ()


def test_another_hash_under_faults_of_messages_is_a_violation(walk: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    """Here the simulator refuses a command after that of a later tick."""
    newest: dict[SimulatedRun, int] = {}

    def check(self: SimulatedRun, command: JointCommand) -> None:
        newest[self] = max(newest.get(self, 0), command.tick)
        if command.tick < newest[self]:
            raise Refusal("order", "a later command came")

    monkeypatch.setattr(SimulatedRun, "check", check)
    found = suffer(walk, [ChaosEvent("reorder", 120, "walker", 20, 1.0)], 0)
    assert found.violations == ("another hash than without faults",)


@pytest.mark.parametrize("seed", [0, 1])
def test_services_killed_and_frozen_in_mid_step_come_back(walk: Scenario, seed: int) -> None:
    found = run_chaos(walk, seed, 3, ("kill", "freeze"), ticks=250)
    assert found.outcomes
    assert found.violations == ()
    assert all(outcome.recovered is not None for outcome in found.outcomes)


@pytest.mark.parametrize("robot", ["ragno", "bioloid"])
def test_the_failure_of_a_seed_is_replayed_to_the_bit(robot: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(DriverNode, "_repeat", lambda self, ticks: None)
    monkeypatch.setattr(memory, "STALL_S", 10.0)
    one, other = (run_chaos(walk_of(robot), 2, 4, ("drop", "kill"), ticks=200) for _ in range(2))
    assert one.violations
    assert "no tick" in one.violations[0]
    assert one == other


def test_a_biped_in_paced_time_walks_on_without_a_fall_and_to_the_bit() -> None:
    one, other = (run_chaos(walk_of("bioloid"), 0, 4, ("kill", "freeze", "drop"), ticks=400, paced=True) for _ in "12")
    assert one == other
    assert (one.violations, one.fell_at) == ((), None)
    assert {outcome.event.kind for outcome in one.outcomes} & {"kill", "freeze"}


def test_an_order_that_reaches_a_frozen_walker_too_late_is_repeated() -> None:
    """The caller waits for it, as over a network; meanwhile the tick of the order passes."""
    frozen = ChaosEvent("freeze", 69, "walker", size=0.3)
    found = suffer(walk_of("ragno"), [frozen], 0, paced=True)
    assert [outcome.event for outcome in found.outcomes if outcome.recovered is not None] == [frozen]
    assert found.violations == ()


def test_a_robot_without_commands_is_held_and_stands() -> None:
    assert not falls_when_held(walk_of("ragno"), 200)


def test_a_failure_is_shrunk_and_its_test_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, complaint: Callable[..., str]
) -> None:
    """In place of the robot a run that fails when there are a drop and a kill."""

    def suffered(
        scenario: Scenario, events: Sequence[ChaosEvent], seed: int, *, paced: bool = False, **_: object
    ) -> MemoryRun:
        bad = ("no tick after 7",) if {event.kind for event in events} == {"drop", "kill"} else ()
        return MemoryRun(seed=seed, outcomes=(), violations=bad, ticks=9, run_hash="", unbound=0, wall_s=1.0)

    monkeypatch.setattr(run, "suffer", suffered)
    monkeypatch.setattr(shrink, "suffer", suffered)
    file = tmp_path / "my-walk.toml"
    file.write_text(WALK.format(robot="ragno"), encoding="utf-8")
    words = ("chaos", file, "--seed", 2, "--events", 9, "--kinds", "drop,kill", "--ticks", 120, "--out", tmp_path)
    shown = complaint(*words, code=1)
    assert "seed 2 (drop, kill)" in shown
    assert "2 of 9 events make it fail" in shown
    assert "recoveries taken" in shown
    written = (tmp_path / "test_my_walk_seed2.py").read_text(encoding="utf-8")
    found: dict[str, Any] = {}
    exec(compile(written, "test_my_walk_seed2.py", "exec"), found)
    assert {event.kind for event in found["EVENTS"]} == {"drop", "kill"}
    with pytest.raises(AssertionError):
        found["test_my_walk_survives_seed_2"]()


def test_a_kind_that_is_not_known_is_refused_with_those_that_are(complaint: Callable[..., str]) -> None:
    shown = complaint("chaos", "flat", "--kinds", "drop,slow")
    assert "'slow'" in shown
    assert "corrupt" in shown
