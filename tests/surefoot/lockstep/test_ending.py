"""SIGTERM at any moment of a start ends a service with exit code 0, and soon."""

import os
import pty
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from surefoot.services.supervisor.processes.process import Child
from tests.ports import free_address
from tests.processes import running, running_child

STOP_S = 2.0
SLOW_S = 20.0  # s wall, bound of what is not the end itself

COMPILES = """
import ctypes, os, sys, threading
from surefoot.lockstep.ending import ENDING
ENDING.watch()
libc = ctypes.PyDLL(None) if sys.argv[1] == "python" else ctypes.CDLL(None)
many = ctypes.create_string_buffer(1 << 28)
print("ready", flush=True)
if sys.argv[1] == "foreign":  # a compiler: the main thread is in foreign code for seconds and runs no Python
    libc.qsort(many, 1 << 28, 1, ctypes.cast(libc.strcmp, ctypes.c_void_p))
elif sys.argv[1] == "callback":
    compare = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(lambda a, b: sum(range(10**6)) * 0)
    array = (ctypes.c_int * 100000)()
    libc.qsort(array, 100000, 4, compare)  # foreign code that calls back: an exception cannot pass through it
else:
    while True:
        sum(range(1000))
"""


def processor_s(pid: int) -> float:
    """Processor time of a process, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.fixture(autouse=True)
def hangups() -> Iterator[None]:
    """Hangups end this process and its children, which inherit what it ignores: `nohup` may have started the tests."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("work", ["foreign", "callback", "python"])
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_while_the_main_thread_is_busy(work: str, number: signal.Signals) -> None:
    with running([sys.executable, "-c", COMPILES, work], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        before, deadline = processor_s(process.pid), time.monotonic() + SLOW_S
        while processor_s(process.pid) < before + 0.1:  # it is at work, not on its way there
            assert time.monotonic() < deadline
        began = time.monotonic()
        process.send_signal(number)
        assert process.wait(SLOW_S) == 0
        assert time.monotonic() - began < STOP_S


WAITS = """
import sys, threading
from surefoot.lockstep.ending import ENDING
from surefoot.logline import write_line
ENDING.watch()
ended = threading.Event()
ENDING.prepared(ended.set)
print("ready", flush=True)
ended.wait()
write_line("ends in order")
open(sys.argv[1], "w").write("closed")
"""


def test_a_service_whose_terminal_is_closed_ends_in_order(tmp_path: Path) -> None:
    pid, terminal = pty.fork()
    if pid == 0:
        os.execv(sys.executable, [sys.executable, "-c", WAITS, str(tmp_path / "end")])
    seen = b""
    with open(terminal, "rb", buffering=0) as screen:
        while b"ready\r\n" not in seen:  # closed before the line's end, it would be an error of `print`
            seen += screen.read(4096)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
    assert (tmp_path / "end").read_text() == "closed"


def test_a_service_that_nohup_started_outlives_its_terminal() -> None:
    command = [
        "nohup",
        sys.executable,
        "-c",
        WAITS.replace("ended.wait()", "print(ended.wait(0.2), flush=True)"),
        "/dev/null",
    ]
    with running(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        process.send_signal(signal.SIGHUP)
        assert process.stdout.readline() == "False\n"


@pytest.mark.parametrize("after_s", [0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6])
def test_a_service_at_any_moment_of_its_start(after_s: float, tmp_path: Path) -> None:
    """No router is there, so that the last moments are those of opening a session."""
    command = ("surefoot-service", "walker", "--connect", free_address())
    with running_child("walker", command, {}, tmp_path / "walker.log") as child:
        assert isinstance(child, Child)
        threading.Event().wait(after_s)
        began = time.monotonic()
        child.terminate()
        assert child.wait(SLOW_S) == 0, (tmp_path / "walker.log").read_text()
        assert time.monotonic() - began < STOP_S
