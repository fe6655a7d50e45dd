"""Completion as bash and zsh ask for it."""

import os
import subprocess
import sys

import pytest

from surefoot.lab.cli import completion
from surefoot.lab.cli.entry import main


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (["ru"], ["run"]),
        (["run", "bioloid-w"], ["bioloid-walk"]),
        (["run", "flat", "--robot", "lu"], ["lupo"]),
        (["up", "messor"], ["messor"]),
        (["robot", "show", "na"], ["nao"]),
        (["robot", "check", "lu"], ["lupo"]),
        (["robot", "export", "mes"], ["messor"]),
        (["chaos", "slo"], ["slope"]),
        (["warm", "messor"], ["messor"]),
        (["stop", "messor"], ["messor"]),
        (["schema", "file", "sc"], ["scenario"]),
        (["topic", "echo", "state/velocity/ek"], ["state/velocity/ekf"]),
        (["call", "stability/r"], ["stability/region"]),
        (["logs", "esti"], ["estimator"]),
        (["param", "set", "stability", "m"], ["measured_com", "mu"]),
        (["bag", "export", "x", "--to", "t"], ["tum"]),
        (["whatif", "run.mcap", "--set", "fr"], ["friction="]),
        (["estimate", "log.csv", "--robot", "lu"], ["lupo"]),
        (["view", "run.mcap", "--robot", "lu"], ["lupo"]),
        (["bag", "import", "log.csv", "--robot", "lu"], ["lupo"]),
    ],
)
def test_a_word_is_completed(
    words: list[str], found: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("_SUREFOOT_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", " ".join(["surefoot", *words]))
    monkeypatch.setenv("COMP_CWORD", str(len(words)))
    with pytest.raises(SystemExit) as ended:
        main([])
    assert ended.value.code == 0
    assert capsys.readouterr().out.split() == found


def test_bash_gets_what_it_asks_for() -> None:
    asked = {"_SUREFOOT_COMPLETE": "complete_bash", "COMP_WORDS": "surefoot robot show na", "COMP_CWORD": "3"}
    command = [sys.executable, "-m", "surefoot.lab.cli.entry"]
    done = subprocess.run(command, env={**os.environ, **asked}, check=True, capture_output=True, text=True, timeout=60)
    assert done.stdout.split() == ["nao"]


def test_zsh_gets_the_same_names() -> None:
    asked = {"_SUREFOOT_COMPLETE": "complete_zsh", "_TYPER_COMPLETE_ARGS": "surefoot robot show na"}
    command = [sys.executable, "-m", "surefoot.lab.cli.entry"]
    done = subprocess.run(command, env={**os.environ, **asked}, check=True, capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() == """_arguments '*: :(("nao"))'"""


def test_every_beginning_is_open() -> None:
    for names in ("scenarios", "systems", "robots", "services", "topics", "queries"):
        assert len(getattr(completion, names)("")) >= 3
        assert getattr(completion, names)("no such") == []
