"""Chaos on live systems: what is drawn, what counts as noticed and as left over; one real walk under faults."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from surefoot.lab.chaos.events import LIVE, ChaosEvent, ChaosOutcome, draw_events
from surefoot.lab.chaos.live import Chaos, orphans, run_live
from surefoot.lab.runs.live import Options
from surefoot.schemas.system import LogRecord
from surefoot.services.supervisor.scenarios.scenario import parse_scenario
from tests.ports import free_address
from tests.processes import end_process

NAMES = ("simulator", "estimator", "walker", "recorder")
WALK = """
description = "Ragno walks 5 cm while things go wrong"
max_duration_s = 20.0
[world]
terrain = "flat"
map_profile = "exact"
[[step]]
when = "ready"
do = "walk"
distance = 0.05
[limits]
no_fall = true
min_distance_m = 0.04
"""


def test_a_seed_draws_every_kind_and_leaves_the_world_alive() -> None:
    assert draw_events(LIVE, 7, 30, NAMES, 1000) == draw_events(LIVE, 7, 30, NAMES, 1000)
    events = draw_events(LIVE, 7, 500, NAMES, 1000, LIVE.kinds)
    assert {event.kind for event in events} == set(LIVE.kinds)
    assert {event.service for event in events if event.kind == "kill"} == set(NAMES[1:])
    driver = {(event.kind, event.size) for event in events if event.service == "simulator"}
    assert driver == {("freeze", 0.3), ("freeze", 1.0), ("slow", 1.0), ("slow", 3.0)}
    assert max(event.tick for event in events) <= 800
    assert [event.tick for event in events] == sorted(event.tick for event in events)


@pytest.fixture
def chaos() -> Chaos:
    session: Any = SimpleNamespace(driver="simulator")
    return Chaos(session, ())


def test_a_sign_that_names_the_service_or_its_topics_is_its_notice(chaos: Chaos) -> None:
    event = ChaosEvent("freeze", 1, "estimator", size=1.0)
    chaos.sign("supervisor", "start recorder (wanted)")
    assert chaos._noticed(event, 0.0) is None
    chaos._on_log(LogRecord(source="walker", level="info", text="state/velocity comes again"))
    assert chaos._noticed(event, 0.0) is None
    chaos._on_log(LogRecord(source="walker", level="warning", text="state/velocity is silent: no new sample"))
    found = chaos._noticed(event, 0.0)
    assert found is not None
    assert found[1].startswith("walker: state/velocity")
    assert chaos._noticed(event, found[0] + 1.0) is None
    assert chaos._noticed(ChaosEvent("slow", 1, "simulator"), 0.0) is None


def test_a_silent_driver_is_named_by_what_it_publishes(chaos: Chaos) -> None:
    chaos.sign("walker", "hw/joints is silent: no new sample for 0.11 s")
    assert chaos._noticed(ChaosEvent("slow", 1, "simulator"), 0.0) is not None


def test_each_event_is_a_note_of_the_report(chaos: Chaos) -> None:
    event = ChaosEvent("freeze", 140, "walker", size=0.3)
    chaos.outcomes = [ChaosOutcome(event, 1.0), ChaosOutcome(event, 1.0, recovered=1.5, noticed=1.2, by="bus: gone")]
    unseen, seen = chaos.notes
    assert "freeze of walker for 0.3 s in tick 140" in unseen
    assert "not noticed" in unseen
    assert "never back" in unseen
    assert "0.20 s (bus: gone)" in seen
    assert "0.50 s" in seen


def test_what_lives_on_in_the_group_of_an_ended_service_is_an_orphan() -> None:
    code = "import subprocess, sys; subprocess.run([sys.executable, '-c', 'input()'])"
    process = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, start_new_session=True)
    try:
        assert process.pid in orphans({("walker", process.pid)})
        assert set(orphans({("walker", process.pid)}).values()) == {"walker"}
    finally:
        process.communicate(b"\n")
        end_process(process)
    assert orphans({("walker", process.pid)}) == {}


@pytest.mark.e2e
@pytest.mark.slow
def test_a_live_walk_survives_its_seed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    options = Options(listen=free_address(), out=tmp_path / "out")
    run = run_live(parse_scenario(WALK, Path("walk.toml")), 5, 6, options, kinds=LIVE.kinds, ticks=300)
    assert {outcome.event.kind for outcome in run.outcomes} >= {"kill", "forge"}
    assert run.violations == ()
    assert run.verdict.ok, run.verdict
    assert run.fell_at is None
    assert all(count > 0 for count in run.bags.values())
    assert all(outcome.recovered is not None for outcome in run.outcomes)
    assert run.report is not None
    assert "chaos: kill of" in run.report.read_text(encoding="utf-8")
