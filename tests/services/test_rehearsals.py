"""Once services have started, no kernel is compiled or loaded: not in a tick, and not for a query but a rare one."""

import json
import subprocess
import sys

import pytest

PROGRAM = """
import json, sys
from surefoot.kernels import jit
from surefoot.lockstep.local import LocalSystem
from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario
from surefoot.lab.runs import local

at_start = {}
begin = LocalSystem.__init__
def started(self, services):
    begin(self, services)
    at_start.update(jit.loaded())
LocalSystem.__init__ = started
local.run_local(load_scenario(find_scenario(sys.argv[1])))
now = jit.loaded()
print(json.dumps([len(at_start), sorted(name for name in now if now[name] != at_start.get(name))]))
"""


SCENARIOS = ["rough-terrain", "slope", "bioloid-walk", "nao-turn", "messor", "nao-corner", "crawl-rough"]


@pytest.mark.slow
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_nothing_is_loaded_after_the_start(scenario: str) -> None:
    command = [sys.executable, "-W", "ignore", "-c", PROGRAM, scenario]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    at_start, later = json.loads(done.stdout.strip().splitlines()[-1])
    assert at_start > 30
    assert later == []
