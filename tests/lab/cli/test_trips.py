"""Values stay near where they come from: bounds on the stops of a trip that may only shrink."""

import pytest

from tests.trips import stops


@pytest.mark.parametrize(("trip", "most"), [("stability/region", 20), ("stability/check", 38)])
def test_few_stops_between_a_request_and_its_reply(trip: str, most: int) -> None:
    assert len(stops(trip)) <= most


@pytest.mark.e2e
@pytest.mark.parametrize(
    ("command", "most", "end"), [("run", 30, "judge.py:judge"), ("up", 17, "session.py:Session.call")]
)
def test_few_stops_from_a_command_to_its_end(command: str, most: int, end: str) -> None:
    found = stops(command)
    assert any(stop.endswith(end) for stop in found)  # it was followed to there
    assert len(found) <= most
