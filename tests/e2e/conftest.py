"""The command line as a user runs it, away from everything else on this machine."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.e2e.live import environment
from tests.ports import free_address

Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def surefoot(tmp_path: Path) -> Run:
    """`surefoot WORDS`, with an own state folder, port and namespace."""
    settings = environment(tmp_path, SUREFOOT_LISTEN=free_address(), SUREFOOT_NAMESPACE="test/cli")

    def run(*words: str, timeout: float = 60.0, **more: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "surefoot.lab.cli.main", *words],
            cwd=tmp_path, env={**settings, **more}, capture_output=True, text=True, timeout=timeout, check=False,
        )  # fmt: skip

    return run
