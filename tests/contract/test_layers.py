"""The layers hold, files stay readable, and nothing names a machine or a registry."""

import re
import subprocess
from pathlib import Path

import pytest

from tests.processes import run_process

ROOT = Path(__file__).parents[2]
MAX_LINES = 400
KEEP_TIME = ("recorder", "simulator", "supervisor")
"""Modules that may read the clock: the driver, which paces, those that watch processes or time a run."""
_WORDS = ("py" + r"pi\.org", "python" + "hosted", "npm" + "js", "index" + "-url", "find" + "-links")
HOSTS = re.compile("|".join(_WORDS), re.IGNORECASE)
"""Registries and the options that name one; in pieces, so that this file does not name them either."""


def tracked() -> list[Path]:
    try:
        listing = run_process(["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout")
    return [path for line in listing.splitlines() if not (path := ROOT / line).is_symlink()]


def test_no_long_module() -> None:
    long = {
        str(p.relative_to(ROOT)): n
        for p in tracked()
        if p.suffix == ".py" and (n := len(p.read_text().splitlines())) > MAX_LINES
    }
    assert not long


def test_nothing_names_a_registry_or_a_machine() -> None:
    places = (f"{ROOT}/", f"{Path.home()}/")
    for path in tracked():
        if path.suffix in (".py", ".toml", ".md", ".yaml", ".lock", ".cff", ""):
            text = path.read_text(errors="ignore")
            assert not HOSTS.search(text), path
            assert not any(place in text for place in places), path


def test_function_services_do_not_speak_zenoh_or_read_the_clock() -> None:
    clock = re.compile(
        r"^\s*(import time|from time|import zenoh|from zenoh|import datetime|from datetime)", re.MULTILINE
    )
    for path in (ROOT / "services").rglob("*.py"):
        if path.relative_to(ROOT / "services").parts[0] not in KEEP_TIME:
            assert not clock.search(path.read_text()), path
