"""Whichever service drives is found on the bus: its name does not matter, and only a simulator is reset."""

import threading

import pytest

from surefoot.bus.zenoh import ZenohBus, ZenohOptions
from surefoot.lockstep.join import DRIVER
from surefoot.schemas.sim import ResetReply, World
from surefoot.schemas.topics import SIM_RESET
from surefoot.services.supervisor.processes.compose import parse_compose
from surefoot.services.supervisor.processes.keep import StartOrder, keep
from surefoot.services.supervisor.processes.session import Session

SYSTEM = """
name: bench
services:
  motors: {command: [python, -c, "import time; time.sleep(60)"], healthcheck: {disable: true}}
  walker: {command: [python, -c, "import time; time.sleep(60)"], healthcheck: {disable: true}}
"""


@pytest.fixture
def appear(listen, monkeypatch):
    """The processes of the system do nothing; here is what they would publish on the bus."""
    monkeypatch.setenv("SUREFOOT_NAMESPACE", "test/bench")
    buses = []

    def announce(resets=None):
        bus = ZenohBus(ZenohOptions("peer", (listen,), (), "test/bench"))
        buses.append(bus)
        if resets is not None:

            def on_reset(incoming):
                if incoming.probe:
                    incoming.accept_probe()
                    return
                resets.append(incoming.request())
                incoming.reply(ResetReply(epoch=1, run_id="bench"))

            bus.serve(SIM_RESET, on_reset)
        drives = bus.new_instance()
        for name, instance in (("walker", "w1"), ("motors", drives), (DRIVER, drives)):
            bus.announce(name, instance)

    yield announce
    for bus in buses:
        bus.close()


def test_the_driver_is_who_is_alive_as_driver(listen, appear):
    with Session(parse_compose(SYSTEM), listen=listen) as session:
        assert session.driver == ""
        appear()
        assert session.wait_for(lambda: session.driver == "motors", 80.0)
        assert session.expected == ("walker", "supervisor")
        assert session.alive == ("motors", "supervisor", "walker")
        assert not session.answers(SIM_RESET)


@pytest.mark.parametrize("simulates", [True, False])
def test_only_a_driver_that_can_be_reset_is(listen, appear, simulates):
    resets, lines, stop = [], [], threading.Event()
    pause = threading.Event()
    arguments = {"listen": listen, "notify": lines.append}
    thread = threading.Thread(target=keep, args=(parse_compose(SYSTEM), StartOrder(World()), stop), kwargs=arguments)
    thread.start()
    try:
        for _ in range(4000):
            if len(lines) >= 2:  # both processes are started, so the router is there
                break
            pause.wait(0.02)
        appear(resets if simulates else None)
        for _ in range(4000 if simulates else 50):
            if resets:
                break
            pause.wait(0.02)
    finally:
        stop.set()
        thread.join(80.0)
    assert not thread.is_alive()
    assert [request.expect for request in resets] == ([("walker", "supervisor")] if simulates else [])
    assert not any("could not be started" in line for line in lines)
