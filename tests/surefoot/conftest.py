"""Fixtures of the runtime's tests."""

from collections.abc import Iterator

import pytest

from tests.surefoot.net import Net


@pytest.fixture
def net() -> Iterator[Net]:
    made = Net()
    yield made
    made.close()
