"""Every scenario that comes with the project passes under its own limits, with the real services in one process."""

import pytest

from surefoot.files import names
from surefoot.lab.runs.local import run_local
from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario

SHORT = {"rough-terrain", "ragno-own-map", "bioloid-ice", "nao-stand", "messor", "push", "stand"}
"""A walk or more of each kind of robot; the quadruped's, and short goals, are in `tests.contract.short_walks`."""


@pytest.mark.parametrize(
    "name", [n if n in SHORT else pytest.param(n, marks=pytest.mark.slow) for n in names("scenarios", ".toml")]
)
def test_passes(name: str) -> None:
    verdict = run_local(load_scenario(find_scenario(name)), without=("recorder",)).verdict
    assert not verdict.problems
    assert [(row.name, row.value, row.limits) for row in verdict.rows if row.ok is False] == []
    assert verdict.ok
