"""Secret of a system in its run folder: that of the system that runs, whatever the times of files are."""

import fcntl
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from surefoot.services.supervisor.processes import rundir
from surefoot.services.supervisor.processes.rundir import Endpoint, RunFolder
from surefoot.state import LOCK, secret_of, state_home

PLACE = Endpoint("tcp/127.0.0.1:7", "surefoot/ragno")


@pytest.fixture(autouse=True)
def own_state(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


def written(name: str, secret: str, at_ns: int) -> RunFolder:
    """Return the run folder of a supervisor that was killed, whose files were written at a time."""
    folder = RunFolder(name)
    folder.path.mkdir(parents=True, exist_ok=True)
    folder.write_endpoint(PLACE, secret)
    (folder.path / LOCK).touch()
    for path in folder.path.iterdir():
        os.utime(path, ns=(at_ns, at_ns))
    return folder


def found() -> str:
    return secret_of(PLACE.connect, PLACE.namespace)


@pytest.mark.parametrize("later_ns", [-3_600_000_000_000, 0, 1, 3_600_000_000_000])
@pytest.mark.parametrize("names", ["ab", "ba"])
def test_the_system_that_runs_counts_before_one_that_a_killed_supervisor_left(names: str, later_ns: int) -> None:
    now_ns = 1_700_000_000_000_000_000
    runs, left = written(names[0], "runs", now_ns), written(names[1], "left", now_ns + later_ns)
    with (runs.path / LOCK).open("rb") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert found() == "runs"
    if later_ns:
        assert found() == ("left" if later_ns > 0 else "runs"), "the newest, also by a nanosecond"
    assert left.path.parent == state_home()


def test_a_secret_that_is_replaced_at_the_same_time_of_its_file_is_the_new_one() -> None:
    for secret in ("first", "second"):
        written("a", secret, 1_700_000_000_000_000_000)
        assert found() == secret


def test_at_no_moment_a_new_address_stands_beside_an_old_secret(monkeypatch: pytest.MonkeyPatch) -> None:
    folder, seen = RunFolder("a"), list[str]()
    written("a", "old", 1)
    replace: Callable[..., None] = os.replace

    def looked(source: str, target: Path) -> None:
        replace(source, target)
        seen.append(secret_of("tcp/127.0.0.1:8", PLACE.namespace))

    monkeypatch.setattr(os, "replace", looked)
    folder.write_endpoint(Endpoint("tcp/127.0.0.1:8", PLACE.namespace), "new")
    assert "old" not in seen
    assert seen[-1] == "new"


def test_a_reader_that_looks_at_the_lock_for_a_moment_refuses_no_supervisor(monkeypatch: pytest.MonkeyPatch) -> None:
    folder = RunFolder("a")
    folder.path.mkdir(parents=True)
    with (folder.path / LOCK).open("ab") as reader, monkeypatch.context() as patched:
        fcntl.flock(reader, fcntl.LOCK_SH)
        patched.setattr(rundir.time, "sleep", lambda pause_s: fcntl.flock(reader, fcntl.LOCK_UN))
        folder.acquire()
    with pytest.raises(rundir.RunFolderError, match="already run"):
        RunFolder("a").acquire()
    folder.release()
