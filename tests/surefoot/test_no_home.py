"""A user without a home folder, as in a container, stops and observes systems; who starts one gets the remedy."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from surefoot.bus.endpoint import security_folder
from surefoot.services.supervisor.processes import rundir
from surefoot.services.supervisor.processes.rundir import RunFolder, RunFolderError, run_folders
from surefoot.state import NO_HOME, secret_of, state_home, user_home

STOP = """
import pwd, sys
def unknown(user):
    raise KeyError(user)
pwd.getpwuid = unknown
sys.argv = ["surefoot", "stop", "--connect", "tcp/127.0.0.1:1", "--timeout", "0.1"]
from surefoot.lab.cli.entry import main
main()
"""


@pytest.fixture
def homeless(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", unknown)
    for name in ("XDG_STATE_HOME", "XDG_CONFIG_HOME", "SUREFOOT_SECURITY"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.usefixtures("homeless")
def test_without_a_home_there_are_no_systems_no_secrets_and_no_certificates() -> None:
    assert user_home() == NO_HOME
    assert NO_HOME in state_home().parents
    assert NO_HOME in security_folder("surefoot/ragno").parents
    assert run_folders() == ()
    assert secret_of("tcp/127.0.0.1:1", "surefoot/ragno") == ""


@pytest.mark.usefixtures("homeless")
def test_who_starts_a_system_without_a_home_gets_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    def denied(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(rundir.Path, "mkdir", denied)
    with pytest.raises(RunFolderError, match="set XDG_STATE_HOME"):
        RunFolder("ragno").acquire()


def test_an_emergency_stop_needs_no_home() -> None:
    kept = {name: value for name, value in os.environ.items() if name not in ("HOME", "XDG_STATE_HOME")}
    done = subprocess.run([sys.executable, "-c", STOP], env=kept, capture_output=True, text=True, timeout=60.0)
    assert done.returncode == 1
    assert "tcp/127.0.0.1:1" in done.stdout + done.stderr
    assert "RuntimeError" not in done.stdout + done.stderr
