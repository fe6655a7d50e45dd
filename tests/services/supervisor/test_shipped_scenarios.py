"""Every scenario that comes with the project passes under its own limits, with the real services in one process."""

import pytest

from services.supervisor.files import names
from services.supervisor.scenario import find_scenario, load_scenario
from services.supervisor.study import run_local


@pytest.mark.parametrize("name", names("scenarios", ".toml"))
def test_passes(name: str) -> None:
    verdict = run_local(load_scenario(find_scenario(name)), without=("recorder",)).verdict
    assert not verdict.problems
    assert [(row.name, row.value, row.limits) for row in verdict.rows if row.ok is False] == []
    assert verdict.ok
