"""The run folder: one supervisor at a time, a stale one is no obstacle."""

import errno
import json
import os
import shutil
import sys
import tempfile

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from surefoot.lab.cli.system import _show_status as show_status
from surefoot.schemas.system import ServiceStatus
from surefoot.services.supervisor.processes.identity import identify
from surefoot.services.supervisor.processes.rundir import Endpoint, RunFolder, RunFolderError, run_folders, unreadable
from surefoot.state import state_home
from tests.ports import free_address
from tests.processes import GRACE_S, run_process, running, running_child

OVERRIDES = "-dac_override,-dac_read_search,-fowner"
CLI = "surefoot.lab.cli.entry"
AS_A_USER = [] if os.geteuid() else ["setpriv", "--bounding-set", OVERRIDES, "--inh-caps", OVERRIDES]
"""Words before a command by which the rights of files hold for it, for root too."""
SLEEP = [sys.executable, "-c", "import time; time.sleep(60)"]
ENDPOINT = Endpoint("tcp/127.0.0.1:1", "surefoot/ragno", "/x.yaml", "ragno")


@pytest.fixture
def folder(tmp_path):
    found = RunFolder("ragno", tmp_path)
    yield found
    found.release()


def test_is_taken_once(folder, tmp_path):
    folder.acquire()
    folder.write_endpoint(ENDPOINT)
    other = RunFolder("ragno", tmp_path)
    assert other.held()
    assert other.endpoint() == ENDPOINT
    with pytest.raises(RunFolderError, match="surefoot down ragno"):
        other.acquire()
    folder.release()
    assert not other.held()
    assert other.endpoint() is None
    other.acquire()
    other.release()


def test_holds_table_and_readiness(folder):
    folder.acquire()
    folder.write_rows([ServiceStatus(service="walker", state="healthy", pid=7, restarts=1, detail="")])
    assert folder.read_rows()[0]["service"] == "walker"
    assert not folder.ready()
    folder.write_ready({"connect": "x"})
    assert folder.ready() == {"connect": "x"}
    folder.release()
    assert not folder.ready()
    assert folder.read_rows() == []


def test_a_supervisor_that_was_killed_leaves_processes_that_the_next_one_ends(folder, tmp_path):
    with running_child("walker", SLEEP, {}, folder.log("walker")) as child:
        _supervise_and_die(child, tmp_path)
        assert not folder.held()
        assert folder.endpoint() is None
        assert folder.supervisor() is None
        assert set(folder.processes()) == {"walker"}
        with pytest.raises(RunFolderError, match="not held"):
            folder.end_leftovers()
        folder.acquire()
        assert folder.end_leftovers() == ("walker",)
        assert child.wait(GRACE_S) == -15
        assert folder.end_leftovers() == ()


def _supervise_and_die(child, tmp_path):
    script = (
        "import os, signal, sys; from surefoot.services.supervisor.processes.identity import identify\n"
        "from surefoot.services.supervisor.processes.rundir import Endpoint, RunFolder\n"
        "from pathlib import Path\n"
        f"f = RunFolder('ragno', Path({str(tmp_path)!r})); f.acquire()\n"
        f"f.write_endpoint(Endpoint('tcp/x', 'a/b')); f.write_processes({{'walker': identify({child.pid})}})\n"
        "os.kill(os.getpid(), signal.SIGKILL)"
    )
    assert run_process([sys.executable, "-c", script]).returncode == -9


@pytest.mark.parametrize(
    "content", ["", "null", "[1]", '{"walker": {"pid": 1}}', '{"walker": null}', "\x00", "[" * 99999]
)
def test_a_damaged_file_is_an_empty_one(folder, content):
    folder.acquire()
    for name in ("processes.json", "endpoint.json", "supervisor.json", "status.json"):
        (folder.path / name).write_text(content)
    assert folder.processes() == {}
    assert folder.endpoint() is None
    assert folder.supervisor() is None
    assert folder.end_leftovers() == ()


IDENTITY = {"pid": 1, "started": 1, "boot": "x"}
ADDRESS = {"connect": "tcp/127.0.0.1:1", "namespace": "surefoot/ragno", "compose": "", "robot": ""}
ROW = {"service": "walker", "state": "healthy", "pid": 1, "restarts": 0, "detail": ""}
ANY = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**20), 10**20) | st.floats(allow_nan=False) | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=4,
)


def damaged(right):
    """Return an entry of a file in which fields have another value, are gone, or are new."""
    values = st.dictionaries(st.sampled_from([*right, "zz"]), ANY, max_size=2)
    gone = st.sets(st.sampled_from(sorted(right)), max_size=1)

    def changed(new, left_out):
        return {name: one for name, one in {**right, **new}.items() if name not in left_out}

    return ANY | st.builds(changed, values, gone)


@given(damaged(ADDRESS), damaged(IDENTITY), damaged(ROW), ANY)
@example({"connect": 5, "namespace": "a/b"}, {**IDENTITY, "pid": "\0"}, {"service": "walker"}, [])
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=60)
def test_whatever_stands_in_a_file_is_right_in_each_field_or_left_out(folder, address, identity, row, ready):
    folder.acquire()
    for name, content in (
        ("endpoint", address),
        ("supervisor", identity),
        ("processes", {"walker": identity, "simulator": identity}),
        ("status", [row, row]),
        ("ready", ready),
    ):
        (folder.path / f"{name}.json").write_text(json.dumps(content))
    place = folder.endpoint(orphaned=True)
    assert place is None or {type(one) for one in place} == {str}
    assert folder.supervisor() is None
    assert folder.processes() == folder.orphans() == {}
    assert all({name: one[name] for name in ROW} == row for one in folder.read_rows())
    show_status("ragno", {"connect": "", "namespace": "", "services": folder.read_rows()})
    assert isinstance(folder.ready() or {}, dict)
    folder.release()


def test_a_process_that_has_got_the_number_of_an_earlier_one_is_none_of_the_system(folder):
    folder.acquire()
    with running(SLEEP) as process:
        own = identify(process.pid)
        assert own is not None
        for other in (own._replace(started=own.started - 1), own._replace(boot="before")):
            folder.write_processes({"walker": other})
            (folder.path / "supervisor.json").write_text(json.dumps(other._asdict()))
            assert folder.processes() == {}
            assert folder.supervisor() is None
            assert folder.end_leftovers() == ()
        assert process.poll() is None


def test_a_folder_that_cannot_be_written_is_reported(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RunFolderError, match="cannot write"):
        RunFolder("ragno", tmp_path / "file").acquire()


def test_lies_under_the_state_home(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert state_home() == tmp_path / "surefoot"
    monkeypatch.setenv("XDG_STATE_HOME", "relative")
    assert state_home().parts[-3:] == (".local", "state", "surefoot")
    assert run_folders(tmp_path) == ()


@pytest.mark.skipif(bool(AS_A_USER) and shutil.which("setpriv") is None, reason="root without setpriv")
@pytest.mark.parametrize("closed", ["home", "folder", "lock"])
def test_what_this_user_cannot_read_is_named_where_nothing_seems_to_run(tmp_path, monkeypatch, closed):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    folder = RunFolder("ragno")
    folder.acquire()
    folder.write_endpoint(ENDPOINT)
    assert unreadable() == ""
    path = {"home": folder.path.parent, "folder": folder.path, "lock": folder.path / "lock"}[closed]
    path.chmod(0)
    try:
        words = {"home": ["status"], "folder": ["down"], "lock": ["stop", "--connect", free_address()]}[closed]
        done = run_process([*AS_A_USER, sys.executable, "-m", CLI, *words], capture_output=True, text=True)
        named = folder.path if closed == "lock" else path
        assert f"this user cannot read {named}, so that a system there is not seen" in done.stdout + done.stderr
    finally:
        path.chmod(0o700)
    folder.release()


def test_a_file_that_cannot_be_begun_is_named_and_not_its_temporary_name(folder, monkeypatch):
    def full(**options):
        raise OSError(errno.EACCES, "Permission denied", f"{folder.path}/.endpoint.jsonx1")

    folder.acquire()
    monkeypatch.setattr(tempfile, "mkstemp", full)
    with pytest.raises(OSError, match=r"ragno/secret\.json'$"):
        folder.write_endpoint(ENDPOINT)
