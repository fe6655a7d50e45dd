"""The command line as a user runs it, away from everything else on this machine."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.e2e.live import environment
from tests.ports import free_address
from tests.processes import end_systems, run_process

Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def surefoot(tmp_path: Path) -> Iterator[Run]:
    """`surefoot WORDS`, with an own state folder, port and namespace. What still runs at the end is ended."""
    settings = environment(tmp_path, SUREFOOT_LISTEN=free_address(), SUREFOOT_NAMESPACE="test/cli")

    def run(*words: str, **more: str) -> subprocess.CompletedProcess[str]:
        return run_process(
            [sys.executable, "-m", "surefoot.lab.cli.main", *words],
            cwd=tmp_path, env={**settings, **more}, capture_output=True, text=True,
        )  # fmt: skip

    yield run
    end_systems(tmp_path / "state" / "surefoot")
