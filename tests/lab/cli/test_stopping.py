"""An emergency stop over the network: who confirms it, and what does not."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from surefoot.bus.seals import DRIVER
from surefoot.bus.zenoh import ZenohBus
from surefoot.lab.cli.running import RunningSystem
from surefoot.lab.cli.stopping import Stopped, stop_all
from surefoot.schemas.status import SimStatus
from surefoot.schemas.topics import CMD_ESTOP, SIM_STATUS
from surefoot.services.supervisor.processes.rundir import Endpoint, RunFolder
from tests.surefoot.net import Net

SECRET, STRANGER = "0123456789abcdef" * 2, b'{"stopped": "forged", "tick": 1, "source": "simulator"}'
STATUS = SimStatus(state="running", rtf=1.0, ticks=8, comparable=True, stopped="a hand in the way")
pytestmark = pytest.mark.usefixtures("apart")


@pytest.fixture
def net() -> Iterator[Net]:
    made = Net()
    yield made
    made.close()


@pytest.fixture
def system(net: Net) -> Iterator[RunningSystem]:
    """A system of this user, whose run folder holds its secret."""
    folder = RunFolder("ragno")
    folder.acquire()
    folder.write_endpoint(Endpoint(net.address, net.namespace), SECRET)
    yield RunningSystem("ragno", net.address, net.namespace, folder)
    folder.release()


@contextmanager
def published(net: Net, payload: bytes) -> Iterator[None]:
    """A stranger that publishes a status without end."""
    over, session = threading.Event(), net.plain()

    def work() -> None:
        while not over.wait(0.005):
            session.put(f"{net.namespace}/{SIM_STATUS.key}", payload)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        session.close()


def visible_driver(net: Net) -> ZenohBus:
    bus = net.open(identity="simulator", secret=SECRET)
    for service in ("simulator", DRIVER):
        bus.announce(service, bus.new_instance())
    return bus


def stopped(system: RunningSystem, timeout_s: float) -> Stopped:
    return stop_all([system], "a hand in the way", timeout_s)[0]


def test_a_strangers_status_confirms_no_stop(net: Net, system: RunningSystem) -> None:
    visible_driver(net)  # it hangs
    with published(net, STRANGER):
        found = stopped(system, 1.0)
    assert (found.driver, found.stopped) == ("", "")
    assert "no driver has confirmed the stop" in found.detail


@pytest.mark.parametrize("payload", [b'{"stopped": "x"}', b'{"stopped": "x", "tick": "a"}', b"[" * 60_000, STRANGER])
def test_a_driver_confirms_a_stop_beside_a_stranger(net: Net, system: RunningSystem, payload: bytes) -> None:
    bus = visible_driver(net)
    status = bus.publisher(SIM_STATUS, bus.new_instance())
    confirmed = STATUS.stamped(0, 7, 1, 0, "simulator")
    bus.subscribe(CMD_ESTOP, lambda _: status.put(confirmed))
    with published(net, payload):
        found = stopped(system, 10.0)
    assert (found.driver, found.stopped, found.tick) == ("simulator", "a hand in the way", 7)
