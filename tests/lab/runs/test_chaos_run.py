"""A hexapod under faults from a seed: it stands, it walks on, and the seed replays it to the bit."""

from pathlib import Path

import pytest

from surefoot.lab.runs.chaos import run_chaos
from surefoot.services.supervisor.scenarios.scenario import Scenario, parse_scenario

WALK = """
description = "Ragno walks 5 cm while things go wrong"
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
    return parse_scenario(WALK, Path("walk.toml"))


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
