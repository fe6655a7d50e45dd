"""4.7 of Walas & Belter (2011) with every service: the scenario that moves the trunk and returns the motors' factor."""

import re

import pytest

from surefoot.lab.runs.local import run_local
from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario


@pytest.mark.slow
def test_the_scenario_returns_the_gain_within_1_percent() -> None:
    scenario = load_scenario(find_scenario("calibrate"))
    assert scenario.world.torque_per_ampere is not None
    run = run_local(scenario, without=("recorder",))
    assert run.verdict.ok, (run.verdict.problems, run.verdict.rows)
    note = next(note for note in run.verdict.notes if note.startswith("calibration:"))
    found = re.search(r"x ([0-9.]+) .* ([0-9.]+) Nm/A, ([0-9]+) poses", note)
    assert found is not None, note
    assert float(found[2]) == pytest.approx(scenario.world.torque_per_ampere, rel=0.01)
    assert int(found[3]) >= 9
