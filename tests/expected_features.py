"""Runs the commands of docs/features.md as they stand there, and prints which of them show what they should.

`python -m tests.expected_features [--only TEXT]`: in a new folder, with a system of its own on a free port.
"""

import argparse
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from tests.ports import free_address

PAGE = Path(__file__).parents[1] / "docs" / "features.md"
SYSTEM = "ragno"
LIMIT_S = 300.0
"""Longest time of a command, s wall."""


class Feature(NamedTuple):
    """A row of the page."""

    name: str
    commands: tuple[str, ...]
    shows: str
    """Text in what the commands print or in the names of the files that they write."""
    live: bool
    """A system runs meanwhile."""


def features(page: str) -> Iterator[Feature]:
    """Yield the rows of the page's tables."""
    live = False
    for line in page.splitlines():
        live = line == "## While it runs" if line.startswith("## ") else live
        cells = [cell.strip() for cell in line.strip("|").split(" | ")]
        if line.startswith("| ") and len(cells) == 3 and cells[0] != "feature":
            yield Feature(cells[0], tuple(re.findall(r"`([^`]+)`", cells[1])), cells[2], live)


def run(command: str, folder: Path, environment: Mapping[str, str]) -> subprocess.CompletedProcess[str]:
    """Run a command of the page with this Python."""
    words = shlex.split(command)
    here = {"surefoot": [sys.executable, "-m", "surefoot.lab.cli.main"], "python": [sys.executable]}
    return subprocess.run(
        [*here[words[0]], *words[1:]], cwd=folder, env=environment, capture_output=True, text=True, timeout=LIMIT_S,
        check=False,
    )  # fmt: skip


def shown(feature: Feature, folder: Path, environment: Mapping[str, str]) -> str:
    """Run the commands of a feature; return why it is missing, empty when it is there."""
    printed = ""
    for command in feature.commands:
        try:
            done = run(command, folder, environment)
        except subprocess.TimeoutExpired:
            return f"{command}: no end within {LIMIT_S:g} s"
        printed += done.stdout + done.stderr
        if done.returncode != 0 or "Traceback" in printed:
            return f"{command}: exit code {done.returncode}, {printed.strip()[-160:]!r}"
    names = "\n".join(path.name for path in folder.iterdir())
    return "" if feature.shows in printed or feature.shows in names else f"no {feature.shows!r} in {printed[-160:]!r}"


def main() -> int:
    """Print the table; exit code 1: a feature is missing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="features whose row contains this text")
    only = parser.parse_args().only
    rows = [each for each in features(PAGE.read_text(encoding="utf-8")) if only in " ".join(map(str, each))]
    missing = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        own = {"SUREFOOT_LISTEN": free_address(), "XDG_STATE_HOME": str(folder / "state")}
        own |= {"XDG_CONFIG_HOME": str(folder / "config")}  # certificates
        environment = {key: value for key, value in os.environ.items() if not key.startswith("SUREFOOT_")} | own
        (folder / "work").mkdir()
        up = False
        try:
            run("surefoot run stand --seed 3 --out first", folder / "work", environment)
            for row in rows:
                if row.live and not up:
                    up = run(f"surefoot up {SYSTEM} -d", folder / "work", environment).returncode == 0
                began = time.monotonic()
                why = shown(row, folder / "work", environment)
                missing += bool(why)
                print(f"{'missing' if why else 'works':8} {time.monotonic() - began:5.1f} s  {row.name}", flush=True)
                if why:
                    print(f"         {why}", flush=True)
        finally:
            if up:
                run(f"surefoot down {SYSTEM}", folder / "work", environment)
    print(f"{len(rows) - missing} of {len(rows)} work")
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
