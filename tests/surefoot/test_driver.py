"""The driver's half of lockstep under fault: bad commands, lost and returning members, silence, pace."""

from collections.abc import Callable
from typing import Any

import pytest

from schemas.base import Message
from schemas.hw import JointCommand, Tick
from schemas.sim import SimStatus
from schemas.system import Done, JoinRequest
from schemas.terrain import HeightMapMessage
from schemas.topics import CMD_JOINTS, HW_IMU, HW_TICK, SIM_JOIN, STATE_VELOCITY, TERRAIN_MAP, TICK_DONE, TICK_NS, Topic
from surefoot import driver as runtime
from surefoot.bus import Delivery, Raw
from surefoot.codec import encode
from surefoot.config import ServiceConfig
from surefoot.driver import DriverNode
from surefoot.errors import Refusal
from surefoot.join import TickInputs
from surefoot.leader import Leader
from surefoot.local import LocalSystem
from surefoot.node import Node
from tests.surefoot.toys import ToyDriver, ToyEstimator, ToyObserver, ToyWalker

EXPECT = ("estimator", "walker", "recorder")
LIMIT = 50.0  # the toy's range of a joint


class GuardedDriver(ToyDriver):
    """A driver with one joint, a range, and a map."""

    outputs = (HW_IMU, TERRAIN_MAP)

    def check(self, command: JointCommand) -> None:
        if command.position is not None and (len(command.position) != 1 or abs(command.position[0]) > LIMIT):
            raise Refusal("out_of_range", f"got {command.position}", "position")

    def latched(self) -> list[tuple[Topic[Any], Message]]:
        return [(TERRAIN_MAP, HeightMapMessage(rows=1, cols=1, cell=0.1, origin=(0.0, 0.0), version=4, data=b"\0" * 4))]


class MapReader(ToyEstimator):
    """An estimator that also needs the map."""

    inputs = (HW_IMU, TERRAIN_MAP)

    def __init__(self) -> None:
        super().__init__(ServiceConfig())
        self.versions: list[int] = []

    def on_tick(self, inputs: TickInputs) -> None:
        found = inputs.get(TERRAIN_MAP)
        assert found is not None
        self.versions.append(found.version)
        super().on_tick(inputs)


class Bench:
    """The toys on one bus, pumped in turn; members can be killed and started again."""

    def __init__(self, policy: str = "hold", mode: str = "lockstep", delay: int = 1) -> None:
        self.driver = GuardedDriver()
        self.estimator = MapReader()
        self.walker, self.observer = ToyWalker(ServiceConfig()), ToyObserver()
        self.system = LocalSystem([self.driver, self.estimator, self.walker, self.observer])
        self.bus = self.system.bus
        self.ticks: list[Tick] = []
        self.bus.subscribe(HW_TICK, self._keep)
        self.node: DriverNode = self.driver.node
        self.node.begin(EXPECT, mode, 0.0, delay, policy, 0)

    def _keep(self, delivery: Delivery) -> None:
        message = delivery.message()
        assert isinstance(message, Tick)
        if message.tick >= 0:
            self.ticks.append(message)

    @property
    def leader(self) -> Leader:
        return self.node.leader

    def until(self, condition: Callable[[], bool]) -> None:
        def finished() -> bool:
            assert self.leader.tick < 500, "the run does not end"
            return condition()

        self.system.run_until(finished, max_idle_rounds=2000)

    def until_tick(self, tick: int) -> None:
        self.until(lambda: self.leader.tick >= tick)

    def finish(self, tick: int) -> list[float]:
        self.leader.end_tick = tick
        self.until(lambda: self.leader.state == "ended" and self.leader.all_done())
        return self.driver.history

    def kill(self, name: str) -> Node:
        node = next(node for node in self.system.nodes if node.name == name)
        self.system.nodes.remove(node)
        for sinks in self.bus._sinks.values():
            sinks[:] = [sink for sink in sinks if getattr(sink, "__self__", None) is not node.inbox]
        self.bus.depart(name)
        return node

    def revive(self, service: Any) -> Node:
        node = Node(service, self.bus)
        self.system.nodes.append(node)
        node.start()
        return node

    def command(self, tick: int, position: tuple[float, ...] | None, epoch: int = 1) -> None:
        message = JointCommand(position=position).stamped(tick * TICK_NS, tick, epoch, tick, "walker")
        self.node.handle(Delivery(CMD_JOINTS, message, None))


@pytest.fixture(autouse=True)
def no_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    """Links are proved as fast as the nodes are pumped, not each 20 ms."""
    monkeypatch.setattr(runtime, "PRIME_S", 0.0)


def reference(ticks: int, delay: int = 1) -> list[float]:
    return Bench(delay=delay).finish(ticks)


# -- commands ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (b"{", "malformed"),
        (b'{"position":[0.0],"speed":1}', "invalid"),
        (b'{"position":[NaN]}', "invalid"),
        (b'{"position":[1e999]}', "invalid"),
        (b'{"position":"' + b"0" * (10 << 20) + b'"}', "too_large"),
    ],
    ids=["cut", "unknown field", "nan", "inf", "10 MB"],
)
def test_unreadable_command_is_refused_counted_and_changes_nothing(payload: bytes, reason: str) -> None:
    bench = Bench()
    bench.until_tick(10)
    bench.node.handle(Delivery(CMD_JOINTS, None, Raw(payload, None, "")))
    assert bench.node.refused == {reason: 1}
    assert bench.finish(30) == reference(30)


@pytest.mark.parametrize(
    "encoding", ["application/json;surefoot/JointCommand/2.0", "application/json;surefoot/JointState/1.0"]
)
def test_command_of_another_schema_is_refused(encoding: str) -> None:
    bench = Bench()
    bench.until_tick(10)
    payload = encode(JointCommand(position=(0.0,)).stamped(0, 10, 1, 10, "walker"))[0]
    bench.node.handle(Delivery(CMD_JOINTS, None, Raw(payload, None, encoding)))
    assert bench.node.refused == {"schema": 1}


@pytest.mark.parametrize(
    ("tick", "epoch", "reason"), [(2, 1, "stale"), (10**6, 1, "stale"), (10, 0, "stale_epoch"), (10, 2, "stale_epoch")]
)
def test_command_of_another_time_is_refused(tick: int, epoch: int, reason: str) -> None:
    bench = Bench()
    bench.until_tick(40)
    bench.command(tick, (1.0,), epoch)
    assert bench.node.refused == {reason: 1}
    assert bench.finish(50) == reference(50)


@pytest.mark.parametrize("position", [(LIMIT + 1.0,), (0.0, 0.0), ()], ids=["range", "long", "short"])
def test_command_the_hardware_must_not_obey_holds_what_was(position: tuple[float, ...]) -> None:
    class Mad(ToyWalker):
        def on_tick(self, inputs: TickInputs) -> None:
            if inputs.number == 10:
                self.publish(self.outputs[1], _gait())
                self.publish(CMD_JOINTS, JointCommand(position=position))
            else:
                super().on_tick(inputs)

    bench = Bench()
    bench.kill("walker")
    bench.revive(Mad(ServiceConfig()))
    history = bench.finish(30)
    assert bench.node.refused == {"out_of_range": 1}
    assert len(history) == 30
    assert history[11] == pytest.approx(0.9 * history[10])  # the toy holds by adding nothing; delay of one tick


def _gait() -> Any:
    from schemas.state import GaitState

    return GaitState(walk_id=1, state="walking", phase=0.0, stance=(), footholds=(), remaining=0.0)


def test_a_refused_stranger_does_not_take_the_place_of_the_walker() -> None:
    bench = Bench(delay=0)
    bench.until(lambda: bench.leader.tick == 10 and not bench.leader.may_advance())
    bench.command(10, (LIMIT + 1.0,))
    assert bench.node.refused == {"out_of_range": 1}
    assert bench.finish(30) == reference(30, delay=0)


def test_first_command_of_a_tick_counts() -> None:
    bench = Bench(delay=0)
    bench.until_tick(10)
    for node in bench.system.nodes[1:]:
        node.pump()
    while not bench.node.inbox.empty():
        bench.node.handle(bench.node.inbox.get_nowait())
    assert 10 in bench.node._commands
    bench.command(10, (LIMIT,))
    assert bench.finish(30) == reference(30, delay=0)


# -- loss and return ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["estimator", "walker", "recorder"])
@pytest.mark.parametrize("at", [3, 20])
def test_hold_waits_and_a_new_process_joins(name: str, at: int) -> None:
    bench = Bench()
    bench.until_tick(at)
    bench.kill(name)
    for _ in range(5):
        for node in bench.system.nodes:
            node.pump()
    held = bench.leader.tick
    assert bench.leader.state == "holding"
    assert bench.leader.missing() == (name,)
    new = {"estimator": MapReader, "walker": lambda: ToyWalker(ServiceConfig()), "recorder": ToyObserver}[name]()
    bench.revive(new)
    history = bench.finish(40)
    assert len(history) == 40
    assert held < 40
    assert not bench.leader.comparable
    assert name in bench.leader.members
    assert bench.node.refused["resent_ticks"] == 0  # nothing had to be waited for
    if name == "estimator":
        assert set(new.versions) == {4}  # latched state is told to the newcomer


@pytest.mark.parametrize("pumps", range(1, 7))
def test_hold_of_a_walker_that_had_answered_already(pumps: int) -> None:
    """Whatever the dead one had sent for the present tick, the new one's command must be enough to go on."""
    bench = Bench(delay=1)
    bench.until_tick(20)
    for _ in range(pumps):
        for node in bench.system.nodes[1:]:
            node.pump()
    bench.kill("walker")
    bench.revive(ToyWalker(ServiceConfig()))
    assert len(bench.finish(40)) == 40
    assert bench.node.refused["resent_ticks"] == 0


def test_stateless_member_that_returns_under_hold_gives_the_same_run() -> None:
    bench = Bench()
    bench.until_tick(20)
    bench.kill("estimator")
    bench.revive(MapReader())
    assert bench.finish(40) == reference(40)
    assert not bench.leader.comparable


def test_hold_gives_up_and_goes_on_without(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runtime, "HOLD_S", 0.0)
    bench = Bench()
    bench.until_tick(20)
    bench.kill("estimator")
    bench.finish(40)
    assert "estimator" not in bench.leader.members


def test_degrade_goes_on_at_once_and_takes_the_newcomer_in_at_a_tick() -> None:
    bench = Bench(policy="degrade")
    bench.until_tick(20)
    bench.kill("estimator")
    bench.until_tick(30)
    assert "estimator" not in bench.leader.members
    version = bench.leader.roster_version
    new = MapReader()
    node = bench.revive(new)
    bench.bus.call(SIM_JOIN, JoinRequest(service="estimator", instance=node.instance))
    bench.until(lambda: "estimator" in bench.leader.members)
    assert bench.leader.roster_version == version + 1
    bench.finish(bench.leader.tick + 10)
    assert new.versions
    assert set(new.versions) == {4}
    without = [t.tick for t in bench.ticks if "estimator" not in t.roster]
    assert without == list(range(without[0], without[-1] + 1))


def test_fail_ends_the_run() -> None:
    bench = Bench(policy="fail")
    bench.until_tick(20)
    bench.kill("estimator")
    bench.node.pump()
    assert bench.leader.state == "ended"
    assert "estimator" in bench.leader.reason


def test_a_late_done_of_a_dead_instance_does_not_count() -> None:
    bench = Bench()
    bench.until_tick(20)
    before = bench.leader.members["recorder"].done
    late = Done(tick=before + 3, epoch=1, source="recorder", instance="dead")
    bench.node.handle(Delivery(TICK_DONE, late, None))
    assert bench.leader.members["recorder"].done == before


def test_a_late_ready_of_an_epoch_before_does_not_count() -> None:
    bench = Bench()
    bench.finish(5)
    bench.node.begin(EXPECT, "lockstep", 0.0, 1, "hold", 0)
    late = Done(tick=-1, epoch=1, source="recorder", instance="x", ready=True)
    bench.node.handle(Delivery(TICK_DONE, late, None))
    assert bench.leader.ready == {}


def test_silence_is_answered_by_the_same_tick_again(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench()
    bench.until_tick(20)
    asleep = bench.system.nodes.pop(1)
    monkeypatch.setattr(runtime, "SILENCE_S", 0.0)
    for _ in range(4):
        bench.node.pump_once()
    assert bench.node.refused["resent_ticks"] > 0
    assert [t.tick for t in bench.ticks].count(bench.leader.tick) > 1
    monkeypatch.setattr(runtime, "SILENCE_S", 10.0)
    bench.system.nodes.insert(1, asleep)
    assert bench.finish(40) == reference(40)
    assert bench.leader.comparable


@pytest.mark.parametrize("name", ["estimator", "walker", "recorder"])
@pytest.mark.parametrize("policy", ["degrade", "hold"])
def test_a_frozen_member_counts_as_lost_and_may_return(name: str, policy: str, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(policy=policy)
    bench.until_tick(20)
    asleep = next(node for node in bench.system.nodes if node.name == name)
    bench.system.nodes.remove(asleep)
    monkeypatch.setattr(runtime, "SILENCE_S", 0.0)
    while not bench.leader.reason:
        bench.node.pump_once()
        for node in bench.system.nodes[1:]:
            node.pump()
    monkeypatch.setattr(runtime, "SILENCE_S", 10.0)
    assert bench.leader.reason == f"{name} is silent"
    if policy == "degrade":
        assert name not in bench.leader.members
        bench.until_tick(40)
        bench.system.nodes.append(asleep)
        bench.bus.call(SIM_JOIN, JoinRequest(service=name, instance=asleep.instance))
        bench.until(lambda: name in bench.leader.members)
    else:
        assert bench.leader.missing() == (name,)
        bench.system.nodes.append(asleep)
    bench.finish(bench.leader.tick + 20)
    assert name in bench.leader.members
    assert not bench.leader.comparable


# -- start -------------------------------------------------------------------------------------------------------------


def test_nobody_starts_before_all_expected_are_ready(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench()
    bench.kill("walker")
    for _ in range(20):
        for node in bench.system.nodes:
            node.pump()
    assert bench.leader.state == "joining"
    assert "walker" in bench.leader.missing()
    monkeypatch.setattr(runtime, "JOIN_TIMEOUT_S", 0.0)
    bench.node.pump()
    assert bench.leader.state == "idle"
    assert "walker" in bench.leader.reason


def test_joiners_are_turned_away_between_runs() -> None:
    bench = Bench()
    bench.finish(5)
    reply = bench.bus.call(SIM_JOIN, JoinRequest(service="viewer", instance="1"))
    assert not reply.accepted
    assert "ended" in reply.reason


def test_a_second_epoch_repeats_the_first() -> None:
    bench = Bench()
    first = list(bench.finish(20))
    bench.driver.x = 0.0
    bench.driver.history.clear()
    assert bench.node.begin(EXPECT, "lockstep", 0.0, 1, "hold", 0) == 2
    assert bench.finish(20) == first
    assert bench.leader.comparable


# -- paced -------------------------------------------------------------------------------------------------------------


def test_paced_mode_waits_for_nobody() -> None:
    bench = Bench(mode="paced")
    bench.until_tick(3)
    tick = bench.leader.tick
    for _ in range(20):
        bench.node.pump_once()
    assert bench.leader.tick == tick + 20
    assert bench.leader.comparable


def test_paced_driver_obeys_a_command_that_comes_late_but_not_a_stale_one() -> None:
    bench = Bench(mode="paced")
    bench.until_tick(3)
    bench.kill("walker")
    bench.node.pump_once()
    for _ in range(30):
        bench.node.pump_once()
    applied: list[float | None] = []
    bench.driver.actuate = (  # type: ignore[method-assign]
        lambda tick, command: applied.append(None if command is None else (command.position or (0.0,))[0])
    )
    now = bench.leader.tick
    bench.command(now - 9, (9.0,))
    bench.command(now - 3, (3.0,))
    bench.command(now - 11, (11.0,))
    assert bench.node.refused == {"stale": 1}
    for _ in range(20):
        bench.node.pump_once()
    assert applied == [3.0] + 19 * [None]  # the newest once; None lets the driver hold


def test_paced_mode_keeps_the_wall_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(mode="paced")
    bench.until_tick(3)
    clock = [100.0]
    monkeypatch.setattr(runtime.time, "monotonic", lambda: clock[0])
    bench.node.rtf = 2.0
    bench.node._pace_origin = (clock[0], bench.leader.tick)
    begun = bench.leader.tick
    for _ in range(100):
        clock[0] += 0.001
        bench.node.pump_once()
    assert bench.leader.tick - begun == pytest.approx(20, abs=1)  # 0.1 s of wall time, twice as fast


# -- order -------------------------------------------------------------------------------------------------------------


def test_pause_in_the_past_is_refused() -> None:
    bench = Bench()
    bench.until_tick(10)
    with pytest.raises(Refusal) as caught:
        bench.node.pause(3, end=False)
    assert (caught.value.code, caught.value.field) == ("late", "at_tick")


def test_pause_and_resume() -> None:
    bench = Bench()
    bench.node.pause(15, end=False)
    bench.until(lambda: bench.leader.state == "paused")
    assert bench.leader.tick == 15
    bench.node.resume(5)
    bench.until(lambda: bench.leader.state == "paused")
    assert bench.leader.tick == 20
    bench.node.resume(None)
    assert bench.finish(30) == reference(30)
    with pytest.raises(Refusal):
        bench.node.resume(None)


def test_status_of_the_run_is_one_of_the_message() -> None:
    states = SimStatus.model_fields["state"].annotation
    for state in ("idle", "joining", "running", "paused", "holding", "ended"):
        assert state in states.__args__  # type: ignore[union-attr]


def test_the_velocity_of_the_toys_is_what_the_observer_saw() -> None:
    bench = Bench()
    bench.finish(10)
    assert all(STATE_VELOCITY.key in messages for _, messages in bench.observer.seen)
