"""Seeds of faults over the toys: the run is that without faults, whatever was dropped, doubled, delayed or forged.

Twenty faults planted into the protocol are each found by a short campaign, and shrunk to a few events.
"""

from typing import Any

import pytest

from surefoot.lab.chaos.events import MEMORY, MESSAGES, ChaosEvent, Kind, draw_events, swarm
from surefoot.lab.chaos.marks import MARKS, Marks
from surefoot.lab.chaos.shrink import shrink
from surefoot.lockstep import join
from surefoot.schemas.topics import Topic
from tests.surefoot.lockstep import toy_chaos


def test_the_events_of_a_seed_are_the_same_and_of_every_kind() -> None:
    assert draw_events(MEMORY, 7, 50, toy_chaos.NAMES, 1000) == draw_events(MEMORY, 7, 50, toy_chaos.NAMES, 1000)
    events = draw_events(MEMORY, 7, 500, toy_chaos.NAMES, 1000, MEMORY.kinds)
    assert {event.kind for event in events} == set(MEMORY.kinds)
    assert {event.service for event in events if event.kind in ("kill", "freeze")} == set(toy_chaos.NAMES[1:])
    assert [event.tick for event in events] == sorted(event.tick for event in events)


@pytest.mark.parametrize("seeds", [range(20), pytest.param(range(20, 60), marks=pytest.mark.slow)])
def test_spoilt_messages_change_nothing(seeds: range) -> None:
    expected = toy_chaos.reference()
    found = {seed: toy_chaos.failure(toy_chaos.drawn(seed), seed, expected) for seed in seeds}
    assert not {seed: text for seed, text in found.items() if text}


@pytest.mark.parametrize("seeds", [range(40), pytest.param(range(40, 200), marks=pytest.mark.slow)])
def test_faults_of_messages_before_the_first_tick_change_nothing(seeds: range) -> None:
    expected = toy_chaos.reference()
    found = {seed: toy_chaos.failure(toy_chaos.drawn_at_start(seed), seed, expected) for seed in seeds}
    assert not {seed: text for seed, text in found.items() if text}


def test_services_that_begin_with_any_tick_are_found_by_faults_before_the_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    expected = toy_chaos.reference()
    monkeypatch.setattr(join.Join, "_offer_tick", toy_chaos.begin_with_any_tick)
    seed = toy_chaos.ANY_TICK_SEED
    assert toy_chaos.failure(toy_chaos.drawn_at_start(seed), seed, expected) == "another run, from tick 2"


def test_the_faults_of_a_seed_are_replayed_to_the_bit() -> None:
    one, other = toy_chaos.run(3), toy_chaos.run(3)
    assert one[0] == other[0]
    assert one[1].outcomes == other[1].outcomes
    assert one[1].now == other[1].now


@pytest.mark.parametrize("seeds", [range(7), pytest.param(range(7, 20), marks=pytest.mark.slow)])
@pytest.mark.parametrize("kinds", [("kill",), ("freeze",), MEMORY.kinds])
def test_after_killed_and_frozen_services_everybody_is_back(kinds: tuple[Kind, ...], seeds: range) -> None:
    for seed in seeds:
        history, system = toy_chaos.run(seed, 3, kinds)
        assert len(history) == toy_chaos.TICKS
        assert system.absent() == ()


LATE_READY = (
    ChaosEvent("delay", 27, "recorder", 2, 28.0),
    ChaosEvent("freeze", 38, "recorder", 0, 1.0),
    ChaosEvent("kill", 48, "recorder", 0, 1.0),
)
"""Seed 2403, shrunk: the killed process had reported that it is ready, and the report arrives after its end."""
LOST_PRIME = (
    ChaosEvent("kill", 34, "walker", 0, 1.0),
    ChaosEvent("corrupt", 42, "estimator", 17, 1.0),
    ChaosEvent("kill", 43, "estimator", 0, 1.0),
)
"""Seed 2385, shrunk: the recorder does not get the prime of the new estimator, and refuses its frames."""


@pytest.mark.parametrize(("seed", "events"), [(2403, LATE_READY), (2385, LOST_PRIME)])
def test_what_is_late_or_lost_of_a_process_that_was_replaced_stalls_nothing(
    seed: int, events: tuple[ChaosEvent, ...]
) -> None:
    history, system = toy_chaos.run_events(events, seed)
    assert len(history) == toy_chaos.TICKS
    assert system.absent() == ()
    assert all(member.done == toy_chaos.TICKS for member in system.driver.leader.members.values())


def test_who_noticed_an_event_and_when_is_part_of_its_outcome() -> None:
    for seed in range(6):
        for kind, by in (("kill", "simulator: "), ("corrupt", ": malformed")):
            for outcome in toy_chaos.run(seed, 2, (kind,))[1].outcomes:  # type: ignore[arg-type]
                if outcome.spoilt or kind == "kill":
                    assert outcome.noticed is not None, outcome
                    assert by in outcome.by
                    assert outcome.began <= outcome.noticed <= (outcome.recovered or outcome.noticed)


def test_nothing_forged_is_obeyed_and_each_is_counted() -> None:
    expected = toy_chaos.reference()
    refused = 0
    for seed in range(7):
        history, system = toy_chaos.run(seed, 6, ("forge",))
        assert history == expected
        refused += sum(found.refused["unbound"] for found in system.nodes.values())
    assert refused > 35  # 5 and more of the 6 of each seed, at 7 seeds


def test_what_a_slow_reader_lost_a_window_ago_is_sent_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its last report was of tick 9, so the others are 21 ticks on before anybody notices."""
    original, lost = join.Join.offer, list[int]()

    def offer(self: join.Join, topic: Topic[Any], message: Any, *rest: Any) -> str | None:
        if self.service == "recorder" and topic.key == "state/velocity" and message.tick == 10 and not lost:
            lost.append(message.tick)
            return None
        return original(self, topic, message, *rest)

    monkeypatch.setattr(join.Join, "offer", offer)
    history, system = toy_chaos.run(0, 0)
    assert (lost, history[:5]) == ([10], toy_chaos.reference()[:5])
    assert system.driver.leader.comparable, system.driver.leader.reason
    assert system.nodes["recorder"].join.last == toy_chaos.TICKS


def test_a_lost_delayed_input_of_the_last_tick_is_sent_again() -> None:
    """Of a seed in which a recorder is killed and the walker's own gait of the tick before is damaged."""
    history, system = toy_chaos.run(171)
    assert (len(history), system.driver.leader.tick) == (toy_chaos.TICKS, toy_chaos.TICKS)


# -- planted faults ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fault", toy_chaos.PLANTED)
def test_a_planted_fault_of_the_protocol_is_found_and_shrunk(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = toy_chaos.reference()
    monkeypatch.setattr(*toy_chaos.PLANTED[fault])
    seed = toy_chaos.FIRST_SEED.get(fault, 0)
    found = toy_chaos.shrunk(expected, range(seed, seed + 1))
    assert found is not None, f"{fault} was not found"
    _, least = found
    assert len(least.events) <= 5
    assert toy_chaos.failure(least.events, seed, expected) == least.failure
    assert len(toy_chaos.PLANTED) == 20


def test_events_that_a_failure_does_not_need_are_left_out() -> None:
    """Without the protocol: a run fails when the two events with these ticks are both there."""
    events = draw_events(MEMORY, 5, 12, toy_chaos.NAMES, 1000, MESSAGES)
    needed = {events[3], events[9]}

    def fail(some: Any) -> str:
        return (
            f"fails in tick {len(some)}" if {event.tick for event in needed} <= {event.tick for event in some} else ""
        )

    found = shrink(events, fail)
    assert [event.tick for event in found.events] == sorted(event.tick for event in needed)
    assert all(event.count <= 1 for event in found.events)
    assert found.runs < 80
    with pytest.raises(ValueError, match="does not fail"):
        shrink(events[:2], fail)


def test_another_failure_is_no_reason_to_leave_an_event_out() -> None:
    events = tuple(ChaosEvent("drop", tick, "walker", 1) for tick in range(3))
    found = shrink(events, lambda some: "as before" if len(some) == 3 else "another")
    assert found.events == events


def test_each_seed_leaves_other_kinds_on() -> None:
    left = {seed: swarm(MEMORY, seed) for seed in range(200)}
    assert all(left.values())
    assert left == {seed: swarm(MEMORY, seed) for seed in range(200)}
    assert len(set(left.values())) > 80
    for seed, kinds in left.items():
        assert {event.kind for event in draw_events(MEMORY, seed, 40, toy_chaos.NAMES, 1000)} <= set(kinds)


def test_recoveries_that_a_run_takes_are_marked_and_the_runtime_is_as_before() -> None:
    before = [vars(mark.owner).get(mark.method) for mark in MARKS.values()]
    with Marks() as marks:
        toy_chaos.run(0, 0)
        assert not {name for name in marks.taken if name.startswith(("leader", "driver sends"))}
        for seed in range(20):
            toy_chaos.run(seed)
    assert marks.taken >= {
        "join gets a tick again", "node refuses a malformed message", "node refuses a process that is not bound",
        "node sends a tick's outputs again", "driver sends ticks again", "leader holds time for a lost member",
        "leader gets a member back that was out of sight", "leader lets a new process take over",
    }  # fmt: skip
    assert [vars(mark.owner).get(mark.method) for mark in MARKS.values()] == before
