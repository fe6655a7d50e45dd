"""The driver: start, commands good and bad, order, pace."""

import pytest

from surefoot.bus.codec import encode
from surefoot.bus.interface import Delivery, Raw
from surefoot.errors import Refusal
from surefoot.lockstep import driver as runtime
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.leader import PACED_COMMAND_LAG_TICKS, PACED_WINDOW_TICKS
from surefoot.schemas.hw import JointCommand
from surefoot.schemas.state import GaitState
from surefoot.schemas.status import SimStatus
from surefoot.schemas.system import JoinRequest
from surefoot.schemas.topics import CMD_JOINTS, SIM_JOIN, STATE_GAIT, STATE_VELOCITY
from tests.surefoot.expect import expect_error
from tests.surefoot.lockstep.driver_bench import EXPECT, LIMIT, Bench, reference
from tests.surefoot.toys import ToyWalker

GOOD = encode(JointCommand(position=(0.0,)).stamped(0, 10, 1, 10, "walker"))[0]
pytestmark = pytest.mark.usefixtures("no_waiting")


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


@pytest.mark.parametrize(
    ("payload", "encoding", "reason"),
    [
        (b"{", "", "malformed"),
        (b'{"position":[0.0],"speed":1}', "", "invalid"),
        (b'{"position":[NaN]}', "", "invalid"),
        (b'{"position":[1e999]}', "", "invalid"),
        (b'{"position":"' + b"0" * (10 << 20) + b'"}', "", "too_large"),
        (GOOD, "application/json;surefoot/JointCommand/2.0", "schema"),
        (GOOD, "application/json;surefoot/JointState/1.0", "schema"),
    ],
    ids=["cut", "unknown field", "nan", "inf", "10 MB", "major", "name"],
)
def test_unreadable_command_is_refused_counted_and_changes_nothing(payload: bytes, encoding: str, reason: str) -> None:
    bench = Bench(at=10)
    bench.node.handle(Delivery(CMD_JOINTS, None, Raw(payload, None, encoding)))
    assert bench.node.refused == {reason: 1}
    assert bench.finish(30) == reference(30)


@pytest.mark.parametrize(
    ("tick", "epoch", "reason"), [(2, 1, "stale"), (10**6, 1, "stale"), (10, 0, "stale_epoch"), (10, 2, "stale_epoch")]
)
def test_command_of_another_time_is_refused(tick: int, epoch: int, reason: str) -> None:
    bench = Bench(at=100)
    bench.command(tick, (1.0,), epoch)
    assert bench.node.refused == {reason: 1}
    assert bench.finish(110) == reference(110)


@pytest.mark.parametrize("position", [(LIMIT + 1.0,), (0.0, 0.0), ()], ids=["range", "long", "short"])
def test_command_the_hardware_must_not_obey_holds_what_was(position: tuple[float, ...]) -> None:
    class Mad(ToyWalker):
        def on_tick(self, inputs: TickInputs) -> None:
            if inputs.number == 10:
                gait = GaitState(walk_id=1, state="walking", phase=0.0, stance=(), footholds=(), remaining=0.0)
                self.publish(STATE_GAIT, gait)
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


def test_a_refused_stranger_does_not_take_the_place_of_the_walker() -> None:
    bench = Bench(delay=0)
    bench.until(lambda: bench.leader.tick == 10 and not bench.leader.may_advance())
    bench.command(10, (LIMIT + 1.0,))
    assert bench.node.refused == {"out_of_range": 1}
    assert bench.finish(30) == reference(30, delay=0)


def test_first_command_of_a_tick_counts() -> None:
    bench = Bench(delay=0, at=10)
    for node in bench.system.nodes[1:]:
        node.pump()
    while not bench.node.inbox.empty():
        bench.node.handle(bench.node.inbox.get_nowait())
    assert bench.node.commands.known(10)
    bench.command(10, (LIMIT,))
    assert bench.finish(30) == reference(30, delay=0)


FAST = 1e9  # real-time factor of a pace that is due at once


def test_a_pace_waits_for_nobody() -> None:
    bench = Bench(mode="paced", at=3)
    tick = bench.leader.tick
    bench.node.pace.begin(FAST, tick)
    for _ in range(20):
        bench.node.pump_once()
    assert bench.leader.tick == tick + 20
    assert bench.leader.comparable


def test_without_a_pace_time_gives_way_to_its_slowest_member(no_waiting: None) -> None:
    """As fast as it goes means as fast as they go: else what they cannot take is lost, heartbeats among it."""
    bench = Bench(mode="paced", policy="degrade", at=3)
    walker = bench.leader.members["walker"]
    for _ in range(5 * PACED_WINDOW_TICKS):
        bench.node._run()
        if bench.node.refused["resent_ticks"]:
            break
    assert bench.leader.tick <= walker.done + PACED_COMMAND_LAG_TICKS + 1
    bench.until_tick(100)
    assert bench.leader.members.keys() == {"estimator", "walker", "recorder"}


def test_paced_driver_obeys_a_command_that_comes_late_but_not_a_stale_one() -> None:
    bench = Bench(mode="paced", at=3)
    bench.node.pace.begin(FAST, bench.leader.tick)
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
    bench = Bench(mode="paced", at=3)
    clock = [100.0]
    monkeypatch.setattr(bench.node.pace, "_clock", lambda: clock[0])
    bench.node.pace.begin(2.0, bench.leader.tick)
    begun = bench.leader.tick
    for _ in range(100):
        clock[0] += 0.001
        bench.node.pump_once()
    assert bench.leader.tick - begun == pytest.approx(20, abs=1)  # 0.1 s of wall time, twice as fast


def test_pause_in_the_past_is_refused() -> None:
    bench = Bench(at=10)
    with expect_error(Refusal, "late", field="at_tick"):
        bench.node.pause(3, end=False)


def test_pause_and_resume() -> None:
    bench = Bench()
    bench.node.pause(15, end=False)
    bench.until(lambda: bench.leader.state == "paused")
    assert bench.leader.tick == 15
    bench.node.work()
    assert bench.node.health().state == "ready"  # no tick comes
    bench.node.resume(5)
    assert bench.node.health().state == "running"
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
