"""A run has the same hash whatever code OpenBLAS and numpy choose for the processor, and on any number of cores."""

import json
import subprocess
from contextlib import ExitStack
from dataclasses import replace

import pytest

from tests.contract.short_walks import WALKS
from tests.processes import LIMIT_S, running
from tests.processors import ROOT, Setting, settings

AT_ONCE = 2


def hashes(chosen: list[Setting]) -> dict[str, dict[str, str]]:
    """Return the hashes of the short walks by setting, each setting in a process of its own, all at once."""
    found: dict[str, dict[str, str]] = {}
    with ExitStack() as stack:
        processes: dict[str, subprocess.Popen[str]] = {}
        for setting in chosen:
            command = setting.command("-m", "tests.contract.short_walks")
            options = {"env": setting.environment(), "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
            processes[setting.name] = stack.enter_context(running(command, cwd=ROOT, text=True, **options))
        for name, process in processes.items():
            out, complaints = process.communicate(timeout=LIMIT_S)
            assert process.returncode == 0, f"{name}: {complaints}"
            found[name] = json.loads(out.splitlines()[-1])
    return found


def assert_one_hash_a_walk(found: dict[str, dict[str, str]]) -> None:
    """Every walk must have one hash under all settings."""
    for name in WALKS:
        by_setting = {setting: of[name] for setting, of in found.items()}
        assert len(set(by_setting.values())) == 1, f"{name}: {by_setting}"
        assert all(len(value) == 64 for value in by_setting.values())


@pytest.mark.timeout(600)
def test_the_hash_is_the_same_with_the_oldest_code_and_that_of_this_processor() -> None:
    by_name = {setting.name: setting for setting in settings()}
    prescott, plain = by_name["prescott"], by_name["no-avx512"]
    oldest = replace(prescott, name="oldest", variables={**prescott.variables, **plain.variables}, one_core=True)
    found = hashes([oldest, by_name["8-threads"]])
    assert_one_hash_a_walk(found)


@pytest.mark.slow
def test_the_hash_is_the_same_under_every_processor_setting() -> None:
    possible = [setting for setting in settings() if not setting.obstacle()]
    found: dict[str, dict[str, str]] = {}
    for first in range(0, len(possible), AT_ONCE):
        found |= hashes(possible[first : first + AT_ONCE])
    assert_one_hash_a_walk(found)
