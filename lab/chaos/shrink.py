"""Reduction of a failing run to the faults that cause its failure (delta debugging), written as a pytest file."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

from surefoot.services.supervisor.scenarios.scenario import Scenario

from .events import ChaosEvent
from .run import suffer

MOST_RUNS = 200
"""Largest number of runs to reduce a failing set of faults; the reduction ends there."""
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
    """Result of the reduction of a failing run to the faults that cause its failure."""

    events: tuple[ChaosEvent, ...]
    """Remaining faults, of which none can be left out without losing the failure (unless `MOST_RUNS` was reached)."""
    failure: str
    """First violation of the run with the remaining faults."""
    runs: int
    """Number of runs that the reduction took."""


def shape(violation: str) -> str:
    """Return a violation with each number replaced by #, so that a failure has one text whatever its tick."""
    return _NUMBERS.sub("#", violation)


def shrink(events: Sequence[ChaosEvent], fail: Callable[[Sequence[ChaosEvent]], str]) -> Shrunk:
    """Reduce a failing run: leave out faults, then make the rest smaller, as long as the run fails in the same way.

    Leaving out is the algorithm ddmin (Zeller & Hildebrandt, TSE 2002): after it every single fault is needed.

    Args:
        events: faults of the failing run.
        fail: runs with some of the faults and returns the first violation, "" if there is none.

    Raises:
        ValueError: the run with all faults does not fail.
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
    """Return a subset of events for which `fails` is True, and is False if any one of them is removed."""
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
    """Return reduced variants of an event, the smallest first: fewer messages, then size 1 (s, or rounds)."""
    counts = [replace(event, count=count) for count in (1, 2, 4, 8) if count < event.count]
    return counts + [replace(event, size=1.0)] * (event.size > 1.0)


def shrink_run(scenario: Scenario, events: Sequence[ChaosEvent], seed: int, *, paced: bool) -> Shrunk:
    """Reduce the faults of a failing in-memory run of a scenario to those that cause its failure.

    Args:
        scenario: scenario of the run.
        events: faults of the failing run.
        seed: seed of the random parts of the faults.
        paced: True: time goes on while a service is missing; False: time waits for it (lockstep).
    """
    return shrink(events, lambda some: next(iter(suffer(scenario, some, seed, paced=paced).violations), ""))


def as_test(text: str, name: str, drawn: int, found: Shrunk, seed: int, *, paced: bool) -> str:
    """Return the text of a pytest file that fails until the failure is repaired.

    Args:
        text: content of the scenario file.
        name: name of the scenario.
        drawn: number of faults of the run before its reduction.
        found: remaining faults and their failure.
        seed: seed of the random parts of the faults.
        paced: True: time went on while a service was missing; False: time waited for it (lockstep).
    """
    events = "\n".join(f"    {event!r}," for event in found.events)
    named = re.sub(r"\W", "_", f"{name}_survives_seed_{seed}")
    failure = found.failure.replace("\\", "").replace('"', "'")
    return _TEST.format(
        seed=seed, drawn=drawn, left=len(found.events), failure=failure, scenario=text.strip(), events=events,
        name=named, paced=paced,
    )  # fmt: skip
