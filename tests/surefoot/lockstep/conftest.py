"""Fixtures of the tests of lockstep."""

import pytest

from surefoot.lockstep import driver
from tests.surefoot.lockstep.node_bench import Bench


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture
def no_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    """Links are proved as fast as the nodes are pumped, not each 20 ms."""
    monkeypatch.setattr(driver, "PRIME_S", 0.0)
