"""Settings of all tests."""

import gc
import os
from pathlib import Path

import pytest
from hypothesis import settings

gc.disable()  # nothing that is imported or collected becomes garbage: half of the time that collecting takes

LIMITS_S = {"slow": 1800.0, "e2e": 900.0}
"""Time limits of marked tests, s wall, with their fixtures; `timeout` of pyproject.toml holds for the others."""

# pyzeros compiles what it publishes into this folder, once: 18 s.
os.environ.setdefault("CYDR_CACHE_DIR", str(Path(__file__).parent / "__pycache__" / "cydr"))

# The same examples on every machine; a first call may compile a kernel, so single examples have no time limit.
settings.register_profile("surefoot", derandomize=True, deadline=None)
settings.load_profile("surefoot")


def pytest_collection_finish() -> None:
    """Let garbage be collected from now on, and leave out what every test shares."""
    gc.freeze()
    gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give marked tests their time limit, and run files of live systems first: short files fill the end of a run."""
    live = {item.path for item in items if item.get_closest_marker("e2e")}
    items.sort(key=lambda item: item.path not in live)
    for item in items:
        marked = [seconds for name, seconds in LIMITS_S.items() if item.get_closest_marker(name)]
        if marked and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(max(marked)))
