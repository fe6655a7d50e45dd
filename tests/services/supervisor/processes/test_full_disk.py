"""A disk that is full while a system runs: it goes on, the file is named once, and is written when there is room."""

import sys
import threading
from contextlib import ExitStack
from pathlib import Path

import pytest

from surefoot.lab.cli.output import notify
from surefoot.schemas.sim import World
from surefoot.services.supervisor.processes.compose import parse_compose
from surefoot.services.supervisor.processes.keep import StartOrder, keep
from surefoot.services.supervisor.processes.rundir import Endpoint, RunFolder
from surefoot.services.supervisor.processes.session import Session
from tests.processes import full_disk
from tests.surefoot.lockstep.node_bench import Bench, Subject

WAIT_S = 80.0
SYSTEM = """
name: idle
services:
  a: {command: [python, -c, "import time; time.sleep(60)"], restart: on-failure, healthcheck: {disable: true}}
"""


def test_a_system_goes_on_on_a_full_disk_and_its_files_follow_once_there_is_room(listen, monkeypatch):
    notes, stop, seen = list[str](), threading.Event(), list[dict[str, int]]()
    step, limits = Session.step, ExitStack()

    def look(session):
        step(session)
        stored = {name: found.pid for name, found in session.folder.processes().items()}
        running = {row.service: row.pid for row in session.system.rows() if row.pid is not None}
        match len(seen):
            case 0 if stored == running != {}:
                seen.append(running)
                limits.enter_context(full_disk(16))
                session.system.signal_kill("a")
            case 1 if running and running != seen[0] and session.folder.trouble:
                assert stored == {}, "the one that was killed"
                seen.append(running)
                limits.close()
            case 2 if stored == running:
                stop.set()

    monkeypatch.setattr(Session, "step", look)
    with limits:
        keep(parse_compose(SYSTEM), StartOrder(World()), stop, listen=listen, notify=notes.append)
    assert len(seen) == 2
    troubles = [note for note in notes if "cannot write" in note]
    assert 1 <= len(troubles) <= 2
    assert all(note.endswith(".json (File too large); it is tried again") for note in troubles)
    assert not list(RunFolder("idle").path.glob(".*")), "no part of a file is left"


def test_a_file_that_a_start_needs_is_named_and_no_part_is_left(tmp_path):
    folder = RunFolder("idle", tmp_path)
    folder.acquire()
    with full_disk(16), pytest.raises(OSError, match=r"endpoint\.json"):
        folder.write_endpoint(Endpoint("tcp/127.0.0.1:1", "a/b"))
    assert [path.name for path in folder.path.iterdir()] == ["lock"]
    folder.release()


def test_lines_of_a_log_on_a_full_disk_end_nothing(monkeypatch):
    full_log = Path("/dev/full").open("w", encoding="utf-8", buffering=1)  # noqa: SIM115 - closing it fails
    monkeypatch.setattr(sys, "stderr", full_log)
    bench = Bench(Subject())
    for number in range(2000):
        bench.node.log("warning", f"line {number}")
        notify(f"line {number}")
    monkeypatch.undo()
    with pytest.raises(OSError, match="No space"):
        full_log.close()
