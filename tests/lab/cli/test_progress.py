"""Long work states its share and the time left, short work nothing."""

from itertools import pairwise

from surefoot.lab.cli.progress import EACH_S, FIRST_S, Progress


def lines_of(seconds: float, steps: int) -> list[tuple[float, str]]:
    """Return the lines, and when they come, of even work."""
    lines, now = list[tuple[float, str]](), [100.0]
    progress = Progress("walk", lambda text: lines.append((now[0] - 100.0, text)), lambda: now[0])
    for step in range(1, steps + 1):
        now[0] += seconds / steps
        progress.at(step / steps)
    return lines


def test_short_work_is_silent() -> None:
    assert lines_of(0.9 * FIRST_S, 10) == []


def test_long_work_reports_within_its_first_seconds_and_then_now_and_then() -> None:
    lines = lines_of(60.0, 600)
    assert lines[0][0] <= FIRST_S + 0.11
    assert lines[0][1] == "walk: 2 %, about 59 s left"
    gaps = [b[0] - a[0] for a, b in pairwise(lines)]
    assert all(EACH_S <= gap <= EACH_S + 0.11 for gap in gaps)
    assert lines[3][1] == "walk: 52 %, about 29 s left"


def test_a_share_of_nothing_and_of_all_is_no_line() -> None:
    lines, now = list[str](), [0.0]
    progress = Progress("walk", lines.append, lambda: now[0])
    now[0] = 50.0
    progress.at(0.0)
    progress.at(1.0)
    assert lines == []
