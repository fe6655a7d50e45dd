"""An installed package adds a service without touching our tree: an entry point, nothing else."""

import os
import sys
from pathlib import Path

import pytest

from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.discover import GROUP, own_service_names, service_class, service_names
from surefoot.lockstep.local import LocalSystem
from tests.processes import run_process
from tests.surefoot.toys import ToyDriver, ToyEstimator, ToyWalker

SERVICE = """
from surefoot.schemas.base import Message
from surefoot.schemas.topics import HW_IMU, Kind, Topic
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.service import Service

class Count(Message):
    count: int

COUNT = Topic("countlegs/count", Count, Kind.STATE, "counter")

class Counter(Service[ServiceConfig]):
    name = "counter"
    inputs = (HW_IMU,)
    outputs = (COUNT,)

    def on_reset(self):
        self.count = 0

    def on_tick(self, inputs):
        self.count += inputs.get(HW_IMU) is not None
        self.publish(COUNT, Count(count=self.count))

class Reader(Service[ServiceConfig]):
    name = "reader"
    inputs = (COUNT,)

    def on_tick(self, inputs):
        self.count = inputs.get(COUNT).count
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return what an installer leaves behind."""
    (tmp_path / "countlegs.py").write_text(SERVICE)
    info = tmp_path / "countlegs-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: countlegs\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        f"[{GROUP}]\ncounter = countlegs:Counter\nreader = countlegs:Reader\nwalker = countlegs:Counter\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def test_it_is_listed_last_and_replaces_none_of_ours(package: Path) -> None:
    assert service_names() == (*own_service_names(), "counter", "reader")
    assert service_class("walker").__module__ == "surefoot.services.walker.service"
    with pytest.raises(KeyError):
        service_class("counters")


def test_its_services_and_its_topic_take_part_in_lockstep(package: Path) -> None:
    driver, counter, reader = ToyDriver(), *(service_class(n)(ServiceConfig()) for n in ("counter", "reader"))
    system = LocalSystem([reader, counter, ToyEstimator(ServiceConfig()), ToyWalker(ServiceConfig()), driver])
    driver.node.begin(("estimator", "walker", "counter", "reader"), "lockstep", 0.0, 1, "hold", 0)
    leader = driver.node.leader
    leader.end_tick = 20
    system.run_until(lambda: leader.state == "ended" and leader.all_done())
    assert counter.count == reader.count == 21


def test_it_is_started_by_its_name(package: Path) -> None:
    root = Path(__file__).parents[3]
    environment = {**os.environ, "PYTHONPATH": f"{package}{os.pathsep}{root}"}
    for name, code in (("counter", 0), ("countr", 2)):
        command = [sys.executable, "-m", "surefoot.lockstep.discover", name, "--print-config"]
        done = run_process(command, cwd=package, env=environment, capture_output=True, text=True)
        assert done.returncode == code, done.stderr
    assert "did you mean 'counter'" in done.stderr
