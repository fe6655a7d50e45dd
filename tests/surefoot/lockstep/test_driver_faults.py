"""Lost, returning and frozen members."""

import time

import pytest

from surefoot.bus.interface import Delivery, Life
from surefoot.bus.memory import MemoryBus
from surefoot.lockstep import driver as runtime
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.node import Node
from surefoot.schemas.hw import JointCommand
from surefoot.schemas.system import Done, JoinRequest
from surefoot.schemas.topics import SIM_JOIN, TICK_DONE
from tests.surefoot.lockstep.driver_bench import EXPECT, Bench, MapReader, reference
from tests.surefoot.toys import ToyObserver, ToyWalker

pytestmark = pytest.mark.usefixtures("no_waiting")


@pytest.mark.parametrize("name", ["estimator", "walker", "recorder"])
@pytest.mark.parametrize("at", [3, 20])
def test_hold_waits_and_a_new_process_joins(name: str, at: int) -> None:
    bench = Bench(at=at)
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
        assert set(new.versions) == {4}  # latched state is sent to the process that came last


@pytest.mark.parametrize("pumps", range(1, 7))
def test_hold_of_a_walker_that_had_answered_already(pumps: int) -> None:
    """Whatever the dead one had sent for the present tick, the new one's command must be enough to go on."""
    bench = Bench(delay=1, at=20)
    for _ in range(pumps):
        for node in bench.system.nodes[1:]:
            node.pump()
    bench.kill("walker")
    bench.revive(ToyWalker(ServiceConfig()))
    assert len(bench.finish(40)) == 40
    assert bench.node.refused["resent_ticks"] == 0


def test_stateless_member_that_returns_under_hold_gives_the_same_run() -> None:
    bench = Bench(at=20)
    bench.kill("estimator")
    bench.revive(MapReader())
    assert bench.finish(40) == reference(40)
    assert not bench.leader.comparable


def test_hold_gives_up_after_two_minutes_and_ends_the_run() -> None:
    bench, now = Bench(), [0.0]
    bench.node.clock = lambda: now[0]  # type: ignore[method-assign]
    bench.until_tick(20)
    bench.kill("estimator")
    held = -1
    for now[0] in (1.0, 60.0, 119.0):
        for node in bench.system.nodes:
            node.pump()
        held = bench.leader.tick if held < 0 else held
        assert (bench.leader.state, bench.leader.tick, bench.node.gave_up) == ("holding", held, "")
    now[0] = 122.0
    bench.until(lambda: bench.leader.state == "ended" and bench.leader.all_done())
    assert bench.leader.tick == held + 1
    assert "estimator" not in bench.leader.members
    assert "estimator" in bench.node.gave_up
    assert "120 s" in bench.node.gave_up


def test_degrade_goes_on_at_once_and_takes_the_newcomer_in_at_a_tick() -> None:
    bench = Bench(policy="degrade", at=20)
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


def test_a_newer_process_joins_though_the_token_of_its_killed_one_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where a stranger holds a link in the name of the killed process."""
    age: dict[str, int] = {}
    monkeypatch.setattr(MemoryBus, "born_ms", lambda _, service, instance: age.setdefault(instance, len(age) + 1))
    bench = Bench(policy="degrade", mode="paced", at=20)
    monkeypatch.setattr(bench.bus, "depart", lambda name: None)
    bench.kill("estimator")
    bench.until_tick(30)
    new = bench.revive(MapReader())
    bench.bus.call(SIM_JOIN, JoinRequest(service="estimator", instance=new.instance))
    bench.until(lambda: bench.leader.members["estimator"].instance == new.instance)
    (walker,) = (node for node in bench.system.nodes if node.name == "walker")
    bench.until(lambda: walker.bindings.bound["estimator"] == new.instance)


def test_a_run_that_begins_without_services_takes_in_those_of_the_run_before() -> None:
    """As after a request of `sim/reset` that names no service to wait for."""
    bench, now = Bench(at=20), [time.monotonic()]
    for node in bench.system.nodes:
        node.clock = lambda: now[0]
    assert bench.node.begin((), "lockstep", 0.0, 1, "hold", 0) == 2

    def joined() -> bool:
        now[0] += 0.05
        for node in bench.system.nodes:
            node.timers()
        return set(bench.leader.members) == set(EXPECT)

    bench.until(joined)
    bench.until_tick(bench.leader.tick + 30)
    assert not any(node.join.outrun for node in bench.system.nodes)


def test_a_process_beside_a_bound_one_that_runs_does_not_join() -> None:
    bench = Bench(at=20)
    bench.bus.announce("estimator", "stranger")
    reply = bench.bus.call(SIM_JOIN, JoinRequest(service="estimator", instance="stranger"))
    assert not reply.accepted
    assert "which runs" in reply.reason


@pytest.mark.parametrize("name", ["driver", "simulator"])
def test_the_driver_is_no_member_of_its_own_roster(name: str) -> None:
    bench = Bench(at=20)
    bench.bus.announce(name, bench.node.instance)
    ready = Done(tick=-1, epoch=1, source=name, instance=bench.node.instance, ready=True)
    bench.node.handle(Delivery(TICK_DONE.of(name), ready, None))
    assert bench.node.refused["unbound"] == 1
    bench.finish(60)
    assert name not in bench.leader.members


def test_fail_ends_the_run() -> None:
    bench = Bench(policy="fail", at=20)
    bench.kill("estimator")
    bench.node.pump()
    assert bench.leader.state == "ended"
    assert "estimator" in bench.leader.reason


def test_a_late_done_of_a_dead_instance_does_not_count() -> None:
    bench = Bench(at=20)
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
    bench = Bench(at=20)
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


def lost_in_silence(bench: Bench, name: str, monkeypatch: pytest.MonkeyPatch) -> Node:
    """Return the node of a member that does nothing until it counts as lost; it is no longer in the system."""
    asleep = next(node for node in bench.system.nodes if node.name == name)
    bench.system.nodes.remove(asleep)
    monkeypatch.setattr(runtime, "SILENCE_S", 0.0)
    while not bench.leader.reason:
        bench.node.pump_once()
        for node in bench.system.nodes[1:]:
            node.pump()
    monkeypatch.setattr(runtime, "SILENCE_S", 10.0)
    return asleep


@pytest.mark.parametrize("name", ["estimator", "walker", "recorder"])
@pytest.mark.parametrize("policy", ["degrade", "hold"])
def test_a_frozen_member_counts_as_lost_and_may_return(name: str, policy: str, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(policy=policy, at=20)
    asleep = lost_in_silence(bench, name, monkeypatch)
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


@pytest.mark.parametrize("name", ["estimator", "walker", "recorder"])
def test_a_member_that_was_cut_off_gets_all_it_lacks(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its process lives, nothing reaches it, and it counts as lost: what was published meanwhile comes again."""
    bench = Bench(policy="hold", at=20)
    cut = lost_in_silence(bench, name, monkeypatch)
    behind = cut.join.last
    assert bench.leader.missing() == (name,)
    assert bench.leader.tick > behind
    cut.inbox.tick.items.clear()
    bench.system.nodes.append(cut)
    assert bench.finish(60) == reference(60)


@pytest.mark.parametrize("alive", [True, False])
def test_ticks_come_again_to_all_while_a_silent_member_is_awaited(alive: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """It may wait for the reply of another that lacks a tick; one whose process is gone waits for none."""
    bench = Bench(policy="hold", at=20)
    lost_in_silence(bench, "walker", monkeypatch)
    if not alive:
        bench.bus.depart("walker")
    monkeypatch.setattr(runtime, "REPEAT_S", 0.0)
    before = [tick.tick for tick in bench.ticks].count(bench.leader.tick)
    for _ in range(3):
        bench.node.pump_once()
    assert bench.leader.state == "holding"
    assert [tick.tick for tick in bench.ticks].count(bench.leader.tick) == before + (3 if alive else 0)


@pytest.mark.parametrize("held", [False, True])
def test_a_command_that_was_lost_is_awaited_though_the_next_is_there(
    held: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also of a walker that was out of sight meanwhile and is the same process when it is back; a report that it is
    ready counts only while it is in sight, for it may be late."""
    bench = Bench(at=20)
    take, came = bench.node._on_command, set[int]()

    def lose_one(command: JointCommand, sender: str) -> None:
        came.add(command.tick)
        if command.tick != 20 or 21 in came:
            take(command, sender)

    monkeypatch.setattr(bench.node, "_on_command", lose_one)
    bench.until(lambda: 21 in came)
    if held:
        instance = bench.leader.members["walker"].instance
        bench.node.on_life(Life("walker", instance, False))
        ready = Done(tick=-1, epoch=1, source="walker", instance=instance, ready=True)
        bench.node.handle(Delivery(TICK_DONE, ready, None))
        bench.node.pump_once()
        assert bench.leader.lost == {"walker"}
        bench.node.on_life(Life("walker", instance, True))
    for _ in range(3):  # the others are slower
        bench.node.pump_once()
    monkeypatch.setattr(runtime, "SILENCE_S", 1e-6)
    assert bench.finish(40) == reference(40)
