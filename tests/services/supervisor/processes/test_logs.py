"""Logs of several services are shown in the order of time, each line with what else it holds."""

import json
from pathlib import Path

from surefoot.services.supervisor.processes.logs import last_lines
from surefoot.services.supervisor.processes.rundir import RunFolder

FIRST = "2026-03-01T12:00:00.100Z info    walker: first"
SECOND = "2026-03-01T12:00:00.200Z warning recorder tick 7: second"
THIRD = "2026-03-01T12:00:01.000Z error   walker tick 9: third"


def logs(folder: Path) -> dict[str, Path]:
    folder.mkdir(parents=True, exist_ok=True)
    for name, lines in (("walker", [FIRST, THIRD, "Traceback"]), ("recorder", [SECOND])):
        (folder / f"{name}.log").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return {name: folder / f"{name}.log" for name in ("walker", "recorder")}


def test_lines_come_in_the_order_of_time_and_others_stay_where_they_were(tmp_path: Path) -> None:
    found = last_lines(logs(tmp_path), 20)
    assert found == [("walker", FIRST), ("recorder", SECOND), ("walker", THIRD), ("walker", "Traceback")]
    assert last_lines(logs(tmp_path), 1) == [("walker", "Traceback"), ("recorder", SECOND)]


def test_the_command_shows_them(surefoot, place) -> None:
    folder = RunFolder("ragno", place[0] / "state" / "surefoot")
    logs(folder.path / "logs")
    folder.acquire()
    folder.release()
    done = surefoot("logs")
    assert (done.returncode, done.stdout.splitlines()) == (0, [FIRST, SECOND, THIRD, "walker: Traceback"])
    lines = [json.loads(line) for line in surefoot("logs", "--json").stdout.splitlines()]
    assert lines[1] == {
        "service": "recorder", "time": "2026-03-01T12:00:00.200Z", "level": "warning", "tick": 7, "text": "second",
    }  # fmt: skip
    assert lines[3] == {"service": "walker", "time": None, "level": None, "tick": None, "text": "Traceback"}


def test_a_log_without_lines_is_stated(surefoot, place) -> None:
    folder = RunFolder("ragno", place[0] / "state" / "surefoot")
    logs(folder.path / "logs")["walker"].write_text("")
    done = surefoot("logs", "walker")
    assert (done.returncode, done.stdout) == (0, "")
    assert "no lines so far of walker" in done.stderr
