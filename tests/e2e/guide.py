"""Folder of a user in which tests execute the commands of the pages as they stand."""

import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from surefoot.lab.robots.export import mjcf_of
from surefoot.robot.reader import load_robot
from tests.e2e.live import ROOT, environment
from tests.ports import free_address
from tests.processes import LIMIT_S, end_process, run_process, start_process

BLOCK = re.compile(r"^```\n(.*?)^```", re.MULTILINE | re.DOTALL)
SHELL = """
set -e
surefoot() { "$PYTHON" -m surefoot.lab.cli.main "$@"; }
surefoot-service() { "$PYTHON" -m surefoot.lockstep.discover "$@"; }
python() { "$PYTHON" "$@"; }
"""
PARTS = {"lf": "FL", "rf": "FR", "lh": "RL", "rh": "RR", "femur": "thigh", "tibia": "calf"}


def renamed(text: str) -> str:
    """Return text with the names of Lupo's legs and links as those of a Go2."""
    return re.sub("|".join(rf"(?<![a-z]){name}(?![a-z])" for name in PARTS), lambda found: PARTS[found[0]], text)


class Guide:
    """A folder with the files of a user, and the commands of the pages."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.address = folder, free_address()
        self.names = renamed(",".join(load_robot("lupo").joint_names)).split(",")
        (folder / "go2.xml").write_text(renamed(mjcf_of(load_robot("lupo"))))
        self.environment = environment(folder, SUREFOOT_LISTEN=self.address, PYTHON=sys.executable)

    def commands(self, page: str, block: int = 0, others: Mapping[str, str] | None = None) -> list[str]:
        """Return the commands of a block of a page, without installing; `others` replaces words."""
        found = BLOCK.findall((ROOT / "docs" / page).read_text(encoding="utf-8"))[block]
        for old, new in {"tcp/127.0.0.1:7447": self.address, **(others or {})}.items():
            found = found.replace(old, new)
        return [line for line in found.splitlines() if not line.startswith(("pip ", "export SUREFOOT_LISTEN"))]

    def run(self, commands: list[str], limit_s: float = LIMIT_S) -> str:
        """Run commands in one shell for `limit_s` at most; return what they print."""
        done = run_process(
            ["bash", "-m", "-c", "\n".join([SHELL, *commands])], cwd=self.folder, env=self.environment,
            capture_output=True, text=True, timeout=limit_s,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    @contextmanager
    def beside(self, *words: str) -> Iterator[None]:
        """Run a program of Python beside the commands."""
        process = start_process(
            [sys.executable, *words], cwd=self.folder, env=self.environment, stdout=subprocess.DEVNULL
        )
        try:
            yield
        finally:
            end_process(process)
