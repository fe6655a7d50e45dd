"""Every command of the cheat sheet is executed as it stands, in one folder and beside one running system."""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from surefoot.lab.cli.main import main
from surefoot.lab.robots.export import write_mjcf
from surefoot.lab.runs.local import run_local
from surefoot.robot.reader import load_robot
from surefoot.services.supervisor.scenarios.scenario import load_scenario
from tests.e2e.live import ROOT, environment
from tests.ports import free_address
from tests.processes import end_process, end_systems, interruptible, run_process, start_process

pytestmark = pytest.mark.e2e

SHEET = (ROOT / "docs" / "cheatsheet.md").read_text(encoding="utf-8")
COMMANDS = list(dict.fromkeys(re.findall(r"`(surefoot [a-z][^`]*)`", SHEET)))
ELSEWHERE = {
    "surefoot run rough-terrain": "make demo",
    "surefoot run crawl-flat --robot ./go2": "tests/e2e/test_guides.py",
    "surefoot bag import walk/ --robot ./go2 --imu /imu/data --joints /joint_states": "tests/e2e/test_guides.py",
    "surefoot audit run.mcap": "tests/lab/audit/test_audit.py",
    "surefoot render run.mcap -o walk.webp": "tests/lab/scene/test_render.py",
}
"""Commands that take long, or need a recording of a foreign robot, and what executes their like."""
ENDLESS = {
    "surefoot view": 30.0, "surefoot topic echo state/velocity": 30.0, "surefoot topic top": 30.0,
    "surefoot topic echo state/velocity --plot velocity": 2.0,
}  # fmt: skip
"""Commands that run until Ctrl-C, each with the longest time until it is ended, s wall: once it printed something. One
that draws only at its end is given `SLOWER` times as long where it had not come to anything by then."""
SLOWER = 15.0
FILES = ("surefoot doctor", "surefoot warm", *(f"surefoot {name} " for name in (
    "report", "why", "verify", "whatif", "bisect", "bag", "robot", "estimate")))  # fmt: skip
"""Beginnings of commands that need files and no system."""
FIRST = "surefoot up ragno -d"
LAST = tuple(f"surefoot {name}" for name in ("sim speed", "sim pause", "topic pub", "stop", "down"))
"""Beginnings of the commands after which a system takes all of the processor, halts or ends, in their order."""
RECORDED_S = 2.5
"""Simulated length of the recording, s: the sheet changes a run from 2.3 s on."""


def of_files() -> list[str]:
    return [each for each in COMMANDS if each.startswith(FILES) and each not in ELSEWHERE]


def of_system() -> list[str]:
    rest = [each for each in COMMANDS if each not in (*of_files(), *ELSEWHERE, FIRST)]
    last = [each for begin in LAST for each in rest if each.startswith(begin)]
    return [*(each for each in rest if each not in last), *last]


def run(command: str, capsys: pytest.CaptureFixture[str]) -> str:
    """Return what is wrong with a command of the sheet, with its output; empty: nothing.

    It runs in this process, which imports libraries and reads kernels once for all commands.
    """
    with interruptible(), pytest.raises(SystemExit) as ended:
        main(shlex.split(command)[1:])
    out, err = capsys.readouterr()
    wrong = (ended.value.code or 0) != 0 or "Traceback" in err
    return f"exit code {ended.value.code}: {out[-400:]}{err[-400:]}" if wrong else ""


def run_for_a_while(command: str, folder: Path, variables: Mapping[str, str]) -> str:
    """Return what is wrong with a command that goes on until Ctrl-C: that it ends before, prints nothing or fails."""
    patience = ENDLESS[command]
    return run_for(patience, command, folder, variables) and run_for(SLOWER * patience, command, folder, variables)


def run_for(patience: float, command: str, folder: Path, variables: Mapping[str, str]) -> str:
    """Return what is wrong with a command that is ended once it prints something, after `patience` s at most."""
    out = folder / "printed.txt"
    with out.open("w") as stream:
        words = [sys.executable, "-m", "surefoot.lab.cli.main", *command.split()[1:]]
        process = start_process(words, cwd=folder, env=dict(variables), stdout=stream, stderr=subprocess.STDOUT)
        try:
            end = time.monotonic() + patience
            while process.poll() is None and out.stat().st_size == 0 and time.monotonic() < end:
                time.sleep(0.05)
            ended = process.poll()
            process.send_signal(signal.SIGINT)
            code = process.wait(30.0)
        finally:
            end_process(process)
    printed = out.read_text()
    if ended is None and printed and "Traceback" not in printed and code in (0, 130):
        return ""
    return f"exit code {code}: {printed[-400:]}"


@pytest.fixture
def variables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """The environment of the commands, set here too, in a folder with the files that the sheet names."""
    write_mjcf(load_robot("lupo"), tmp_path / "go2.xml")
    run_local(
        replace(load_scenario("stand"), settle_s=RECORDED_S, max_duration_s=2.0 * RECORDED_S),
        recording=tmp_path / "run.mcap",
    )
    for name in ("a.mcap", "b.mcap", "walk.mcap"):
        shutil.copy(tmp_path / "run.mcap", tmp_path / name)
    wanted = environment(tmp_path, SUREFOOT_LISTEN=free_address())
    for name in os.environ.keys() - wanted.keys():
        monkeypatch.delenv(name)
    for name, value in wanted.items():
        monkeypatch.setenv(name, value)
    monkeypatch.chdir(tmp_path)
    return wanted


def test_each_command_is_of_files_or_of_a_system() -> None:
    assert set(ELSEWHERE) <= set(COMMANDS)
    assert set(ENDLESS) <= set(of_system())
    assert sorted([FIRST, *of_files(), *of_system(), *ELSEWHERE]) == sorted(COMMANDS)


def test_the_commands_of_the_cheat_sheet_work_as_they_stand(
    tmp_path: Path, variables: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = {each: run(each, capsys) for each in of_files()}
    command = [sys.executable, "-m", "surefoot.lab.cli.main"]
    try:
        begun = run_process([*command, *shlex.split(FIRST)[1:]], cwd=tmp_path, env=variables, capture_output=True)
        assert begun.returncode == 0, begun.stderr
        for each in of_system():
            endless = each in ENDLESS
            wrong[each] = run_for_a_while(each, tmp_path, variables) if endless else run(each, capsys)
    finally:
        end_systems(tmp_path / "state" / "surefoot")
    assert {each: text for each, text in wrong.items() if text} == {}
