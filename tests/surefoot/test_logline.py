"""A line of a log holds time, level, service and tick, and can be taken apart again."""

from datetime import UTC, datetime, timedelta

import pytest

from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.local import LocalSystem
from surefoot.logline import log_line, read_log_line, said
from tests.surefoot.toys import ToyDriver, ToyEstimator, ToyWalker


@pytest.mark.parametrize(("tick", "kept"), [(None, None), (-1, None), (0, 0), (123, 123)])
@pytest.mark.parametrize("text", ["refused (stale): command of tick 3", "", "a: b tick 7: c"])
def test_a_line_is_read_as_it_was_written(tick: int | None, kept: int | None, text: str) -> None:
    found = read_log_line(log_line("warning", "walker", text, tick))
    assert found is not None
    assert (found.level, found.service, found.tick, found.text) == ("warning", "walker", kept, text)
    assert abs(datetime.now(UTC) - datetime.fromisoformat(found.time)) < timedelta(seconds=10)
    assert datetime.fromisoformat(found.time).utcoffset() == timedelta(0)


def test_a_longer_text_stays_one_line() -> None:
    line = log_line("error", "walker", "two\nlines")
    assert "\n" not in line
    assert said(line) == "two | lines"


@pytest.mark.parametrize("line", ["Traceback (most recent call last):", "", "info    walker: without a time"])
def test_what_others_write_is_no_line_of_ours(line: str) -> None:
    assert read_log_line(line) is None
    assert said(line) == line


def test_a_service_tells_the_tick_it_was_in(capfd: pytest.CaptureFixture[str]) -> None:
    driver, config = ToyDriver(), ServiceConfig()
    walker = ToyWalker(config)
    system = LocalSystem([ToyEstimator(config), walker, driver])
    walker.log("info", "before")
    driver.node.begin(("estimator", "walker"), "lockstep", 0.0, 1, "hold", 0)
    driver.node.leader.end_tick = 20
    system.run_until(lambda: driver.node.leader.state == "ended" and driver.node.leader.all_done())
    walker.log("info", "after")
    lines = [found for line in capfd.readouterr().err.splitlines() if (found := read_log_line(line)) is not None]
    ticks = [(found.service, found.text, found.tick) for found in lines if found.text in ("before", "after")]
    assert ticks == [("walker", "before", None), ("walker", "after", 20)]
