"""Seeds of faults over the toys: the run is that without faults, whatever was dropped, doubled, delayed or forged.

Ten faults planted into the protocol are each found by a short campaign.
"""

from collections.abc import Callable
from typing import Any

import pytest

from surefoot.bus.interface import Delivery
from surefoot.errors import BusError
from surefoot.lab.chaos.events import FORGER, MEMORY, Kind, draw_events
from surefoot.lab.chaos.memory import ChaosSystem
from surefoot.lockstep import commands, join, node
from surefoot.lockstep import driver as driver_module
from surefoot.lockstep.config import ServiceConfig
from surefoot.schemas.hw import JointCommand
from surefoot.schemas.topics import Topic
from tests.surefoot.toys import ToyDriver, ToyEstimator, ToyObserver, ToyWalker, estimate

TICKS = 60
SEEDS = range(60)
MESSAGES: tuple[Kind, ...] = ("drop", "duplicate", "reorder", "delay", "corrupt", "forge")
NAMES = ("driver", "estimator", "walker", "recorder")


class Found(AssertionError):
    """A campaign has found something wrong."""


def forge(topic: Topic[Any], delivery: Delivery) -> Delivery | None:
    """What an impostor publishes before the owner: the same header, other content."""
    message = delivery.message()
    header = (message.stamp_ns, message.tick, message.epoch, message.seq, "x")
    if topic.key == "cmd/joints":
        return Delivery(topic, JointCommand(position=(40.0,)).stamped(*header), None, None, FORGER)
    if topic.key == "state/velocity":
        return Delivery(topic, estimate(40.0).stamped(*header), None, None, FORGER)
    if topic.key == "hw/tick":
        far = message.model_copy(update={"epoch": 10**9})
        return Delivery(topic, far, None, None, FORGER)
    return None


def run(seed: int, number: int = 8, kinds: tuple[Kind, ...] = MEMORY.kinds) -> tuple[list[float], ChaosSystem]:
    """A run under faults; the history of the toy's state."""
    makers: dict[str, Callable[[], Any]] = {
        "simulator": ToyDriver,
        "estimator": lambda: ToyEstimator(ServiceConfig()),
        "walker": lambda: ToyWalker(ServiceConfig()),
        "recorder": ToyObserver,
    }
    events = draw_events(MEMORY, seed, number, NAMES, TICKS, kinds)
    system = ChaosSystem(makers, events, seed, forge)
    system.driver.begin(("estimator", "walker", "recorder"), "lockstep", 0.0, 1, "hold", 0)
    lead = system.driver.leader
    lead.end_tick = TICKS
    try:
        system.run(lambda: lead.state == "ended" and lead.all_done())
    except BusError as error:
        raise Found(str(error)) from None
    if system.absent():
        raise Found(f"not back: {', '.join(system.absent())}")
    return system.driver.service.history, system  # type: ignore[attr-defined]


def reference() -> list[float]:
    return run(0, 0)[0]


def campaign(expected: list[float]) -> None:
    """Raises Found for the first seed whose run is another than that without faults."""
    for seed in SEEDS:
        try:
            history, _ = run(seed, kinds=MESSAGES)
        except Exception as error:
            raise Found(f"seed {seed}: {type(error).__name__}: {error}") from None
        if history != expected:
            raise Found(f"seed {seed}: another run, from tick {[*map(float.__eq__, history, expected)].index(False)}")


def test_the_events_of_a_seed_are_the_same_and_of_every_kind() -> None:
    assert draw_events(MEMORY, 7, 50, NAMES, 1000) == draw_events(MEMORY, 7, 50, NAMES, 1000)
    events = draw_events(MEMORY, 7, 500, NAMES, 1000)
    assert {event.kind for event in events} == set(MEMORY.kinds)
    assert {event.service for event in events if event.kind in ("kill", "freeze")} == set(NAMES[1:])
    assert [event.tick for event in events] == sorted(event.tick for event in events)


def test_spoilt_messages_change_nothing() -> None:
    campaign(reference())


def test_the_faults_of_a_seed_are_replayed_to_the_bit() -> None:
    one, other = run(3), run(3)
    assert one[0] == other[0]
    assert one[1].outcomes == other[1].outcomes
    assert one[1].now == other[1].now


@pytest.mark.parametrize("kinds", [("kill",), ("freeze",), MEMORY.kinds])
def test_after_killed_and_frozen_services_everybody_is_back(kinds: tuple[Kind, ...]) -> None:
    for seed in range(20):
        history, system = run(seed, 3, kinds)
        assert len(history) == TICKS
        assert system.absent() == ()


def test_who_noticed_an_event_and_when_is_part_of_its_outcome() -> None:
    for seed in range(6):
        for kind, by in (("kill", "simulator: "), ("corrupt", ": malformed")):
            for outcome in run(seed, 2, (kind,))[1].outcomes:  # type: ignore[arg-type]
                if outcome.spoilt or kind == "kill":
                    assert outcome.noticed is not None, outcome
                    assert by in outcome.by
                    assert outcome.began <= outcome.noticed <= (outcome.recovered or outcome.noticed)


def test_nothing_forged_is_obeyed_and_each_is_counted() -> None:
    expected = reference()
    refused = 0
    for seed in range(20):
        history, system = run(seed, 6, ("forge",))
        assert history == expected
        refused += sum(found.refused["unbound"] for found in system.nodes.values())
    assert refused > 100


def test_what_a_slow_reader_lost_a_window_ago_is_sent_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its last report was of tick 9, so the others are 21 ticks on before anybody notices."""
    original, lost = join.Join.offer, list[int]()

    def offer(self: join.Join, topic: Topic[Any], message: Any, value: Any = None) -> str | None:
        if self.service == "recorder" and topic.key == "state/velocity" and message.tick == 10 and not lost:
            lost.append(message.tick)
            return None
        return original(self, topic, message, value)

    monkeypatch.setattr(join.Join, "offer", offer)
    history, system = run(0, 0)
    assert (lost, history[:5]) == ([10], reference()[:5])
    assert system.driver.leader.comparable, system.driver.leader.reason
    assert system.nodes["recorder"].join.last == TICKS


def test_a_lost_delayed_input_of_the_last_tick_is_sent_again() -> None:
    """Of a seed in which a recorder is killed and the walker's own gait of the tick before is damaged."""
    history, system = run(171)
    assert (len(history), system.driver.leader.tick) == (TICKS, TICKS)


# -- planted faults ----------------------------------------------------------------------------------------------------


def offer_again(self: join.Join, tick: Any) -> Any:
    """Work out a tick that comes again once more."""
    if tick.epoch == self.epoch and 0 <= tick.tick == self.last:
        self.last -= 1
    return OFFER_TICK(self, tick)


def raise_malformed(self: node.Node, reason: str, detail: str = "") -> None:
    self.refused[reason] += 1
    if reason == "malformed":
        raise ValueError(detail)


def repeat_without_samples(self: Any, ticks: range) -> None:
    self._outbox.clear()
    REPEAT(self, ticks)


OFFER_TICK, TAKE, REPEAT = join.Join._offer_tick, commands.Commands.take, driver_module.DriverNode._repeat
PLANTED: dict[str, tuple[Any, str, Any]] = {
    "anyone_speaks": (node.Node, "_speaks", lambda *args, **more: True),
    "no_resend": (driver_module.DriverNode, "_repeat_all", lambda self: None),
    "no_replay": (node.Node, "_replay", lambda *args: None),
    "newest_instead_of_same_tick": (join.Join, "_missing", lambda self, tick: []),
    "second_message_wins": (join.Join, "_offer_tick", offer_again),
    "no_delay_kept": (commands.Commands, "take", lambda self, wanted, exact: TAKE(self, wanted + 1, exact=False)),
    "later_command_stands_in": (driver_module.DriverNode, "_lacks_command", lambda self: False),
    "malformed_ends_the_service": (node.Node, "refuse", raise_malformed),
    "outputs_forgotten": (node, "KEEP_TICKS", 0),
    "repeats_without_samples": (driver_module.DriverNode, "_repeat", repeat_without_samples),
}
"""What takes the place of what, by the name of the fault."""


@pytest.mark.parametrize("fault", PLANTED)
def test_a_planted_fault_of_the_protocol_is_found(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = reference()
    monkeypatch.setattr(*PLANTED[fault])
    with pytest.raises(Found):
        campaign(expected)
    assert len(PLANTED) == 10
