"""Seeds of faults over the toys, what counts as found, and twenty faults planted into the protocol."""

from collections.abc import Callable, Sequence
from typing import Any

from surefoot.bus.interface import Delivery
from surefoot.errors import BusError
from surefoot.lab.chaos.events import FORGER, MEMORY, MESSAGES, ChaosEvent, Kind, draw_events
from surefoot.lab.chaos.memory import ChaosSystem
from surefoot.lab.chaos.shrink import Shrunk, shrink
from surefoot.lockstep import binding, commands, join, leader, node
from surefoot.lockstep import driver as driver_module
from surefoot.lockstep.config import ServiceConfig
from surefoot.schemas.hw import JointCommand
from surefoot.schemas.topics import Topic
from tests.surefoot.toys import ToyDriver, ToyEstimator, ToyObserver, ToyWalker, estimate

TICKS = 60
SEEDS = range(300)
NAMES = ("driver", "estimator", "walker", "recorder")
EVENTS = 8
STALL_S = 10.0
"""Virtual time without a tick after which a toy has stalled, s: twice the longest freeze."""


class Found(AssertionError):
    """A campaign has found something wrong."""


def forge(topic: Topic[Any], delivery: Delivery) -> Delivery | None:
    """Message that an impostor publishes before the owner: the same header, other content."""
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


def run(seed: int, number: int = EVENTS, kinds: tuple[Kind, ...] = MEMORY.kinds) -> tuple[list[float], ChaosSystem]:
    """A run under the faults that a seed draws; the history of the toy's state."""
    return run_events(draw_events(MEMORY, seed, number, NAMES, TICKS, kinds), seed)


def run_events(events: Sequence[ChaosEvent], seed: int = 0) -> tuple[list[float], ChaosSystem]:
    """A run under these faults; raises Found when somebody is missing at its end, or it has none."""
    makers: dict[str, Callable[[], Any]] = {
        "simulator": ToyDriver,
        "estimator": lambda: ToyEstimator(ServiceConfig()),
        "walker": lambda: ToyWalker(ServiceConfig()),
        "recorder": ToyObserver,
    }
    system = ChaosSystem(makers, events, seed, forge)
    system.driver.begin(("estimator", "walker", "recorder"), "lockstep", 0.0, 1, "hold", 0)
    lead = system.driver.leader
    lead.end_tick = TICKS
    try:
        system.run(lambda: lead.state == "ended" and lead.all_done(), stall_s=STALL_S)
    except BusError as error:
        raise Found(str(error)) from None
    if system.absent():
        raise Found(f"not back: {', '.join(system.absent())}")
    return system.driver.service.history, system  # type: ignore[attr-defined]


def reference() -> list[float]:
    """The history without faults."""
    return run(0, 0)[0]


def drawn(seed: int) -> tuple[ChaosEvent, ...]:
    """Events of a campaign's seed: with even ones messages alone are spoilt, with odd ones services die, too."""
    return draw_events(MEMORY, seed, EVENTS, NAMES, TICKS, MEMORY.kinds if seed % 2 else MESSAGES)


def drawn_at_start(seed: int) -> tuple[ChaosEvent, ...]:
    """Events of a seed that all begin before tick 0, of messages alone; those of a campaign begin with tick 1."""
    return draw_events(MEMORY._replace(first_tick=0), seed, 3, NAMES, 0, MESSAGES)


def failure(events: Sequence[ChaosEvent], seed: int, expected: list[float]) -> str:
    """Return what is wrong with a run, "" = nothing: the driver differs, or the observer if only messages are."""
    try:
        history, system = run_events(events, seed)
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    if len(history) != len(expected):
        return f"{len(history)} ticks instead of {len(expected)}"
    if not {event.kind for event in events} <= set(MESSAGES):
        return ""
    if not system.driver.leader.comparable:
        return f"a member was lost: {system.driver.leader.reason}"
    if history != expected:
        return f"another run, from tick {[*map(float.__eq__, history, expected)].index(False)}"
    seen = system.nodes["recorder"].service.seen  # type: ignore[attr-defined]
    numbers, keys = [number for number, _ in seen], {frozenset(messages) for _, messages in seen}
    return "" if numbers == [*range(TICKS + 1)] and len(keys) == 1 else "the observer lacks something"


def shrunk(expected: list[float], seeds: range = SEEDS) -> tuple[int, Shrunk] | None:
    """The first seed that fails, and the events that its failure needs; None = none fails."""
    for seed in seeds:
        if failure(drawn(seed), seed, expected):
            return seed, shrink(drawn(seed), lambda some, seed=seed: failure(some, seed, expected))
    return None


# -- planted faults ----------------------------------------------------------------------------------------------------


def offer_again(self: join.Join, tick: Any) -> Any:
    """Work out a tick that comes again once more."""
    if tick.epoch == self.epoch and 0 <= tick.tick == self.last:
        self.last -= 1
    return OFFER_TICK(self, tick)


def raise_malformed(self: node.Node, reason: str, detail: str = "", about: str = "") -> None:
    self.refused[reason] += 1
    if reason == "malformed":
        raise ValueError(detail)


def repeat_without_samples(self: Any, ticks: range) -> None:
    self._outbox.clear()
    REPEAT(self, ticks)


def take_what_is_there(self: node.Node, delivery: Any) -> None:
    """Go on without an input that could not be decoded."""
    before = self.refused["malformed"]
    ON_DELIVERY(self, delivery)
    if self.refused["malformed"] > before and self.join._lacking:
        self.join._lacking.clear()


def offer_as_next(self: join.Join, topic: Any, message: Any, value: Any = None, *rest: Any) -> str | None:
    """Take a message of a later tick for the next one."""
    if topic.key != "hw/tick" and message.epoch == self.epoch and message.tick > self.last + 1:
        message = message.model_copy(update={"tick": self.last + 1})
        value = message
    return OFFER(self, topic, message, value, *rest)


def repeat_undone(self: Any) -> None:
    """Send again from the slowest member's next tick on, not the delayed inputs of its last."""
    done = [member.done for member in self.leader.members.values()]
    self._repeat(range(min(done, default=-1) + 1, self.leader.tick + 1))


def bound_for_ever(self: binding.Bindings, service: str, instance: str) -> bool:
    return self.bound.setdefault(service, instance) == instance


def replay_in_silence(self: node.Node, epoch: int, tick: int) -> None:
    for publisher, token in self._outbox.get((epoch, tick), ()):
        publisher.resend(token)


def wait_for_no_delayed_input(self: join.Join, tick: Any) -> list[str]:
    return [key for key in MISSING(self, tick) if key not in self._delayed_keys]


def answered_by_nonsense(self: Any, delivery: Delivery) -> None:
    """Count a command that could not be decoded as that of its tick."""
    before = self.refused["malformed"]
    FOR_DRIVER(self, delivery)
    if self.refused["malformed"] > before and delivery.key == "cmd/joints":
        self.commands._by_tick.setdefault(self.leader.tick)
        self.leader.on_command(self.leader.tick)


def rejoin_without_past(self: leader.Leader) -> range:
    first = REJOIN(self).stop
    for member in self.members.values():
        member.since = max(member.since, first * (member.since > 0))
    return range(first, self.tick + 1)


def begin_with_any_tick(self: join.Join, tick: Any) -> Any:
    """Begin with the tick that comes first, whichever it is."""
    here = tick.mode == "lockstep" and not self.on_roster and self.service in tick.roster
    return OFFER_TICK(self, tick.model_copy(update={"since": (tick.tick,) * len(tick.roster)}) if here else tick)


OFFER_TICK, TAKE, REPEAT = join.Join._offer_tick, commands.Commands.take, driver_module.DriverNode._repeat
OFFER, MISSING, ON_DELIVERY = join.Join.offer, join.Join._missing, node.Node._on_delivery
REJOIN, FOR_DRIVER = leader.Leader.rejoin, driver_module.DriverNode._on_delivery
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
    "undecodable_input_is_done_without": (node.Node, "_on_delivery", take_what_is_there),
    "later_message_is_taken_for_the_next": (join.Join, "offer", offer_as_next),
    "repeats_without_the_tick_before": (driver_module.DriverNode, "_repeat_all", repeat_undone),
    "repeats_without_manifest": (leader.Leader, "again", lambda self, tick: None),
    "silent_members_are_lost_at_once": (driver_module, "RESENDS", 0),
    "successor_is_never_bound": (binding.Bindings, "bind", bound_for_ever),
    "repeated_tick_is_not_reported": (node.Node, "_replay", replay_in_silence),
    "delayed_input_is_not_awaited": (join.Join, "_missing", wait_for_no_delayed_input),
    "successor_gets_nothing_of_the_past": (leader.Leader, "rejoin", rejoin_without_past),
    "nonsense_answers_a_tick": (driver_module.DriverNode, "_on_delivery", answered_by_nonsense),
}
"""Replacements of parts, by the name of the fault."""
ANY_TICK_SEED = 81
"""First seed of faults before tick 0 that finds `begin_with_any_tick`; 6000 seeds of faults from tick 1 on do not."""
FIRST_SEED = {
    "later_command_stands_in": 4,
    "malformed_ends_the_service": 2,
    "repeats_without_samples": 1,
    "undecodable_input_is_done_without": 59,
    "repeats_without_the_tick_before": 270,
    "successor_is_never_bound": 1,
    "repeated_tick_is_not_reported": 170,
    "successor_gets_nothing_of_the_past": 33,
    "nonsense_answers_a_tick": 4,
}
"""First seed of a campaign that finds a planted fault, 0 of all others; `python -m benchmarks studies planted`."""
