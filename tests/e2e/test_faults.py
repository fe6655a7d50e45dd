"""Services of a walking robot killed or frozen in mid-step, and strangers who talk nonsense: it walks on."""

import json
import signal
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from surefoot.bus.interface import Delivery
from surefoot.bus.options import LEASE_MS
from surefoot.bus.publish import BATCH, FRAME
from surefoot.lab.report.judge import RunVerdict
from surefoot.lab.runs.local import run_local
from surefoot.schemas.topics import QUERIES, STATE_GAIT, TOPICS
from surefoot.services.supervisor.scenarios.scenario import Scenario, parse_scenario
from tests.e2e.live import SERVICES, Live, wait_until

pytestmark = pytest.mark.e2e

WALK = """
description = "something happens while Ragno walks"
max_duration_s = 20.0
policy = "hold"
[[step]]
when = "ready"
do = "walk"
distance = 0.15
{step}
[limits]
no_fall = true
min_distance_m = 0.1
max_tilt_deg = 20.0
"""
MID_STEP = 140
"""A tick in which the tripod swings: the walk begins a little before tick 100."""
KILLED = {"stability": MID_STEP, "footholds": 190, "estimator": 290, "walker": 420}
"""Services killed in one walk, each in a tick in which feet are in the air; the robot pauses after the last two."""


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    with Live(tmp_path_factory.mktemp("faults")) as made:
        made.start(SERVICES)
        yield made


def walk(step: str = "") -> Scenario:
    return parse_scenario(WALK.format(step=step), Path("walk.toml"))


def test_killed_in_mid_step_the_robot_holds_and_walks_on(live: Live) -> None:
    steps = [f'[[step]]\nat_tick = {tick}\ndo = "kill"\nservice = "{name}"' for name, tick in KILLED.items()]
    outcome = live.conduct(walk("\n".join(steps)))
    gaits = [d.message() for d in live.supervisor.kept if d.topic.key == STATE_GAIT.key]
    for name, tick in KILLED.items():
        assert any(not all(g.stance) for g in gaits if tick - 20 <= g.tick <= tick), f"no foot in the air before {name}"
    assert outcome.verdict.ok, outcome.verdict
    assert not outcome.verdict.comparable
    assert len(outcome.run_hash) == 64
    ticks = [g.tick for g in gaits]
    assert ticks == sorted(set(ticks))


def test_frozen_and_thawed_it_is_let_in_again(live: Live) -> None:
    process = live.processes["estimator"]
    thaw = threading.Timer(1.5 * LEASE_MS / 1000.0, process.send_signal, [signal.SIGCONT])

    def freeze(delivery: Delivery) -> None:
        if not delivery.prime and delivery.header().tick == MID_STEP and thaw.ident is None:
            process.send_signal(signal.SIGSTOP)
            thaw.start()

    live.bus.subscribe(STATE_GAIT, freeze)
    try:
        outcome = live.conduct(walk())
    finally:
        process.send_signal(signal.SIGCONT)
        thaw.join()
    assert outcome.verdict.ok, outcome.verdict
    assert not outcome.verdict.comparable
    assert live.health("estimator").tick == live.supervisor.ticks - 1


def numbers(verdict: RunVerdict) -> dict[str, float | None]:
    return {row.name: row.value for row in verdict.rows if row.name != "real_time_factor"}


def test_nonsense_on_every_key_is_counted_and_changes_nothing(live: Live) -> None:
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([live.address]))
    stop, codes = threading.Event(), list[str]()
    owners = {t.owner for t in TOPICS if t.framed}
    frames = [family.format(owner) for family in (FRAME, BATCH) for owner in owners]
    sent = dict.fromkeys([*frames, *(t.key for t in TOPICS if "*" not in t.key)], 0)

    def babble() -> None:
        with zenoh.open(config) as stranger:
            for payload in (b"{", b"\xff\x00", b'{"tick":-9}', b"7" * 2_000_000):
                for key in sent:
                    stranger.put(f"{live.namespace}/{key}", payload, congestion_control=zenoh.CongestionControl.BLOCK)
                    sent[key] += 1
                for query in QUERIES:
                    for reply in stranger.get(f"{live.namespace}/{query.key}", payload=payload, timeout=60.0):
                        codes.append("" if reply.err is None else json.loads(reply.err.payload.to_bytes())["code"])
        stop.set()

    stranger = threading.Thread(target=babble, daemon=True)
    stranger.start()
    outcome = live.conduct(walk())
    wait_until(stop.is_set, 240.0, "the stranger has said everything")
    stranger.join()
    assert len(codes) > 100
    assert set(codes) <= {"malformed", "invalid", "too_large"}
    assert outcome.verdict.ok, outcome.verdict
    assert outcome.verdict.comparable
    assert numbers(outcome.verdict) == numbers(run_local(walk()).verdict)
    for name in SERVICES:
        refused = live.health(name).refused
        assert refused.get("malformed", 0) + refused.get("invalid", 0) + refused.get("too_large", 0) > 0, name
        assert "Traceback" not in live.log(name).read_text()
