"""Pause and resume of a goal in the whole service: the robot stands, limits stand still, each end is honest."""

from pathlib import Path

import pytest

from surefoot.schemas.navigation import CancelRequest, PauseGoalRequest, ResumeGoalRequest
from tests.services.navigator.journeys import Journey, ready


def pause(journey: Journey, ticks: int = 300) -> None:
    """Pause the goal and let ticks pass."""
    assert journey.service.requests.pause_goal(PauseGoalRequest()).accepted
    journey.step(ticks)


def resume(journey: Journey) -> None:
    assert journey.service.requests.resume_goal(ResumeGoalRequest()).accepted
    journey.step(2)


def test_a_paused_robot_stands_until_the_goal_is_resumed_and_then_arrives(journey: Journey) -> None:
    journey.goto(1.2, 0.3)
    journey.step(300)
    pause(journey)
    w, feedback = journey.walker, journey.feedback()
    place = (w.x, w.y, w.yaw)
    assert (w.state, feedback.state, feedback.progress.paused) == ("standing", "navigating", True)
    journey.step(3000)
    assert (w.x, w.y, w.yaw) == place
    resume(journey)
    end = journey.until_ended()
    assert (end.state, end.progress) == ("succeeded", None)
    assert journey.missed(1.2, 0.3) < 0.2


def test_no_limit_runs_in_a_pause() -> None:
    journey = ready(set=("conduct.stuck=25.0",))
    journey.goto(1.0, 0.0, timeout=50.0)
    journey.step(300)
    pause(journey, 9000)
    resume(journey)
    end = journey.until_ended()
    assert (end.state, end.results[0].missed_waypoints) == ("succeeded", ())
    assert end.results[0].navigation_time > 90.0


def test_the_timeout_counts_on_after_a_pause(journey: Journey) -> None:
    journey.goto(2.5, 0.0, timeout=6.0)
    journey.step(300)
    pause(journey, 1000)
    resume(journey)
    end = journey.until_ended()
    assert end.error_code == "timeout"
    assert 16.0 < end.navigation_time < 19.5


@pytest.mark.parametrize("how", ["cancelled", "replaced", "taken_over", "fallen"])
def test_what_ends_a_goal_ends_a_paused_one(journey: Journey, how: str) -> None:
    journey.goto(2.0, 0.0, goal_id="first")
    journey.step(300)
    pause(journey)
    if how == "cancelled":
        assert journey.service.requests.cancel(CancelRequest()).accepted
    elif how == "replaced":
        journey.goto(0.6, 0.0)
    elif how == "taken_over":
        journey.walker.walk_id += 1  # a stop by another client
    else:
        journey.walker.state = "refused"
    journey.step(30)
    end = journey.feedback()
    assert (end.results[0].goal_id, end.results[0].error_code) == ("first", how)
    assert end.progress is None
    if how == "replaced":
        assert journey.until_ended().state == "succeeded"


def test_an_emergency_stop_in_a_pause_ends_the_goal_when_it_is_resumed(journey: Journey) -> None:
    journey.goto(2.0, 0.0)
    journey.step(300)
    pause(journey)
    journey.walker.refused = "an emergency stop is in force (button) until a new run begins"
    resume(journey)
    assert journey.until_ended().error_code == "stopped"


def test_pause_and_resume_are_refused_where_they_change_nothing(journey: Journey) -> None:
    requests = journey.service.requests
    assert not requests.pause_goal(PauseGoalRequest()).accepted
    journey.goto(1.0, 0.0, goal_id="far")
    journey.step(100)
    assert not requests.resume_goal(ResumeGoalRequest()).accepted
    assert "'far', not 'near'" in requests.pause_goal(PauseGoalRequest(goal_id="near")).reason
    pause(journey, 2)
    assert not requests.pause_goal(PauseGoalRequest()).accepted


@pytest.mark.parametrize("sent", [True, False], ids=["order sent", "order lost"])
def test_a_killed_navigator_stays_paused(tmp_path: Path, sent: bool) -> None:
    memory = str(tmp_path / "navigator.json")
    first = ready(memory=memory)
    first.goto(1.0, 0.0)
    first.step(300)
    pause(first, 200 if sent else 1)
    second = first.restarted(first.tick - (not sent), memory=memory)
    second.step(1000)
    x, feedback = second.walker.x, second.feedback()
    assert (second.walker.state, feedback.state, feedback.progress.paused) == ("standing", "navigating", True)
    assert x < 0.5
    resume(second)
    assert second.until_ended().state == "succeeded"
