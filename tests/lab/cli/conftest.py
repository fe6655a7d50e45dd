"""A command line of its own for tests: no folder, port or colour of another system."""

import pytest

from surefoot.lab.cli import main as cli
from surefoot.lab.cli.output import state


@pytest.fixture
def apart(monkeypatch, tmp_path):
    """Own run folders, no port of another system, no colours, a wide terminal."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("SUREFOOT_CONNECT", "tcp/127.0.0.1:9")
    monkeypatch.setenv("SUREFOOT_LISTEN", "tcp/127.0.0.1:9")
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setattr(state, "json", False)
    monkeypatch.setattr(state, "debug", False)


@pytest.fixture
def in_process(capsys):
    """The command line in this process: exit code, standard output, standard error."""

    def run(*words):
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            cli.main([*map(str, words)])
        out, err = capsys.readouterr()
        return ended.value.code or 0, out, err

    return run
