"""A process that imports nothing of ours takes part in lockstep, by what docs/systems.md states of the wire."""

import subprocess
import sys
from pathlib import Path

from surefoot.schemas.system import HealthRequest
from surefoot.schemas.topics import HEALTH_GET
from tests.processes import running
from tests.surefoot.lockstep.test_lockstep import run
from tests.surefoot.lockstep.test_zenoh_run import Threads
from tests.surefoot.net import WAIT_S, Net

PROGRAM = Path(__file__).with_name("foreign_estimator.py")


def test_a_foreign_estimator_gives_the_run_of_our_own(net: Net, tmp_path: Path) -> None:
    command = [sys.executable, "-I", str(PROGRAM), net.address, net.namespace]
    pipes = {"stdin": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with running(command, cwd=tmp_path, **pipes) as foreign, Threads(net, (0, 2, 3), ticks=60) as system:
        assert system.wait() == run(ticks=60)[0]
        assert [tick for tick, _ in system.observer.seen] == list(range(61))
        assert system.observer.seen[-1][1]["state/velocity"].source == "estimator"
        health = net.open("client").call(HEALTH_GET.of("estimator"), HealthRequest()).health
        assert health.pid == foreign.pid
        _, complaints = foreign.communicate(timeout=WAIT_S)
        assert foreign.returncode == 0, complaints
        assert "Traceback" not in complaints


def test_it_is_foreign() -> None:
    imported = {line.split()[1] for line in PROGRAM.read_text().splitlines() if line.startswith(("import ", "from "))}
    assert imported == {"json", "os", "queue", "sys", "zenoh"}
