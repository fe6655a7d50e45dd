"""Fixtures of the navigator's tests."""

import pytest

from tests.services.navigator.journeys import Journey, ready


@pytest.fixture
def journey() -> Journey:
    """A journey that has begun."""
    return ready()
