"""The whole system as processes over Zenoh: same run in every start order, no first message lost, clean ends.

Two systems are started, one by one in reverse and all at once; the tests of each use it in the order of this file.
"""

import importlib
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from surefoot.lab.runs.local import run_local
from surefoot.lockstep.join import DRIVER, Delayed
from surefoot.record.recording import read_recording, recording_info
from surefoot.schemas.topics import HW_EXTERNAL, HW_LANDMARKS, HW_MAKER, HW_RANGE, TERRAIN_LANDMARKS, Kind
from surefoot.services.supervisor.scenarios.scenario import Scenario, parse_scenario
from tests.e2e.live import SERVICES, SHORT, Conducted, Live

pytestmark = pytest.mark.e2e

ORDERS = {"reversed, one by one": (SERVICES[::-1], True), "shuffled, at once": (SERVICES[3:] + SERVICES[:3], False)}
ENDS = dict(zip(ORDERS, (signal.SIGTERM, signal.SIGINT), strict=True))
"""Signal that ends the services of each system."""


def scenario(text: str = SHORT) -> Scenario:
    return parse_scenario(text, Path("short.toml"))


@pytest.fixture(scope="module")
def in_memory() -> str:
    """The hash of the same scenario on the in-memory bus."""
    return run_local(scenario()).run_hash


@pytest.fixture(scope="module", params=ORDERS)
def system(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Live, Conducted, signal.Signals]]:
    names, one_by_one = ORDERS[request.param]
    with Live(tmp_path_factory.mktemp("live"), record=True) as live:
        live.start(names, one_by_one=one_by_one)
        yield live, live.conduct(scenario()), ENDS[request.param]


def test_hash_is_that_of_the_in_memory_bus_whatever_the_start_order(
    system: tuple[Live, Conducted, signal.Signals], in_memory: str
) -> None:
    _, outcome, _ = system
    assert outcome.verdict.ok, outcome.verdict
    assert outcome.verdict.comparable
    assert len(in_memory) == 64
    assert outcome.run_hash == in_memory


def test_no_first_message_is_lost(system: tuple[Live, Conducted, signal.Signals]) -> None:
    """A member does tick 0 only with all inputs that are due; only a tick may be sent twice, to one that is slow."""
    live, outcome, _ = system
    last = live.supervisor.ticks - 1
    for name in SERVICES:
        health = live.health(name)
        assert health.tick == last, health
        refused = {reason for reason in health.refused if not reason.startswith("join_")} - {"resent_ticks"}
        assert not refused, health
    first: dict[str, int] = {}
    for recorded in read_recording(Path(outcome.recording)):
        if recorded.key not in first:
            first[recorded.key] = recorded.message().seq
    assert set(first.values()) == {0}
    assert declared() <= set(first)
    counts = recording_info(Path(outcome.recording))["topics"]
    assert counts["hw/tick"] == counts["cmd/joints"] == counts["sim/truth"] == last + 1


def declared() -> set[str]:
    """Every deterministic topic that a service of the compose file declares and that Ragno has the sensors for."""
    topics = set()
    for name in SERVICES:
        service = importlib.import_module(f"services.{name}.service").SERVICE
        topics |= {item.topic if isinstance(item, Delayed) else item for item in (*service.inputs, *service.outputs)}
    nao_has = {HW_LANDMARKS, HW_RANGE, TERRAIN_LANDMARKS}
    nobody_has = {HW_EXTERNAL, HW_MAKER}  # a camera or motion capture beside the robot; its maker's own estimate
    mine = {topic for topic in topics - nao_has - nobody_has if topic.owner in (*SERVICES, DRIVER)}
    return {topic.key for topic in mine if topic.deterministic and topic.kind is not Kind.STATUS}


def test_every_service_ends_with_0_within_2_s(system: tuple[Live, Conducted, signal.Signals]) -> None:
    live, _, number = system
    live.reset(mode="paced", rtf=1.0)
    ends = live.stop(number)
    assert {name: code for name, (code, _) in ends.items()} == dict.fromkeys(SERVICES, 0)
    assert max(seconds for _, seconds in ends.values()) < 2.0, ends
    for name in SERVICES:
        assert "Traceback" not in live.log(name).read_text()
