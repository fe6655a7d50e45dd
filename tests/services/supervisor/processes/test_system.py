"""The system between reconciler and processes, with stand-ins for processes and a clock that stands still."""

import pytest

from surefoot.services.supervisor.processes.compose import parse_compose
from surefoot.services.supervisor.processes.rundir import RunFolder
from surefoot.services.supervisor.processes.system import System

TWO = """
name: two
services:
  supervisor: {}
  first: {restart: on-failure, healthcheck: {start_period: 5s}, depends_on: [supervisor]}
  second: {restart: on-failure, depends_on: {first: {condition: service_healthy}}}
"""


class Fake:
    """A process that ends when it is told to."""

    pids = iter(range(1000, 10_000))

    def __init__(self):
        self.pid = next(self.pids)
        self.code = None
        self.deaf = False
        self.starved = 0.0

    def starved_s(self):
        return self.starved

    def poll(self):
        return self.code

    def terminate(self):
        if not self.deaf:
            self.code = 0

    def kill(self):
        self.code = -9


class World:
    def __init__(self, tmp_path, text=TWO, spawn=None):
        self.now = 100.0
        self.processes = {}
        self.log = []
        self.system = System(
            parse_compose(text),
            RunFolder("two", tmp_path),
            clock=lambda: self.now,
            spawn=spawn or self.spawn,
            on_action=lambda action: self.log.append((action.verb, action.service)),
        )
        self.system.folder.path.mkdir()

    def spawn(self, service):
        self.processes[service.name] = Fake()
        return self.processes[service.name]

    def step(self, seconds=0.1, *, well=(), shutdown=False):
        self.now += seconds
        for name in well:
            if name in self.processes:
                self.system.heard(name, self.processes[name].pid, well=True)
        return self.system.step(shutdown=shutdown)

    def state(self):
        return {row.service: (row.state, row.restarts) for row in self.system.rows()}


@pytest.fixture
def world(tmp_path):
    return World(tmp_path)


def test_starts_in_order_and_is_settled(world):
    world.step()
    assert set(world.processes) == {"first"}
    world.step(well=["first"])
    world.step(well=["first"])
    assert set(world.processes) == {"first", "second"}
    world.step(well=["first", "second"])
    assert world.system.settled()
    assert world.state() == {"first": ("healthy", 0), "second": ("healthy", 0)}
    assert world.step() == ()


def test_restarts_what_was_killed(world):
    for _ in range(3):
        world.step(well=["first", "second"])
    old = world.processes["first"]
    world.system.signal_kill("first")
    world.step(0.01)
    assert world.state()["first"] == ("backoff", 0)
    world.step(0.2)
    assert world.processes["first"] is not old
    assert world.state()["first"] == ("starting", 1)
    assert world.processes["second"].code is None


def test_an_old_heartbeat_does_not_speak_for_a_new_process(world):
    for _ in range(3):
        world.step(well=["first"])
    world.processes["first"].code = 1
    world.step(0.01)
    world.step(0.2)
    world.step(0.1)
    assert world.state()["first"][0] == "starting"


def test_a_frozen_process_is_killed_and_replaced(world):
    for _ in range(3):
        world.step(well=["first", "second"])
    frozen = world.processes["first"]
    frozen.deaf = True
    for _ in range(70):
        world.step(0.1, well=["second"])
    assert frozen.code == -9
    assert world.processes["first"] is not frozen
    assert ("kill", "first") in world.log


def test_a_lost_liveliness_is_reported_and_ends_nothing(world):
    """A pause of 1 s ends Zenoh's lease; the process works all the same."""
    for _ in range(3):
        world.step(well=["first", "second"])
    world.system.seen("first", visible=False)
    for _ in range(50):
        world.step(0.1, well=["first", "second"])
    assert world.state()["first"] == ("healthy", 0)
    row = next(row for row in world.system.rows() if row.service == "first")
    assert row.detail.startswith("not visible on the bus for 5.0")
    world.system.seen("first", visible=True)
    world.step(well=["first", "second"])
    assert not next(row for row in world.system.rows() if row.service == "first").detail
    assert not [entry for entry in world.log if entry[0] == "stop"]


def test_a_lost_heartbeat_is_named_apart_from_a_lost_liveliness(world):
    for _ in range(3):
        world.step(well=["first", "second"])
    world.processes["first"].deaf = True
    actions = [action for _ in range(40) for action in world.step(0.1, well=["second"]) if action.verb == "stop"]
    assert [action.reason for action in actions] == ["no heartbeat for 3.1 s"]
    world.system.seen("second", visible=False)
    actions = [action for _ in range(40) for action in world.step(0.1) if action.verb == "stop"]
    assert [action.reason for action in actions] == ["no heartbeat for 3.1 s, not visible on the bus for 3.1 s"]


def test_who_ticks_is_not_ended_for_lost_heartbeats(world):
    for _ in range(3):
        world.step(well=["first", "second"])
    for _ in range(100):
        world.system.ticked("first")
        world.step(0.1, well=["second"])
    assert world.state()["first"] == ("healthy", 0)
    assert not [entry for entry in world.log if entry[0] == "stop"]


def test_time_spent_waiting_for_a_processor_is_no_silence(world):
    for _ in range(3):
        world.step(well=["first", "second"])
    for _ in range(200):
        world.processes["first"].starved += 0.1
        world.step(0.1, well=["second"])
    assert world.state()["first"] == ("healthy", 0)
    for _ in range(40):
        world.step(0.1, well=["second"])
    assert ("stop", "first") in world.log


@pytest.mark.parametrize("sign", ["starved", "compiling"])
def test_a_start_that_gets_on_is_not_ended(world, sign):
    """Its limit of 5 s counts progress and processor time."""
    world.step()
    for _ in range(300):
        if sign == "starved":
            world.processes["first"].starved += 0.1
        else:
            world.system.heard("first", world.processes["first"].pid, well=False)
        world.step(0.1)
    assert world.state()["first"] == ("starting", 0)
    for _ in range(52):
        world.step(0.1)
    assert ("stop", "first") in world.log


def test_a_heartbeat_of_another_process_says_nothing(world):
    world.step()
    world.system.heard("first", 4, well=True)
    world.step()
    assert world.state()["first"][0] == "starting"


def test_gives_up_on_what_never_starts(tmp_path):
    def spawn(service):
        raise FileNotFoundError(service.name)

    world = World(tmp_path, spawn=spawn)
    for _ in range(400):
        world.step(0.5)
    assert world.system.given_up() == ("first",)
    assert world.state()["first"][0] == "failed"
    assert world.system.stop()


def test_stops_in_reverse_order(world):
    for _ in range(3):
        world.step(well=["first", "second"])
    world.step(shutdown=True)
    world.step(shutdown=True)
    world.step(shutdown=True)
    assert [entry for entry in world.log if entry[0] == "stop"] == [("stop", "second"), ("stop", "first")]
    assert not world.system.running()


def test_who_was_ended_as_unwell_is_started_again_though_it_ended_cleanly(world):
    for _ in range(3):
        world.step(well=["first", "second"])
    old = world.processes["first"]
    for _ in range(40):
        world.step(well=["second"])
    assert old.code == 0
    assert world.processes["first"] is not old
    assert world.system.given_up() == ()


def test_silence_while_the_machine_slept_is_nobodys_fault(world):
    for _ in range(3):
        world.step(well=["first", "second"])
    world.step(3600.0)
    assert world.system.settled()
    for _ in range(100):
        world.step(0.05)
    assert ("stop", "first") in world.log
