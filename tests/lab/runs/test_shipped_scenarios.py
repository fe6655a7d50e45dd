"""Every scenario that comes with the project passes under its own limits, with the real services in one process."""

import pytest

from surefoot.files import names
from surefoot.lab.runs.local import run_local
from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario

LONG = {"nao-corner", "nao-lost", "nao-walk", "ragno-goal", "flat", "crawl-flat", "bioloid-walk"}
"""Walks of a robot whose harder walk is in every run: of Nao the corridor, of Ragno and the quadruped rough ground, of
the Bioloid the fast one and ice; short goals are in `tests/e2e/test_goals.py` and `tests.contract.short_walks`."""


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n in LONG else n for n in names("scenarios", ".toml")]
)
def test_passes(name: str) -> None:
    verdict = run_local(load_scenario(find_scenario(name)), without=("recorder",)).verdict
    assert not verdict.problems
    assert [(row.name, row.value, row.limits) for row in verdict.rows if row.ok is False] == []
    assert verdict.ok
