"""Completion as bash and zsh ask for it."""

import os
import subprocess
import sys

import pytest

from surefoot.lab.cli import completion


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
def test_a_word_is_completed(words: list[str], found: list[str]) -> None:
    asked = {"_SUREFOOT_COMPLETE": "complete_bash", "COMP_WORDS": " ".join(["surefoot", *words])}
    command = [sys.executable, "-m", "surefoot.lab.cli.entry"]
    environment = {**os.environ, **asked, "COMP_CWORD": str(len(words))}
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True, timeout=60)
    assert done.stdout.split() == found


def test_zsh_gets_the_same_names() -> None:
    asked = {"_SUREFOOT_COMPLETE": "complete_zsh", "_TYPER_COMPLETE_ARGS": "surefoot robot show na"}
    command = [sys.executable, "-m", "surefoot.lab.cli.entry"]
    done = subprocess.run(command, env={**os.environ, **asked}, check=True, capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() == """_arguments '*: :(("nao"))'"""


def test_every_beginning_is_open() -> None:
    for names in ("scenarios", "systems", "robots", "services", "topics", "queries"):
        assert len(getattr(completion, names)("")) >= 3
        assert getattr(completion, names)("no such") == []
