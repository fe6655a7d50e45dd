"""Robots under faults from a seed: they stand, they walk on, and the seed replays it to the bit, also a failure."""

from pathlib import Path

import pytest

from surefoot.lab.chaos import memory
from surefoot.lab.chaos.run import falls_when_held, run_chaos
from surefoot.lockstep.driver import DriverNode
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
    plain = run_chaos(walk, 3, 0)
    forged = run_chaos(walk, 4, 12, ("forge",), ticks=250)
    assert forged.unbound > 0
    assert (forged.run_hash, forged.violations) == (plain.run_hash, ())


@pytest.mark.parametrize("seed", [0, 1])
def test_services_killed_and_frozen_in_mid_step_come_back(walk: Scenario, seed: int) -> None:
    run = run_chaos(walk, seed, 3, ("kill", "freeze"), ticks=250)
    assert run.outcomes
    assert run.violations == ()
    assert all(outcome.recovered is not None for outcome in run.outcomes)


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


def test_a_robot_without_commands_is_held_and_stands() -> None:
    assert not falls_when_held(walk_of("ragno"), 200)
