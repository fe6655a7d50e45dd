"""A driver that is busy and does no tick is named, and nothing that ticks, waits by name, or is reset for long."""

from types import SimpleNamespace

import pytest

from surefoot.bus.interface import Life
from surefoot.bus.memory import MemoryBus
from surefoot.lockstep.driver import DriverNode
from surefoot.lockstep.join import DRIVER
from surefoot.schemas.status import SimStatus
from surefoot.schemas.system import Health
from surefoot.services.supervisor.processes.compose import parse_compose
from surefoot.services.supervisor.processes.session import Session
from surefoot.services.supervisor.processes.still import STILL_S, Still
from tests.surefoot.toys import ToyDriver

SYSTEM = """
name: idle
services:
  motors: {command: [python, -c, "import time; time.sleep(60)"], healthcheck: {disable: true}}
"""


def beat(tick: int, *, epoch: int = 1, state: str = "running", instance: str = "m") -> Health:
    return Health(service="motors", instance=instance, state=state, pid=1, tick=tick, epoch=epoch)  # type: ignore[arg-type]


def status(state: str = "running", pace: float = 1.0) -> SimStatus:
    return SimStatus(state=state, rtf=1.0, ticks=8, comparable=True, pace=pace)  # type: ignore[arg-type]


def beats(still: Still, rows: list[Health], every_s: float = 1.0) -> Still:
    for number, health in enumerate(rows):
        still.beat(health, 100.0 + number * every_s)
    return still


def test_a_driver_that_is_busy_without_a_tick_is_named_after_the_limit() -> None:
    within = int(STILL_S)
    assert beats(Still(), [beat(7)] * (within + 1)).words(status()) == ""
    still = beats(Still(), [beat(7)] * (within + 3))
    assert still.words(status()) == still.words(None) == f"busy, but no tick for {within + 2} s"
    still.beat(beat(8), 200.0)
    assert still.words(status()) == ""


@pytest.mark.parametrize(
    "rows",
    [
        [beat(tick) for tick in range(40)],
        [beat(7, epoch=epoch) for epoch in range(40)],
        [beat(7, state="ready")] * 40,
        [beat(7, state="joining")] * 40,
        [beat(7, instance=f"m{number // 5}") for number in range(40)],
    ],
    ids=["ticks", "resets", "paused", "joins", "restarts"],
)
def test_what_ticks_begins_anew_or_shall_not_tick_is_not_named(rows: list[Health]) -> None:
    assert beats(Still(), rows).words(status()) == ""


def test_a_tick_or_a_reset_that_takes_long_is_not_named() -> None:
    """No heartbeat comes meanwhile; as long as one hangs the supervisor knows by that."""
    still = beats(Still(), [beat(7), beat(8), beat(8), beat(9)], every_s=5 * STILL_S / 6)
    still.beat(beat(-1, epoch=2), 500.0)
    assert still.words(status()) == ""
    fast = beats(Still(), [beat(7), beat(8), beat(9)], every_s=4 * STILL_S)
    assert fast.words(status(pace=0.0)) == ""


@pytest.mark.parametrize("state", ["joining", "holding", "paused"])
def test_one_that_waits_for_services_and_names_them_is_not_named(state: str) -> None:
    assert beats(Still(), [beat(7)] * 40).words(status(state)) == ""


def test_time_that_shall_run_slowly_has_a_longer_limit() -> None:
    still = beats(Still(), [beat(7)] * 40)
    assert still.words(status(pace=0.0005)) == ""
    assert still.words(status(pace=0.01)) != ""


def test_health_of_a_driver_whose_tick_is_never_due_shows_it() -> None:
    node = DriverNode(ToyDriver(), MemoryBus())
    node.start()
    node.begin((), "paced", 1.0, 1, "degrade", 0)
    node.pace.until_due = lambda tick: 1.0  # type: ignore[method-assign] - as where no sample comes
    still = Still()
    for number in range(int(STILL_S) + 3):
        node.pump()
        still.beat(node.health(), float(number))
    assert still.words(None)


def test_the_supervisor_names_it_and_ends_nothing(listen: str, monkeypatch: pytest.MonkeyPatch) -> None:
    now, notes = [1000.0], list[str]()
    with Session(parse_compose(SYSTEM), listen=listen, notify=notes.append) as session:
        assert session.wait_for(session.system.settled, 80.0)
        for name in ("motors", DRIVER):
            session._on_life(Life(name, "m", alive=True))
        clock = SimpleNamespace(monotonic=lambda: now[0])
        monkeypatch.setattr("surefoot.services.supervisor.processes.session.time", clock)
        for _ in range(40):
            now[0] += 1.0
            session.supervisor.health["motors"] = beat(7)
            session.heard("motors", 1, well=True)
        row = session.rows()[0]
        monkeypatch.undo()
        session.step()
        assert (row.pid, row.restarts) == (session.rows()[0].pid, 0)
        assert row.detail == "busy, but no tick for 39 s"
        assert [note for note in notes if "tick" in note] == ["motors: busy, but no tick for 11 s"]
