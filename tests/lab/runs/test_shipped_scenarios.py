"""Every scenario that comes with the project passes under its own limits, with the real services in one process."""

import pytest

from surefoot.files import names
from surefoot.lab.runs.local import run_local
from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario

LONG = {"nao-corner", "nao-lost"}
"""Two minutes of walking each; `make test` walks the corridor, and short goals over Zenoh."""


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n in LONG else n for n in names("scenarios", ".toml")]
)
def test_passes(name: str) -> None:
    verdict = run_local(load_scenario(find_scenario(name)), without=("recorder",)).verdict
    assert not verdict.problems
    assert [(row.name, row.value, row.limits) for row in verdict.rows if row.ok is False] == []
    assert verdict.ok
