"""Unlucky ways to run the program: its terminal is closed, or it has neither output nor errors."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

HELD = """
import os, signal, sys
from surefoot.lab.cli.system import _until_signal
signal.signal(signal.SIGHUP, getattr(signal, sys.argv[1]))
with _until_signal() as stop:
    os.kill(os.getpid(), signal.SIGHUP)
    print("ends" if stop.wait(0.2) else "goes on")
assert signal.getsignal(signal.SIGHUP) is getattr(signal, sys.argv[1])
"""
COMMAND = """
import os, signal, sys
from surefoot.lab.cli import main as cli
def command(*_):
    os.kill(os.getpid(), signal.SIGHUP)
cli.compilation_reported = command
cli.main(["list"])
"""
CLOSED = """
import os, sys
for number in map(int, sys.argv[2]):
    os.close(number)
os.execv(sys.executable, [sys.executable, "-m", "surefoot.lab.cli.entry", "list", "--json"])
"""


@pytest.mark.parametrize(("before", "expected"), [("SIG_DFL", "ends"), ("SIG_IGN", "goes on")])
def test_a_system_whose_terminal_is_closed_ends_in_order_unless_nohup_started_it(before: str, expected: str) -> None:
    done = subprocess.run([sys.executable, "-c", HELD, before], capture_output=True, text=True, timeout=60.0)
    assert (done.returncode, done.stdout) == (0, f"{expected}\n"), done.stderr


def test_a_command_whose_terminal_is_closed_ends_as_by_ctrl_c() -> None:
    done = subprocess.run([sys.executable, "-c", COMMAND], capture_output=True, text=True, timeout=60.0)
    assert done.returncode not in (0, -signal.SIGHUP), done.stderr


@pytest.mark.parametrize("closed", ["1", "12", "012"])
def test_a_command_without_output_and_errors_works(tmp_path: Path, closed: str) -> None:
    done = subprocess.run([sys.executable, "-c", CLOSED, str(tmp_path), closed], timeout=60.0)
    assert done.returncode == 0
