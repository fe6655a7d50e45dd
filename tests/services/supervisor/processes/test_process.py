"""Processes are started, recognised and ended; nothing that is not ours is ever touched."""

import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from surefoot.services.supervisor.processes.identity import await_end, end, identify
from surefoot.services.supervisor.processes.logs import tail
from surefoot.services.supervisor.processes.ports import _LOOPBACK, owner_of, port_of, ports_of
from surefoot.services.supervisor.processes.process import Child, busy_s, resolve_command, starved_s
from tests.processes import GRACE_S, run_process, running, running_child

SLEEP = [sys.executable, "-c", "import time; print('up', flush=True); time.sleep(60)"]
DEAF = [
    sys.executable,
    "-c",
    "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('up', flush=True); time.sleep(60)",
]


@contextmanager
def started(tmp_path, command):
    """A child that has written its first line: its signal handlers are in place."""
    with running_child("child", command, {}, tmp_path / "logs" / "child.log") as child:
        deadline = time.monotonic() + GRACE_S
        while not child.log.read_bytes() and time.monotonic() < deadline:
            child.wait(0.01)
        yield child


def test_a_child_ends_on_sigterm_and_tells_how(tmp_path):
    with started(tmp_path, SLEEP) as child:
        assert child.poll() is None
        assert child.identity.alive()
        child.terminate()
        assert child.wait(GRACE_S) == -signal.SIGTERM
        assert not child.identity.alive()
        assert child.last_words() == "up"
        child.terminate()  # the id is free now: nothing may be signalled
        child.kill()


def test_a_deaf_child_is_killed(tmp_path):
    with started(tmp_path, DEAF) as child:
        child.terminate()
        assert child.wait(0.2) is None
        child.kill()
        assert child.wait(GRACE_S) == -signal.SIGKILL


def test_a_child_has_its_environment_and_its_log(tmp_path):
    code = "import os, sys; print(os.environ['X']); print('bad', file=sys.stderr)"
    with running_child("env", [sys.executable, "-c", code], {"X": "seven"}, tmp_path / "env.log") as child:
        assert child.wait(GRACE_S) == 0
    assert sorted(child.log.read_text().split()) == ["bad", "seven"]


def test_a_program_that_does_not_exist_is_an_error(tmp_path):
    with pytest.raises(OSError, match="No such file"):
        Child("none", ["/no/such/program"], {}, tmp_path / "none.log")


def test_an_id_that_was_given_again_is_not_taken_for_ours(tmp_path):
    with started(tmp_path, SLEEP) as child:
        other = child.identity._replace(started=child.identity.started - 1)
        assert not other.alive()
        assert not other.signal_group(signal.SIGKILL)
        assert end(other)
        assert child.identity._replace(boot="another").alive() is False
        assert child.poll() is None


def test_ends_a_process_that_is_not_a_child(tmp_path):
    script = (
        "import subprocess, sys; p = subprocess.Popen([sys.executable, '-c', "
        f"{DEAF[2]!r}], start_new_session=True, stdout=open({str(tmp_path / 'out')!r}, 'w')); print(p.pid)"
    )
    pid = int(run_process([sys.executable, "-c", script], check=True, stdout=subprocess.PIPE, text=True).stdout)
    identity = identify(pid)
    assert identity is not None
    try:
        assert end(identity, grace_s=0.2)
        assert identify(pid) != identity
    finally:
        identity.signal_group(signal.SIGKILL)


def test_own_programs_run_by_this_python():
    assert resolve_command(["surefoot-service", "walker"])[:2] == [sys.executable, "-m"]
    assert resolve_command(["python", "-V"]) == [sys.executable, "-V"]
    assert resolve_command(["sh", "-c", "x"]) == ["sh", "-c", "x"]


def test_tail_reads_the_end_only(tmp_path):
    path = tmp_path / "long.log"
    path.write_text("".join(f"line {i}\n" for i in range(50_000)))
    assert tail(path, 3) == ["line 49997", "line 49998", "line 49999"]
    assert tail(path, 0) == []
    assert tail(tmp_path / "none", 3) == []
    assert len(tail(path, 60_000)) == 50_000


def test_a_busy_port_is_told_with_its_owner():
    import socket

    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        port = listener.getsockname()[1]
        assert owner_of(port).startswith(f"process {os.getpid()} (")
        assert port in ports_of(os.getpid())
        assert port not in ports_of(os.getpid(), beyond_loopback=True)
    assert owner_of(port) == ""


def test_the_owner_of_a_port_is_told_in_one_line():
    script = "import socket\ns = socket.create_server(('127.0.0.1', 0))\nprint(s.getsockname()[1], flush=True)\ninput()"
    with running([sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        owner = owner_of(int(child.stdout.readline()))
        child.communicate(b"\n")
    assert owner.startswith(f"process {child.pid} (")
    assert "\n" not in owner
    assert port_of("tcp/127.0.0.1:7447") == 7447
    assert port_of("unixsock-stream//tmp/x") is None


def test_processor_time_of_processes_grows_while_they_work():
    before = busy_s((os.getpid(), 2**22 + 1))
    while busy_s((os.getpid(),)) == before:
        sum(range(10_000))
    assert busy_s((os.getpid(),)) > before > 0.0


def test_who_waits_for_processes_returns_when_one_ends_and_not_before() -> None:
    with running(SLEEP) as lasting, running(SLEEP) as dying:
        pids = (lasting.pid, dying.pid)
        assert await_end(pids, 0.01)
        assert dying.poll() is None
        dying.kill()
        began = time.monotonic()
        assert await_end(pids, 60.0)
        assert time.monotonic() - began < 30.0
        assert dying.wait(0.5) is not None
    assert not await_end(pids, 60.0)  # both are gone altogether: nothing to wait by


def test_addresses_of_loopback_are_known_as_the_kernel_writes_them():
    local = ("0100007F", "0500007F", f"{0:024}01000000", "0000000000000000FFFF00000100007F")
    others = ("00000000", f"{0:032}", "0100A8C0", "B80D01200000000000000000" + "0100007F", "0000007E")
    assert all(_LOOPBACK.fullmatch(address) for address in local)
    assert not any(_LOOPBACK.fullmatch(address) for address in others)


WORKS = """
import os, threading, time
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
def work():
    while True:
        pass
threading.Thread(target=work, daemon=True).start()
print("up", flush=True)
time.sleep(60)
"""


@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="the kernel does not count what waits")
def test_what_any_thread_waits_for_a_processor_counts():
    """Two processes on one processor: a thread of each works while its main thread sleeps."""
    works = [sys.executable, "-c", WORKS]
    with running(works) as first, running(works):
        before, deadline = starved_s(first.pid), time.monotonic() + GRACE_S
        while starved_s(first.pid) < before + 0.1:
            assert time.monotonic() < deadline
    assert starved_s(first.pid) == 0.0
