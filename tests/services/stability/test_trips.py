"""Requests stay near their replies: a bound on the stops between them that may only shrink."""

import pytest

from tests.trips import stops


@pytest.mark.parametrize(("trip", "most"), [("stability/region", 20), ("stability/check", 38)])
def test_few_stops_between_a_request_and_its_reply(trip: str, most: int) -> None:
    assert len(stops(trip)) <= most
