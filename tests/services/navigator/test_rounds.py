"""Goals of several places: a heading at each, rounds over them, and progress, in the whole service."""

import math
from typing import Any

import pytest

from surefoot.errors import Refusal
from surefoot.schemas.navigation import CancelRequest, WaypointsRequest
from tests.services.navigator.journeys import Journey, ready
from tests.services.refusals import refused

SQUARE = ((0.5, 0.0), (0.5, 0.4))


def ask(journey: Journey, *places: tuple[float, float], **request: Any) -> None:
    assert journey.service.requests.waypoints(WaypointsRequest(positions=places, **request)).accepted


def near(journey: Journey, x: float, y: float, yaw: float | None = None) -> bool:
    turned = 0.0 if yaw is None else math.remainder(journey.walker.yaw - yaw, math.tau)
    return journey.missed(x, y) < 0.2 and abs(turned) < 0.2


def test_the_robot_turns_to_the_heading_of_each_place(journey: Journey) -> None:
    ask(journey, *SQUARE, yaws=(math.pi / 2, 0.0), yaw_goal_tolerance=0.2)
    seen = False
    while journey.pilot.state in ("idle", "navigating"):
        journey.step()
        seen |= near(journey, 0.5, 0.0, math.pi / 2)
        if journey.pilot.goal is not None and journey.pilot.goal.index > 0:
            assert seen  # before it goes on
    end = journey.until_ended()
    assert (end.state, end.results[-1].missed_waypoints) == ("succeeded", ())
    assert near(journey, 0.5, 0.4, 0.0)


def test_one_place_may_have_several_headings(journey: Journey) -> None:
    ask(journey, (0.5, 0.0), (0.5, 0.0), yaws=(1.0, -1.0))
    left = False
    while journey.pilot.state in ("idle", "navigating"):
        journey.step()
        left |= near(journey, 0.5, 0.0, 1.0)
    assert journey.until_ended().state == "succeeded"
    assert left
    assert near(journey, 0.5, 0.0, -1.0)


def test_a_place_whose_heading_is_not_taken_is_missed() -> None:
    journey = ready(set=("conduct.aligning_turns=0",))
    ask(journey, *SQUARE, yaws=(-2.0, None))
    assert journey.until_ended().results[-1].missed_waypoints == (0,)


def test_rounds_are_walked_as_often_as_asked_with_one_result(journey: Journey) -> None:
    ask(journey, *SQUARE, loops=2)
    seen: list[tuple[int, int]] = []
    while journey.pilot.state in ("idle", "navigating"):
        journey.step()
        progress = journey.feedback().progress
        if progress is not None and (progress.loop, progress.place) not in seen:
            seen.append((progress.loop, progress.place))
    end = journey.until_ended()
    assert seen == [(1, 1), (1, 2), (2, 1), (2, 2)]
    assert [result.state for result in end.results] == ["succeeded"]
    assert (end.results[0].progress.loop, end.results[0].progress.places) == (2, 2)
    assert near(journey, *SQUARE[1])


def test_endless_rounds_end_when_cancelled(journey: Journey) -> None:
    ask(journey, *SQUARE, loops=0)
    while journey.pilot.goal is None or journey.pilot.goal.loop < 4:
        journey.step()
        assert journey.tick < 20_000
    journey.service.requests.cancel(CancelRequest())
    end = journey.until_ended()
    assert (end.error_code, end.progress.loops, end.progress.loop) == ("cancelled", 0, 4)


def test_a_round_in_which_no_place_is_reached_ends_as_stuck() -> None:
    journey = ready(set=("conduct.stuck=10.0",))
    walker, move = journey.walker, journey.walker.tick

    def slip() -> None:
        before = walker.x, walker.y
        move()
        walker.x, walker.y = before

    walker.tick = slip  # type: ignore[method-assign]
    ask(journey, *SQUARE, loops=0)
    assert journey.until_ended().results[-1].error_code == "stuck"


def test_a_killed_navigator_goes_on_in_its_round(tmp_path: Any) -> None:
    memory = str(tmp_path / "navigator.json")
    first = ready(memory=memory)
    ask(first, *SQUARE, loops=2, yaws=(None, 0.5))
    while first.pilot.goal is None or first.pilot.goal.loop < 2:
        first.step()
    first.step(101 - first.tick % 100)
    second = first.restarted(first.tick, memory=memory)
    second.step(2)
    goal = second.pilot.goal
    assert goal is not None
    assert (goal.loop, goal.loops, goal.yaws) == (2, 2, (None, 0.5))
    assert second.until_ended().state == "succeeded"


def test_a_goal_of_one_place_has_no_progress_of_places(journey: Journey) -> None:
    """Messages of such goals are those of earlier versions to the byte, and so are hashes of runs."""
    journey.goto(0.5, 0.0)
    journey.step(100)
    assert journey.feedback().progress is None
    assert "progress" not in journey.feedback().model_dump_json()


@pytest.mark.parametrize(
    ("request_", "field"),
    [
        ({"positions": SQUARE, "yaws": (0.0,)}, "yaws"),
        ({"positions": ((0.5, 0.0),), "loops": 0}, "loops"),
        ({"positions": ((0.5, 0.0), (0.6, 0.0)), "loops": 3}, "loops"),
    ],
    ids=["yaws", "one place", "near places"],
)
def test_headings_and_rounds_that_fit_no_places_are_refused(
    journey: Journey, request_: dict[str, Any], field: str
) -> None:
    with refused(Refusal, "invalid", field):
        journey.service.requests.waypoints(WaypointsRequest(**request_))
