"""Reduction of a failing run to the events that its failure needs (delta debugging), and a test of the result."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

from surefoot.services.supervisor.scenarios.scenario import Scenario

from .events import ChaosEvent
from .run import suffer

MOST_RUNS = 200
"""Largest number of runs to shrink one failing set of events."""
_NUMBERS = re.compile(r"\d+(\.\d+)?")
_TEST = '''"""A failure of `surefoot chaos`, seed {seed}, shrunk from {drawn} events to {left}: {failure}"""

from surefoot.lab.chaos.events import ChaosEvent
from surefoot.lab.chaos.run import suffer
from surefoot.services.supervisor.scenarios.scenario import parse_scenario

SCENARIO = """
{scenario}
"""
EVENTS = (
{events}
)


def test_{name}() -> None:
    assert suffer(parse_scenario(SCENARIO), EVENTS, {seed}, paced={paced}).violations == ()
'''


class Shrunk(NamedTuple):
    """Result of the reduction of a failing run: the events that the failure needs."""

    events: tuple[ChaosEvent, ...]
    """Smallest set of events that still fails: none of them can be left out."""
    failure: str
    """First violation of the run with these events."""
    runs: int
    """Number of runs that the shrinking took."""


def shape(violation: str) -> str:
    """Return a violation with its numbers replaced, so that the same failure in another tick gives the same text."""
    return _NUMBERS.sub("#", violation)


def shrink(events: Sequence[ChaosEvent], fail: Callable[[Sequence[ChaosEvent]], str]) -> Shrunk:
    """Reduce a failing run: leave out events, then make the others smaller, while it fails in the same way.

    Leaving out is the algorithm ddmin (Zeller & Hildebrandt, TSE 2002): after it every single event is needed.

    Args:
        events: those of the failing run.
        fail: runs with some events, and returns the first violation, "" when there is none.

    Raises:
        ValueError: the run with all events does not fail.
    """
    failure = fail(events)
    if not failure:
        raise ValueError(f"a run with {len(events)} events that does not fail cannot be shrunk")
    wanted, runs, last = shape(failure), 1, failure

    def fails(some: Sequence[ChaosEvent]) -> bool:
        nonlocal runs, last
        if runs >= MOST_RUNS:
            return False
        runs += 1
        found = fail(some)
        last = found if shape(found) == wanted else last
        return shape(found) == wanted

    kept = _least(tuple(events), fails)
    for place in range(len(kept)):
        for smaller in _smaller(kept[place]):
            candidate = (*kept[:place], smaller, *kept[place + 1 :])
            if fails(candidate):
                kept = candidate
                break
    return Shrunk(kept, last, runs)


def _least(events: tuple[ChaosEvent, ...], fails: Callable[[Sequence[ChaosEvent]], bool]) -> tuple[ChaosEvent, ...]:
    """Return a minimal subset of events that still fails: without any one of them it does not."""
    if fails(()):
        return ()
    parts = 2
    while len(events) > 1:
        cuts = [len(events) * n // parts for n in range(parts + 1)]
        chunks = [events[low:high] for low, high in pairwise(cuts)]
        rests = [events[:low] + events[high:] for low, high in pairwise(cuts)]
        found = next((some for some in chunks if fails(some)), None)
        if found is not None:
            events, parts = found, 2
            continue
        found = next((some for some in rests if fails(some)), None) if parts > 2 else None
        if found is not None:
            events, parts = found, parts - 1
        elif parts == len(events):
            break
        else:
            parts = min(2 * parts, len(events))
    return events


def _smaller(event: ChaosEvent) -> list[ChaosEvent]:
    """Return smaller events of a kind, the smallest first: fewer messages, then a shorter time."""
    counts = [replace(event, count=count) for count in (1, 2, 4, 8) if count < event.count]
    return counts + [replace(event, size=1.0)] * (event.size > 1.0)


def shrink_run(scenario: Scenario, events: Sequence[ChaosEvent], seed: int, *, paced: bool) -> Shrunk:
    """Reduce the events of a failing run of a scenario in one process to those that its failure needs.

    Args:
        scenario: what was done.
        events: of the failing run.
        seed: of the random parts of the events.
        paced: time goes on in real time when a service is missing; else it waits (lockstep).
    """
    return shrink(events, lambda some: next(iter(suffer(scenario, some, seed, paced=paced).violations), ""))


def as_test(text: str, name: str, drawn: int, found: Shrunk, seed: int, *, paced: bool) -> str:
    """Return a pytest file that fails until the failure is repaired.

    Args:
        text: of the scenario file.
        name: of the scenario.
        drawn: number of events of the run before it was shrunk.
        found: reduced events and their failure.
        seed: of the random parts of the events.
        paced: time went on in real time when a service was missing; else it waited (lockstep).
    """
    events = "\n".join(f"    {event!r}," for event in found.events)
    named = re.sub(r"\W", "_", f"{name}_survives_seed_{seed}")
    failure = found.failure.replace("\\", "").replace('"', "'")
    return _TEST.format(
        seed=seed, drawn=drawn, left=len(found.events), failure=failure, scenario=text.strip(), events=events,
        name=named, paced=paced,
    )  # fmt: skip
