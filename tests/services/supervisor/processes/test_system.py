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


BOTH = ("first", "second")


class Fake:
    """A process that ends when it is asked to."""

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

    def steps(self, times, seconds=0.1, well=()):
        """Step so many times; `well`: services that send heartbeats."""
        for _ in range(times):
            self.step(seconds, well=well)

    def state(self):
        return {row.service: (row.state, row.restarts) for row in self.system.rows()}


@pytest.fixture
def world(tmp_path):
    return World(tmp_path)


@pytest.fixture
def healthy(world):
    """A world whose two services are healthy."""
    world.steps(3, well=BOTH)
    return world


def test_starts_in_order_and_is_settled(world):
    world.step()
    assert set(world.processes) == {"first"}
    world.step(well=["first"])
    world.step(well=["first"])
    assert set(world.processes) == {"first", "second"}
    world.step(well=BOTH)
    assert world.system.settled()
    assert world.state() == {"first": ("healthy", 0), "second": ("healthy", 0)}
    assert world.step() == ()


def test_restarts_what_was_killed(healthy):
    old = healthy.processes["first"]
    healthy.system.signal_kill("first")
    healthy.step(0.01)
    assert healthy.state()["first"] == ("backoff", 0)
    healthy.step(0.2)
    assert healthy.processes["first"] is not old
    assert healthy.state()["first"] == ("starting", 1)
    assert healthy.processes["second"].code is None


def test_an_old_heartbeat_does_not_speak_for_a_new_process(world):
    world.steps(3, well=["first"])
    world.processes["first"].code = 1
    world.step(0.01)
    world.step(0.2)
    world.step(0.1)
    assert world.state()["first"][0] == "starting"


def test_a_frozen_process_is_killed_and_replaced(healthy):
    frozen = healthy.processes["first"]
    frozen.deaf = True
    healthy.steps(70, 0.1, well=["second"])
    assert frozen.code == -9
    assert healthy.processes["first"] is not frozen
    assert ("kill", "first") in healthy.log


def test_a_lost_liveliness_is_reported_and_ends_nothing(healthy):
    """As after a pause longer than Zenoh's lease; the process works all the same."""
    healthy.system.seen("first", visible=False)
    healthy.steps(50, 0.1, well=BOTH)
    assert healthy.state()["first"] == ("healthy", 0)
    row = next(row for row in healthy.system.rows() if row.service == "first")
    assert row.detail.startswith("not visible on the bus for 5.0")
    healthy.system.seen("first", visible=True)
    healthy.step(well=BOTH)
    assert not next(row for row in healthy.system.rows() if row.service == "first").detail
    assert not [entry for entry in healthy.log if entry[0] == "stop"]


def test_a_lost_heartbeat_is_named_apart_from_a_lost_liveliness(healthy):
    healthy.processes["first"].deaf = True
    actions = [action for _ in range(40) for action in healthy.step(0.1, well=["second"]) if action.verb == "stop"]
    assert [action.reason for action in actions] == ["no heartbeat for 3.1 s"]
    healthy.system.seen("second", visible=False)
    actions = [action for _ in range(40) for action in healthy.step(0.1) if action.verb == "stop"]
    assert [action.reason for action in actions] == ["no heartbeat for 3.1 s, not visible on the bus for 3.1 s"]


def test_who_ticks_is_not_ended_for_lost_heartbeats(healthy):
    for _ in range(100):
        healthy.system.ticked("first")
        healthy.step(0.1, well=["second"])
    assert healthy.state()["first"] == ("healthy", 0)
    assert not [entry for entry in healthy.log if entry[0] == "stop"]


def test_time_spent_waiting_for_a_processor_is_no_silence(healthy):
    for _ in range(200):
        healthy.processes["first"].starved += 0.1
        healthy.step(0.1, well=["second"])
    assert healthy.state()["first"] == ("healthy", 0)
    healthy.steps(40, 0.1, well=["second"])
    assert ("stop", "first") in healthy.log


def test_a_hang_is_found_on_the_busiest_machine(healthy):
    """However long its threads wait together, a tenth of the time is silence: 3 s after 30 s."""
    for _ in range(310):
        healthy.processes["first"].starved += 0.5
        healthy.step(0.1, well=["second"])
    assert ("stop", "first") in healthy.log


def test_the_waiting_of_a_process_is_read_only_while_it_is_silent(healthy, monkeypatch):
    reads = []
    monkeypatch.setattr(Fake, "starved_s", lambda self: reads.append(self.pid) or 0.0)
    healthy.steps(50, 0.1, well=BOTH)
    assert not reads
    healthy.steps(20, 0.1, well=["second"])
    assert set(reads) == {healthy.processes["first"].pid}


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
    world.steps(52, 0.1)
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
    world.steps(400, 0.5)
    assert (world.system.given_up(), world.state()["first"][0]) == (("first",), "failed")
    assert world.system.stop()


@pytest.mark.parametrize(("well", "given_up"), [((), ("first",)), (("first",), ())])
def test_gives_up_on_a_wrong_configuration_unless_the_process_was_healthy_with_it(world, well, given_up):
    world.steps(1)
    world.steps(1, well=well)
    world.processes["first"].code = 2
    world.steps(5)
    assert world.system.given_up() == given_up
    assert (world.state()["first"][0] == "failed") == bool(given_up)


def test_stops_in_reverse_order(healthy):
    healthy.step(shutdown=True)
    healthy.step(shutdown=True)
    healthy.step(shutdown=True)
    assert [entry for entry in healthy.log if entry[0] == "stop"] == [("stop", "second"), ("stop", "first")]
    assert not healthy.system.running()


def test_who_was_ended_as_unwell_is_started_again_though_it_ended_cleanly(healthy):
    old = healthy.processes["first"]
    healthy.steps(40, well=["second"])
    assert old.code == 0
    assert healthy.processes["first"] is not old
    assert healthy.system.given_up() == ()


def test_silence_while_the_machine_slept_is_no_fault(healthy):
    healthy.step(3600.0)
    assert healthy.system.settled()
    healthy.steps(100, 0.05)
    assert ("stop", "first") in healthy.log
